"""Which beams can touch which screen tile: projected footprints, walked row by row, into a list of beams per tile.

The projection of a cone is the hull of two discs. Its half extent R/z is linear along the projected axis: numbers that
are linear along the axis, as R and 1, are linear on the screen once they are divided by z. So the columns that a row of
tiles has to visit follow from linear inequalities. A beam that contains the camera, or nearly does, has no such
footprint: every tile lists it, as the Talk puts a quad over the whole screen.

The order of a list depends on nothing but the beams: each lane walks its own part of the beams in turn and counts in
its own cells, so that no two threads race for a slot.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import drjit as dr

from ..beams import Beams
from ..numerics.arrays import indices
from ..runtime.device import Array2f, Array3f, Array4f, Bool, Float, Int32, UInt32
from .cones import Cone, around, half_line

#: Width and height of a tile in pixels.
TILE = 16

# Lanes that count, and the most cells (of four bytes) in which they count; there is a cell for each lane and tile.
_LANES, _MOST_CELLS = 1024, 1 << 25

_FAR = 1e30

# Beams are clipped this many radii in front of the camera plane, where a disc's picture is still an ellipse.
_CLIP = 1.25
# Of beams around the camera, the part that is farther than this many radii has a width on the screen: anything nearer
# covers more than a quarter of a radian.
_WIDE = 4.0


@dataclass
class Pose:
    """Where a camera is: its position and its unit vectors in world space (Dr.Jit, opaque)."""

    origin: Any
    right: Any
    up: Any
    forward: Any

    def to_camera(self, point: Any) -> Any:
        """Return a world point in camera space: x right, y up, z forward."""
        q = point - self.origin
        return Array3f(dr.dot(q, self.right), dr.dot(q, self.up), dr.dot(q, self.forward))


@dataclass
class Projection:
    """Camera space and screen of one view.

    Attributes
    ----------
    poses
        Where the camera is: once, or at shutter open and at shutter close. In between, objects at rest move linearly
        through camera space.
    scale
        Pixels per unit of slope (perspective), or per scene unit (orthographic), along x and along y.
    center
        Pixel position of the optical axis.
    width, height
        Image size in pixels.
    edge_x, edge_y
        Greatest |x/z| and |y/z| in the picture (perspective); opaque, because each lens and crop has its own.
    lens
        Radius of the lens and the distance at which it is in focus (opaque); None for a pinhole.
    """

    poses: tuple[Pose, ...]
    scale: tuple[Any, Any]
    center: tuple[Any, Any]
    width: int
    height: int
    orthographic: bool
    edge_x: Any
    edge_y: Any
    lens: tuple[Any, Any] | None = None

    @property
    def origin(self) -> Any:
        """Position of the camera, at shutter open where it moves."""
        return self.poses[0].origin

    @property
    def columns(self) -> int:
        """Number of tiles in a row."""
        return -(-self.width // TILE)

    @property
    def rows(self) -> int:
        """Number of rows of tiles."""
        return -(-self.height // TILE)

    @property
    def tiles(self) -> int:
        """Number of tiles."""
        return self.columns * self.rows

    def reduced(self, level: int, margin: tuple[int, int]) -> Projection:
        """Return the projection with pixels 2^`level` as wide, after adding a `margin` of pixels at left and top."""
        factor = dr.opaque(Float, 1 / (1 << level))
        (sx, sy), (cx, cy) = self.scale, self.center
        width, height = (-(-(size + own) >> level) for size, own in zip((self.width, self.height), margin, strict=True))
        center = cx + dr.opaque(Float, margin[0]), cy + dr.opaque(Float, margin[1])
        return replace(
            self, scale=(sx * factor, sy * factor), center=(center[0] * factor, center[1] * factor),
            width=width, height=height,
        )  # fmt: skip


class Widths(NamedTuple):
    """Which beams a tile lists, by their least half width there on the screen, in pixels.

    A tile lists beams of at least `own` that are narrower than `coarser` in the square of four tiles around it. If
    `own` is None, it lists beams that are at least as wide as `coarser` there. Both numbers are opaque.
    """

    own: Any
    coarser: Any


@dataclass
class Footprints:
    """Screen footprints of N beams: two discs, x, y and half extents in pixels, and 1/z, packed for gathering."""

    data: Any  # three packets of four a beam
    count: int


def footprints(beams: Beams, view: Projection, close: Beams | None = None) -> Footprints:
    """Project beams to the screen, widened by the lens and by all motion over the shutter.

    At any time, each end of a beam is in camera space a convex combination of its places with camera and beam at
    shutter open and at shutter close. So the box around an end's discs at those times holds this end, and the hull of
    both ends' boxes holds the beam, at all times.
    """
    cones = [_posed(each, pose) for pose in view.poses for each in (beams, close) if each is not None]
    near, visible, limit = _nearness(cones, view)
    limit = dr.select(near, limit * (_WIDE / _CLIP), limit)
    starts = _Box.around(_clipped(cones, limit, view), view)
    ends = _Box.around(_clipped([Cone(b, a, rb, ra) for a, b, ra, rb in cones], limit, view), view)
    widest = cones[0].radius_start
    for cone in cones:
        widest = dr.maximum(widest, dr.maximum(cone.radius_start, cone.radius_end))
    packets = (
        Array4f(starts.x, starts.y, ends.x, ends.y),
        Array4f(starts.half_x, starts.half_y, ends.half_x, ends.half_y),
        Array4f(starts.key, ends.key, widest, dr.select(near, 1, dr.select(visible, 0, -1))),
    )
    data = dr.zeros(Float, len(beams) * 12)
    for number, packet in enumerate(packets):
        dr.scatter(data, packet, dr.arange(UInt32, len(beams)) * 3 + number)
    dr.eval(data)
    return Footprints(data, len(beams))


def _posed(beams: Beams, pose: Pose) -> Cone:
    """Return the bounds of beams in camera space."""
    return around(beams, pose.to_camera(beams.start), pose.to_camera(beams.end))


def _nearness(cones: list[Cone], view: Projection) -> tuple[Any, Any, Any]:
    """Return which beams are near the camera, which can be seen at all, and the z at which each is clipped.

    A disc of radius R about a point c behind the clip plane z = ε is seen, in a picture whose corner lies at the angle
    e, only if √(|c|² − ε²) cos e − ε sin e < R. Beams that come so near count as seen everywhere. For moving beams, and
    for rays from all over a lens, R is that of a beam at rest that holds all of them.
    """
    first = cones[0]
    largest, moved = dr.maximum(first.radius_start, first.radius_end), Float(0)
    for cone in cones[1:]:
        largest = dr.maximum(largest, dr.maximum(cone.radius_start, cone.radius_end))
        moved = dr.maximum(moved, dr.maximum(dr.norm(cone.start - first.start), dr.norm(cone.end - first.end)))
    reach = largest + moved + (view.lens[0] if view.lens is not None else 0)
    limit = dr.maximum(_CLIP * reach, 1e-6)
    if view.orthographic:
        count = dr.width(largest)
        return dr.full(Bool, False, count), dr.full(Bool, True, count), limit
    axis = first.end - first.start
    where = dr.clip(-dr.dot(first.start, axis) / dr.maximum(dr.squared_norm(axis), 1e-20), 0, 1)
    distance = dr.norm(first.start + axis * where)
    edge_x, edge_y = _edges(view)
    corner = dr.sqrt(1 + edge_x * edge_x + edge_y * edge_y)
    nearest, farthest = first.start.z, first.start.z
    for cone in cones:
        nearest = dr.minimum(nearest, dr.minimum(cone.start.z, cone.end.z))
        farthest = dr.maximum(farthest, dr.maximum(cone.start.z, cone.end.z))
    near = (nearest < limit) & (distance < (_CLIP + (1 + _CLIP) * corner) * reach)
    return near, near | (farthest > limit), limit


def _edges(view: Projection) -> tuple[Any, Any]:
    """Return the greatest |x/z| and |y/z| of rays: from the rim of a lens they lean farther out than from a pinhole."""
    lean = view.lens[0] / view.lens[1] if view.lens is not None else Float(0)
    return view.edge_x + lean, view.edge_y + lean


def _clipped(cones: list[Cone], limit: Any, view: Projection) -> list[tuple[Any, Any, Any]]:
    """Return centre, radius and validity of the discs whose hull holds the cones' starts, in front of the clip plane.

    A start behind the plane is replaced by the points where the lines from it to all other corners of the hull pass the
    plane.
    """
    if view.orthographic:
        return [(cone.start, cone.radius_start, Bool(True)) for cone in cones]
    discs = []
    for cone in cones:
        start, radius = cone.start, cone.radius_start
        others = [(other.end, other.radius_end) for other in cones]
        others += [(other.start, other.radius_start) for other in cones if other is not cone]
        behind = start.z < limit
        for corner, corner_radius in others:
            dz = corner.z - start.z
            cut = dr.select(behind, dr.clip((limit - start.z) / dr.select(dz == 0, 1, dz), 0, 1), 0)
            place = start + (corner - start) * cut
            place.z = dr.maximum(place.z, limit)
            discs.append((place, dr.lerp(radius, corner_radius, cut), ~behind | (corner.z > limit)))
    return discs


class _Box(NamedTuple):
    """Screen box of discs: centre and half extents in pixels, and the key of the nearest depth."""

    x: Any
    y: Any
    half_x: Any
    half_y: Any
    key: Any

    @classmethod
    def around(cls, discs: list[tuple[Any, Any, Any]], view: Projection) -> _Box:
        """Return the box of all valid discs; without any, the beam is not seen and the box has no meaning."""
        low, high, key = Array2f(_FAR), Array2f(-_FAR), Float(-_FAR)
        for place, radius, valid in discs:
            center, half = _disc(place, radius, view)
            low = dr.select(valid, dr.minimum(low, center - half), low)
            high = dr.select(valid, dr.maximum(high, center + half), high)
            key = dr.select(valid, dr.maximum(key, _key(place.z, view)), key)
        middle, extent = 0.5 * (low + high), 0.5 * (high - low)
        return cls(middle.x, middle.y, extent.x, extent.y, key)


def _disc(place: Any, radius: Any, view: Projection) -> tuple[Any, Any]:
    """Return centre and half extents in pixels of a disc, with its blur where it is out of focus."""
    (sx, sy), (cx, cy) = view.scale, view.center
    z = Float(1) if view.orthographic else dr.rcp(place.z)
    center = Array2f(cx + sx * place.x * z, cy - sy * place.y * z)
    if view.orthographic:
        return center, Array2f(dr.abs(sx) * radius, dr.abs(sy) * radius)
    # In a picture with this greatest slope, a sphere's picture is at most this much wider than R/z.
    edge_x, edge_y = _edges(view)
    half = Array2f(dr.sqrt(1 + edge_x * edge_x), dr.sqrt(1 + edge_y * edge_y)) * (radius * z)
    if view.lens is not None:
        half += view.lens[0] * dr.abs(z - dr.rcp(view.lens[1]))
    return center, half * Array2f(dr.abs(sx), dr.abs(sy))


def _key(z: Any, view: Projection) -> Any:
    # Depths are compared by a number that is linear on the screen: 1/z in perspective, −z in parallel projection.
    return -z if view.orthographic else dr.rcp(z)


@dr.syntax
def _walk(
    marks: Footprints, view: Projection, begin: Any, stop: Any, depth: Any, widths: Any, lanes: int,
    counter: Any, base: Any, out: Any,
) -> Any:  # fmt: skip
    """Visit the tiles under each lane's beams, begin + lane, begin + lane + lanes, …; count them or list the beams.

    counter
        Cell (tile, lane) counts the beams that the lane has put into the tile.
    widths
        `Widths`, or None.
    base, out
        Where each cell begins in the list, and the list; None only counts.
    """
    columns, rows = dr.opaque(Int32, view.columns), dr.opaque(Int32, view.rows)
    all_lanes = dr.opaque(UInt32, lanes)
    lane = dr.arange(UInt32, lanes)
    beam = begin + lane
    while beam < stop:
        ends = dr.gather(Array4f, marks.data, beam * 3)
        reach = dr.gather(Array4f, marks.data, beam * 3 + 1)
        rest = dr.gather(Array4f, marks.data, beam * 3 + 2)
        everywhere = rest.w > 0
        dx, dy = ends.z - ends.x, ends.w - ends.y
        drx, dry = reach.z - reach.x, reach.w - reach.y
        row = dr.select(everywhere, 0, _from_zero(_tile(dr.minimum(ends.y - reach.y, ends.w - reach.w), rows)))
        last = dr.select(everywhere, rows, _tile(dr.maximum(ends.y + reach.y, ends.w + reach.w), rows) + 1)
        last = dr.minimum(dr.select(rest.w < 0, 0, last), rows)
        last = dr.select(everywhere | _may_be(reach, widths), last, 0)
        while row < last:
            top = Float(row * TILE)
            # y − r ≤ bottom and y + r ≥ top, linear in λ: the part of the axis whose discs touch the row
            low0, high0 = half_line(dy - dry, ends.y - reach.y - (top + TILE))
            low1, high1 = half_line(-(dy + dry), top - (ends.y + reach.y))
            low, high = dr.maximum(low0, low1), dr.minimum(high0, high1)
            xa, ra = dr.fma(dx, low, ends.x), dr.fma(drx, low, reach.x)
            xb, rb = dr.fma(dx, high, ends.x), dr.fma(drx, high, reach.x)
            column = dr.select(everywhere, 0, _from_zero(_tile(dr.minimum(xa - ra, xb - rb), columns)))
            edge = dr.select(everywhere, columns, _tile(dr.maximum(xa + ra, xb + rb), columns) + 1)
            edge = dr.minimum(dr.select((low > high) & ~everywhere, 0, edge), columns)
            front = dr.maximum(dr.lerp(rest.x, rest.y, low), dr.lerp(rest.x, rest.y, high))
            while column < edge:
                tile = UInt32(row * columns + column)
                farthest = dr.gather(Float, depth, tile)
                seen = (farthest >= 0) & (everywhere | (front > _hidden(farthest, rest.z, view)))
                cell = tile * all_lanes + lane
                seen &= _is_of(ends, reach, column, row, widths)
                slot: Any = dr.scatter_inc(counter, cell, seen)
                if dr.hint(out is not None, mode="scalar"):
                    dr.scatter(out, beam, dr.gather(UInt32, base, cell) + slot, seen)
                column += 1
            row += 1
        beam += all_lanes


def _may_be(reach: Any, widths: Widths | None) -> Any:
    """Return whether any tile can list a beam, given the half extents of its ends."""
    if widths is None:
        return Bool(True)
    most = -_least(-reach)
    return most >= widths.coarser if widths.own is None else (_least(reach) < widths.coarser) & (most >= widths.own)


def _is_of(ends: Any, reach: Any, column: Any, row: Any, widths: Widths | None) -> Any:
    """Return whether a beam has the width of the beams that a tile lists."""
    if widths is None:
        return Bool(True)
    around = Float((column >> 1) * (2 * TILE)), Float((row >> 1) * (2 * TILE))
    wide = _half_width(ends, reach, *around, 2 * TILE) >= widths.coarser
    if widths.own is None:
        return wide
    return ~wide & (_half_width(ends, reach, Float(column * TILE), Float(row * TILE), TILE) >= widths.own)


def _least(packet: Any) -> Any:
    """Return the least of four numbers."""
    return dr.minimum(dr.minimum(packet.x, packet.y), dr.minimum(packet.z, packet.w))


def _half_width(ends: Any, reach: Any, left: Any, top: Any, side: int) -> Any:
    """Return the least half width, in pixels, of a beam in a square; infinite if the axis does not cross the square."""
    dx, dy, drx, dry = ends.z - ends.x, ends.w - ends.y, reach.z - reach.x, reach.w - reach.y
    bounds = (
        half_line(dx - drx, ends.x - reach.x - (left + side)), half_line(-(dx + drx), left - (ends.x + reach.x)),
        half_line(dy - dry, ends.y - reach.y - (top + side)), half_line(-(dy + dry), top - (ends.y + reach.y)),
    )  # fmt: skip
    low, high = bounds[0]
    for first, last in bounds[1:]:
        low, high = dr.maximum(low, first), dr.minimum(high, last)
    a, b = (dr.minimum(dr.fma(drx, each, reach.x), dr.fma(dry, each, reach.y)) for each in (low, high))
    return dr.select(low <= high, dr.minimum(a, b), _FAR)


def _hidden(depth: Any, radius: Any, view: Projection) -> Any:
    """Return the depth key below which a beam of this radius lies entirely behind the tile's farthest surface."""
    return -(depth + radius) if view.orthographic else dr.rcp(depth + radius)


def _tile(pixel: Any, count: Any) -> Any:
    # Clip as a float first: a far pixel position does not fit into an integer.
    return Int32(dr.floor(dr.clip(pixel * (1 / TILE), -1, Float(count))))


def _from_zero(tile: Any) -> Any:
    return dr.maximum(tile, 0)


@dataclass
class TileLists:
    """The beams of each tile: `beams[first[tile] : stop[tile]]`."""

    beams: Any
    first: Any
    stop: Any
    entries: int

    def keep(self, flags: Any) -> TileLists:
        """Return the lists with only the flagged entries, in their order."""
        index = indices(flags > 0)
        before = dr.prefix_sum(flags)
        total, entries = dr.opaque(UInt32, dr.width(index)), dr.opaque(UInt32, self.entries)

        def place(i: Any) -> Any:
            return dr.select(i < entries, dr.gather(UInt32, before, dr.minimum(i, entries - 1)), total)

        first, stop = place(self.first), place(self.stop)
        result = replace(self, beams=dr.gather(UInt32, self.beams, index), first=first, stop=stop, entries=len(index))
        dr.eval(result.beams, first, stop)
        return result


class Bins:
    """The cells in which one view's beams are counted, for the beams `begin` … `stop` − 1.

    Parameters
    ----------
    depth
        (tiles,) planar depth of each tile's farthest surface; beams wholly behind it are not listed. A tile with a
        depth below 0 lists no beams.
    widths
        Widths of the beams that are listed; None: all beams.
    """

    def __init__(
        self, marks: Footprints, view: Projection, depth: Any, begin: int, stop: int, widths: Widths | None = None
    ) -> None:
        self._tiles = view.tiles
        self._lanes = min(_LANES, 1 << ((_MOST_CELLS // self._tiles).bit_length() - 1))
        self._inputs = marks, view, dr.opaque(UInt32, begin), dr.opaque(UInt32, stop), depth, widths, self._lanes
        self._cells = self._tiles * self._lanes
        counter = dr.zeros(UInt32, self._cells)
        _walk(*self._inputs, counter, None, None)
        self._base = dr.prefix_sum(counter)
        last = dr.opaque(UInt32, self._cells - 1)
        self.entries = int((dr.gather(UInt32, self._base, last) + dr.gather(UInt32, counter, last))[0])

    def lists(self) -> TileLists:
        """Return the beams of each tile."""
        out, cursor = dr.zeros(UInt32, max(self.entries, 1)), dr.zeros(UInt32, self._cells)
        if self.entries:
            _walk(*self._inputs, cursor, self._base, out)
        tile, lanes = dr.arange(UInt32, self._tiles), dr.opaque(UInt32, self._lanes)
        first = dr.gather(UInt32, self._base, tile * lanes)
        last, total = dr.opaque(UInt32, self._tiles - 1), dr.opaque(UInt32, self.entries)
        stop = dr.select(tile < last, dr.gather(UInt32, self._base, dr.minimum(tile + 1, last) * lanes), total)
        dr.eval(out, first, stop)
        return TileLists(out, first, stop, self.entries)
