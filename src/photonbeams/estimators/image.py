"""Radiance of beams toward all pixels of a picture: each tile has a list of candidate beams for the estimators.

There are two kernels. The billboard's carries eight pixels in each lane and visits every candidate; for `auto` it also
marks, in each entry of the lists, the blocks of the tile of which some pixel needs the frustum. The frustum's kernel
then visits only those.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import drjit as dr

from ..beams import Beams
from ..looks import BoundLook, LightContext, Look
from ..runtime.device import Array3f, Bool, Float, UInt32, UInt64
from ..scene import Medium
from .billboard import billboard_sum
from .cells import batches
from .coarse import Level, depths, dim_of, foretold, interpolated, levels_of
from .estimate import ENDLESS, bind, check_estimator, check_motion
from .footprints import footprints
from .frustum import frustum_sum
from .geometry import Rays
from .lanes import PIXELS, LaneRay, Lanes, PixelRays, lanes_of_pixels, lanes_of_some, tiles_of
from .points import Points
from .projection import Projection
from .records import Packed, pack
from .tiles import Bins, TileLists

# The most tests of a kernel if the picture may be ended between kernels: about a tenth of a second on two cores, as
# measured with the keyhole. Parts begin where vectors of lanes begin.
_MOST_TESTS, _ALIGNED = 1e7, 64


@dataclass
class ImageRadiance:
    """Radiance of all rays, (N, 3), and the numbers of ray–beam tests in the two kernels."""

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
    step: Callable[[], None] | None = None,
) -> ImageRadiance:
    """Return the radiance of beams along the rays: the same as `estimate`, to float32 rounding.

    With a `tolerance`, beams with smooth looks are gathered along fewer rays, so few that the relative error is about
    that (see `coarse`); the rays must have one origin and a lattice. With noise in looks, more beams are billboards
    then. `step` is called between kernels, which are short then; an exception from it ends the estimate.
    """
    check_estimator(estimator)
    check_motion(beams, close, rays.times)
    if len(beams) == 0:
        return ImageRadiance(dr.zeros(Array3f, dr.width(rays.direction)))
    bound, levels = bind(look, beams, close, medium, context), [Level(0, view, rays)]
    bound.lenient = tolerance > 0
    if tolerance > 0 and rays.lattice is not None and rays.shared_origin and close is None and bound.smooth:
        levels = levels_of(view, rays)
    gather = _ImageGather(
        levels=levels,
        beams=beams,
        close=close,
        look=bound,
        points=points,
        estimator=estimator,
        tolerance=tolerance,
        step=step,
    )
    for each in batches(gather.binned, len(beams)):
        if each.entries:
            gather.add(each)
    return gather.result


class _Binned:
    """A range of the beams, counted in the tiles of all levels."""

    def __init__(self, bins: Sequence[Bins], beams: range) -> None:
        self._bins, self.beams, self.entries = bins, beams, sum(each.entries for each in bins)
        self.by_level: list[TileLists] = []

    def lists(self) -> _Binned:
        """List the beams of each level's tiles."""
        self.by_level = [each.lists() for each in self._bins]
        return self


class _ImageGather:
    """Gathers the beams of a picture.

    Parameters
    ----------
    levels
        The levels of the picture.
    beams, close
        The beams, and where they are at shutter close.
    look, points, estimator, tolerance, step
        As for `estimate_image`; the look is bound.
    """

    def __init__(
        self, levels: Sequence[Level], beams: Beams, close: Beams | None, look: BoundLook, points: Points,
        estimator: str, tolerance: float, step: Callable[[], None] | None,
    ) -> None:  # fmt: skip
        first, self._step = levels[0], step
        shared = first.rays.shared_origin
        self._packed = pack(beams, first.rays.origin if shared else first.view.origin, shared, close, look.of_beams)
        self._levels, self._look, self._points = levels, look, points
        self._estimator, self._tolerance = estimator, tolerance
        self._depth = depths(levels, tile_depth(first.view, first.rays))
        self._marks = [footprints(beams, level.view, close) for level in levels]
        self.result = ImageRadiance(dr.zeros(Array3f, dr.width(first.rays.direction)))

    def binned(self, begin: int, stop: int) -> _Binned:
        """Return a range of the beams, counted in the tiles of all levels."""
        bins = []
        for level, marks, depth in zip(self._levels, self._marks, self._depth, strict=True):
            widths = level.widths(len(self._levels)) if self._levels[1:] else None
            bins.append(Bins(marks, level.view, depth, begin, stop, widths))
        return _Binned(bins, range(begin, stop))

    def add(self, binned: _Binned) -> None:
        """Add the beams of a range, level by level from the coarsest one on."""
        found, good, dim = None, None, None
        for level, lists in zip(reversed(self._levels), reversed(binned.by_level), strict=True):
            radiance = dr.zeros(Array3f, dr.width(level.rays.direction))
            if lists.entries:
                self._sum(radiance, level, lists, partial(lanes_of_pixels, level.view, level.rays))
            if found is not None:
                usable, told = interpolated(level, self._levels[level.number + 1], found, good, self._tolerance)
                radiance += dr.select(usable, told, 0)
                dr.eval(radiance)
                self._add_exact(radiance, level, ~usable, binned.beams)
            found = radiance
            if level.number:
                dim = dim_of(radiance) if dim is None else dim
                good = foretold(level, radiance, dim, self._tolerance)
        self.result.radiance += found
        dr.eval(self.result.radiance)

    def _add_exact(self, radiance: Array3f, level: Level, some: Bool, beams: range) -> None:
        """Add the beams of all coarser levels along `some` rays (a mask) of a level."""
        depth, widths = level.of_coarser(some, self._depth[level.number])

        def sort(begin: int, stop: int) -> Bins:
            return Bins(self._marks[level.number], level.view, depth, beams.start + begin, beams.start + stop, widths)

        for lists in batches(sort, len(beams)):
            if lists.entries:
                self._sum(radiance, level, lists, partial(lanes_of_some, level.view, level.rays, some))

    def _sum(self, radiance: Array3f, level: Level, lists: TileLists, lanes: Callable[..., Lanes | None]) -> None:
        """Add the radiance of listed beams along the rays of a level that lanes carry."""
        marks = None
        if self._estimator != "frustum" and (lane := lanes(PIXELS, lists.busy)) is not None:
            marks = dr.zeros(UInt32, lists.entries) if self._estimator == "auto" else None
            self.result.billboard_tests += (tests := _tests(lists, lane))
            for part in self._parts(lane, tests):
                rays, blocks = (
                    [_lane_rays(level, ray, part.group) for ray in part.rays],
                    [ray.block for ray in part.rays],
                )
                values = billboard_sum(rays, *self._seen(lists, part), marks is not None, marks, blocks)
                # Evaluate all rays of a lane in one kernel: otherwise each scatter would run the loop again.
                dr.eval(values, marks)
                _add(radiance, part, values)
        if marks is not None:
            lists = lists.keep(marks)
        if self._estimator == "billboard" or not lists.entries or (lane := lanes(1, lists.busy)) is None:
            return
        self.result.frustum_tests += (tests := _tests(lists, lane))
        for part in self._parts(lane, tests):
            (own,) = part.rays

            def wanted(i: UInt32, own: LaneRay = own) -> Bool:
                return (dr.gather(UInt32, lists.marks, i) & own.block) > 0

            ray, seen = _lane_rays(level, own, part.group), self._seen(lists, part)
            _add(radiance, part, [frustum_sum(ray, *seen, marks is not None, None if marks is None else wanted)])

    def _parts(self, lane: Lanes, tests: int) -> Iterator[Lanes]:
        """Yield lanes in parts whose kernels are short, if the estimate may be ended between them; else all at once."""
        width = dr.width(lane.tile)
        if self._step is None or tests <= _MOST_TESTS:
            yield lane
            return
        size = max(int(width * _MOST_TESTS / tests) // _ALIGNED, 1) * _ALIGNED
        for begin in range(0, width, size):
            self._step()
            yield lane.part(begin, min(begin + size, width))

    def _seen(
        self, lists: TileLists, lane: Lanes
    ) -> tuple[UInt32, UInt32, Callable[[UInt32], UInt32], Packed, BoundLook, Points]:
        """Return the arguments of kernels for listed beams: where lists begin and stop, and what is in them."""
        tile = lane.tile
        first, stop = dr.gather(UInt32, lists.first, tile), dr.gather(UInt32, lists.stop, tile)
        return first, stop, lambda i: dr.gather(UInt32, lists.beams, i), self._packed, self._look, self._points


def _add(radiance: Array3f, lane: Lanes, values: Sequence[Array3f]) -> None:
    """Add radiance to that of the rays of lanes; no ray occurs twice."""
    for ray, value in zip(lane.rays, values, strict=True):
        here = ray.exists & dr.full(Bool, True, dr.width(lane.tile))
        dr.scatter_add(radiance, value, ray.index, here, dr.ReduceMode.NoConflicts)
    dr.eval(radiance)


def _tests(lists: TileLists, lane: Lanes) -> int:
    """Return how many pairs of rays and beams are tested."""
    found = dr.gather(UInt32, lists.stop, lane.tile) - dr.gather(UInt32, lists.first, lane.tile)
    return int(dr.sum(UInt64(found))[0]) * len(lane.rays)


def tile_depth(view: Projection, rays: PixelRays) -> Float:
    """Return (tiles,) the planar depth of the farthest surface in each tile."""
    depth = dr.minimum(rays.t_max, ENDLESS) * rays.facing
    result = dr.zeros(Float, view.tiles)
    # By default, the kernel would contain the number of tiles.
    dr.scatter_reduce(dr.ReduceOp.Max, result, depth, tiles_of(view, rays), mode=dr.ReduceMode.Local)
    dr.eval(result)
    return result


def _lane_rays(level: Level, ray: LaneRay, group: UInt32) -> Rays:
    """Return a ray of each lane, of the lane's group of pixels."""
    rays, view, pixel, inside = level.rays, level.view, ray.index, ray.exists
    origin = None if rays.origins is None else dr.gather(Array3f, rays.origins, group)
    time = None if rays.times is None else dr.gather(Float, rays.times, group)
    if view.orthographic:
        origin = dr.gather(Array3f, rays.origin, pixel, inside)
    # Outside of the picture t_max is 0: such a ray meets nothing.
    return Rays(
        origin=None if rays.shared_origin else origin - view.origin,
        direction=dr.gather(Array3f, rays.direction, pixel, inside),
        t_max=dr.gather(Float, rays.t_max, pixel, inside),
        t_min=dr.gather(Float, rays.t_min, pixel, inside),
        shared_origin=rays.shared_origin,
        time=time,
        base=rays.origin if rays.shared_origin else view.origin,
        index=dr.select(inside, pixel, 0),  # factors look up data by this number, and beside the picture there is none
    )
