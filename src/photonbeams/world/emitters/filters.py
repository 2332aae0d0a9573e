"""Filters of lights in Dr.Jit: which fraction of a lamp's light is left at a point.

All filters answer one question: what is left of the light that comes from a lamp along a line to a point? Surfaces ask
it for each sample of a lamp, and beams for each of the pieces into which filters cut them, so the two cannot disagree.

For beams, a soft edge is a hard edge at a random place: the shape grows by a random part of the edge, with a
distribution whose mean is the smooth step from full effect to none. At a point, the mean itself is known in most cases.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, lru_cache
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple

import drjit as dr
import numpy as np

from ... import scene
from ...looks.context import LightContext, ShadingContext
from ...looks.factors import Factor
from ...looks.guarded import LARGEST
from ...looks.tint import Tint
from ...numerics.arrays import opaque, to_uint
from ...numerics.hashing import hash32, unit_float
from ...numerics.structs import Struct, pack
from ...runtime.device import Array3f, Bool, Float, UInt32

# Steps of Newton's method to a rounded box. It begins at the box around that, and comes from outside of a convex
# function, so it does not overshoot; each step squares the error.
_STEPS = 8
# A ray whose least squared distance exceeds the radius by this fraction misses a rounded box: rounding of float32.
_MISS = 1e-5
_TINY = 1e-20


class Placed(Struct):
    """Base of what has a space of its own, to which the rows and the shift lead from world space."""

    x: Array3f
    y: Array3f
    z: Array3f
    shift: Array3f

    def turned(self, vector: Array3f) -> Array3f:
        """Return a vector of world space in the own space."""
        return Array3f(*(dr.dot(row, vector) for row in (self.x, self.y, self.z)))

    def to_local(self, point: Array3f) -> Array3f:
        """Return a point of world space in the own space."""
        return self.turned(point) + self.shift


class FilterShape(Placed):
    """Base of blockers."""

    half: Array3f
    radius: Float
    edge: Float
    color: Array3f
    behind: Float
    inside: Float
    invert: Float

    varying = False

    @classmethod
    def of(cls, blocker: scene.Blocker) -> FilterShape:
        """Return a blocker's parameters, opaque."""
        result = cls()
        inverse = np.linalg.inv(blocker.frame)
        result.x, result.y, result.z = (opaque(row) for row in inverse[:3, :3])
        result.shift, result.half = opaque(inverse[:3, 3]), opaque(blocker.half)
        result.radius, result.edge, result.color = opaque(blocker.radius), opaque(blocker.edge), opaque(blocker.color)
        result.behind, result.inside = (opaque(float(blocker.where == each)) for each in ("behind", "inside"))
        result.invert = opaque(float(blocker.invert))
        return result

    def met(self, origin: Array3f, direction: Array3f, u: Float, soft: bool) -> tuple[Any, Any, Any, Any]:
        """Return where lines enter and leave the shape, where an inverted one acts beside it, and who meets it, 0 or 1.

        `u` from 0 to 1 chooses how much of the soft edge belongs to the shape. If `soft`, who meets a rectangle may be
        the mean over that.
        """
        raise NotImplementedError

    def factor(self, point: Array3f, toward: Array3f, distance: Float, u: Float, soft: bool) -> Array3f:
        """Return what is left at points of light from lamps that are `distance` away along `toward`."""
        first, last, beside, meets = self.met(point, toward, u, soft)
        inverted = self.invert > 0
        passed = dr.select(inverted, dr.select((beside > 0) & (beside < distance), 1 - meets, 0),
                           dr.select((last > 0) & (first < distance), meets, 0))  # fmt: skip
        other = dr.select(first < distance, meets, 0)
        other = dr.select(self.inside > 0, self.covers(point, u, soft), other)
        acts = dr.select(self.behind > 0, passed, dr.select(inverted, 1 - other, other))
        return dr.lerp(Array3f(1), self.color, acts)

    def covers(self, point: Array3f, u: Float, soft: bool) -> Float:
        """Return whether points are in the shape, 0 or 1; if `soft`, the mean over `u`."""
        off = dr.norm(dr.maximum(dr.abs(self._local(point, point)[0]) - self.half, 0))
        return self._smooth(off) if soft else dr.select(off <= self._reach(u), Float(1), 0)

    def _smooth(self, off: Float) -> Float:
        """Return the effect at a distance from the box, within the radius 1, and beyond the edge 0."""
        x = dr.clip((off - self.radius) / dr.maximum(self.edge, _TINY), 0, 1)
        return 1 - x * x * (3 - 2 * x)

    def places(self, origin: Array3f, direction: Array3f, _: Float, u: Float) -> list[Any]:
        """Return the distances along segments at which the factor may change; infinite where there is none."""
        first, last, beside, meets = self.met(origin, direction, u, False)
        beside = dr.select(self.invert * self.behind > 0, beside, dr.inf)
        return [dr.select(meets > 0, first, beside), dr.select(meets > 0, last, dr.inf)]

    def _local(self, origin: Array3f, direction: Array3f) -> tuple[Any, Any]:
        return self.to_local(origin), self.turned(direction)

    def _reach(self, u: Float) -> Float:
        """Return the radius with a part of the edge, such that the mean effect is 1 − smoothstep over the edge."""
        return self.radius + self.edge * (0.5 - dr.sin(dr.asin(dr.clip(1 - 2 * u, -1, 1)) * (1 / 3)))


class FlatShape(FilterShape):
    """A rectangle with round corners."""

    def met(self, origin: Array3f, direction: Array3f, u: Float, soft: bool) -> tuple[Any, Any, Any, Any]:
        """Return where lines cross the plane, three times, and whether that is in the rectangle."""
        p, d = self._local(origin, direction)
        place = -p.z / dr.copysign(dr.maximum(dr.abs(d.z), _TINY), d.z)
        x = dr.maximum(dr.abs(dr.fma(d.x, place, p.x)) - self.half.x, 0)
        y = dr.maximum(dr.abs(dr.fma(d.y, place, p.y)) - self.half.y, 0)
        off = dr.sqrt(x * x + y * y)
        return place, place, place, self._smooth(off) if soft else dr.select(off <= self._reach(u), Float(1), 0)

    def places(self, origin: Array3f, direction: Array3f, _: Float, u: Float) -> list[Any]:
        """Return the distances along segments to the plane."""
        return [self.met(origin, direction, u, False)[0]]


class BoxShape(FilterShape):
    """A box with sharp edges."""

    def met(self, origin: Array3f, direction: Array3f, u: Float, soft: bool) -> tuple[Any, Any, Any, Any]:
        """Return where lines enter and leave the box, where they are closest to its center, and whether they meet."""
        p, d, nearest = self._at_center(origin, direction)
        first, last = _slabs(p, d, self.half)
        return first + nearest, last + nearest, nearest, dr.select(first <= last, Float(1), 0)

    def _at_center(self, origin: Array3f, direction: Array3f) -> tuple[Any, Any, Any]:
        """Return lines in the filter's space, from their points closest to the center, and where these are."""
        p, d = self._local(origin, direction)
        nearest = -dr.dot(p, d) / dr.maximum(dr.squared_norm(d), _TINY)
        return dr.fma(d, nearest, p), d, nearest


class RoundShape(BoxShape):
    """A box with round edges, a capsule or a sphere."""

    def met(self, origin: Array3f, direction: Array3f, u: Float, soft: bool) -> tuple[Any, Any, Any, Any]:
        """Return where lines enter and leave the shape, where they are closest to its center, and whether they meet."""
        p, d, nearest = self._at_center(origin, direction)
        reach = self._reach(u)
        first, last = _slabs(p, d, self.half + reach)
        meets = first <= last
        first, far = self._approached(p, d, first, reach)
        last, other = self._approached(p, d, last, reach)
        meets &= ~far & ~other & (first <= last)
        return first + nearest, last + nearest, nearest, dr.select(meets, Float(1), 0)

    def _approached(self, p: Array3f, d: Array3f, place: Float, reach: Float) -> tuple[Any, Any]:
        """Return where lines enter the shape that come from a place outside of it, and which of them miss it."""
        square = reach * reach
        for _ in range(_STEPS):
            value, slope = self._excess(p, d, place, square)
            place = dr.select(value > 0, place - value / dr.copysign(dr.maximum(dr.abs(slope), _TINY), slope), place)
        return place, self._excess(p, d, place, square)[0] > _MISS * square

    def _excess(self, p: Array3f, d: Array3f, place: Float, square: Float) -> tuple[Any, Any]:
        """Return the squared distance from the box beyond the radius's square, and its derivative."""
        there = dr.fma(d, place, p)
        off = dr.maximum(dr.abs(there) - self.half, 0)
        return dr.squared_norm(off) - square, 2 * dr.dot(off, dr.mulsign(Array3f(d), there))


def _slabs(p: Array3f, d: Array3f, half: Array3f) -> tuple[Any, Any]:
    """Return where lines enter and leave a box around 0; those that miss it enter after they leave."""
    away: Any = dr.copysign(dr.maximum(dr.abs(d), _TINY), d)
    inverse = dr.rcp(away)
    one, other = (-half - p) * inverse, (half - p) * inverse
    return dr.max(dr.minimum(one, other)), dr.min(dr.maximum(one, other))


class RampFilter(Struct):
    """A ramp by the distance from the lamp; `_ramp` makes a class for each number of knots."""

    count = 0
    varying = True

    @classmethod
    def of(cls, ramp: scene.DistanceRamp) -> RampFilter:
        """Return a ramp's parameters, opaque."""
        result = cls()
        for place, (knot, color) in enumerate(zip(ramp.knots, ramp.colors, strict=True)):
            setattr(result, f"knot{place}", opaque(knot))
            setattr(result, f"color{place}", opaque(color))
        return result

    def factor(self, _: Array3f, __: Array3f, distance: Float, *___: object) -> Array3f:
        """Return the ramp's colour at distances from lamps."""
        knots = [(getattr(self, f"knot{place}"), getattr(self, f"color{place}")) for place in range(self.count)]
        result = Array3f(knots[0][1])
        for (before, color), (after, following) in pairwise(knots):
            part = dr.clip((distance - before) / dr.maximum(after - before, _TINY), 0, 1)
            result = dr.select(distance > before, dr.lerp(color, following, part), result)
        return result

    def places(self, _: Array3f, __: Array3f, offset: Float, ___: Float) -> list[Any]:
        """Return the distances along segments to the knots; segments begin `offset` from the lamp."""
        return [getattr(self, f"knot{place}") - offset for place in range(self.count)]


class TintFilter(Placed):
    """The tint of surfaces by a look, and its light context; `_tint` makes a class for each colour along beams."""

    frame: Float
    time: Float
    begin: Array3f

    color: ClassVar[Factor]
    far: ClassVar[bool]  # from zero, so that positions have double precision
    varying = True

    @classmethod
    def of(cls, tint: Tint) -> TintFilter:
        """Return a tint's light context as opaque numbers."""
        result, own = cls(), LightContext(*tint.clock, to_world=tint.to_world, zero=tint.zero)
        result.frame, result.time, result.begin = own.frame, own.time, opaque(tint.zero)
        result.x, result.y, result.z, result.shift = *own.rows, own.shift
        return result

    @property
    def zero(self) -> Any:
        """As of a `LightContext`; single precision holds it, too, because it is a multiple of a power of two."""
        kind: Any = dr.float64_array_t(Array3f)
        return kind(self.begin) if self.far else None

    def factor(self, point: Array3f, _: Array3f, distance: Float, *__: object) -> Array3f:
        """Return the colour at points of surfaces, where light paths end."""
        from_light: Any = dr.minimum(distance, LARGEST)
        where = {"distance": from_light, "from_light": from_light, "fraction": Float(1), "place": lambda: point}
        value: Any = Array3f(self.color.evaluate(ShadingContext(context=self, **where)))  # type: ignore[arg-type]
        return dr.select(dr.isfinite(value), dr.maximum(value, 0), 0)


@lru_cache(256)
def _tint(color: Factor, far: bool) -> type[TintFilter]:
    """Return the class of tints with a colour."""
    known = {"color": color, "far": far, "__annotations__": {}, "__module__": __name__}
    return type("TintOfLook", (TintFilter,), known)


@cache
def _ramp(count: int) -> type[RampFilter]:
    """Return the class of ramps with `count` knots."""
    fields = {f"knot{place}": Float for place in range(count)} | {f"color{place}": Array3f for place in range(count)}
    parts = {"__annotations__": fields, "count": count, "__module__": __name__}
    return type(f"Ramp{count}", (RampFilter,), parts)


def filter_of(described: scene.LightFilter) -> Any:
    """Return a filter in Dr.Jit."""
    if isinstance(described, scene.DistanceRamp):
        return _ramp(len(described.knots)).of(described)
    if isinstance(described, Tint):
        return _tint(described.factor, any(described.zero)).of(described)
    assert isinstance(described, scene.Blocker)
    if described.flat:
        return FlatShape.of(described)
    return (RoundShape if described.radius + described.edge > 0 else BoxShape).of(described)


class FilterChain(NamedTuple):
    """The filters of a lamp, and whether the lamp is infinitely far away, whose beams begin somewhere on the way."""

    filters: tuple[Any, ...]
    infinite: bool = False

    @property
    def varying(self) -> bool:
        """Whether the factor changes between places where filters cut beams."""
        return any(each.varying for each in self.filters)

    def factor(
        self, point: Array3f, toward: Array3f, distance: Float, seed: UInt32, soft: bool = True,
        acting: UInt32 | None = None,
    ) -> Array3f:  # fmt: skip
        """Return what is left at points of light from lamps that are `distance` away along `toward`.

        If `soft`, it may be the mean over the seeds. `acting` has a bit for each filter that acts; None: all of them.
        """
        distance = distance + dr.inf if self.infinite else distance
        result = Array3f(1)
        for number, each in enumerate(self.filters):
            u = unit_float(hash32(seed, UInt32(number)))
            left = each.factor(point, toward, distance, u, soft)
            result *= left if acting is None else dr.select((acting >> number) & 1 > 0, left, 1)
        return result

    def places(self, origin: Array3f, direction: Array3f, offset: Float, seed: UInt32) -> list[Any]:
        """Return the distances along segments at which the factor may change, in ascending order."""
        result: list[Any] = []
        for number, each in enumerate(self.filters):
            u = unit_float(hash32(seed, UInt32(number)))
            result += each.places(origin, direction, offset, u)
        for end in range(len(result) - 1, 0, -1):
            for place in range(end):
                pair = result[place], result[place + 1]
                result[place], result[place + 1] = dr.minimum(*pair), dr.maximum(*pair)
        return result


def chain_of(described: Sequence[scene.LightFilter], infinite: bool) -> FilterChain | None:
    """Return the filters of a lamp in Dr.Jit, None if it has none."""
    return FilterChain(tuple(map(filter_of, described)), infinite) if described else None


def seed_of(point: Array3f, direction: Array3f) -> UInt32:
    """Return a number for a soft edge's random place, which rays from points determine."""
    bits: list[Any] = [dr.reinterpret_array(UInt32, Float(each)) for each in (*point, *direction)]
    return hash32(*bits)


class PathFilters:
    """The filters of all sources, as light paths meet them: those of one kind are packed.

    Parameters
    ----------
    chains
        The filters of each source, by its number; None: it has none.
    """

    def __init__(self, chains: Sequence[FilterChain | None]) -> None:
        kinds: dict[Any, list[int]] = {}
        for number, chain in enumerate(chains):
            if chain is not None:
                kinds.setdefault((tuple(map(type, chain.filters)), chain.infinite), []).append(number)
        self._groups: list[tuple[FilterChain, Any]] = []
        for (_, infinite), numbers in kinds.items():
            known = [chains[number] for number in numbers]
            columns = zip(*(chain.filters for chain in known if chain is not None), strict=True)
            table = np.zeros(len(chains) + 1, dtype=np.uint32)
            table[numbers] = np.arange(1, len(numbers) + 1)
            self._groups.append((FilterChain(tuple(pack(each) for each in columns), infinite), to_uint(table)))

    def factor(
        self, source: UInt32, point: Array3f, toward: Array3f, distance: Float, seed: UInt32, active: Bool,
        acting: UInt32 | None,
    ) -> Array3f:  # fmt: skip
        """Return what is left at active points of light straight from their sources, of whose filters these act."""
        result = Array3f(1)
        for packed, table in self._groups:
            number = dr.gather(UInt32, table, source, active)
            own = active & (number > 0)
            index = dr.maximum(number, 1) - 1
            chain = packed._replace(filters=tuple(dr.gather(type(each), each, index) for each in packed.filters))
            result = dr.select(own, chain.factor(point, toward, distance, seed, acting=acting), result)
        return result
