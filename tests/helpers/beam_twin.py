"""Float64 twins of the estimators, for one beam and many rays: they are written from the definitions alone.

A truncated cone is convex, so a ray's chord is found by search: first for the minimum of a convex function, then for
its zeros on both sides. The integral is a dense quadrature, and k1 is the line integral of k2. Rays that miss are left
out, and the others are taken a few at a time, so that the numbers at all points of their chords fit into a cache.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

ENDLESS = 1e9
_X, _W = np.polynomial.legendre.leggauss(16)
_AT_A_TIME = 32  # rays


@dataclass
class Beam:
    start: Any
    end: Any
    radius_start: float
    radius_end: float
    power: Any = (1.0, 1.0, 1.0)
    offset: float = 0.0
    total: float | None = None
    entry: float = 0.0
    end_normal: Any = None
    tangents: Any = None  # the light's directions at both ends
    power_end: Any = None
    start_normal: Any = None
    side: Any = None  # (point, normal) of the plane beside the beam

    @property
    def length(self):
        return np.linalg.norm(np.subtract(self.end, self.start))

    @property
    def axis(self):
        return np.subtract(self.end, self.start) / self.length

    def radius(self, s):
        return self.radius_start + (self.radius_end - self.radius_start) * s / self.length

    def planes(self):
        """Return (point, normal) of the planes that cut the beam; the normals point to the beam's side."""
        if self.tangents is None:
            first, last = (self.start, self.axis), (self.end, -self.axis)
        else:
            first, last = (self.start, self.tangents[0]), (self.end, -np.asarray(self.tangents[1]))
        start = [] if self.start_normal is None else [(self.start, self.start_normal)]
        side = [] if self.side is None else [self.side]
        return [first, last if self.end_normal is None else (self.end, self.end_normal), *start, *side]

    def reach(self):
        """Return the distances along the axis between which the beam lies, whatever its planes are."""
        low = 0.0 if self.tangents is None else -self.radius_start
        cut = self.end_normal is not None or self.tangents is not None
        return low, self.length + (self.radius_end if cut else 0.0)

    def along(self, point):
        """Return the distance from the start, on which falloff, radius and direction depend, at points (…, 3).

        Between the planes at the ends it grows linearly on every line parallel to the axis.
        """
        if self.tangents is None:
            return (point - self.start) @ self.axis
        first, last = (
            np.asarray(each) @ self.axis / np.linalg.norm(each) for each in self.tangents
        )  # cosines of the planes' slants
        a, b = (
            ((point - end) @ (np.asarray(each) / np.linalg.norm(each))) / cosine
            for end, each, cosine in zip((self.start, self.end), self.tangents, (first, last), strict=True)
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.length * np.clip(np.where(a - b > 0, a / (a - b), 0.5), 0, 2)

    def cosine(self, s, direction):
        """Return the cosine between directions (N, 3) and the light's own at distances s (N, …) from the start."""
        if self.tangents is None:
            return np.broadcast_to((direction @ self.axis).reshape(-1, *[1] * (s.ndim - 1)), s.shape)
        first, last = (np.asarray(each) / np.linalg.norm(each) for each in self.tangents)
        turned = first + (s / self.length)[..., None] * (last - first)
        turned /= np.linalg.norm(turned, axis=-1, keepdims=True)
        return np.einsum("n...k,nk->n...", turned, direction)

    def light(self, s):
        """Return the power at distances from the start."""
        last = self.power if self.power_end is None else self.power_end
        return np.maximum(np.asarray(self.power) + (s / self.length)[..., None] * np.subtract(last, self.power), 0)

    def fields(self):
        """Return the arguments of `Beams`."""
        given = {name: getattr(self, name) for name in ("start", "end", "power")}
        given |= {name: getattr(self, name) for name in ("radius_start", "radius_end")}
        given |= {"offset": self.offset, "entry": self.entry}
        if self.total is not None:
            given["total"] = self.total
        if self.end_normal is not None:
            given["end_normal"] = self.end_normal
        if self.start_normal is not None:
            given["start_normal"] = self.start_normal
        if self.side is not None:
            given["side"], given["side_normal"] = self.side
        if self.tangents is not None:
            given["start_tangent"], given["end_tangent"] = self.tangents
        if self.power_end is not None:
            given["power_end"] = self.power_end
        return given


def ones(*_, **__):
    return np.ones(3)


@dataclass
class TwinLook:
    """The four factors as NumPy functions; colours have a last axis of three."""

    across: Callable[[Any], Any]  # of ρ, normalised
    along: Callable[[Any, Any, Any], Any] = ones  # of distance, depth and fraction
    eye: Callable[[Any, Any], Any] = ones  # of distance and depth
    angle: Callable[[Any], Any] = ones  # of the cosine toward the camera
    corners: tuple[float, ...] = field(default=())  # fractions at which `along` jumps
    more: Callable[..., Any] = ones  # of s (fraction), distance, r, t, P and cosine

    def factors(self, beam, s, t, t_min, rho, point, cosine):
        distance = s + beam.offset
        depth = np.maximum(distance - beam.entry, 0)
        total = beam.offset + beam.length if beam.total is None else beam.total
        fraction = np.clip(distance / total, 0, 1)
        more = self.more(s=fraction, distance=distance, r=rho, t=t, P=point, cosine=cosine)
        return self.along(distance, depth, fraction) * self.eye(t, t - t_min) * more


def places(beam, origin, direction, t):
    """Return the points (N, …, 3) at t (N, …) on rays (N, 3), and their distance from the beam's axis."""
    t = np.asarray(t)
    inner = (slice(None),) + (None,) * (t.ndim - 1)
    point = origin[inner] + t[..., None] * direction[inner]
    offset = point - beam.start
    return point, np.linalg.norm(offset - (offset @ beam.axis)[..., None] * beam.axis, axis=-1)


def outside(beam, origin, direction, t, t_min, t_max):
    """Return a function of t that is negative on the visible ray in the beam; it is convex but for a curve's taper."""
    point, r = places(beam, origin, direction, t)
    s = (point - beam.start) @ beam.axis
    low, high = beam.reach()
    walls = [r - beam.radius(beam.along(point)), low - s, s - high, t_min - t, t - t_max]
    walls += [-((point - place) @ (np.asarray(normal) / np.linalg.norm(normal))) for place, normal in beam.planes()]
    return np.max(walls, axis=0)


def chords(beam, origin, direction, t_min, t_max):
    """Return where rays (N, 3) enter and leave the beam; the same number twice for a miss."""

    def wall(t):
        return outside(beam, origin, direction, t, t_min, t_max)

    middle = np.sum((np.add(beam.start, beam.end) / 2 - origin) * direction, axis=1)
    size = beam.length + 3 * (beam.radius_start + beam.radius_end)
    low = np.maximum(middle - size, t_min - size)
    high = np.maximum(np.minimum(middle + size, t_max + size), low)
    left, right = low.copy(), high.copy()
    for _ in range(92):  # (2/3)^92 < 2^−53: to the last bit
        a, b = left + (right - left) / 3, right - (right - left) / 3
        lower = wall(a) < wall(b)
        left, right = np.where(lower, left, a), np.where(lower, b, right)
    lowest = (left + right) / 2
    hit = wall(lowest) < 0
    ends = []
    origin, direction, t_min, t_max = origin[hit], direction[hit], t_min[hit], t_max[hit]
    for far in (low, high):
        inside, away = lowest[hit], far[hit]
        for _ in range(60):
            half = (inside + away) / 2
            within = wall(half) < 0
            inside, away = np.where(within, half, inside), np.where(within, away, half)
        end = lowest.copy()
        end[hit] = inside
        ends.append(end)
    return ends[0], ends[1]


def few(chosen):
    """Yield the places of the chosen rays, a few at a time."""
    numbers = np.flatnonzero(chosen)
    for first in range(0, len(numbers), _AT_A_TIME):
        yield numbers[first : first + _AT_A_TIME]


def frustum(beam, look, origin, direction, t_min=0.0, t_max=ENDLESS, pieces=64):
    """Beam × Beam 2D: Φ · angle · ∫ across(r/R)/R² · along · eye dt over the chord."""
    origin, direction, t_min, t_max = rays(origin, direction, t_min, t_max)
    a, b = chords(beam, origin, direction, t_min, t_max)
    value = np.zeros((len(a), 3))
    for some in few(a < b):
        value[some] = over_chords(
            beam, look, origin[some], direction[some], t_min[some], a[some], b[some], pieces
        )  # fmt: skip
    return value


def over_chords(beam, look, origin, direction, t_min, a, b, pieces):
    """Return the radiance (N, 3) toward rays whose chords are from a to b."""
    edges = a[:, None] + (b - a)[:, None] * np.linspace(0, 1, pieces + 1)
    # A piece begins where the colour along the beam jumps, and at the closest approach.
    c = direction @ beam.axis
    s0 = (origin - beam.start) @ beam.axis
    total = beam.offset + beam.length if beam.total is None else beam.total
    with np.errstate(divide="ignore", invalid="ignore"):
        jumps = [(corner * total - beam.offset - s0) / c for corner in look.corners]
    jumps.append(closest(beam, origin, direction)[1])
    jumps = np.nan_to_num(np.stack(jumps, axis=1))
    edges = np.sort(np.concatenate([edges, np.clip(jumps, a[:, None], b[:, None])], axis=1), axis=1)
    half, middle = np.diff(edges)[..., None] / 2, (edges[:, 1:] + edges[:, :-1])[..., None] / 2
    t = (middle + half * _X).reshape(len(a), -1)
    weight = (half * _W).reshape(len(a), -1)
    point, r = places(beam, origin, direction, t)
    s = beam.along(point)
    radius = np.where(weight > 0, beam.radius(s), 1.0)  # a miss may pass the cone's tip
    rho = np.minimum(r / radius, 1)
    kernel = look.across(rho) / radius**2
    cosine = -beam.cosine(s, direction)
    light = look.factors(beam, s, t, t_min[:, None], rho, point, cosine) * look.angle(cosine) * beam.light(s)
    return np.sum((weight * kernel)[..., None] * light, axis=1)


def billboard(beam, look, origin, direction, t_min=0.0, t_max=ENDLESS):
    """Beam × Beam 1D: Φ · angle / sin θ · k1(u, R(s)) · along · eye at the closest approach."""
    origin, direction, t_min, t_max = rays(origin, direction, t_min, t_max)
    straight, t = closest(beam, origin, direction)
    point, u = places(beam, origin, direction, t)
    s = beam.along(point) if beam.tangents is not None else straight
    radius = beam.radius(s)
    low, high = beam.reach()
    hit = (straight > low) & (straight < high) & (t > t_min) & (t < t_max) & (u < radius)
    surfaces = (beam.end_normal, beam.start_normal, None if beam.side is None else beam.side[1])
    for place, normal in beam.planes():
        # `reach` has the planes that are perpendicular to the axis.
        if beam.tangents is not None or any(each is normal for each in surfaces):
            hit &= (point - place) @ np.asarray(normal, dtype=float) > 0
    value = np.zeros((len(s), 3))
    for some in few(hit):
        given = (x[some] for x in (s, t, u, radius, t_min, direction, point))
        value[some] = at_points(beam, look, *given)
    return value


def at_points(beam, look, s, t, u, radius, t_min, direction, point):
    """Return the radiance (N, 3) of a billboard toward rays that meet it at these points."""
    cosine = -beam.cosine(s, direction)
    sine = np.linalg.norm(np.cross(direction, beam.axis), axis=1)

    def light(rho):
        columns = (x[:, None] for x in (s, t, t_min))
        return look.across(rho)[..., None] * look.factors(beam, *columns, rho, point[:, None], cosine[:, None])

    projected = k1(light, u / radius) / (radius * sine)[:, None]
    return look.angle(cosine) * projected * beam.light(s)


def closest(beam, origin, direction):
    """Return s and t of the closest points of two lines, by least squares of start + s w − o − t d."""
    c = direction @ beam.axis
    normal = np.stack([np.stack([np.ones_like(c), -c], axis=-1), np.stack([-c, np.ones_like(c)], axis=-1)], axis=1)
    e = origin - beam.start
    right = np.stack([e @ beam.axis, -np.sum(e * direction, axis=1)], axis=-1)
    normal += np.eye(2) * (np.abs(c)[:, None, None] == 1)  # parallel: any result will do
    s, t = np.linalg.solve(normal, right[..., None])[..., 0].T
    return s, t


def k1(kernel, x, pieces=64):
    """Return the line integral (N, 3) of a kernel of ρ, (N, K, 3), at the distances x (N,) from the axis, in radii.

    The position on the line is its half length times sin φ, so that the integrand has no singular slope at the ends.
    """
    x = np.asarray(x, dtype=float)
    edges = np.linspace(0, np.pi / 2, pieces + 1)
    half, middle = np.diff(edges)[:, None] / 2, (edges[1:] + edges[:-1])[:, None] / 2
    phi, weight = (middle + half * _X).ravel(), (half * _W).ravel()
    line = np.sqrt(np.maximum(1 - x * x, 0))[..., None]
    rho = np.sqrt(np.minimum(x[..., None] ** 2 + (line * np.sin(phi)) ** 2, 1))
    return 2 * np.sum(kernel(rho) * (line * np.cos(phi) * weight)[..., None], axis=-2)


def rays(origin, direction, t_min, t_max):
    """Return rays as four arrays of one length, directions of unit length."""
    direction = np.atleast_2d(np.asarray(direction, dtype=float))
    direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    count = max(len(direction), len(np.atleast_2d(origin)), np.size(t_min), np.size(t_max))
    return (
        np.broadcast_to(np.asarray(origin, dtype=float), (count, 3)),
        np.broadcast_to(direction, (count, 3)),
        np.broadcast_to(np.asarray(t_min, dtype=float), (count,)),
        np.broadcast_to(np.asarray(t_max, dtype=float), (count,)),
    )
