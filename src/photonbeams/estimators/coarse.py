"""Fewer rays than pixels: the picture of many wide beams is smooth, so every second pixel can stand for all.

Beams are divided into levels by their width on the screen, tile by tile. Beams of level k are so wide that no stroke
slips through the rays of every 2ᵏ-th pixel. From the coarsest level on, the sum of all beams so far is found for the
rays of the next finer level, either by interpolation between four of the coarser rays, or by gathering along the ray
itself. The latter is done where rays twice as far apart did not predict the coarser rays well, and at the edges of
objects, where a ray does not reach as far as its neighbours predict.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import drjit as dr

from ..runtime.device import Array2f, Array3f, Bool, Float, Int32, UInt32
from .lanes import PixelRays, pixels_of, tiles_of
from .projection import TILE, Projection
from .tiles import Widths

# The least half width of beams in pixels of their level: three rays of every 2ᵏ-th pixel pass across a stroke.
_HALF_WIDTH = 1.5
# Allowed difference, in units of the relative error, between rays and what rays twice as far apart predict: at half the
# spacing a quarter of it is left if the picture is smooth.
_FORETOLD = 8.0
# Allowed difference between the end of a ray and what the ends of its neighbours predict: it changes the light along a
# ray in about the same proportion.
_ENDS = 0.25
# Fraction of the mean of a picture: dimmer pixels may have larger relative errors.
_DIM = 0.05


@dataclass
class Level:
    """The rays of every 2ᵏ-th pixel along x and y of the whole picture, as a picture; level 0 has all rays."""

    number: int  # k
    view: Projection  # with a margin up to a corner of tiles of the whole picture's coarsest level
    rays: PixelRays
    first: tuple[int, int] = (0, 0)  # column and row of its first pixel, in pixels

    def widths(self, levels: int) -> Widths:
        """Return the widths of the beams of this level, out of so many `levels`."""
        own = _HALF_WIDTH if self.number else 0.0
        coarser = 2 * _HALF_WIDTH if self.number + 1 < levels else float("inf")
        return Widths(dr.opaque(Float, own), dr.opaque(Float, coarser))

    def of_coarser(self, some: Bool, farthest: Float) -> tuple[Float, Widths]:
        """Return depths of tiles and widths for lists of all coarser levels' beams, for `some` rays (a mask)."""
        own = dr.full(Float, -1, self.view.tiles)
        tile = tiles_of(self.view, self.rays)
        dr.scatter(own, dr.gather(Float, farthest, tile), tile, some)
        dr.eval(own)
        return own, Widths(None, dr.opaque(Float, 2 * _HALF_WIDTH))

    def inverse_depths(self) -> Array2f:
        """Return the inverse planar depths at which rays begin and end: for planes they are linear on the screen."""
        rays = self.rays
        return Array2f(*(dr.rcp(dr.maximum(each * rays.facing, 1e-20)) for each in (rays.t_min, rays.t_max)))


def levels_of(view: Projection, rays: PixelRays) -> list[Level]:
    """Return the levels of a picture, level 0 first."""
    lattice = rays.lattice
    assert lattice is not None
    levels = lattice.levels
    while levels and min(view.width, view.height) >> levels < 4:
        levels -= 1
    side = TILE << lattice.levels
    margin = (lattice.corner[0] % side, lattice.corner[1] % side)
    result = []
    for number in range(levels + 1):
        step = 1 << number
        first = (-lattice.corner[0] % step, -lattice.corner[1] % step)
        own = ((margin[0] + first[0]) >> number, (margin[1] + first[1]) >> number)
        reduced = replace(view.reduced(number, margin), margin=own)
        level = Level(number, reduced, rays, first)
        if number:
            width, across, each = (dr.opaque(UInt32, size) for size in (view.width, reduced.across, step))
            index = dr.arange(UInt32, reduced.across * reduced.down)
            x, y = (dr.opaque(UInt32, place) for place in first)
            level.rays = rays.taken((y + index // across * each) * width + x + index % across * each)
        result.append(level)
    return result


def depths(levels: Sequence[Level], farthest: Float) -> list[Float]:
    """Return for each level the planar depth of each tile's farthest surface, given that of level 0."""
    result = [farthest]
    for finer, level in pairwise(levels):
        tile, columns = dr.arange(UInt32, finer.view.tiles), finer.view.counts.columns
        own = tile // columns // 2 * level.view.counts.columns + tile % columns // 2
        found = dr.zeros(Float, level.view.tiles)
        # By default, the kernel would contain the number of tiles.
        dr.scatter_reduce(dr.ReduceOp.Max, found, result[-1], own, mode=dr.ReduceMode.Local)
        dr.eval(found)
        result.append(found)
    return result


def dim_of(radiance: Array3f) -> Float:
    """Return the radiance below which errors may be as large as at this radiance: a fraction of the picture's mean."""
    # Not `dr.mean`, whose kernels contain the number of entries.
    result = dr.max(dr.sum(radiance, axis=1)) * dr.opaque(Float, _DIM / dr.width(radiance))
    dr.eval(result)
    return result


def foretold(level: Level, radiance: Array3f, dim: Float, tolerance: float) -> Bool:
    """Return in which cells between four rays of a level other rays may be interpolated.

    A block of 3 × 3 rays decides, whose corners are rays of the next coarser level: the five others are compared with
    what the corners predict for them.
    """
    view, lattice = level.view, level.rays.lattice
    across, down, *_ = view.counts
    assert lattice is not None
    cells = max((view.across - 1) * (view.down - 1), 1)
    columns = dr.opaque(UInt32, max(view.across - 1, 1))
    cell = dr.arange(UInt32, cells)

    def block(place: UInt32, axis: int, count: UInt32) -> tuple[UInt32, Bool]:
        odd = dr.opaque(UInt32, (lattice.corner[axis] + level.first[axis]) >> level.number & 1)
        begin = ((place - odd) & 0xFFFFFFFE) + odd
        return begin, (place >= odd) & (begin + 2 < count)

    (x, inside), (y, between) = block(cell % columns, 0, across), block(cell // columns, 1, down)
    whole = inside & between

    def at(right: int, below: int) -> Array3f:
        return dr.gather(Array3f, radiance, (y + below) * across + x + right, whole)

    good = whole & corners_foretell({(i, j): at(i, j) for i in range(3) for j in range(3)}, Float(dim), tolerance)
    dr.eval(good)
    return good


def corners_foretell(found: Mapping[tuple[int, int], Array3f], least: Float, tolerance: float) -> Bool:
    """Return whether the corners of blocks of 3 × 3 rays predict the five others, relative to `least` at least."""
    a, b, c, d = found[0, 0], found[2, 0], found[0, 2], found[2, 2]
    sides = {(1, 0): (a + b) / 2, (0, 1): (a + c) / 2, (2, 1): (b + d) / 2, (1, 2): (c + d) / 2}
    difference, most = Float(0), least
    for each in found.values():
        most = dr.maximum(most, dr.max(each))
    for place, told in (sides | {(1, 1): (a + b + c + d) / 4}).items():
        difference = dr.maximum(difference, dr.max(dr.abs(found[place] - told)))
    return difference <= dr.opaque(Float, _FORETOLD * tolerance) * most


def bilinear(corners: Sequence[dr.ArrayT], u: Float, v: Float) -> dr.ArrayT:
    """Return the value at (u, v) between four corners: the two of the first row, then the two of the second."""
    a, b, c, d = corners
    return dr.lerp(dr.lerp(a, b, u), dr.lerp(c, d, u), v)


def interpolated(level: Level, coarser: Level, radiance: Array3f, good: Any, tolerance: float) -> tuple[Bool, Array3f]:
    """Return where the rays of a level may be interpolated from the next coarser level, and the radiance there.

    `good` are the cells of the coarser level, as `foretold` returns them. There is an edge where a ray begins or ends
    off the plane through its neighbours' ends.
    """
    (x, y), known = _place(level, coarser)
    across, down = coarser.view.across, coarser.view.down

    def cell(place: Float, count: int) -> tuple[UInt32, Float]:
        first = UInt32(dr.clip(dr.floor(place), 0, dr.opaque(Float, max(count - 2, 0))))
        return first, place - Float(first)

    (column, u), (row, v) = cell(x, across), cell(y, down)
    columns = dr.opaque(UInt32, across)
    at = row * columns + column
    known &= dr.gather(Bool, good, row * (columns - 1) + column)
    corners = (at, at + 1, at + columns, at + columns + 1)

    def between(kind: type[dr.ArrayT], values: dr.ArrayT) -> dr.ArrayT:
        return bilinear([dr.gather(kind, values, each, known) for each in corners], u, v)

    told, own = between(Array2f, coarser.inverse_depths()), level.inverse_depths()
    near = dr.abs(told - own) <= dr.opaque(Float, _ENDS * tolerance) * dr.minimum(told, own)
    # Extra rays of a pixel are there because it has an edge.
    known &= dr.arange(UInt32, dr.width(x)) < dr.opaque(UInt32, level.view.across * level.view.down)
    # Rays of pixels beside the first or last pixels of the lattice may lie a little beyond these.
    usable, result = known & near.x & near.y, dr.maximum(between(Array3f, radiance), 0)
    dr.eval(usable, result)
    return usable, result


def _place(level: Level, coarser: Level) -> tuple[tuple[Float, Float], Bool]:
    """Return where rays of a level lie among those of the coarser level, in its pixels, and whether between them."""
    index, columns = pixels_of(level.rays, level.view.across * level.view.down), level.view.counts.across
    begin = [dr.opaque(Int32, each) for each in coarser.first]
    own = [dr.opaque(Int32, each) for each in level.first]
    fine = dr.opaque(Int32, 1 << level.number)
    x, y = (Int32(each) * fine + first for each, first in zip((index % columns, index // columns), own, strict=True))
    step = dr.opaque(Float, 1 / (1 << coarser.number))
    columns_from, rows_from = x - begin[0], y - begin[1]
    ends = coarser.view.across, coarser.view.down
    last_x, last_y = (dr.opaque(Int32, (count - 1) << coarser.number) for count in ends)
    amid = (columns_from >= 0) & (rows_from >= 0) & (columns_from <= last_x) & (rows_from <= last_y)
    if level.number:
        return (Float(columns_from) * step, Float(rows_from) * step), amid
    assert level.rays.lattice is not None
    film, place = on_film(level.view, level.rays.direction), Array2f(level.rays.lattice.place)
    offset = (Float(begin[0]) + place.x, Float(begin[1]) + place.y)
    return ((film.x - offset[0]) * step, (film.y - offset[1]) * step), amid


def on_film(view: Projection, direction: Array3f) -> Array2f:
    """Return where rays from the view's origin pass the picture, in pixels."""
    pose = view.poses[0]
    (sx, sy), (cx, cy) = view.scale, view.center
    depth = dr.rcp(dr.dot(direction, pose.forward))
    x, y = dr.dot(direction, pose.right) * depth, dr.dot(direction, pose.up) * depth
    return Array2f(cx - dr.opaque(Float, view.margin[0]) + sx * x, cy - dr.opaque(Float, view.margin[1]) - sy * y)
