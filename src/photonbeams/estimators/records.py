"""Beams packed for gathering in kernels, and loaded from there.

A beam is a record of packets of four floats: the speed of the estimators' loops is limited by gathers, not arithmetic.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr

from ..beams import Beams
from ..numerics.arrays import packets
from ..numerics.given import Number
from ..runtime.device import Array3f, Array4f, Float, UInt32

#: Beams shorter than this have no direction that float32 could hold; they carry no visible light.
SHORTEST = 1e-12


@dataclass
class Packed:
    """Beams packed for gathering: for each beam, packets of four floats, relative to the point `origin`.

    Beams at rest have the packets "axis" (axis, radius at the start), "start" (start, slope k of the radius) and
    "power" (power, length). Then, if present: "moment" (w × e, w·e) for a shared ray origin, "cap" (end normal, its
    plane's distance from the origin), "foot" and "side" (normals of the planes at the start and beside, likewise),
    "path" (offset, total, entry, 0), "first" (T0, its plane's distance from the origin) and "last" (T1, likewise),
    "power_end" (power at the end, 0).

    Moving beams have "start" (start, radius), "end" (end, radius) and "power" (power, 0), and the same others with 0
    for the scalars, first at shutter open and then at shutter close.

    Last, if asked for: (random number, number, generation, 0).
    """

    data: Any
    names: tuple[str, ...]  # of the packets, once
    origin: Any
    count: int
    moving: bool
    identity: bool

    @property
    def groups(self) -> int:
        """Number of packets of a beam."""
        return len(self.names) * (2 if self.moving else 1) + self.identity


def pack(beams: Beams, origin: Array3f, shared: bool, close: Beams | None = None, identity: bool = False) -> Packed:
    """Pack beams relative to `origin`, which is the origin of all rays if `shared` is true.

    `close` are the same beams at shutter close, if they move; both have the same optional fields. With `identity`, the
    beams' random number, number and generation are packed too, for looks that use them.
    """
    states = [_at_rest(beams, origin, shared)] if close is None else [_ends(each, origin) for each in (beams, close)]
    entries = [packet for state in states for packet in state.values()]
    if identity:  # last, once: it is the same at all times
        entries.append((beams.identity(), dr.zeros(Float, len(beams))))
    return Packed(packets(*entries), tuple(states[0]), origin, len(beams), close is not None, identity)


def _at_rest(beams: Beams, origin: Array3f, shared: bool) -> dict[str, tuple[Array3f, Float]]:
    start, end = beams.start - origin, beams.end - origin
    axis = end - start
    length = dr.norm(axis)
    axis = axis * dr.select(length > SHORTEST, dr.rcp(length), 0)
    slope = (beams.radius_end - beams.radius_start) * dr.select(length > SHORTEST, dr.rcp(length), 0)
    packets = {"axis": (axis, beams.radius_start), "start": (start, slope), "power": (beams.power, length)}
    if shared:
        packets["moment"] = dr.cross(axis, start), dr.dot(axis, start)
    if beams.end_normal is not None:
        packets["cap"] = beams.end_normal, dr.dot(beams.end_normal, end)
    packets |= _cuts(beams, origin) | _path(beams, length)
    if beams.start_tangent is not None:
        first, last = _unit(beams.start_tangent, axis), _unit(beams.end_tangent, axis)
        packets |= {"first": (first, dr.dot(first, start)), "last": (last, dr.dot(last, end))}
    return packets | _power_end(beams)


def _ends(beams: Beams, origin: Array3f) -> dict[str, tuple[Array3f, Float]]:
    nothing = dr.zeros(Float, len(beams))
    packets = {
        "start": (beams.start - origin, beams.radius_start), "end": (beams.end - origin, beams.radius_end),
        "power": (beams.power, nothing),
    }  # fmt: skip
    if beams.end_normal is not None:
        packets["cap"] = beams.end_normal, nothing
    packets |= _cuts(beams, origin) | _path(beams, dr.norm(beams.end - beams.start))
    if beams.start_tangent is not None:
        axis = dr.normalize(beams.end - beams.start)
        packets["first"] = _unit(beams.start_tangent, axis), nothing
        packets["last"] = _unit(beams.end_tangent, axis), nothing
    return packets | _power_end(beams)


# The distance of a plane that cuts nothing.
_FAR = 1e30


def _cuts(beams: Beams, origin: Array3f) -> dict[str, tuple[Array3f, Float]]:
    """Return the planes at the start of beams and beside them; they move linearly, too."""
    planes = {"foot": (beams.start_normal, beams.start), "side": (beams.side_normal, beams.side)}
    return {
        name: (normal, Float(dr.select(dr.squared_norm(normal) > 0, dr.dot(normal, place - origin), -_FAR)))
        for name, (normal, place) in planes.items()
        if normal is not None and place is not None
    }


def _power_end(beams: Beams) -> dict[str, tuple[Array3f, Float]]:
    return {} if beams.power_end is None else {"power_end": (beams.power_end, dr.zeros(Float, len(beams)))}


def _unit(tangent: Any, axis: Array3f) -> Array3f:
    """Return tangents with unit length; a tangent without length becomes the axis."""
    squared = dr.squared_norm(tangent)
    return dr.select(squared > SHORTEST, tangent * dr.rsqrt(dr.maximum(squared, SHORTEST)), axis)


def _path(beams: Beams, length: Float) -> dict[str, tuple[Array3f, Float]]:
    if beams.offset is None and beams.total is None and beams.entry is None:
        return {}
    nothing = dr.zeros(Float, len(beams))
    offset = beams.offset if beams.offset is not None else nothing
    total = beams.total if beams.total is not None else offset + length
    entry = beams.entry if beams.entry is not None else nothing
    return {"path": (Array3f(offset, total, entry), nothing)}


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
    cuts: Any = ()  # normals of the planes at the start and beside, and their distances from the origin
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

    def planes(self, origin: Array3f | None) -> list[tuple[Any, Any]]:
        """Return the planes of surfaces that cut the beam: normals, and distances from the origin of rays.

        `origin` is relative to the packed origin, or None if that is the origin of all rays.
        """
        cuts = [*([] if self.cap is None else [(self.cap, self.cap_offset)]), *self.cuts]
        return [(normal, far if origin is None else far - dr.dot(origin, normal)) for normal, far in cuts]

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
    packets: list[Any] = [dr.gather(Array4f, packed.data, base + group) for group in range(packed.groups)]
    identity = packets.pop().xyz if packed.identity else None
    if packed.moving:
        ends = packets[: len(packed.names)], packets[len(packed.names) :]
        packets = [dr.lerp(first, last, time) for first, last in zip(*ends, strict=True)]
    at = dict(zip(packed.names, packets, strict=True))
    record = _moved(at) if packed.moving else _loaded(at)
    if "path" in at:
        record.path = at["path"].xyz
    record.cuts = [(at[name].xyz, at[name].w) for name in ("foot", "side") if name in at]
    if "power_end" in at:
        record.gain = at["power_end"].xyz - record.power
    record.identity = identity
    record.inv_total = dr.rcp(record.total)  # once for each beam, not for each ray
    return record


def _moved(at: dict[str, Array4f]) -> Record:
    start, end = at["start"].xyz, at["end"].xyz
    axis = end - start
    squared = dr.maximum(dr.squared_norm(axis), SHORTEST * SHORTEST)
    inv = dr.rsqrt(squared)
    axis *= inv
    record = Record(
        axis=axis, radius=at["start"].w, start=start, slope=(at["end"].w - at["start"].w) * inv,
        power=at["power"].xyz, length=squared * inv, inv_total=None,
    )  # fmt: skip
    if "cap" in at:
        record.cap = dr.normalize(at["cap"].xyz)
        record.cap_offset = dr.dot(record.cap, end)
    if "first" in at:
        first, last = dr.normalize(at["first"].xyz), dr.normalize(at["last"].xyz)
        record.bend = _bend(axis, first, last, dr.dot(first, start), dr.dot(last, end))
    return record


def _bend(axis: Any, first: Array3f, last: Array3f, first_height: Float, last_height: Float) -> Bend:
    # A plane along the axis would cut nothing; curves have no such joints, see `beams.curves.tangents`.
    first_inv, last_inv = (dr.rcp(dr.maximum(dr.dot(axis, each), 0.05)) for each in (first, last))
    return Bend(first, last, first_height, last_height, first_inv, last_inv, 1 - dr.dot(first, last))


def _loaded(at: dict[str, Array4f]) -> Record:
    record = Record(
        axis=at["axis"].xyz, radius=at["axis"].w, start=at["start"].xyz, slope=at["start"].w,
        power=at["power"].xyz, length=at["power"].w, inv_total=None,
    )  # fmt: skip
    if "moment" in at:
        record.moment, record.reach = at["moment"].xyz, at["moment"].w
    if "cap" in at:
        record.cap, record.cap_offset = at["cap"].xyz, at["cap"].w
    if "first" in at:
        first, last = at["first"], at["last"]
        record.bend = _bend(record.axis, first.xyz, last.xyz, first.w, last.w)
    return record
