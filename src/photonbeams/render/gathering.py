"""Gather the beams of a pass along camera paths: primary rays by tiles, all other segments by a grid."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import numpy as np

from ..beams import Beams
from ..beams.sets import BeamSet, merged
from ..estimators.coarse import on_film
from ..estimators.coarse_rays import RayImages
from ..estimators.estimate import ENDLESS, bind, estimate_rays
from ..estimators.geometry import Rays
from ..estimators.image import estimate_image
from ..estimators.lanes import Lattice, MoreSamples, PixelRays, lane_of
from ..estimators.points import Points
from ..estimators.projection import Projection
from ..looks import LightContext
from ..numerics.arrays import compressed, indices, joined
from ..numerics.structs import Struct
from ..runtime.device import Array2f, Array3f, Bool, Float, UInt32
from ..scene import SceneError
from ..world.cameras.sensors import PrimaryRays
from ..world.media.media import Media
from ..world.media.rendered import RenderedMedium
from .passes import Statistics
from .paths.branches import CameraPaths, add_to_pixels
from .paths.camera_paths import CameraVertex
from .tallied import TalliedView

# Segments that are collected for one query of the grid; building the grid takes as long as the query.
_MOST = 1 << 22


class PathSegments(Struct):
    """Segments of camera paths in media behind mirrors and glass, or those of panoramic cameras (`primary`)."""

    origin: Array3f
    direction: Array3f
    far: Float
    throughput: Array3f
    medium: UInt32
    pixel: UInt32
    branch: UInt32
    depth: UInt32
    seed: UInt32
    primary: Bool

    @classmethod
    def of(cls, paths: CameraPaths, vertex: CameraVertex) -> PathSegments:
        """Return the segments of one step."""
        result = cls()
        result.origin, result.direction = paths.origin + paths.near * paths.direction, paths.direction
        result.far = dr.minimum(vertex.end, ENDLESS) - paths.near
        result.throughput, result.medium = paths.throughput, paths.medium
        result.pixel, result.branch = paths.pixel, paths.branch
        result.depth, result.seed, result.primary = paths.depth, vertex.seed, paths.primary
        return result


@dataclass(frozen=True)
class EstimatorOptions:
    """Options of the estimate: `estimator`, `points` and `tolerance` as in `estimate_image`, and the longest path.

    `context` returns the light context of a set of beams.
    """

    estimator: str
    points: Points
    max_depth: int | None
    context: Callable[[BeamSet], LightContext] | None = None
    tolerance: float = 0.0


def is_coarse(options: EstimatorOptions, each: BeamSet, media: Media) -> bool:
    """Return whether `estimate_image` gathers a set of beams along fewer rays than pixels, where rays allow it."""
    medium = next((own for own in media.all if own.number == each.medium), None)
    if options.tolerance <= 0 or each.close is not None or medium is None or not len(each.beams):
        return False
    context = None if options.context is None else options.context(each)
    with naming_look(each):
        return bind(medium.shaded(each.look), each.beams, None, medium.medium, context).smooth


class Gathering:
    """The beams' radiance toward pixels, by light groups, over the steps of a pass.

    Parameters
    ----------
    view, primary
        The projection of the primary rays (or None), and the primary rays.
    media, sets
        The media, and the beams in them.
    estimating, statistics
        Options of the estimate, and the statistics that count its tests.
    """

    def __init__(
        self, view: Projection | None, primary: PrimaryRays, media: Media, sets: Sequence[BeamSet],
        options: EstimatorOptions, statistics: Statistics, more: MoreSamples | None = None,
        lattice: Lattice | None = None, tallied: Sequence[TalliedView] = (),
    ) -> None:  # fmt: skip
        self._view, self._primary, self._options, self._statistics = view, primary, options, statistics
        sets = merged(sets)
        self._media = [
            (medium, own) for medium in media.all if (own := [each for each in sets if each.medium == medium.number])
        ]
        self._lattice, self._tallied, self._step = lattice, tallied, 0
        self._more, self._count = more, dr.width(primary.direction)
        further = 0 if more is None else more.each * dr.width(more.pixels)
        self._pixels = self._count - further
        self._share = Float(1) if more is None else more.shares(self._pixels)
        self.radiance: dict[str, Any] = {each.group: dr.zeros(Array3f, self._count) for each in sets}
        self._steps: list[PathSegments] = []

    def add(self, paths: CameraPaths, vertex: CameraVertex) -> None:
        """Add the segments of one step of camera paths."""
        inside = paths.alive & (paths.medium > 0) & (vertex.end > paths.near)
        tiled = inside & paths.primary & Bool(self._view is not None)
        others = inside & ~tiled & (paths.pixel < dr.opaque(UInt32, self._pixels))
        dr.eval(tiled, others)
        for medium, sets in self._media:
            sets = [each for each in sets if not each.tallied]
            own = tiled & (paths.medium == dr.opaque(UInt32, medium.number))
            if self._view is not None and bool(dr.any(own)):
                self._add_tiled(medium, sets, paths, vertex, own)
        weights = [each.weight(paths) for each in self._tallied] if len(self._tallied) > 1 else [Float(1)]
        whole = dr.rcp(dr.maximum(sum(weights, Float(0)), 1e-6))
        for each, weight in zip(self._tallied, weights, strict=False):
            own = inside & paths.primary & (weight > 0)
            share = self._share * weight * whole
            each.add(self.radiance, self._step, paths, vertex, share=share, active=own)
        self._step += 1
        self._steps += compressed(others, PathSegments.of(paths, vertex))
        if sum(dr.width(each.pixel) for each in self._steps) > _MOST:
            self.finish()

    def _add_tiled(
        self, medium: RenderedMedium, sets: Sequence[BeamSet], paths: CameraPaths, vertex: CameraVertex, own: Bool
    ) -> None:
        medium.track(paths.origin, paths.direction, paths.near, vertex.end, vertex.seed, own)
        primary = self._primary
        rays = PixelRays(
            primary.origin, primary.direction, primary.facing, dr.select(own, dr.minimum(vertex.end, ENDLESS), 0),
            dr.select(own, paths.near, 0), primary.origins, more=self._more, lattice=self._lattice,
        )  # fmt: skip
        dr.eval(rays.t_max, rays.t_min)
        assert self._view is not None
        for each in sets:
            self._statistics.step()
            with naming_look(each):
                part = estimate_image(
                    each.beams, self._view, rays if each.close is None else replace(rays, times=primary.times),
                    look=medium.shaded(each.look), medium=medium.medium,
                    estimator=self._options.estimator, points=self._options.points, close=each.close,
                    context=self._context(each), tolerance=self._options.tolerance, step=self._statistics.stepping,
                )  # fmt: skip
            self.radiance[each.group] += dr.select(own, part.radiance * paths.throughput * self._share, 0)
            dr.eval(self.radiance[each.group])
            self._statistics.tests += part.billboard_tests + part.frustum_tests

    def _context(self, each: BeamSet) -> LightContext | None:
        return None if self._options.context is None else self._options.context(each)

    def finish(self) -> None:
        """Add the segments that were collected for the grid."""
        if not self._steps:
            return
        widths = [dr.width(each.pixel) for each in self._steps]
        segments = joined(self._steps)
        images = self._images(segments, widths)
        for medium, sets in self._media:
            own = segments.medium == dr.opaque(UInt32, medium.number)
            for each in sets:
                self._statistics.step()
                shown = own & ~segments.primary if each.tallied else own
                found = dr.zeros(Array3f, sum(widths))
                if images is not None:
                    images = replace(images, least=self._brought(each.group, segments))
                for lanes, beams in self._pairs(each, segments, shown):
                    part = None if images is None else images.taken(lanes)
                    dr.scatter(found, self._grid(medium, each, beams, segments, lanes, part), lanes)
                self._add_found(each.group, found, widths)
        self._steps = []

    def _images(self, segments: PathSegments, widths: Sequence[int]) -> RayImages | None:
        """Return the segments as pictures, one for each step and branch; None if beams are gathered along all."""
        tolerance = self._options.tolerance
        if self._lattice is None or self._view is None or tolerance <= 0:
            return None
        step = joined([dr.opaque(UInt32, number, width) for number, width in enumerate(widths)])
        branches = dr.max(segments.branch) + 1
        film = dr.gather(Array2f, on_film(self._view, self._primary.direction), segments.pixel)
        size = self._view.width, self._view.height
        return RayImages(
            self._lattice, size, step * branches + segments.branch, segments.pixel, film, Float(0), tolerance
        )

    def _brought(self, group: str, segments: PathSegments) -> Float:
        """Return the radiance along segments that would bring all the light of a group that their pixels have now."""
        brought = dr.max(dr.gather(Array3f, self.radiance[group], segments.pixel))
        return brought * dr.rcp(dr.maximum(dr.max(segments.throughput), 1e-6))

    def _add_found(self, group: str, found: Any, widths: Sequence[int]) -> None:
        """Add the radiance along segments to their pixels, step by step: each branch of a pixel has one in a step."""
        first = 0
        for step, width in zip(self._steps, widths, strict=True):
            here = dr.gather(Array3f, found, dr.arange(UInt32, width) + dr.opaque(UInt32, first))
            add_to_pixels(self.radiance[group], here * step.throughput, step.pixel, step.branch)
            first += width

    def _pairs(self, each: BeamSet, segments: PathSegments, own: Bool) -> list[tuple[Any, BeamSet]]:
        """Return lanes, each with its beams; beams that would make a path longer than allowed are left out."""
        lanes = indices(own)
        if not len(lanes):
            return []
        most = self._options.max_depth
        if most is None:
            return [(lanes, each)]
        result = []
        for depth in np.unique(dr.gather(UInt32, segments.depth, lanes).numpy()):
            beams = up_to(each, most - 2 - int(depth))
            if beams is not None:
                result.append((indices(own & (segments.depth == dr.opaque(UInt32, int(depth)))), beams))
        return result

    def _grid(
        self,
        medium: RenderedMedium,
        each: BeamSet,
        beams: BeamSet,
        segments: PathSegments,
        lanes: Any,
        images: RayImages | None,
    ) -> Any:
        count = len(lanes)
        origin, direction = (dr.gather(Array3f, one, lanes) for one in (segments.origin, segments.direction))
        far = dr.gather(Float, segments.far, lanes)
        time = self._time(dr.gather(UInt32, segments.pixel, lanes)) if beams.close is not None else None
        rays = Rays(origin, direction, far, dr.zeros(Float, count), time=time, index=dr.arange(UInt32, count))
        dr.eval(rays.origin, rays.direction, rays.t_max, rays.t_min, rays.time)
        seed = dr.gather(UInt32, segments.seed, lanes)
        medium.track(origin, direction, rays.t_min, far, seed, dr.full(Bool, True, count))
        with naming_look(each):
            return estimate_rays(
                beams.beams, rays, look=medium.shaded(each.look), medium=medium.medium, close=beams.close,
                estimator=self._options.estimator, points=self._options.points, context=self._context(each),
                images=images,
            )  # fmt: skip

    def _time(self, pixel: UInt32) -> Any:
        """Return the time of pixels' rays, from 0 to 1 over the pass's slice of the shutter interval."""
        assert self._primary.times is not None
        if self._view is None:
            return dr.gather(Float, self._primary.times, pixel)
        width = dr.opaque(UInt32, self._view.width)
        group = lane_of(pixel % width, pixel // width, self._view.counts.columns)
        return dr.gather(Float, self._primary.times, group)


def up_to(each: BeamSet, most: int) -> BeamSet | None:
    """Return the beams with at most `most` bounces, or None if there are none."""
    if most < 0:
        return None
    if each.depth is None:
        return each
    states: list[Beams] = [each.beams] if each.close is None else [each.beams, each.close]
    kept = compressed(each.depth <= dr.opaque(UInt32, most), *states)
    return each._replace(beams=kept[0], close=kept[1] if len(kept) > 1 else None) if kept else None


@contextmanager
def naming_look(each: BeamSet) -> Iterator[None]:
    """Prefix a look's errors with the name of its set of beams, which the look itself does not know."""
    try:
        yield
    except SceneError as error:
        if not each.name:
            raise
        raise SceneError(f"{each.name}: {error}") from error
