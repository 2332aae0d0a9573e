"""Rays by tiles of the screen, and which rays a lane of a kernel carries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import drjit as dr

from ..numerics.arrays import indices, joined, taken
from ..runtime.device import Array2f, Bool, Float, UInt32
from .projection import TILE, Projection

#: Pixels in a lane of the billboard's kernel. A beam is gathered once for all of them. Of 1, 4 and 8 pixels, 8 are the
#: fastest on two AVX-512 cores.
PIXELS = 8

# Neighbouring lanes carry neighbouring pixels, so that a vector of lanes sees a small block of the picture. A beam
# misses most blocks, and code that no lane needs is skipped.
_BLOCK_WIDTH = 4
_BLOCK_HEIGHT = 4
_BLOCK = _BLOCK_WIDTH * _BLOCK_HEIGHT
_BLOCKS_ACROSS = TILE // _BLOCK_WIDTH

_LEVELS = 4  # most levels at which every second ray stands for all
_COARSEST = 192  # least width of a picture with the coarsest rays alone

# Groups of pixels in a tile that share an origin and a time: those of the billboard's lanes.
_GROUPS = TILE * TILE // PIXELS


@dataclass(frozen=True)
class MoreSamples:
    """The rays after those of all pixels: `each` more for every pixel in `pixels`, the first ones of all come first."""

    pixels: Any
    each: int

    def shares(self, count: int) -> Float:
        """Return the weight of each ray in its pixel: of the rays of `count` pixels, and then of the further rays."""
        part, result = dr.opaque(Float, 1 / (self.each + 1)), dr.ones(Float, count)
        dr.scatter(result, part, self.pixels)
        return joined([result, part + dr.zeros(Float, self.each * dr.width(self.pixels))])


@dataclass(frozen=True)
class Lattice:
    """Pixels with evenly spaced rays: every second pixel along x and y of the whole picture; others are jittered."""

    corner: tuple[int, int]  # (left, top) of a crop window in the whole picture
    place: Any  # in [0, 1)², where rays pass these pixels
    levels: int  # at each of them, every second ray of the level before stands for all

    @classmethod
    def of(cls, width: int, height: int, corner: tuple[int, int], place: Array2f) -> Lattice:
        """Return the lattice of a whole picture of this size, or of a crop window of it."""
        return cls(corner, place, min(max((max(width, height) // _COARSEST).bit_length() - 1, 0), _LEVELS))


@dataclass
class PixelRays:
    """One ray for each pixel, row by row from the top left: `origin` is one point for all, or (W · H, 3).

    If the lens is wide or the camera moves, `origins` are those that groups of pixels share, (lanes(view), 3); `origin`
    repeats them. If beams move, `times` are those of the groups, (lanes(view),), from 0 to 1 over the shutter.
    `lane_of` returns a pixel's group.

    After the W · H rays there may be `more` rays of some pixels, if rays share their origin. `lattice` tells which rays
    are evenly spaced, if any are.
    """

    origin: Any
    direction: Any  # (W · H, 3), unit length
    facing: Any  # (W · H,) planar depth per unit of t
    t_max: Any  # (W · H,)
    t_min: Any  # (W · H,)
    origins: Any = None
    times: Any = None
    more: MoreSamples | None = None
    lattice: Lattice | None = None

    @property
    def shared_origin(self) -> bool:
        """Whether all rays start at one point."""
        return dr.width(self.origin) == 1 and self.origins is None

    def taken(self, index: UInt32) -> PixelRays:
        """Return some of the rays, which must have one origin; further rays of a pixel are left out."""
        own = {name: taken(getattr(self, name), index) for name in ("direction", "facing", "t_max", "t_min")}
        dr.eval(own)
        return replace(self, **own, more=None)


class LaneRay(NamedTuple):
    """A ray of each lane: its index, whether it exists, and the bit of its pixel's block of the tile."""

    index: Any
    exists: Any
    block: Any


class Lanes(NamedTuple):
    """What lanes carry: the tile and the group of each, and its rays."""

    tile: Any
    group: Any
    rays: list[LaneRay]

    def part(self, begin: int, stop: int) -> Lanes:
        """Return the lanes from `begin` to before `stop`."""
        index = dr.arange(UInt32, stop - begin) + dr.opaque(UInt32, begin)
        rays = [LaneRay(*(taken(each, index) for each in ray)) for ray in self.rays]
        result = Lanes(taken(self.tile, index), taken(self.group, index), rays)
        dr.eval(result)
        return result

    @classmethod
    def joined(cls, parts: Sequence[Lanes | None]) -> Lanes | None:
        """Return the lanes of all parts; None if there are none."""
        there = [each for each in parts if each is not None]
        if len(there) < 2:
            return there[0] if there else None
        tile, group, rays = joined([(each.tile, each.group, tuple(each.rays)) for each in there])
        result = cls(tile, group, [*rays])
        dr.eval(result)
        return result


def lanes_of_pixels(view: Projection, rays: PixelRays, count: int, busy: Bool) -> Lanes | None:
    """Return lanes of `count` pixels each, of `busy` tiles: tile after tile, block after block; None if none is.

    After these come lanes with further rays, of one pixel each.
    """
    return Lanes.joined([_of_pixels(view, count, busy), _of_more(view, rays.more, count, busy)])


def _of_pixels(view: Projection, count: int, busy: Bool) -> Lanes | None:
    tiles = indices(busy)
    if not len(tiles):
        return None
    per_tile = TILE * TILE // count
    lane = dr.arange(UInt32, len(tiles) * per_tile)
    columns = view.counts.columns
    tile, local = _entries(tiles, lane // per_tile), lane % per_tile
    block, place = local // _BLOCK * count, local % _BLOCK
    column, row = tile % columns, tile // columns
    carried = [
        LaneRay(*_pixel(view, column, row, block + number, place), _bit(block + number)) for number in range(count)
    ]
    result = Lanes(tile, _group(tile, block, place), carried)
    dr.eval(result)
    return result


def _entries(table: UInt32, index: UInt32) -> UInt32:
    """Return entries of a table of any width."""
    # Two entries more, because a gather from one is another kernel: see `numerics.arrays.padded`.
    return dr.gather(UInt32, joined([table, dr.zeros(UInt32, 2)]), index)


def _of_more(view: Projection, more: MoreSamples | None, count: int, busy: Bool) -> Lanes | None:
    """Return lanes of `count` further rays each, of one pixel of a `busy` tile."""
    if more is None:
        return None
    edges = indices(dr.gather(Bool, busy, tile_of(view, more.pixels)))
    if not len(edges):
        return None
    for_pixel = dr.opaque(UInt32, -(-more.each // count))
    lane = dr.arange(UInt32, len(edges) * -(-more.each // count))
    edge, sample = _entries(edges, lane // for_pixel), lane % for_pixel * count
    width, height, left, top, columns = view.counts
    pixel = _entries(more.pixels, edge)
    each, step, first = dr.opaque(UInt32, more.each), dr.opaque(UInt32, dr.width(more.pixels)), width * height
    x, y = pixel % width + left, pixel // width + top
    block = _bit(_block_of(x, y))
    carried = []
    for number in range(count):
        there = sample + number < each
        # Each has a mask of its own: a kernel that reads one array for all of them would be another kernel.
        own = dr.select(there, block, 0)
        carried.append(LaneRay(first + edge + (sample + number) * step, there, own))
    result = Lanes(tile_of(view, pixel), lane_of(x, y, columns), carried)
    dr.eval(result)
    return result


def lanes_of_some(view: Projection, rays: PixelRays, some: Bool, count: int, busy: Bool) -> Lanes | None:
    """Return lanes of `count` pixels each, of a `busy` tile, for the pixels in the mask `some`; None if there are none.

    After these come lanes with further rays, of one pixel each.
    """
    return Lanes.joined([_of_some(view, some, count, busy), _of_more(view, rays.more, count, busy)])


def _of_some(view: Projection, some: Bool, count: int, busy: Bool) -> Lanes | None:
    slot = dr.arange(UInt32, view.tiles * TILE * TILE)
    tile, local, columns = slot // (TILE * TILE), slot % (TILE * TILE), view.counts.columns
    pixel, exists = _pixel(view, tile % columns, tile // columns, local // _BLOCK, local % _BLOCK)
    here = exists & dr.gather(Bool, busy, tile)
    here &= dr.gather(Bool, some, pixel, here)
    dr.eval(here, pixel)
    chosen = indices(here)
    if not len(chosen):
        return None
    counted, first = dr.select(here, UInt32(1), 0), dr.arange(UInt32, view.tiles) * (TILE * TILE)
    stops = dr.cumsum(counted)
    begin = dr.gather(UInt32, stops, first) - dr.gather(UInt32, counted, first)
    stop = dr.gather(UInt32, stops, first + (TILE * TILE - 1))
    needed = (stop - begin + dr.opaque(UInt32, count - 1)) // dr.opaque(UInt32, count)
    dr.eval(begin, needed)
    end = dr.cumsum(needed)
    lanes = int(end[dr.width(end) - 1])
    own = dr.gather(UInt32, tile, chosen)
    # At least 1, because unused lanes of a vector would divide by 0.
    of_tile = dr.maximum(dr.gather(UInt32, needed, own), 1)
    rank = dr.arange(UInt32, len(chosen)) - dr.gather(UInt32, begin, own)
    # Neighbouring pixels are in neighbouring lanes.
    lane, place = dr.gather(UInt32, end, own) - of_tile + rank % of_tile, rank // of_tile
    tiles = dr.zeros(UInt32, lanes)
    carried, blocks = dr.zeros(UInt32, lanes * count), dr.zeros(UInt32, lanes * count)
    dr.scatter(tiles, own, lane)
    at = place * dr.opaque(UInt32, lanes) + lane
    dr.scatter(carried, dr.gather(UInt32, pixel, chosen), at)
    dr.scatter(blocks, _bit(chosen % (TILE * TILE) // _BLOCK), at)
    dr.eval(tiles, carried, blocks)
    own_rays = []
    for number in range(count):
        at = dr.arange(UInt32, lanes) + dr.opaque(UInt32, number * lanes)
        block = dr.gather(UInt32, blocks, at)
        own_rays.append(LaneRay(dr.gather(UInt32, carried, at), block > 0, block))
    result = Lanes(tiles, dr.zeros(UInt32, lanes), own_rays)
    dr.eval(result)
    return result


def _bit(block: UInt32) -> UInt32:
    """Return the bit of a block of a tile."""
    return UInt32(1) << block


def _pixel(view: Projection, column: UInt32, row: UInt32, block: UInt32, place: UInt32) -> tuple[UInt32, Bool]:
    """Return the index of the pixel at a place in a block of a tile, and whether there is one."""
    width, height, left, top, _ = view.counts
    x = column * TILE + block % _BLOCKS_ACROSS * _BLOCK_WIDTH + place % _BLOCK_WIDTH - left
    y = row * TILE + block // _BLOCKS_ACROSS * _BLOCK_HEIGHT + place // _BLOCK_WIDTH - top
    return y * width + x, (x < width) & (y < height)  # unsigned: in the margin x or y wraps to a large number


def tile_of(view: Projection, pixel: UInt32) -> UInt32:
    """Return the tile of pixels."""
    width, _, left, top, columns = view.counts
    return (pixel // width + top) // TILE * columns + (pixel % width + left) // TILE


def tiles_of(view: Projection, rays: PixelRays) -> UInt32:
    """Return the tile of each ray."""
    return tile_of(view, pixels_of(rays, view.across * view.down))


def pixels_of(rays: PixelRays, count: int) -> UInt32:
    """Return the pixel of each ray, in a picture of `count` pixels."""
    pixel = dr.arange(UInt32, count)
    return pixel if rays.more is None else joined([pixel, *[rays.more.pixels] * rays.more.each])


def _group(tile: UInt32, block: UInt32, place: UInt32) -> UInt32:
    """Return the group of the pixel at a place in a block of a tile."""
    return tile * _GROUPS + block // PIXELS * _BLOCK + place


def whole_group(group: UInt32, columns: UInt32, left: UInt32, top: UInt32, whole: UInt32) -> UInt32:
    """Return the number in the whole picture, `whole` tiles wide, of a group in a crop window `columns` tiles wide.

    The window begins in the tile (`left`, `top`) of the picture; if it begins at that tile's corner, the groups are
    those of the whole picture.
    """
    tile = group // _GROUPS
    return ((tile // columns + top) * whole + tile % columns + left) * _GROUPS + group % _GROUPS


def lanes(view: Projection) -> int:
    """Return how many groups of pixels there are that share an origin and a time."""
    return view.tiles * _GROUPS


def lane_of(x: UInt32, y: UInt32, columns: UInt32) -> UInt32:
    """Return the group of the pixel (x, y), in a picture that is `columns` tiles wide.

    The pixels of a group lie four apart: of 4 × 4 neighbours, each belongs to another group.
    """
    place = y % _BLOCK_HEIGHT * _BLOCK_WIDTH + x % _BLOCK_WIDTH
    return _group(y // TILE * columns + x // TILE, _block_of(x, y), place)


def _block_of(x: UInt32, y: UInt32) -> UInt32:
    """Return the number of the block of the pixel (x, y) in its tile."""
    return y % TILE // _BLOCK_HEIGHT * _BLOCKS_ACROSS + x % TILE // _BLOCK_WIDTH
