"""How many points the light along a ray takes: error against n, for Gauss and Riemann rules and all built-in factors.

Camera rays begin inside a beam, and the renderer's own integral (estimators/frustum.py; Talk, section 3) has n points
on each smooth piece of a ray. Errors are those against many points. They end at the rounding of single precision.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import drjit as dr
import numpy as np

from ..beams import Beams
from ..constants import MOST_POINTS
from ..estimators.estimate import ENDLESS, bind, sum_over_all
from ..estimators.geometry import Rays
from ..estimators.points import Points
from ..estimators.records import pack
from ..looks import (
    Across,
    Attenuation,
    Biweight,
    ColorRamp,
    Epanechnikov,
    Exponential,
    Factor,
    Gaussian,
    Look,
    Polynomial,
    Power,
    Smoothstep,
    Tabulated,
    Texture,
    Uniform,
)
from ..numerics.arrays import to_numpy, to_vectors
from ..quadrature import Rule, gauss_legendre, riemann
from ..runtime.device import Array3f, Float
from ..scene import Array, Medium

Case = tuple[str, Across, Factor]

#: "A good estimate" (Talk, section 3) is taken as an error of 1 % on every ray.
ACCURACY = 0.01
#: The points that Tangled needed.
GAUSS_POINTS = 6

# A shaft that opens to three times its width, in a fog that takes 60 % (red) to 92 % (blue) of it over its length.
_LENGTH = 4.0
_RADII = 0.3, 0.9
_MEDIUM = Medium(scattering=(0.2, 0.35, 0.6), absorption=(0.03, 0.03, 0.03))

_CONVERGED = gauss_legendre(64)
# An error counts relative to the ray's light, but at least to this fraction of the brightest ray's.
_DIM = 1e-3
# Numbers of Riemann points that are tried: all of the small ones, then in steps of 6 %.
_RIEMANN_COUNTS = sorted({*range(1, 33), *np.geomspace(33, MOST_POINTS, 36).astype(int).tolist()})


def _rays_inside(count: int, seed: int) -> Rays:
    """Return rays from points uniform over length and cross-section, in directions uniform over the sphere."""
    rng = np.random.default_rng(seed)
    s, square, turn, z, heading = rng.random((5, count)) * [[_LENGTH], [1], [2 * np.pi], [2], [2 * np.pi]]
    r, z = np.sqrt(square) * np.interp(s, (0, _LENGTH), _RADII), z - 1
    flat = np.sqrt(1 - z * z)
    origin = np.stack([r * np.cos(turn), r * np.sin(turn), s], axis=1)
    direction = np.stack([flat * np.cos(heading), flat * np.sin(heading), z], axis=1)
    ends = dr.full(Float, ENDLESS, count), dr.zeros(Float, count)
    return Rays(to_vectors(origin), to_vectors(direction), *ends)


@dataclass(frozen=True)
class Curve:
    """Relative error against n for one profile or falloff: median and worst over the rays, by the number of points.

    The error of a ray is that of its worst channel, relative to its brightest.
    """

    name: str
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
    inside = _rays_inside(rays, seed)
    orders = range(1, max(max_order, GAUSS_POINTS) + 1)
    result = []
    for name, across, along in cases:
        error = _errors(Look(along=along, across=across, angle=1.0), inside)
        gauss = {n: error(gauss_legendre(n)) for n in orders}
        result.append(Curve(name, gauss, {n: error(riemann(n)) for n in sorted({*_RIEMANN_COUNTS, *orders})}))
        done()
    return result


def _errors(look: Look, rays: Rays) -> Callable[[Rule], tuple[float, float]]:
    """Return a function that returns the median and the worst error of a rule over rays."""
    beam = Beams([[0, 0, 0]], [[0, 0, _LENGTH]], *_RADII, power=[[1, 1, 1]])
    bound, packed = bind(look, beam, None, _MEDIUM), pack(beam, Array3f(0), shared=False)

    def light(rule: Rule) -> Array:
        return to_numpy(sum_over_all(packed, rays, bound, "frustum", Points(rule))).astype(np.float64)

    exact = light(_CONVERGED)
    brightest = exact.max(axis=0)
    scale = np.maximum(brightest, _DIM * brightest.max())

    def error(rule: Rule) -> tuple[float, float]:
        off = np.abs(light(rule) - exact).max(axis=0) / scale
        return float(np.median(off)), float(off.max())

    return error
