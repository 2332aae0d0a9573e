"""The inspector: how much the beams of each light add to a pixel, and how the light of the brightest is integrated.

The integrand is measured with the renderer's own frustum estimator, as the difference that a slightly longer ray makes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from ..estimators.estimate import estimate
from ..quadrature import gauss_legendre, riemann
from ..runtime.device import Array2f, Float, UInt32
from ..scene import Array
from ..transport.guiding.importance import Views
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
    view = Views([frame.projection()])(UInt32(0))
    origin, direction = view.ray(Array2f(*(dr.opaque(Float, float(each)) for each in at)))
    start, way, ahead = (np.ravel(each.numpy()).astype(np.float64)[:3] for each in (origin, direction, view.forward))
    known = depth is not None and np.isfinite(depth) and 0 < depth < 1e30
    return _Ray(start, way, float(depth) / max(float(way @ ahead), 1e-6) if known else 1e9)  # type: ignore[arg-type]


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
    number = _brightest(each, ray)
    if number is None:
        return None
    single = each._replace(beams=each.beams[number : number + 1])
    interval, radii, length = _crossed(single, ray)
    if interval is None:
        return None
    low, high = interval

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
    return RayIntegral(
        estimator="1D" if nearer else "2D", interval=(low, high), radius=radii, length=length,
        s=middle.tolist(), integrand=integrand.tolist(),
        gauss=_rules(gauss_legendre, low, high, middle, integrand, lambda rule: up_to(whole, rule), true),
        riemann=_rules(riemann, low, high, middle, integrand, lambda rule: up_to(whole, rule), true),
    )  # fmt: skip


def _rules(
    kind: Any, low: float, high: float, middle: Array, integrand: Array, measured: Any, true: float
) -> RuleCurves:  # fmt: skip
    """Return the points, the integrand there, and the relative error of a rule for each number of points."""
    result = RuleCurves([], [], [], [])
    for order in _ORDERS:
        rule = kind(order)
        points = 0.5 * (low + high) + 0.5 * (high - low) * rule.points
        result.n.append(order)
        result.points.append(points.tolist())
        result.values.append(np.interp(points, middle, integrand).tolist())
        result.error.append(float(measured(rule).sum() / true - 1) if true > 0 else 0.0)
    return result


def _brightest(each: BeamSet, ray: _Ray) -> int | None:
    """Return the index of the beam that is roughly the brightest along a ray; None if the ray misses all of them."""
    start, end = (np.asarray(state.numpy()).T.astype(np.float64) for state in (each.beams.start, each.beams.end))
    radii = [np.asarray(state.numpy()).astype(np.float64) for state in (each.beams.radius_start, each.beams.radius_end)]
    power = np.asarray(each.beams.power.numpy()).mean(axis=0)
    axis = end - start
    length = np.maximum(np.linalg.norm(axis, axis=1), 1e-30)
    axis = axis / length[:, None]
    to = start - ray.origin
    cosine = axis @ ray.direction
    # The closest points of two lines; the denominator is kept above 0 for parallel ones.
    across = np.maximum(1 - cosine**2, 1e-9)
    s = np.clip(((to @ ray.direction) * cosine - (to * axis).sum(axis=1)) / across, 0, length)
    place = start + s[:, None] * axis
    t = np.clip((place - ray.origin) @ ray.direction, 0, ray.length)
    aside = np.linalg.norm(place - ray.origin - t[:, None] * ray.direction, axis=1)
    radius = radii[0] + (radii[1] - radii[0]) * s / length
    inside = np.maximum(1 - (aside / np.maximum(radius, 1e-30)) ** 2, 0)
    weight = power * inside / np.maximum(radius * np.sqrt(across), 1e-12)
    return int(np.argmax(weight)) if weight.max(initial=0.0) > 0 else None


def _crossed(single: BeamSet, ray: _Ray) -> tuple[tuple[float, float] | None, tuple[float, float], float]:
    """Return the interval of distances in which a ray is inside a beam, or None, and the beam's radii and length."""
    beams = single.beams
    start, end = (np.ravel(state.numpy()).astype(np.float64) for state in (beams.start, beams.end))
    first, last = (float(np.ravel(state.numpy())[0]) for state in (beams.radius_start, beams.radius_end))
    length = float(np.linalg.norm(end - start))
    axis = (end - start) / max(length, 1e-30)
    far = min(ray.length, float(np.linalg.norm(start - ray.origin)) + length + max(first, last))
    t = np.linspace(0, far, 4096)
    to = ray.origin + t[:, None] * ray.direction - start
    s = to @ axis
    rho = np.linalg.norm(to - s[:, None] * axis, axis=1)
    inside = (s >= 0) & (s <= length) & (rho <= first + (last - first) * s / max(length, 1e-30))
    if np.count_nonzero(inside) < 2:
        return None, (first, last), length
    within = np.flatnonzero(inside)
    return (float(t[within[0]]), float(t[within[-1]])), (first, last), length
