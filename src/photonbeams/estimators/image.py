"""Radiance of beams toward all pixels of a picture: the estimators behind each tile's list of candidates.

Two kernels. The billboard's carries eight pixels a lane and visits every candidate; for `auto` it also marks the
entries of the lists in which some pixel needs the frustum. The frustum's kernel then visits those alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import drjit as dr

from ..beams import Beams
from ..looks import LightContext, Look
from ..numerics.arrays import joined
from ..runtime.device import Array3f, Bool, Float, UInt32
from ..scene import Medium
from .billboard import billboard_sum
from .cells import batches
from .estimate import ENDLESS, bind, check_estimator, check_motion
from .frustum import frustum_sum
from .geometry import Rays
from .points import Points
from .records import Packed, pack
from .tiles import TILE, Bins, Projection, TileLists, footprints

#: Pixels a lane of the billboard's kernel. A beam is gathered once for all of them: of 1, 4 and 8 pixels, 8 are the
#: fastest on two AVX-512 cores.
PIXELS = 8


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


@dataclass
class Estimate:
    """Radiance of all rays, (N, 3), and how many ray–beam tests the billboard's kernel has made, and the frustum's."""

    radiance: Any
    billboard_tests: int = 0
    frustum_tests: int = 0


def estimate_image(
    beams: Beams,
    view: Projection,
    rays: PixelRays,
    *,
    look: Look,
    medium: Medium | None,
    estimator: str = "auto",
    points: Points,
    close: Beams | None = None,
    context: LightContext | None = None,
) -> Estimate:
    """Return the radiance of beams along the rays; the same numbers as `estimate`, to float32 rounding."""
    check_estimator(estimator)
    check_motion(beams, close, rays.lanes)
    result = Estimate(dr.zeros(Array3f, dr.width(rays.direction)))
    if len(beams) == 0:
        return result
    bound = bind(look, beams, close, medium, context)
    shared = rays.shared_origin
    packed = pack(beams, rays.origin if shared else view.origin, shared, close, bound.of_beams)
    marks, depth = footprints(beams, view, close), tile_depth(view, rays)
    for lists in batches(partial(Bins, marks, view, depth), marks.count):
        if lists.entries == 0:
            continue
        flags = None
        if estimator != "frustum":
            flags = dr.zeros(UInt32, lists.entries) if estimator == "auto" else None
            result.billboard_tests += lists.entries * TILE * TILE
            result.radiance += _billboards(lists, view, rays, packed, bound, points, flags)
        if flags is not None:
            lists = lists.keep(flags)
        if estimator != "billboard" and lists.entries:
            result.frustum_tests += lists.entries * TILE * TILE
            result.radiance += _frustums(lists, view, rays, packed, bound, points, blended=estimator == "auto")
        dr.eval(result.radiance)
    return result


def tile_depth(view: Projection, rays: PixelRays) -> Any:
    """Return (tiles,) the planar depth of the farthest surface in each tile."""
    pixel = dr.arange(UInt32, view.width * view.height)
    if rays.more is not None:
        pixel = joined([pixel, *[rays.more.pixels] * rays.more.each])
    tile = _tile_of(view, pixel)
    depth = dr.minimum(rays.t_max, ENDLESS) * rays.facing
    result = dr.zeros(Float, view.tiles)
    dr.scatter_reduce(dr.ReduceOp.Max, result, depth, tile)
    dr.eval(result)
    return result


def _tile_of(view: Projection, pixel: Any) -> Any:
    """Return the tile of pixels."""
    width, columns = dr.opaque(UInt32, view.width), dr.opaque(UInt32, view.columns)
    return (pixel // width) // TILE * columns + (pixel % width) // TILE


# Neighbouring lanes carry neighbouring pixels, so that a vector of lanes sees a small block of the picture: a beam
# passes most blocks by, and what no lane needs is skipped.
_BLOCK_WIDTH, _BLOCK_HEIGHT = 4, 4
_BLOCK = _BLOCK_WIDTH * _BLOCK_HEIGHT
_BLOCKS_ACROSS = TILE // _BLOCK_WIDTH

# Groups of pixels in a tile that share an origin and a time: those of the billboard's lanes.
_GROUPS = TILE * TILE // PIXELS


class _Lanes:
    """The rays of lanes that carry `count` of them: tile after tile, block after block within a tile.

    Behind these, lanes carry further rays of one pixel each.
    """

    def __init__(self, view: Projection, rays: PixelRays, count: int) -> None:
        per_tile, more = TILE * TILE // count, rays.more or MoreSamples(dr.zeros(UInt32, 0), 1)
        usual, edges, pixels = view.tiles * per_tile, dr.width(more.pixels), view.width * view.height
        for_edge = -(-more.each // count)
        lane = dr.arange(UInt32, usual + edges * for_edge)
        first, lanes = dr.opaque(UInt32, usual), dr.opaque(UInt32, for_edge)
        self._behind = lane >= first
        edge = dr.select(self._behind, (lane - first) // lanes, 0)
        # Of two and more: a gather from one is a broadcast, hence another kernel.
        known = dr.zeros(UInt32, 2)
        pixel = dr.gather(UInt32, joined([more.pixels, known]) if edges else known, edge, self._behind)
        self.tile, local = dr.select(self._behind, _tile_of(view, pixel), lane // per_tile), lane % per_tile
        self._block, self._place = local // _BLOCK * count, local % _BLOCK
        self.group = _group(self.tile, self._block, self._place)
        self._width, self._height = dr.opaque(UInt32, view.width), dr.opaque(UInt32, view.height)
        self._columns = dr.opaque(UInt32, view.columns)
        self._sample = dr.select(self._behind, (lane - first) % lanes * count, 0)
        self._each, self._step = dr.opaque(UInt32, more.each), dr.opaque(UInt32, edges)
        self._first = dr.opaque(UInt32, pixels) + edge

    def ray(self, number: int) -> tuple[Any, Any]:
        """Return the index of a lane's ray, and whether there is one."""
        block = self._block + number
        x = (self.tile % self._columns) * TILE + block % _BLOCKS_ACROSS * _BLOCK_WIDTH + self._place % _BLOCK_WIDTH
        y = (self.tile // self._columns) * TILE + block // _BLOCKS_ACROSS * _BLOCK_HEIGHT + self._place // _BLOCK_WIDTH
        sample = self._sample + number
        index = dr.select(self._behind, self._first + sample * self._step, y * self._width + x)
        return index, dr.select(self._behind, sample < self._each, (x < self._width) & (y < self._height))


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


def _lane_rays(rays: PixelRays, view: Projection, pixel: Any, inside: Any, group: Any) -> Rays:
    """Return the ray of an index, of a group of pixels."""
    origin, time = None, None
    if rays.lanes is not None:
        origin, time = dr.gather(Array3f, rays.lanes[0], group), dr.gather(Float, rays.lanes[1], group)
    if view.orthographic:
        origin = dr.gather(Array3f, rays.origin, pixel, inside)
    # Outside of the picture t_max = 0: such a ray meets nothing.
    return Rays(
        None if rays.shared_origin else origin - view.origin,
        dr.gather(Array3f, rays.direction, pixel, inside),
        dr.gather(Float, rays.t_max, pixel, inside),
        dr.gather(Float, rays.t_min, pixel, inside),
        rays.shared_origin,
        time,
        rays.origin if rays.shared_origin else view.origin,
        dr.select(inside, pixel, 0),  # factors look up what belongs to a ray, and beside the picture there is nothing
    )


def _billboards(
    lists: TileLists, view: Projection, rays: PixelRays, packed: Packed, look: Any, points: Points, flags: Any
) -> Any:
    lane = _Lanes(view, rays, PIXELS)
    pixels = [lane.ray(number) for number in range(PIXELS)]
    radiance = billboard_sum(
        [_lane_rays(rays, view, *pixel, lane.group) for pixel in pixels],
        dr.gather(UInt32, lists.first, lane.tile),
        dr.gather(UInt32, lists.stop, lane.tile),
        lambda i: dr.gather(UInt32, lists.beams, i),
        packed,
        look,
        points,
        blended=flags is not None,
        flags=flags,
    )
    # One kernel for all pixels of a lane: left to the scatters, the loop would run once for each.
    dr.eval(radiance, flags)
    picture = dr.zeros(Array3f, dr.width(rays.direction))
    for (pixel, inside), value in zip(pixels, radiance, strict=True):
        dr.scatter(picture, value, pixel, inside)
    dr.eval(picture)
    return picture


def _frustums(
    lists: TileLists, view: Projection, rays: PixelRays, packed: Packed, look: Any, points: Points, blended: bool
) -> Any:
    lane = _Lanes(view, rays, 1)
    pixel, inside = lane.ray(0)
    radiance = frustum_sum(
        _lane_rays(rays, view, pixel, inside, lane.group),
        dr.gather(UInt32, lists.first, lane.tile),
        dr.gather(UInt32, lists.stop, lane.tile),
        lambda i: dr.gather(UInt32, lists.beams, i),
        packed,
        look,
        points,
        blended,
    )
    picture = dr.zeros(Array3f, dr.width(rays.direction))
    dr.scatter(picture, radiance, pixel, inside & dr.full(Bool, True, dr.width(pixel)))
    dr.eval(picture)
    return picture
