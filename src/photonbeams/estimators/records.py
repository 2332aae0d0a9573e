"""Beams packed for gathering in kernels, and loaded from there.

A beam is a record of packets of four floats: the speed of the estimators' loops is limited by gathers, not arithmetic.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr

from ..beams import Beams
from ..numerics.given import Number
from ..runtime.device import Array3f, Array4f, Float, UInt32

#: Beams shorter than this have no direction that float32 could hold; they carry no visible light.
SHORTEST = 1e-12


@dataclass
class Packed:
    """Beams packed for gathering: `groups` packets of four floats for each beam, relative to the point `origin`.

    Beams at rest: (axis, radius at the start) · (start, slope k of the radius) · (power, length) · then, if present,
    (w × e, w·e) for a shared ray origin · (end normal, its plane's distance from the origin) · (offset, total, entry,
    0) · (T0, its plane's distance from the origin) and (T1, likewise) · (power at the end, 0).

    Moving beams, first at shutter open and then at shutter close: (start, radius) · (end, radius) · (power, 0) · then,
    if present, (end normal, 0) · (offset, total, entry, 0) · (T0, 0) and (T1, 0) · (power at the end, 0).

    Last, if asked for: (random number, number, generation, 0).
    """

    data: Any
    groups: int
    origin: Any
    shared: bool
    caps: bool
    path: bool
    count: int
    moving: bool = False
    bent: bool = False
    graded: bool = False
    identity: bool = False


def pack(beams: Beams, origin: Array3f, shared: bool, close: Beams | None = None, identity: bool = False) -> Packed:
    """Pack beams relative to `origin`, which is the origin of all rays if `shared` is true.

    `close` are the same beams at shutter close, if they move; both have the same optional fields. With `identity`, the
    beams' random number, number and generation are packed too, for looks that use them.
    """
    caps = beams.end_normal is not None
    path = any(value is not None for value in (beams.offset, beams.total, beams.entry))
    packets = _at_rest(beams, origin, shared) if close is None else _ends(beams, origin) + _ends(close, origin)
    if identity:  # last, once: it is the same at all times
        packets.append((beams.identity(), dr.zeros(Float, len(beams))))
    count, groups = len(beams), len(packets)
    data = dr.zeros(Float, count * groups * 4)
    place = dr.arange(UInt32, count) * groups
    for number, (vector, scalar) in enumerate(packets):
        dr.scatter(data, Array4f(vector.x, vector.y, vector.z, scalar), place + number)
    dr.eval(data)
    bent, graded = beams.start_tangent is not None, beams.power_end is not None
    return Packed(
        data, groups, origin, shared and close is None, caps, path, count, close is not None, bent, graded, identity
    )


def _at_rest(beams: Beams, origin: Array3f, shared: bool) -> list[tuple[Array3f, Float]]:
    start, end = beams.start - origin, beams.end - origin
    axis = end - start
    length = dr.norm(axis)
    axis = axis * dr.select(length > SHORTEST, dr.rcp(length), 0)
    slope = (beams.radius_end - beams.radius_start) * dr.select(length > SHORTEST, dr.rcp(length), 0)
    packets = [(axis, beams.radius_start), (start, slope), (beams.power, length)]
    if shared:
        packets.append((dr.cross(axis, start), dr.dot(axis, start)))
    if beams.end_normal is not None:
        packets.append((beams.end_normal, dr.dot(beams.end_normal, end)))
    packets += _path(beams, length)
    if beams.start_tangent is not None:
        for tangent, place in ((beams.start_tangent, start), (beams.end_tangent, end)):
            unit = _unit(tangent, axis)
            packets.append((unit, dr.dot(unit, place)))
    return packets + _power_end(beams)


def _ends(beams: Beams, origin: Array3f) -> list[tuple[Array3f, Float]]:
    nothing = dr.zeros(Float, len(beams))
    packets = [
        (beams.start - origin, beams.radius_start),
        (beams.end - origin, beams.radius_end),
        (beams.power, nothing),
    ]
    if beams.end_normal is not None:
        packets.append((beams.end_normal, nothing))
    packets += _path(beams, dr.norm(beams.end - beams.start))
    if beams.start_tangent is not None:
        axis = dr.normalize(beams.end - beams.start)
        packets += [(_unit(each, axis), nothing) for each in (beams.start_tangent, beams.end_tangent)]
    return packets + _power_end(beams)


def _power_end(beams: Beams) -> list[tuple[Array3f, Float]]:
    return [] if beams.power_end is None else [(beams.power_end, dr.zeros(Float, len(beams)))]


def _unit(tangent: Any, axis: Array3f) -> Array3f:
    """Return tangents with unit length; a tangent without length becomes the axis."""
    squared = dr.squared_norm(tangent)
    return dr.select(squared > SHORTEST, tangent * dr.rsqrt(dr.maximum(squared, SHORTEST)), axis)


def _path(beams: Beams, length: Float) -> list[tuple[Array3f, Float]]:
    if beams.offset is None and beams.total is None and beams.entry is None:
        return []
    nothing = dr.zeros(Float, len(beams))
    offset = beams.offset if beams.offset is not None else nothing
    total = beams.total if beams.total is not None else offset + length
    entry = beams.entry if beams.entry is not None else nothing
    return [(Array3f(offset, total, entry), nothing)]


@dataclass
class Bend:
    """The planes between which a piece of a curve lies, and the light's directions there."""

    first: Any  # T0
    last: Any  # T1
    first_height: Any  # distances of the planes from the origin
    last_height: Any
    first_inv: Any  # 1 / (w·T0)
    last_inv: Any  # 1 / (w·T1)
    twist: Any  # 1 − T0·T1


@dataclass
class Record:
    """One beam for each lane, loaded in a kernel; vectors are relative to the packed origin."""

    axis: Any
    radius: Any  # at the start
    start: Any
    slope: Any  # of the radius, along the axis
    power: Any
    length: Any
    inv_total: Any  # 1 / the length of the whole light path
    moment: Any = None  # w × e, for a shared ray origin
    reach: Any = None  # w·e, likewise
    cap: Any = None  # end normal
    cap_offset: Any = None  # its plane's distance from the origin
    path: Any = None  # offset, total, entry
    identity: Any = None  # random number, number, generation
    bend: Any = None  # of a piece of a curve
    gain: Any = None  # change of the power from start to end, where it has one

    @property
    def offset(self) -> Number:
        """Distance from the light at the beam's start."""
        return 0.0 if self.path is None else self.path.x

    @property
    def total(self) -> Float:
        """Length of the whole light path."""
        return self.length if self.path is None else self.path.y

    def depth(self, distance: Float) -> Float:
        """Return the part of a `distance` from the light that lies in the medium."""
        return dr.maximum(distance - self.entry, 0)

    def fraction(self, distance: Float) -> Float:
        """Return a `distance` from the light as a fraction of the whole light path."""
        return dr.clip(distance * self.inv_total, 0, 1)

    @property
    def entry(self) -> Number:
        """Distance from the light at which the medium begins."""
        return 0.0 if self.path is None else self.path.z

    @property
    def stop(self) -> Float:
        """Distance from the start beyond which there is no part of the beam.

        A beam that ends on a surface is cut by the surface's plane. If it meets the plane at a slant, the cone's rim
        reaches past the end of the axis, but at most by a radius: farther out the plane is a poor approximation of the
        surface.
        """
        if self.cap is None and self.bend is None:
            return self.length
        return self.length + dr.fma(self.slope, self.length, self.radius)

    @property
    def begin(self) -> Number:
        """Distance from the start before which there is no part of the beam: a joint's rim may reach back a radius."""
        return 0 if self.bend is None else -self.radius

    @property
    def widest(self) -> Float:
        """The greater of the radii."""
        return dr.maximum(self.radius, dr.fma(self.slope, self.length, self.radius))

    @property
    def reaching(self) -> Float:
        """The greatest radius: a widening piece of a curve keeps growing past its end, up to a surface's plane."""
        if self.cap is None:
            return self.widest
        return dr.maximum(self.radius, dr.fma(2 * self.slope, self.length, self.radius))

    def light(self, s: Float) -> Array3f:
        """Return the power at a distance from the start."""
        if self.gain is None:
            return self.power
        return dr.maximum(dr.fma(self.gain, s * dr.rcp(dr.maximum(self.length, 1e-20)), self.power), 0)


def load(packed: Packed, number: UInt32, time: Float | None = None) -> Record:
    """Gather the beams with these numbers, as they are at a `time` of the shutter interval."""
    base = number * packed.groups
    packets = [dr.gather(Array4f, packed.data, base + group) for group in range(packed.groups)]
    identity = packets.pop().xyz if packed.identity else None
    record = _moved(packets, packed, time) if packed.moving else _loaded(packets, packed)
    record.identity = identity
    record.inv_total = dr.rcp(record.total)  # once for each beam, not for each ray
    return record


def _moved(packets: list[Array4f], packed: Packed, time: Any) -> Record:
    half = len(packets) // 2
    at = [dr.lerp(first, last, time) for first, last in zip(packets[:half], packets[half:], strict=True)]
    start, end = at[0].xyz, at[1].xyz
    axis = end - start
    squared = dr.maximum(dr.squared_norm(axis), SHORTEST * SHORTEST)
    inv = dr.rsqrt(squared)
    axis *= inv
    record = Record(
        axis=axis, radius=at[0].w, start=start, slope=(at[1].w - at[0].w) * inv,
        power=at[2].xyz, length=squared * inv, inv_total=None,
    )  # fmt: skip
    rest = at[3:]
    if packed.caps:
        record.cap = dr.normalize(rest[0].xyz)
        record.cap_offset = dr.dot(record.cap, end)
        rest = rest[1:]
    if packed.path:
        record.path = rest[0].xyz
        rest = rest[1:]
    if packed.bent:
        first, last = dr.normalize(rest[0].xyz), dr.normalize(rest[1].xyz)
        record.bend = _bend(axis, first, last, dr.dot(first, start), dr.dot(last, end))
        rest = rest[2:]
    if packed.graded:
        record.gain = rest[0].xyz - record.power
    return record


def _bend(axis: Any, first: Array3f, last: Array3f, first_height: Float, last_height: Float) -> Bend:
    # A plane along the axis would cut nothing; curves have no such joints, see `beams.curves.tangents`.
    first_inv, last_inv = (dr.rcp(dr.maximum(dr.dot(axis, each), 0.05)) for each in (first, last))
    return Bend(first, last, first_height, last_height, first_inv, last_inv, 1 - dr.dot(first, last))


def _loaded(packets: list[Array4f], packed: Packed) -> Record:
    record = Record(
        axis=packets[0].xyz, radius=packets[0].w, start=packets[1].xyz, slope=packets[1].w,
        power=packets[2].xyz, length=packets[2].w, inv_total=None,
    )  # fmt: skip
    rest = packets[3:]
    if packed.shared:
        record.moment, record.reach = rest[0].xyz, rest[0].w
        rest = rest[1:]
    if packed.caps:
        record.cap, record.cap_offset = rest[0].xyz, rest[0].w
        rest = rest[1:]
    if packed.path:
        record.path = rest[0].xyz
        rest = rest[1:]
    if packed.bent:
        record.bend = _bend(record.axis, rest[0].xyz, rest[1].xyz, rest[0].w, rest[1].w)
        rest = rest[2:]
    if packed.graded:
        record.gain = rest[0].xyz - record.power
    return record
