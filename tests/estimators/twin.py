"""Float64 twins of the estimators: one beam, many rays, written from the definitions and sharing no formula with them.

A truncated cone is convex, so a ray's chord is found by searching: down a convex function to its lowest point, then
from there to both sides for its zeros. The integral is a dense quadrature, and k1 the line integral of k2.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

ENDLESS = 1e9
_X, _W = np.polynomial.legendre.leggauss(16)


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

    @property
    def length(self):
        return np.linalg.norm(np.subtract(self.end, self.start))

    @property
    def axis(self):
        return np.subtract(self.end, self.start) / self.length

    def radius(self, s):
        return self.radius_start + (self.radius_end - self.radius_start) * s / self.length

    def fields(self):
        """Return what `Beams` takes."""
        given = {name: getattr(self, name) for name in ("start", "end", "power")}
        given |= {name: getattr(self, name) for name in ("radius_start", "radius_end")}
        given |= {"offset": self.offset, "entry": self.entry}
        if self.total is not None:
            given["total"] = self.total
        if self.end_normal is not None:
            given["end_normal"] = self.end_normal
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


def place(beam, origin, direction, t):
    """Return the distance along the beam and from its axis, of points (N, …) at t on rays (N, 3)."""
    t = np.asarray(t)
    inner = (slice(None),) + (None,) * (t.ndim - 1)
    point = origin[inner] + t[..., None] * direction[inner] - beam.start
    s = point @ beam.axis
    return s, np.linalg.norm(point - s[..., None] * beam.axis, axis=-1)


def outside(beam, origin, direction, t, t_min, t_max):
    """Return a convex function of t that is negative where the point lies in the beam and on the visible ray."""
    s, r = place(beam, origin, direction, t)
    stop = beam.length if beam.end_normal is None else beam.length + beam.radius_end
    walls = [r - beam.radius(s), -s, s - stop, t_min - t, t - t_max]
    if beam.end_normal is not None:
        point = origin + t[:, None] * direction - beam.end
        walls.append(-(point @ np.asarray(beam.end_normal, dtype=float)))
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
    for _ in range(120):  # (2/3)^120: to the last bit
        a, b = left + (right - left) / 3, right - (right - left) / 3
        lower = wall(a) < wall(b)
        left, right = np.where(lower, left, a), np.where(lower, b, right)
    lowest = (left + right) / 2
    hit = wall(lowest) < 0
    ends = []
    for far in (low, high):
        inside, away = lowest.copy(), far.copy()
        for _ in range(60):
            half = (inside + away) / 2
            within = wall(half) < 0
            inside, away = np.where(within, half, inside), np.where(within, away, half)
        ends.append(np.where(hit, inside, lowest))
    return ends[0], ends[1]


def frustum(beam, look, origin, direction, t_min=0.0, t_max=ENDLESS, pieces=64):
    """Beam × Beam 2D: Φ · angle · ∫ across(r/R)/R² · along · eye dt over the chord."""
    origin, direction, t_min, t_max = rays(origin, direction, t_min, t_max)
    a, b = chords(beam, origin, direction, t_min, t_max)
    edges = a[:, None] + (b - a)[:, None] * np.linspace(0, 1, pieces + 1)
    # Where the colour along the beam jumps, and at the closest approach, a piece begins.
    c = direction @ beam.axis
    s0, _ = place(beam, origin, direction, np.zeros(len(c)))
    total = beam.offset + beam.length if beam.total is None else beam.total
    with np.errstate(divide="ignore", invalid="ignore"):
        jumps = [(corner * total - beam.offset - s0) / c for corner in look.corners]
    jumps.append(closest(beam, origin, direction)[1])
    jumps = np.nan_to_num(np.stack(jumps, axis=1))
    edges = np.sort(np.concatenate([edges, np.clip(jumps, a[:, None], b[:, None])], axis=1), axis=1)
    half, middle = np.diff(edges)[..., None] / 2, (edges[:, 1:] + edges[:, :-1])[..., None] / 2
    t = (middle + half * _X).reshape(len(a), -1)
    weight = (half * _W).reshape(len(a), -1)
    s, r = place(beam, origin, direction, t)
    radius = np.where(weight > 0, beam.radius(s), 1.0)  # a miss may pass the cone's tip
    rho = np.minimum(r / radius, 1)
    kernel = look.across(rho) / radius**2
    point = origin[:, None] + t[..., None] * direction[:, None]
    factors = look.factors(beam, s, t, t_min[:, None], rho, point, -c[:, None])
    light = np.sum((weight * kernel)[..., None] * factors, axis=1)
    return np.asarray(beam.power) * look.angle(-c) * light


def billboard(beam, look, origin, direction, t_min=0.0, t_max=ENDLESS):
    """Beam × Beam 1D: Φ · angle / sin θ · k1(u, R(s)) · along · eye at the closest approach."""
    origin, direction, t_min, t_max = rays(origin, direction, t_min, t_max)
    s, t = closest(beam, origin, direction)
    _, u = place(beam, origin, direction, t)
    radius = beam.radius(s)
    hit = (s > 0) & (t > t_min) & (t < t_max) & (u < radius)
    if beam.end_normal is None:
        hit &= s < beam.length
    else:
        point = origin + t[:, None] * direction - beam.end
        hit &= (s < beam.length + beam.radius_end) & (point @ np.asarray(beam.end_normal, dtype=float) > 0)
    c = direction @ beam.axis
    value = np.zeros((len(c), 3))
    s, t, u, c, radius, t_min = (x[hit] for x in (s, t, u, c, radius, t_min))
    sine = np.linalg.norm(np.cross(direction[hit], beam.axis), axis=1)
    point = origin[hit] + t[:, None] * direction[hit]

    def light(rho):
        columns = (x[:, None] for x in (s, t, t_min))
        return look.across(rho)[..., None] * look.factors(beam, *columns, rho, point[:, None], -c[:, None])

    projected = k1(light, u / radius) / (radius * sine)[:, None]
    value[hit] = np.asarray(beam.power) * look.angle(-c) * projected
    return value


def closest(beam, origin, direction):
    """Return s and t of the closest points of two lines: the least squares of start + s w − o − t d."""
    c = direction @ beam.axis
    normal = np.stack([np.stack([np.ones_like(c), -c], axis=-1), np.stack([-c, np.ones_like(c)], axis=-1)], axis=1)
    e = origin - beam.start
    right = np.stack([e @ beam.axis, -np.sum(e * direction, axis=1)], axis=-1)
    normal += np.eye(2) * (np.abs(c)[:, None, None] == 1)  # parallel: any answer
    s, t = np.linalg.solve(normal, right[..., None])[..., 0].T
    return s, t


def k1(kernel, x, pieces=64):
    """Return the line integral (N, 3) of a kernel of ρ, (N, K, 3), at the distances x (N,) from the axis, in radii.

    The line's half length times sin φ is the place on it, so that the integrand has no singular slope at its ends.
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
