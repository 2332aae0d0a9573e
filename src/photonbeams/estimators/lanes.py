"""Rays by tiles of the screen, and which of them a lane of a kernel carries."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import drjit as dr

from ..numerics.arrays import joined
from ..runtime.device import Float, UInt32
from .tiles import TILE, Projection

#: Pixels a lane of the billboard's kernel. A beam is gathered once for all of them: of 1, 4 and 8 pixels, 8 are the
#: fastest on two AVX-512 cores.
PIXELS = 8

# Neighbouring lanes carry neighbouring pixels, so that a vector of lanes sees a small block of the picture: a beam
# passes most blocks by, and what no lane needs is skipped.
_BLOCK_WIDTH, _BLOCK_HEIGHT = 4, 4
_BLOCK = _BLOCK_WIDTH * _BLOCK_HEIGHT
_BLOCKS_ACROSS = TILE // _BLOCK_WIDTH

# Groups of pixels in a tile that share an origin and a time: those of the billboard's lanes.
_GROUPS = TILE * TILE // PIXELS


@dataclass(frozen=True)
class MoreSamples:
    """Which rays there are behind one a pixel: `each` of every pixel in `pixels`, the first ones of all come first."""

    pixels: Any
    each: int

    def shares(self, count: int) -> Any:
        """Return what part of its pixel each ray is, of one for each of `count` pixels and of those behind them."""
        part, result = dr.opaque(Float, 1 / (self.each + 1)), dr.ones(Float, count)
        dr.scatter(result, part, self.pixels)
        return joined([result, part + dr.zeros(Float, self.each * dr.width(self.pixels))])


@dataclass
class PixelRays:
    """One ray a pixel, row by row from the top left: `origin` is one point for all, or (W · H, 3).

    `lanes` are origins and times (0 to 1 over the shutter) that groups of pixels share, (lanes(view), 3) and
    (lanes(view),), where the lens is wide or anything moves; `lane_of` tells a pixel's group. `origin` repeats them.

    Behind the W · H rays there may be more of some pixels, where rays share their origin or have no lanes.
    """

    origin: Any
    direction: Any  # (W · H, 3), unit length
    facing: Any  # (W · H,) planar depth per unit of t
    t_max: Any  # (W · H,)
    t_min: Any  # (W · H,)
    lanes: tuple[Any, Any] | None = None
    more: MoreSamples | None = None

    @property
    def shared_origin(self) -> bool:
        """Whether all rays start at one point, at one time."""
        return dr.width(self.origin) == 1 and self.lanes is None


class Lanes(NamedTuple):
    """What lanes carry: the tile and the group of each, and the indices of its rays, each with whether there is one."""

    tile: Any
    group: Any
    rays: list[tuple[Any, Any]]


@dataclass(frozen=True)
class Sheet:
    """Rays that tiles see beams through.

    Attributes
    ----------
    rays
        The rays.
    per_tile
        How many a tile has.
    carried
        Returns lanes that carry so many rays each.
    spread
        Returns the radiance along pixels' rays, given that along these.
    """

    rays: PixelRays
    per_tile: int
    carried: Callable[[int], Lanes]
    spread: Callable[[Any], Any]


def lanes_of_pixels(view: Projection, rays: PixelRays, count: int) -> Lanes:
    """Return lanes of `count` pixels each: tile after tile, block after block within a tile.

    Behind these, lanes carry further rays of one pixel each.
    """
    per_tile, more = TILE * TILE // count, rays.more or MoreSamples(dr.zeros(UInt32, 0), 1)
    usual, edges, pixels = view.tiles * per_tile, dr.width(more.pixels), view.width * view.height
    for_edge = -(-more.each // count)
    lane = dr.arange(UInt32, usual + edges * for_edge)
    first, lanes = dr.opaque(UInt32, usual), dr.opaque(UInt32, for_edge)
    behind = lane >= first
    edge = dr.select(behind, (lane - first) // lanes, 0)
    # Of two and more: a gather from one is a broadcast, hence another kernel.
    known = dr.zeros(UInt32, 2)
    pixel = dr.gather(UInt32, joined([more.pixels, known]) if edges else known, edge, behind)
    tile, local = dr.select(behind, tile_of(view, pixel), lane // per_tile), lane % per_tile
    block, place = local // _BLOCK * count, local % _BLOCK
    width, height = dr.opaque(UInt32, view.width), dr.opaque(UInt32, view.height)
    columns = dr.opaque(UInt32, view.columns)
    sample = dr.select(behind, (lane - first) % lanes * count, 0)
    each, step = dr.opaque(UInt32, more.each), dr.opaque(UInt32, edges)
    own = dr.opaque(UInt32, pixels) + edge
    carried = []
    for number in range(count):
        at = block + number
        x = (tile % columns) * TILE + at % _BLOCKS_ACROSS * _BLOCK_WIDTH + place % _BLOCK_WIDTH
        y = (tile // columns) * TILE + at // _BLOCKS_ACROSS * _BLOCK_HEIGHT + place // _BLOCK_WIDTH
        index = dr.select(behind, own + (sample + number) * step, y * width + x)
        carried.append((index, dr.select(behind, sample + number < each, (x < width) & (y < height))))
    group = _group(tile, block, place)
    dr.eval(tile, group, carried)
    return Lanes(tile, group, carried)


def tile_of(view: Projection, pixel: Any) -> Any:
    """Return the tile of pixels."""
    width, columns = dr.opaque(UInt32, view.width), dr.opaque(UInt32, view.columns)
    return (pixel // width) // TILE * columns + (pixel % width) // TILE


def tiles_of(view: Projection, rays: PixelRays) -> Any:
    """Return the tile of each ray."""
    pixel = dr.arange(UInt32, view.width * view.height)
    if rays.more is not None:
        pixel = joined([pixel, *[rays.more.pixels] * rays.more.each])
    return tile_of(view, pixel)


def _group(tile: Any, block: Any, place: Any) -> Any:
    """Return the group of the pixel at a place in a block of a tile."""
    return tile * _GROUPS + block // PIXELS * _BLOCK + place


def whole_group(group: Any, columns: Any, left: Any, top: Any, whole: Any) -> Any:
    """Return the number in the whole picture, `whole` tiles wide, of a group in a crop window `columns` tiles wide.

    The window begins in tile `left`, `top` of the picture; where it begins on that tile's corner, the groups are those
    of the whole picture.
    """
    tile = group // _GROUPS
    return ((tile // columns + top) * whole + tile % columns + left) * _GROUPS + group % _GROUPS


def lanes(view: Projection) -> int:
    """Return how many groups of pixels there are that share an origin and a time."""
    return view.tiles * _GROUPS


def lane_of(x: Any, y: Any, columns: Any) -> Any:
    """Return the group of the pixel (x, y), in a picture that is `columns` tiles wide.

    The pixels of a group lie four apart: of 4 × 4 neighbours each belongs to another.
    """
    block = y % TILE // _BLOCK_HEIGHT * _BLOCKS_ACROSS + x % TILE // _BLOCK_WIDTH
    place = y % _BLOCK_HEIGHT * _BLOCK_WIDTH + x % _BLOCK_WIDTH
    return _group(y // TILE * columns + x // TILE, block, place)
