"""How many points the chord integral takes: error against n, for Gauss and Riemann rules and all built-in factors.

The integral is the renderer's for a ray whose camera is inside the beam (estimators/frustum.py; Talk, section 3),

    ∫_0^b across(r/R) / R² · along(s) · eye(t) dt,

split at the same corners, so n is the number of points on each smooth piece. It is evaluated in float64, so that the
quadrature's own error is visible: chords and profiles with NumPy, falloffs with the code from which kernels are made.
Some falloffs read tables with linear interpolation; such a table is then the function that is integrated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
import numpy.typing as npt

from ..looks import (
    Across,
    Attenuation,
    Biweight,
    ColorRamp,
    Epanechnikov,
    Exponential,
    Factor,
    Fog,
    Gaussian,
    Polynomial,
    Power,
    ShadingContext,
    Smoothstep,
    Tabulated,
    Texture,
    Uniform,
)
from ..quadrature import MOST_POINTS, Rule, gauss_legendre, riemann
from ..runtime import device
from ..scene import Medium

Array = npt.NDArray[np.float64]
Case = tuple[str, Across, Factor]

#: "A good estimate" (Talk, section 3) is taken as an error of 1 % on every ray.
ACCURACY = 0.01
#: The points that Tangled needed.
GAUSS_POINTS = 6

# A shaft that opens to three times its width, in a fog that takes 60 % (red) to 92 % (blue) of it over its length.
_LENGTH = 4.0
_RADIUS = 0.3  # where it begins
_SLOPE = 0.15
_MEDIUM = Medium(scattering=(0.2, 0.35, 0.6), absorption=(0.03, 0.03, 0.03))

_BLOCK = 64  # rays at a time, so that memory does not grow with the number of rays
_CONVERGED = gauss_legendre(16)  # accurate to 1e-9 or better on smooth pieces
_PANELS = 64  # fine enough for the thousand small corners of a table
# Numbers of Riemann points that are tried: all of the small ones, then in steps of 6 %.
_RIEMANN_COUNTS = sorted({*range(1, 33), *np.geomspace(33, MOST_POINTS, 36).astype(int).tolist()})


@dataclass(frozen=True)
class Chords:
    """Camera rays from inside the beam, (N, 3) each, in float64; the beam's axis is +z from the origin."""

    origin: Array
    direction: Array

    @classmethod
    def random(cls, count: int, seed: int) -> Chords:
        """Return rays from points uniform over length and cross-section, in directions uniform over the sphere."""
        rng = np.random.default_rng(seed)
        s, square, turn, z, heading = rng.random((5, count)) * [[_LENGTH], [1], [2 * np.pi], [2], [2 * np.pi]]
        r, z = np.sqrt(square) * (_RADIUS + _SLOPE * s), z - 1
        flat = np.sqrt(1 - z * z)
        origin = np.stack([r * np.cos(turn), r * np.sin(turn), s], axis=1)
        return cls(origin, np.stack([flat * np.cos(heading), flat * np.sin(heading), z], axis=1))

    def blocks(self) -> Iterator[Chords]:
        """Return the rays in blocks."""
        for i in range(0, len(self.origin), _BLOCK):
            yield Chords(self.origin[i : i + _BLOCK], self.direction[i : i + _BLOCK])

    def s(self, t: Array | float) -> Array:
        """Return the distance along the axis at t."""
        return self.origin[:, 2] + self.direction[:, 2] * t

    def radius(self, t: Array | float) -> Array:
        """Return the beam's radius at t."""
        return _RADIUS + _SLOPE * self.s(t)

    def from_axis(self, t: Array) -> Array:
        """Return the distance from the axis at t."""
        x, y = (self.origin[:, i] + self.direction[:, i] * t for i in (0, 1))
        return np.hypot(x, y)

    def rings(self, rho: float) -> tuple[Array, Array]:
        """Return the two t at which the ray crosses the cone r = ρ R; NaN where it does not cross it."""
        o, d, taper = self.origin[:, :2], self.direction[:, :2], rho * _SLOPE * self.direction[:, 2]
        radius = rho * self.radius(0.0)
        A, B, C = (d * d).sum(1) - taper**2, (o * d).sum(1) - taper * radius, (o * o).sum(1) - radius**2
        with np.errstate(invalid="ignore", divide="ignore"):
            root = np.sqrt(B * B - A * C) if rho > 0 else np.zeros_like(A)
            return (-B - root) / A, (-B + root) / A

    def planes(self, s: float) -> Array:
        """Return the t at which the ray is at s."""
        with np.errstate(divide="ignore"):
            return (s - self.origin[:, 2]) / self.direction[:, 2]

    def exit(self) -> Array:
        """Return where the ray leaves the beam: the first crossing ahead, through the wall or an end."""
        crossings = np.stack([*self.rings(1.0), self.planes(0.0), self.planes(_LENGTH)])
        return np.where(crossings > 0, crossings, np.inf).min(axis=0)

    def edges(self, across: Across, along: Factor) -> Array:
        """Return the bounds of the smooth pieces, (pieces + 1, N) ascending; pieces may be empty."""
        breaks = [t for rho in across.rings for t in (self.rings(rho)[:1] if rho == 0 else self.rings(rho))]
        breaks += [self.planes(s) for space, s in along.corners if space == "distance"]
        breaks += [self.planes(fraction * _LENGTH) for space, fraction in along.corners if space == "fraction"]
        end = self.exit()
        inside = [np.clip(np.nan_to_num(t), 0, end) for t in breaks]
        return np.sort(np.stack([np.zeros_like(end), *inside, end]), axis=0)


@dataclass(frozen=True)
class Curve:
    """Relative error against n for one profile or falloff: median and worst over the rays, by the number of points.

    The error of a ray is that of its worst channel, relative to its brightest. `pieces` is the mean number of smooth
    pieces of a chord.
    """

    name: str
    pieces: float
    gauss: dict[int, tuple[float, float]]
    riemann: dict[int, tuple[float, float]]

    def gauss_needed(self) -> int | None:
        """Return how many Gauss points bring every ray to 1 %."""
        return _needed(self.gauss, ACCURACY)

    def riemann_needed(self) -> int | None:
        """Return how many Riemann points bring every ray to 1 %."""
        return _needed(self.riemann, ACCURACY)

    def riemann_equal(self) -> int | None:
        """Return how many Riemann points have a worst error no larger than that of six Gauss points."""
        return _needed(self.riemann, self.gauss[GAUSS_POINTS][1])


def _needed(errors: dict[int, tuple[float, float]], limit: float) -> int | None:
    """Return the smallest n from which on no worst error exceeds the `limit`; None if there is none."""
    above = [n for n, (_, worst) in errors.items() if worst > limit]
    return min((n for n in errors if n > max(above, default=0)), default=None)


def profiles() -> list[Case]:
    """Return the built-in profiles, each along a beam that fades physically."""
    shapes: dict[str, Across] = {
        "Uniform": Uniform(),
        "Epanechnikov": Epanechnikov(),
        "Biweight": Biweight(),
        "Gaussian 0.35": Gaussian(),
        **{f"Smoothstep {hardness:g}": Smoothstep(hardness) for hardness in (0.0, 0.5, 0.9, 1.0)},
        "Tabulated cone": Tabulated([1.0, 0.0]),
    }
    return [(name, shape, Attenuation()) for name, shape in shapes.items()]


def falloffs() -> list[Case]:
    """Return the built-in falloffs along a beam of the default profile, products included."""
    knots = [0.0, 0.2, 0.45, 0.7, 1.0]
    colors = [[1.0, 0.95, 0.8], [1.0, 0.75, 0.35], [0.9, 0.4, 0.15], [0.5, 0.15, 0.2], [0.15, 0.08, 0.2]]
    x = np.linspace(0, 1, 64)[:, None]
    # A painted gradient: two waves of another tint on an orange that darkens.
    texture = Texture((1 - 0.7 * x) * [1.0, 0.7, 0.4] * (1 + 0.25 * np.sin(4 * np.pi * x + [0.0, 1.0, 2.0])))
    along: dict[str, Factor] = {
        "Attenuation": Attenuation(),
        "Exponential": Exponential(1.0),
        "Power": Power(2.0, 0.5),
        "Polynomial": Polynomial([1.0, 0.0, -0.95]),
        **{f"Ramp {kind}": ColorRamp(knots, colors, kind)
           for kind in ("none", "linear", "smooth", "catmull-rom", "monotone")},
        "Texture": texture,
        "Ramp × physical": ColorRamp(knots, colors) * Attenuation(),
        "Texture × physical": texture * Attenuation(),
    }  # fmt: skip
    return [(name, Epanechnikov(), factor) for name, factor in along.items()]


def curves(
    cases: list[Case], rays: int, max_order: int, seed: int, done: Callable[[], object] = lambda: None
) -> list[Curve]:
    """Return each case's errors for n Gauss points up to `max_order` (at least six), and for Riemann points.

    `done` is called after each case.
    """
    chords = Chords.random(rays, seed)
    result = []
    for case in cases:
        result.append(_curve(case, chords, range(1, max(max_order, GAUSS_POINTS) + 1)))
        done()
    return result


def _curve(case: Case, chords: Chords, orders: range) -> Curve:
    name, across, along = case
    counts = sorted({*_RIEMANN_COUNTS, *orders})
    rules = [*map(gauss_legendre, orders), *map(riemann, counts)]
    blocks, pieces = [], []
    for block in chords.blocks():
        truth, *found = chord_integrals(block, across, along, [(_CONVERGED, _PANELS), *((rule, 1) for rule in rules)])
        off = np.stack([np.abs(each - truth).max(axis=0) for each in found])
        blocks.append(off / truth.max(axis=0))
        edges = block.edges(across, along)
        pieces.append((np.diff(edges, axis=0) > 0).sum(axis=0))
    errors = np.concatenate(blocks, axis=1)  # (rules, rays)
    pairs = list(zip(np.median(errors, axis=1).tolist(), errors.max(axis=1).tolist(), strict=True))
    gauss, rest = pairs[: len(orders)], pairs[len(orders) :]
    mean = float(np.concatenate(pieces).mean())
    return Curve(name, mean, dict(zip(orders, gauss, strict=True)), dict(zip(counts, rest, strict=True)))


def chord_integrals(chords: Chords, across: Across, along: Factor, rules: Sequence[tuple[Rule, int]]) -> list[Array]:
    """Return the chord integrals, (3, N), by each rule, on its number of equal panels of each smooth piece.

    This is `rule.integrate` (Talk, eq. 2) with the points of all rules in one array: one kernel, launched once.
    """
    edges = chords.edges(across, along)
    placed = [_placed(edges, rule, panels) for rule, panels in rules]
    along_axis = _values(along, np.concatenate([chords.s(t).ravel() for t, _ in placed]))
    result, first = [], 0
    for (rule, _), (t, half) in zip(rules, placed, strict=True):
        values = along_axis[:, first : first + t.size].reshape(3, *t.shape)
        first += t.size
        # axes: 3 | n, pieces, N
        integrand = _rest(chords, across, t) * values
        result.append(np.einsum("cjpi,j,pi->ci", integrand, rule.weights, half))
    return result


def _placed(edges: Array, rule: Rule, panels: int) -> tuple[Array, Array]:
    """Return the points of a rule on the pieces between edges, (n, pieces, N), and half of the pieces' lengths."""
    if panels > 1:
        steps = np.arange(panels)[:, None] / panels
        fine = edges[:-1, None] + steps * np.diff(edges, axis=0)[:, None]  # (pieces, panels, N)
        edges = np.concatenate([fine.reshape(-1, edges.shape[1]), edges[-1:]])
    half, middle = np.diff(edges, axis=0) / 2, (edges[1:] + edges[:-1]) / 2
    return middle + half * rule.points[:, None, None], half


def _rest(chords: Chords, across: Across, t: Array) -> Array:
    """Return k2 · eye, (3, *t.shape)."""
    radius = chords.radius(t)
    disc = across.scale * across.shape(np.minimum(chords.from_axis(t) / radius, 1)) / radius**2
    eye: Array = np.exp(-np.multiply.outer(_MEDIUM.extinction, t))
    return disc * eye


def _values(along: Factor, s: Array) -> Array:
    """Return a falloff's values, (3, N) float64, from the code from which kernels are made."""
    float64 = import_module(f"drjit.{device.backend()}.ad").Float64
    distance: Any = float64(s)
    at = ShadingContext(distance=distance, depth=distance, fraction=distance * (1 / _LENGTH), fog=Fog(_MEDIUM))
    values = np.asarray(along.evaluate(at), dtype=np.float64)
    return np.broadcast_to(values, (3, s.size))
