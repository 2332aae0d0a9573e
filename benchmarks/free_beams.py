"""Beams, looks and camera rays drawn freely, each with its exact radiance: the input that nobody chose.

Widths, ramps of every kind, tables, radii that open up to a thousand times, any scale and place, any camera. A ray is
wrong if it errs by more than a bound of its own light, or of a thousandth of that of the brightest ray of its beam, and
by more than ten times what half an ulp of its inputs changes: such rays float32 cannot tell.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

import photonbeams as pb
from photonbeams.looks.ramp import interpolate

from .exact import Array, Cone, Factors, radiance

RAYS = 12  # of each beam
RAMPS = ("linear", "none", "smooth", "catmull-rom", "monotone")
PROFILES = ("uniform", "epanechnikov", "biweight", "gaussian", "smoothstep", "hollow", "table", "colored")
FALLOFFS = (
    "physical", *RAMPS, "distances", "eye", "exponential", "power", "fade",
)  # fmt: skip
SHAPES = ("cylinder", "cone", "opening", "needle", "point")
VIEWS = ("inside", "beside", "along", "tip")
KINDS = {"profile": PROFILES, "falloff": FALLOFFS, "shape": SHAPES, "view": VIEWS}

_DIM = 1e-3
_ROUNDINGS = 10.0
_SHIFTS = 6


@dataclass(frozen=True)
class Draw:
    """One beam with its look and its rays; `kinds` names what was drawn for profile, falloff, shape and views."""

    kinds: dict[str, Any]
    cone: Cone
    offset: float  # of the beam's start from the light
    look: pb.Look
    medium: pb.Medium
    factors: Factors
    origin: Array  # (RAYS, 3)
    direction: Array  # (RAYS, 3)

    @property
    def beams(self) -> pb.Beams:
        """The beam as the estimators take it."""
        cone = self.cone
        return pb.Beams(
            [cone.start], [cone.end], [cone.radius_start], [cone.radius_end], power=[[1.0, 1.0, 1.0]],
            offset=[self.offset],
        )  # fmt: skip

    def estimate(self, estimator: str, rule: pb.Rule) -> Array:
        """Return the radiance (RAYS, 3) by one of the estimators."""
        value = pb.estimate(
            self.beams, self.origin, self.direction, look=self.look, medium=self.medium, estimator=estimator, rule=rule
        )
        return np.asarray(value, dtype=np.float64)

    @cached_property
    def exact(self) -> Array:
        """The exact radiance (RAYS, 3)."""
        rays = zip(self.origin, self.direction, strict=True)
        return np.array([radiance(self.cone, self.factors, *ray) for ray in rays])

    @property
    def lit(self) -> Array:
        """Which rays meet the beam."""
        return self.exact.max(axis=1) > 0

    def errors(self, found: Array) -> Array:
        """Return the error of each ray's worst channel, relative to its light or to a thousandth of the brightest."""
        peak = self.exact.max(axis=1)
        return np.abs(found - self.exact).max(axis=1) / np.maximum(peak, max(_DIM * peak.max(), 1e-300))

    def wrong(self, found: Array, bound: float) -> Array:
        """Return which lit rays err by more than `bound`, and by more than their inputs' rounding explains."""
        result = self.lit & (self.errors(found) > bound)
        peak = self.exact.max(axis=1)
        for index in np.flatnonzero(result):
            scale = max(peak[index], _DIM * peak.max())
            error = np.abs(found[index] - self.exact[index]).max() / scale
            result[index] = error > _ROUNDINGS * self._doubt(index) / scale
        return result

    def _doubt(self, index: int) -> float:
        """Return how much a ray's radiance changes if its inputs change by half an ulp."""
        rng = np.random.default_rng(index)

        def moved(values: Any) -> Array:
            given = np.asarray(values, np.float32)
            ulps = np.spacing(np.maximum(np.abs(given), np.abs(given).max() if given.ndim else 0)).astype(np.float64)
            return given.astype(np.float64) + rng.choice([-0.5, 0.5], given.shape) * ulps

        changes = []
        for _ in range(_SHIFTS):
            cone = replace(
                self.cone, start=moved(self.cone.start), end=moved(self.cone.end),
                radius_start=float(moved(self.cone.radius_start)), radius_end=float(moved(self.cone.radius_end)),
            )  # fmt: skip
            found = radiance(cone, self.factors, moved(self.origin[index]), moved(self.direction[index]))
            changes.append(np.abs(found - self.exact[index]).max())
        return float(max(changes))


def draw(seed: int, **kinds: str) -> Draw:
    """Return a random beam with its look and rays; the same seed gives the same.

    `kinds` may name its "profile", "falloff", "shape" or "view", which are random otherwise.
    """
    rng = np.random.default_rng(seed)
    of = {name: str(rng.choice(each)) for name, each in KINDS.items()} | kinds
    scale = 10 ** rng.uniform(-4, 4)
    length = scale * 10 ** rng.uniform(-1, 1)
    axis = _unit(rng.normal(size=3))
    start = _single(rng.normal(size=3) * scale * rng.choice([0, 1, 10]))
    wide = length * 10 ** rng.uniform(-4, -0.5)
    narrow = wide * {
        "cylinder": 1.0, "cone": rng.uniform(0.2, 1), "opening": 10 ** -rng.uniform(0.5, 3), "needle": 1e-4, "point": 0,
    }[of["shape"]]  # fmt: skip
    radii = [wide, narrow] if rng.random() < 0.5 else [narrow, wide]
    cone = Cone(start, _single(start + axis * length), *(float(np.float32(each)) for each in radii))
    thickness = 10 ** rng.uniform(-2, 1.5) / length
    medium = pb.Medium(tuple(thickness * rng.uniform(0.5, 1, 3)))
    offset = float(np.float32(length * rng.choice([0, 0, rng.uniform(0, 2)])))
    across, density, rings = _across(rng, of["profile"])
    falloff = str(rng.choice(RAMPS)) if of["falloff"] in ("distances", "eye") else of["falloff"]
    along, fading, knots = _along(rng, falloff, cone, offset, medium, by_distance=of["falloff"] == "distances")
    eye, dimming, eye_knots = _eye(rng, medium, length * 10 ** rng.uniform(-1, 1) if of["falloff"] == "eye" else None)
    views = [kinds.get("view") or str(each) for each in rng.choice(VIEWS, RAYS)]
    origin, direction = _rays(rng, views, cone, axis)
    factors = Factors(density, fading, dimming, rings, knots, eye_knots)
    look = pb.Look(along=along, across=across, eye=eye, angle=1.0)
    return Draw({**of, "view": views}, cone, offset, look, medium, factors, origin, direction)


def _unit(vector: Array) -> Array:
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


def _single(values: Any) -> Array:
    return np.asarray(values, np.float32).astype(np.float64)


def _across(rng: np.random.Generator, kind: str) -> tuple[Any, Callable[[Array], Array], list[float]]:
    """Return a profile, its normalised density, and its rings."""
    corners: list[float] = []
    if kind == "gaussian":
        width = float(10 ** rng.uniform(np.log10(0.03), np.log10(0.8)))
        profile: Any = pb.looks.Gaussian(width)
        shape = lambda rho: np.exp(-0.5 * (rho / width) ** 2) - np.exp(-0.5 / width**2)  # noqa: E731
        corners = [each for each in width * np.arange(1, 9) if each < 1]
    elif kind == "smoothstep":
        hardness = float(rng.uniform(0, 0.95))
        profile = pb.looks.Smoothstep(hardness)
        shape = lambda rho: _eased(1 - np.clip((rho - hardness) / (1 - hardness), 0, 1))  # noqa: E731
        corners = [hardness]
    elif kind == "hollow":
        inner, softness = float(rng.uniform(0, 0.95)), float(rng.uniform(0.05, 1))
        profile = pb.looks.Hollow(inner, softness)

        def shape(rho: Array) -> Array:
            t = np.clip((rho - inner) / (1 - inner), 0, 1)
            return _eased(np.clip(np.minimum(t, 1 - t) / (0.5 * softness), 0, 1))

        edge = 0.5 * softness * (1 - inner)
        corners = [inner, inner + edge, 1 - edge]
    elif kind == "table":
        values = rng.uniform(0.01, 1, int(rng.integers(2, 12)))
        profile = pb.looks.Tabulated(values.tolist())
        shape = lambda rho: np.interp(rho, np.linspace(0, 1, len(values)), values)  # noqa: E731
        corners = np.linspace(0, 1, len(values))[:-1].tolist()
    elif kind == "colored":
        return _colored(rng)
    else:
        power = PROFILES.index(kind)
        profile = (pb.looks.Uniform, pb.looks.Epanechnikov, pb.looks.Biweight)[power]()
        shape = lambda rho: (1 - rho * rho) ** power  # noqa: E731
    edges = np.unique(np.concatenate([np.linspace(0, 1, 65), corners]))
    x, weights = np.polynomial.legendre.leggauss(16)
    half, middle = np.diff(edges)[:, None] / 2, (edges[1:] + edges[:-1])[:, None] / 2
    rho = middle + half * x
    total = float(np.sum(shape(rho) * 2 * np.pi * rho * weights * half))
    return profile, lambda rho: (shape(rho) / total)[:, None], corners


def _colored(rng: np.random.Generator) -> tuple[Any, Callable[[Array], Array], list[float]]:
    """Return a profile whose colour changes with the radius, its density, and its rings."""
    kind, places, colors = _ramp(rng)
    profile = pb.looks.Biweight() * pb.looks.ColorRamp(places, colors, kind, space="radius")

    def density(rho: Array) -> Array:
        return np.maximum(interpolate(places, colors, kind, rho), 0) * (3 / np.pi * (1 - rho * rho) ** 2)[:, None]

    return profile, density, places.tolist()


def _ramp(rng: np.random.Generator, kind: str | None = None) -> tuple[Any, Array, Array]:
    """Return a kind of interpolation, knots, and colours."""
    count = int(rng.integers(2, 13))
    places = np.linspace(0, 1, count)
    places[1:-1] += rng.uniform(-0.4, 0.4, count - 2) / (count - 1)
    return kind or str(rng.choice(RAMPS)), places, rng.uniform(0.02, 1, (count, 3))


def _eye(
    rng: np.random.Generator, medium: pb.Medium, reach: float | None
) -> tuple[Any, Callable[[Array], Array], list[float]]:
    """Return the factor toward the camera, its values at t, and its knots; with `reach`, a ramp over that distance."""
    extinction = np.array(medium.extinction)
    if reach is None:
        return pb.looks.Attenuation(), lambda t: np.exp(-extinction * t[:, None]), []
    kind, places, colors = _ramp(rng)
    factor = pb.looks.ColorRamp(places, colors, kind, 0, reach, "distance") * pb.looks.Attenuation()

    def values(t: Array) -> Array:
        return np.maximum(interpolate(places, colors, kind, t / reach), 0) * np.exp(-extinction * t[:, None])

    return factor, values, (places * reach).tolist()


def _eased(t: Array) -> Array:
    return t * t * (3 - 2 * t)


def _along(
    rng: np.random.Generator, kind: str, cone: Cone, offset: float, medium: pb.Medium, by_distance: bool
) -> tuple[Any, Callable[[Array], Array], list[float]]:
    """Return a falloff, its values at s / length, and its knots there."""
    length = float(cone.length)
    total, extinction = offset + length, np.array(medium.extinction)

    def physical(u: Array) -> Array:
        return np.exp(-extinction * (offset + u * length)[:, None])

    if kind == "physical":
        return pb.looks.Attenuation(), physical, []
    if kind == "exponential":
        reach = length * 10 ** rng.uniform(-1.5, 1)
        values = lambda u: np.exp(-(offset + u * length) / reach)[:, None] * np.ones(3)  # noqa: E731
        return pb.looks.Exponential(reach), values, []
    if kind == "power":
        reach, exponent = length * 10 ** rng.uniform(-2, 0), float(rng.uniform(0.5, 3))
        values = lambda u: ((1 + (offset + u * length) / reach) ** -exponent)[:, None] * np.ones(3)  # noqa: E731
        return pb.looks.Power(exponent, reach), values, []
    if kind == "fade":
        inner, outer = np.sort(rng.uniform(0, total, 2))
        fade = lambda u: 1 - _eased(np.clip((offset + u * length - inner) / (outer - inner), 0, 1))  # noqa: E731
        knots = [(each - offset) / length for each in (inner, outer)]
        return pb.looks.Fade(inner, outer) * pb.looks.Attenuation(), lambda u: fade(u)[:, None] * physical(u), knots
    _, places, colors = _ramp(rng, kind)
    ends = {"begin": 0.0, "end": total, "space": "distance"} if by_distance else {}
    ramp = pb.looks.ColorRamp(places, colors, kind, **ends)

    def ramped(u: Array) -> Array:
        fraction = np.clip((offset + u * length) / total, 0, 1)
        return np.maximum(interpolate(places, colors, kind, fraction), 0) * physical(u)

    return ramp * pb.looks.Attenuation(), ramped, [(each * total - offset) / length for each in places]


def _rays(rng: np.random.Generator, views: list[str], cone: Cone, axis: Array) -> tuple[Array, Array]:
    """Return origins and directions of rays that look at a beam in these ways."""
    length = float(cone.length)
    side = _unit(np.cross(axis, rng.normal(size=(RAYS, 3))))

    def radius(u: Array) -> Array:
        return np.asarray(cone.radius_start + (cone.radius_end - cone.radius_start) * u)

    narrow_end = 0.0 if cone.radius_start < cone.radius_end else 1.0
    origin, direction = np.zeros((RAYS, 3)), np.zeros((RAYS, 3))
    for index, view in enumerate(views):
        u = rng.uniform(0, 1)
        if view == "tip":
            u = abs(narrow_end - 10 ** rng.uniform(-4, -0.5))
        target = cone.start + axis * length * u + side[index] * radius(u) * np.sqrt(rng.uniform(0, 0.95))
        if view == "along":
            spread = max(cone.radius_start, cone.radius_end) / length
            way = _unit(axis + side[(index + 1) % RAYS] * spread * rng.uniform(0, 3)) * rng.choice([-1, 1])
        else:
            way = _unit(rng.normal(size=3))
        back = 0.0 if view == "inside" else length * 10 ** rng.uniform(-1, 1)
        origin[index], direction[index] = target - way * back, way
    return _single(origin), _single(direction)
