"""The inspector: how much the beams of each light add to a pixel, and how the light of the brightest is integrated.

The integrand is measured with the renderer's own frustum estimator, as the difference that a slightly longer ray makes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from ..estimators.estimate import estimate
from ..estimators.geometry import chord
from ..estimators.records import load, pack
from ..numerics.arrays import channel_mean
from ..quadrature import gauss_legendre, riemann
from ..runtime.device import Array3f, Float, UInt32
from ..scene import Array
from .protocol import BeamPart, RayIntegral, RuleCurves

if TYPE_CHECKING:
    from ..beams.sets import BeamSet
    from .live import LiveFrame

# Samples of the integrand's curve, the rule that serves as exact, and the numbers of points that are compared.
_CURVE, _EXACT, _ORDERS = 96, gauss_legendre(32), range(1, 7)
_LIGHTS = 12  # the most that are listed, the brightest first


Inspected = tuple[list[BeamPart], RayIntegral | None]


@dataclass(frozen=True)
class _Ray:
    """A camera ray that ends at the first surface: origin and direction, (3,), and its length."""

    origin: Array
    direction: Array
    length: float


def inspected(frame: LiveFrame, at: tuple[float, float], depth: float | None) -> Inspected:
    """Return the beams of a pixel's ray by light, the brightest first, and the integrand of the brightest beam.

    The frame's first pass is done; `at` and `depth` are as for `Session.inspect`, and the depth may be infinite.
    """
    light, ray = frame.first_light(), _ray(frame, at, depth)
    if light is None or not light.sets:
        return [], None
    media = frame.described_media()
    groups: dict[str, str] = {}
    found: dict[str, Array] = {}
    brightest: tuple[float, BeamSet | None] = 0.0, None
    for each in light.sets:
        radiance = _radiance(each, ray, media)
        groups.setdefault(each.name, each.group)
        found[each.name] = found.get(each.name, 0.0) + radiance
        if radiance.mean() > brightest[0]:
            brightest = float(radiance.mean()), each
    whole = max(sum(each.mean() for each in found.values()), 1e-30)
    beams = [
        BeamPart(name, groups[name], tuple(radiance.tolist()), float(radiance.mean() / whole))
        for name, radiance in sorted(found.items(), key=lambda item: -item[1].mean())[:_LIGHTS]
    ]
    drawn = None if brightest[1] is None else _integrated(brightest[1], ray, media)
    return [each for each in beams if each.fraction > 0], drawn


def _ray(frame: LiveFrame, at: tuple[float, float], depth: float | None) -> _Ray:
    start, way, facing = (np.ravel(each.numpy()).astype(np.float64)[:3] for each in frame.view.ray(at)[:3])
    known = depth is not None and np.isfinite(depth) and 0 < depth < 1e30
    return _Ray(start, way, float(depth) / max(float(facing[0]), 1e-6) if known else 1e9)  # type: ignore[arg-type]


def _radiance(each: BeamSet, ray: _Ray, media: dict[int, Any], **given: Any) -> Array:
    """Return the radiance of a set's beams along a ray, (3,), or along parts of it up to each `t_max`, (N, 3)."""
    count = len(given.get("t_max", [0]))
    given = {"t_max": np.full(1, ray.length), **given}
    found = estimate(
        each.beams, np.tile(ray.origin, (count, 1)), np.tile(ray.direction, (count, 1)), look=each.look,
        medium=media.get(each.medium), **given,
    ).numpy()  # fmt: skip
    return found[0] if count == 1 else found


def _integrated(each: BeamSet, ray: _Ray, media: dict[int, Any]) -> RayIntegral | None:
    """Return how the light of a set's brightest beam is integrated along a ray; None if the ray meets no beam."""
    found = _brightest(each, ray)
    if found is None:
        return None
    number, (low, high) = found
    single = each._replace(beams=each.beams[number : number + 1])
    beam = single.beams
    radii = float(beam.radius_start.numpy()[0]), float(beam.radius_end.numpy()[0])
    length = float(np.linalg.norm((beam.end - beam.start).numpy()))

    def up_to(ends: Array, rule: Any = _EXACT) -> Array:
        """Return the radiance along the ray up to each of these distances."""
        found = _radiance(single, ray, media, t_max=ends, estimator="frustum", rule=rule)
        values: Array = np.atleast_2d(found).mean(axis=1)
        return values

    edges = np.linspace(low, high, _CURVE + 1)
    integrand = np.diff(up_to(edges)) / np.diff(edges)
    middle = 0.5 * (edges[:-1] + edges[1:])
    whole = np.array([high])
    true = float(up_to(whole)[0])
    flat, conical, chosen = (
        float(_radiance(single, ray, media, estimator=kind).mean()) for kind in ("billboard", "frustum", "auto")
    )
    nearer = abs(chosen - flat) < abs(chosen - conical)

    def curves(kind: Callable[[int], Any]) -> RuleCurves:
        """Return the points, the integrand there, and the relative error of a rule for each number of points."""
        result = RuleCurves([], [], [], [])
        for order in _ORDERS:
            rule = kind(order)
            points = 0.5 * (low + high) + 0.5 * (high - low) * rule.points
            result.n.append(order)
            result.points.append(points.tolist())
            result.values.append(np.interp(points, middle, integrand).tolist())
            result.error.append(float(up_to(whole, rule).sum() / true - 1) if true > 0 else 0.0)
        return result

    return RayIntegral(
        estimator="1D" if nearer else "2D", interval=(low, high), radius=radii, length=length,
        s=middle.tolist(), integrand=integrand.tolist(), gauss=curves(gauss_legendre), riemann=curves(riemann),
    )  # fmt: skip


def _brightest(each: BeamSet, ray: _Ray) -> tuple[int, tuple[float, float]] | None:
    """Return the index of roughly the brightest beam along a ray, and where the ray is in it; None if it meets none."""
    origin, direction = (Array3f(*vector.tolist()) for vector in (ray.origin, ray.direction))
    beam = load(pack(each.beams, origin, shared=True), dr.arange(UInt32, len(each.beams)))
    inside = chord(beam, None, direction, Float(0), Float(ray.length))
    radius = dr.fma(inside.growth, 0.5 * (inside.a + inside.b), inside.radius)
    light = channel_mean(beam.power) * (inside.b - inside.a) / dr.maximum(dr.square(radius), 1e-24)
    light, low, high = (
        dr.select(inside.valid, each, 0).numpy() for each in (light, inside.t + inside.a, inside.t + inside.b)
    )
    number = int(np.argmax(light))
    return (number, (float(low[number]), float(high[number]))) if light[number] > 0 else None
