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
from ..runtime.device import Array3f, Bool, Float, UInt32
from ..scene import Medium
from . import coarse
from .billboard import billboard_sum
from .cells import batches
from .estimate import ENDLESS, bind, check_estimator, check_motion
from .frustum import frustum_sum
from .geometry import Rays
from .lanes import PIXELS, PixelRays, Sheet, lanes_of_pixels, tiles_of
from .points import Points
from .records import Packed, pack
from .tiles import LEVELS, TILE, Bins, Projection, TileLists, footprints


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
    tolerance: float = 0.0,
) -> Estimate:
    """Return the radiance of beams along the rays; the same numbers as `estimate`, to float32 rounding.

    With a `tolerance` wide smooth beams are looked at along fewer rays, of one origin, and interpolated: as few as
    leave about that relative error.
    """
    check_estimator(estimator)
    check_motion(beams, close, rays.lanes)
    result = Estimate(dr.zeros(Array3f, dr.width(rays.direction)))
    if len(beams) == 0:
        return result
    bound = bind(look, beams, close, medium, context)
    shared = rays.shared_origin
    packed = pack(beams, rays.origin if shared else view.origin, shared, close, bound.of_beams)
    pixels = Sheet(rays, TILE * TILE, partial(lanes_of_pixels, view, rays), lambda radiance: radiance)
    sheets, marks, depth = [pixels], footprints(beams, view, close), tile_depth(view, rays)
    sort = partial(Bins, marks, view, depth)
    if tolerance > 0 and shared and close is None and not view.orthographic and bound.smooth:
        detail = coarse.detail_of(view, rays, bound, sort(0, marks.count), tolerance)
        sheets += [coarse.sheet(view, rays, detail.begin, level) for level in range(1, LEVELS)]
        sort = partial(sort, detail=detail)
    for lists in batches(sort, marks.count):
        if lists.entries == 0:
            continue
        found: list[Any] = [Array3f(0) for _ in sheets]
        flags = None
        if estimator != "frustum":
            flags = dr.zeros(UInt32, lists.entries) if estimator == "auto" else None
            for number, each in enumerate(sheets):
                result.billboard_tests += lists.sizes[number] * each.per_tile
                if lists.sizes[number]:
                    found[number] += _billboards(lists, number, view, each, packed, bound, points, flags)
        if flags is not None:
            lists = lists.keep(flags)
        if estimator != "billboard" and lists.entries:
            for number, each in enumerate(sheets):
                result.frustum_tests += lists.sizes[number] * each.per_tile
                if lists.sizes[number]:
                    found[number] += _frustums(lists, number, view, each, packed, bound, points, flags is not None)
        for each, radiance in zip(sheets, found, strict=True):
            if dr.width(radiance) > 1:
                result.radiance += each.spread(radiance)
        dr.eval(result.radiance)
    return result


def tile_depth(view: Projection, rays: PixelRays) -> Any:
    """Return (tiles,) the planar depth of the farthest surface in each tile."""
    depth = dr.minimum(rays.t_max, ENDLESS) * rays.facing
    result = dr.zeros(Float, view.tiles)
    dr.scatter_reduce(dr.ReduceOp.Max, result, depth, tiles_of(view, rays))
    dr.eval(result)
    return result


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
    lists: TileLists, level: int, view: Projection, sheet: Sheet, packed: Packed, look: Any, points: Points, flags: Any
) -> Any:
    lane = sheet.carried(PIXELS)
    tile = lane.tile + dr.opaque(UInt32, level * view.tiles)
    radiance = billboard_sum(
        [_lane_rays(sheet.rays, view, *ray, lane.group) for ray in lane.rays],
        dr.gather(UInt32, lists.first, tile),
        dr.gather(UInt32, lists.stop, tile),
        lambda i: dr.gather(UInt32, lists.beams, i),
        packed,
        look,
        points,
        blended=flags is not None,
        flags=flags,
    )
    # One kernel for all rays of a lane: left to the scatters, the loop would run once for each.
    dr.eval(radiance, flags)
    result = dr.zeros(Array3f, dr.width(sheet.rays.direction))
    for (ray, exists), value in zip(lane.rays, radiance, strict=True):
        dr.scatter(result, value, ray, exists)
    dr.eval(result)
    return result


def _frustums(
    lists: TileLists, level: int, view: Projection, sheet: Sheet, packed: Packed, look: Any, points: Points,
    blended: bool,
) -> Any:  # fmt: skip
    lane = sheet.carried(1)
    tile = lane.tile + dr.opaque(UInt32, level * view.tiles)
    ((ray, exists),) = lane.rays
    radiance = frustum_sum(
        _lane_rays(sheet.rays, view, ray, exists, lane.group),
        dr.gather(UInt32, lists.first, tile),
        dr.gather(UInt32, lists.stop, tile),
        lambda i: dr.gather(UInt32, lists.beams, i),
        packed,
        look,
        points,
        blended,
    )
    result = dr.zeros(Array3f, dr.width(sheet.rays.direction))
    dr.scatter(result, radiance, ray, exists & dr.full(Bool, True, dr.width(ray)))
    dr.eval(result)
    return result
