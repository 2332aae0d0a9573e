"""Passes over camera rays: light first, then what the rays see of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import numpy as np

from ..beams.sets import BeamSet
from ..estimators.lanes import Lattice, MoreSamples
from ..estimators.points import Points
from ..estimators.projection import Projection
from ..looks import LightContext
from ..numerics.arrays import compressed, joined, taken, to_uint
from ..numerics.grouped import GroupedLight
from ..numerics.samples import BITS, CountedSamples, Samples
from ..runtime.device import Array3f, Bool, Float, UInt32, check_recording
from ..transport.segments.records import PhotonHits
from ..world.cameras.sensors import PrimaryRays
from ..world.world import World
from .films.film import Groups, PassPicture
from .films.sums import ALBEDO, MEAN_NORMAL
from .gathering import EstimatorOptions, Gathering, is_coarse
from .light import NoLighting, ShotLight, TracedLight, max_bounces
from .passes import Statistics
from .paths import camera_paths
from .paths.branches import CameraPaths, add_to_pixels
from .paths.camera_paths import CameraTracing
from .paths.photons import PhotonLighting
from .paths.surface_light import NO_LIGHT, SurfaceLight
from .paths.virtual_lights import VirtualLights
from .settings import Settings
from .tallied import TalliedView
from .techniques import FURTHER, PHOTONS


@dataclass(frozen=True)
class ViewRays:
    """A view's camera rays in a pass, and their projection (or None).

    With a `holdout` rays see no surfaces, and these are the distances at which they end; else it is None. `lattice`
    tells which rays are evenly spaced. If there is also overscan, `inside` has the indices of the rays inside the
    picture, and these as rays of their own.
    """

    primary: PrimaryRays
    view: Projection | None
    holdout: Any = None
    lattice: Lattice | None = None
    inside: tuple[UInt32, ViewRays] | None = None


class PassRenderer:
    """Renders passes: light first, then what camera rays see of it.

    Parameters
    ----------
    settings, light
        How passes are rendered, and their light.
    max_depth
        The longest path in edges, as in Mitsuba's integrators; None: no limit.
    statistics
        Statistics to which those of the passes are added.
    planned
        How many passes share each pixel's sample sequence; further passes begin it again. None: any number.

    Raises
    ------
    DeviceError
        Within a function that `drjit.freeze` records.
    """

    def __init__(
        self, settings: Settings, light: ShotLight, max_depth: int | None, statistics: Statistics | None = None,
        planned: int | None = None,
    ) -> None:  # fmt: skip
        check_recording()
        self.settings, self.light, self.planned = settings, light, planned
        self.statistics = statistics or Statistics()
        self._max_depth = max_depth
        self._points = Points(settings.rule)

    def samples(self, number: int, together: int = 0, each: int = 1) -> Samples:
        """Return the samples of pass `number`, or of sample `number` if all pixels have `each` samples in a pass.

        There may be 2^`together` of them.
        """
        bits = BITS if self.planned is None else min((each * self.planned - 1).bit_length(), BITS)
        return Samples(self.settings.seed, number, bits, together)

    def counted_samples(self, number: int, most: int, other: int = 0) -> CountedSamples:
        """Return the samples of pass `number`, up to `most` of a pixel; another value of `other` gives others."""
        bits = BITS if self.planned is None else (self.planned - 1).bit_length()
        return CountedSamples(self.settings.seed + other, number, bits, most)

    def lit(self, number: int) -> tuple[TracedLight, SurfaceLight]:
        """Return the beams and photons of pass `number`, and the light of traced paths on surfaces."""
        with self.statistics.phase("simulate"):
            light = self.light.traced(number, self.statistics.step)
            return light, self._surface_light(light)

    def count(self, light: TracedLight) -> None:
        """Count the beams of a pass."""
        self.statistics.beams += sum(len(each.beams) for each in light.sets)

    def _surface_light(self, light: TracedLight) -> SurfaceLight:
        """Return the photons and virtual lights of a pass."""
        others, virtual = light.hits, None
        walks = self.light.walks(light.world).surfaces
        if walks is not None and walks.bound is not None:
            straight = [part for each in light.hits for part in compressed(each.straight, each)]
            others = [part for each in light.hits for part in compressed(~each.straight, each)]
            virtual = VirtualLights(light.world, straight, light.bounces, walks.bound)

        def lighting(hits: Sequence[PhotonHits]) -> PhotonLighting | None:
            most = max_bounces(self._max_depth)
            return PhotonLighting(light.world, hits, light.limits, most) if hits else None

        photons = caustics = lighting(others)
        if walks is not None and any(row.by(PHOTONS, FURTHER) for row in self.light.rows):
            # Camera paths have met all that these emitters light: what lies behind a bounce would count twice.
            caustics = lighting([part for each in others for part in compressed(~each.whole, each)])
        return SurfaceLight(photons, caustics, virtual)

    def seen(
        self, light: TracedLight, rays: ViewRays, order: UInt32, samples: Samples, surfaces: SurfaceLight
    ) -> PassPicture:  # fmt: skip
        """Return what camera rays see, except beams; `order` are their numbers in the sample sequences."""
        statistics, count = self.statistics, dr.width(rays.primary.direction)
        tracing = self.camera_tracing(light.world, rays)
        walks, groups = self.light.walks(light.world), light.world.groups
        picture = CameraImage(count, len(groups), tracing.albedo, len(groups) if tracing.normals else 0)
        sky = self.light.single_scattering(light.world, count, samples)
        walked = {group: GroupedLight.dark(1, count) for group, _ in walks.media}
        with statistics.phase("surfaces"):
            begun = camera_paths.begin(tracing, rays.primary, order)
            for step in camera_paths.follow(tracing, begun, samples, surfaces):
                statistics.step()
                picture.add(*step)
                if sky is not None:
                    sky.add(*step)
                for group, walking in walks.media:
                    walking.add_scattered(*step, samples, walked[group])
                if walks.surfaces is not None:
                    walks.surfaces.add_reflected(*step, samples, surfaces, picture.surface)
        scattered = {group: light.total for group, light in walked.items()}
        for group, found in ({} if sky is None else sky.radiance).items():
            scattered[group] = scattered.get(group, 0) + found
        guides = {ALBEDO: picture.albedo} if tracing.albedo else {}
        if self.settings.denoise:
            guides[MEAN_NORMAL] = picture.normal
        surface, emitted = (dict(zip(groups.names, each.parts, strict=bool(each.parts)))
                            for each in (picture.surface, picture.emitted))  # fmt: skip
        return PassPicture(surface, picture.alpha, scattered, picture.transmittance, picture.reach, guides, emitted)

    def gathered(
        self, number: int, light: TracedLight, rays: ViewRays, order: UInt32, samples: Samples,
        more: MoreSamples | None = None, tallied: Sequence[TalliedView] = (),
    ) -> Groups:  # fmt: skip
        """Return the light of the beams of pass `number` along camera rays; with `more`, some pixels have several.

        That of the pass's tally is added, `tallied` toward views that together show all.
        """
        if not light.sets and not tallied:
            return {}
        if rays.inside is not None:
            return self._gathered_apart(
                number=number,
                light=light,
                rays=rays,
                inside=rays.inside,
                order=order,
                samples=samples,
                more=more,
                tallied=tallied,
            )
        statistics, options = self.statistics, self.options(number)
        tracing = unshaded(self.camera_tracing(light.world, rays))
        with statistics.phase("beams"):
            gathering = Gathering(
                view=rays.view,
                primary=rays.primary,
                media=light.world.media,
                sets=light.sets,
                options=options,
                statistics=statistics,
                more=more,
                lattice=rays.lattice,
                tallied=tallied,
            )
            begun = camera_paths.begin(tracing, rays.primary, order)
            for step in camera_paths.follow(tracing, begun, samples, NO_LIGHT):
                gathering.add(*step)
            gathering.finish()
        return gathering.radiance

    def options(self, number: int) -> EstimatorOptions:
        """Return the options of the estimate in pass `number`."""
        clock, zero = self.clock(number), self.light.world.zero
        return EstimatorOptions(
            self.settings.estimator, self._points, self._max_depth,
            lambda each: LightContext(*clock, each.light, each.to_world, zero), self.settings.gather_error,
        )  # fmt: skip

    def clock(self, number: int) -> tuple[float, float]:
        """Return the frame number and the time in seconds of a pass, for looks that change with time."""
        return self.light.clock(number)

    def coarse(self, number: int, light: TracedLight, each: BeamSet) -> bool:
        """Return whether pictures gather a set of the beams of pass `number` along fewer rays than pixels."""
        return is_coarse(self.options(number), each, light.world.media)

    def _gathered_apart(
        self, number: int, light: TracedLight, rays: ViewRays, inside: tuple[UInt32, ViewRays], order: UInt32,
        samples: Samples, more: MoreSamples | None, tallied: Sequence[TalliedView],
    ) -> Groups:  # fmt: skip
        """Return what `_gathered` returns, gathered apart for the picture and for overscan.

        Where some rays of the picture stand for others, which ones do must not depend on overscan.
        """
        index, own = inside
        if more is not None:
            index, own, own_more = _more_inside(rays, index, own, more)
        else:
            own_more = None
        beyond = dr.full(Bool, True, dr.width(rays.primary.direction))
        dr.scatter(beyond, Bool(False), index)
        far = dr.select(beyond, rays.primary.far, 0)
        dr.eval(far)
        rest = replace(rays, primary=replace(rays.primary, far=far), lattice=None, inside=None)
        result = dict(self.gathered(number, light, rest, order, samples, more, tallied))
        inside_picture = self.gathered(number, light, own, taken(order, index), samples, own_more, tallied)
        for group, radiance in inside_picture.items():
            dr.scatter(result[group], radiance, index)
        return result

    def camera_tracing(self, world: World, rays: ViewRays) -> CameraTracing:
        """Return how camera paths are traced in a world."""
        settings = self.settings
        if rays.holdout is not None:
            world = world.without_surfaces()
            lighting = NoLighting(world)
            return CameraTracing(world, lighting, None, settings.rr_depth, True, surfaces=False, sharp=world.sharp)
        return CameraTracing(
            world, self.light.lighting(world), self._max_depth, settings.rr_depth, settings.hide_emitters,
            settings.surfaces, world.sharp, walked=self.light.walks(world).walked,
            normals=settings.denoise, albedo=settings.denoise or settings.albedo,
        )  # fmt: skip


def _more_inside(
    rays: ViewRays, index: UInt32, own: ViewRays, more: MoreSamples
) -> tuple[UInt32, ViewRays, MoreSamples | None]:
    """Return indices, rays and further samples of the pixels inside the picture, with their further rays."""
    edges, pixels = more.pixels.numpy(), dr.width(rays.primary.direction) - more.each * dr.width(more.pixels)
    place = np.full(pixels, -1, np.int64)
    place[index.numpy()] = np.arange(dr.width(index))
    chosen = np.flatnonzero(place[edges] >= 0)
    if not len(chosen):
        return index, own, None
    lanes = to_uint((pixels + np.arange(more.each)[:, None] * len(edges) + chosen).ravel())
    further = PrimaryRays.joined([rays.primary]).taken(lanes)
    own = replace(own, primary=own.primary.with_more(further))
    return joined([index, lanes]), own, MoreSamples(to_uint(place[edges[chosen]]), more.each)


def unshaded(tracing: CameraTracing) -> CameraTracing:
    """Return the same tracing for paths that only find where surfaces are."""
    return replace(tracing, surfaces=False, walked=None, shining=False, normals=False, albedo=False)


class CameraImage:
    """The surfaces that camera paths see in a pass, by pixels.

    Normals are those of surfaces straight ahead. With `guides`, normals and albedos are those of the first surfaces
    that do more than mirror and refract. So many light groups (`emitting`) have the light apart that they emit.
    """

    def __init__(self, count: int, groups: int = 0, guides: bool = False, emitting: int = 0) -> None:
        self.surface, self.emitted = (GroupedLight.dark(each, count) for each in (groups, emitting))
        self.transmittance = dr.zeros(Array3f, count)
        self.alpha, self.distance = dr.zeros(Float, count), dr.full(Float, dr.inf, count)
        self.normal, self.reach = dr.zeros(Array3f, count), dr.zeros(Float, count)
        self._unmet = dr.full(Bool, True, count) if guides else None
        self.albedo = dr.zeros(Array3f, count if guides else 1)

    def add(self, step: CameraPaths, vertex: camera_paths.CameraVertex) -> None:
        """Add one step of camera paths."""
        totals, lights = ([*one.parts, *other.parts] for one, other in (
            (self.surface, self.emitted), (vertex.radiance, vertex.emitted)))  # fmt: skip
        for total, radiance in zip(totals, lights, strict=True):
            add_to_pixels(total, radiance, step.pixel, step.branch, step.alive)
        own = step.alive & step.primary
        dr.scatter(self.transmittance, vertex.transmittance, step.pixel, own)
        dr.scatter(self.reach, vertex.end, step.pixel, own)
        first = own & vertex.solid
        dr.scatter(self.alpha, Float(1), step.pixel, first)
        dr.scatter(self.distance, vertex.end, step.pixel, first)
        if self._unmet is not None:
            # Only one branch of a pixel counts: several may arrive at the same step.
            first = step.alive & (step.branch == 0) & vertex.rough & dr.gather(Bool, self._unmet, step.pixel)
            dr.scatter(self._unmet, Bool(False), step.pixel, first)
            dr.scatter(self.albedo, vertex.albedo, step.pixel, first)
            dr.eval(self._unmet, self.albedo)
        if dr.width(vertex.normal) > 1:
            dr.scatter(self.normal, vertex.normal, step.pixel, first)
        dr.eval(self.surface, self.emitted, self.transmittance, self.alpha, self.distance, self.normal, self.reach)
