"""One frame: the mean of independent passes, each with its own light paths and camera paths.

Stages and Mitsuba scenes have their own worlds, light paths and camera rays; everything else is here. If anything
moves, each pass covers a slice of the shutter interval. Motion within a slice is linear: light straight from its lamp
is traced at both ends of the slice with the same samples, the camera is known at both ends, and camera rays have times
in between. Radii shrink from pass to pass, so that bias and variance both vanish (Progressive Photon Beams, Jarosz et
al. 2011).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import numpy as np

from ..beams.sets import BeamSet
from ..estimators.points import Points
from ..estimators.tiles import Projection
from ..looks import LightContext
from ..numerics.samples import Samples
from ..runtime.device import Array2f, Array3f, Bool, Float, UInt32
from ..scene import SceneError
from ..transport.radii import Limits
from ..transport.records import PhotonHits
from ..transport.simulation import Tuning
from ..world.sensors import PrimaryRays
from ..world.world import World
from . import camera_paths
from .camera_paths import CameraTracing, Lighting
from .film import Film, PassPicture
from .frame_sums import FrameSums
from .gathering import EstimatorOptions, Gathering
from .passes import Statistics
from .photons import PhotonMaps
from .settings import Settings
from .single_scattering import SingleScattering
from .sums import PassSums
from .walks import Walking


@dataclass(frozen=True)
class Simulated:
    """The result of tracing light in a pass: beams, and photon hits with the bounds of their radii.

    `world` is the world of the pass's camera paths.
    """

    world: World
    sets: list[BeamSet]
    hits: list[PhotonHits]
    limits: Limits


@dataclass(frozen=True)
class ViewRays:
    """A view's camera rays in a pass, their projection (None where there is none), and the exposure.

    `holdout` are the distances at which rays end that see no surfaces, or None.
    """

    primary: PrimaryRays
    view: Projection | None
    exposure: float = 1.0
    holdout: Any = None


class PassRenderer(ABC):
    """What renders passes: light first, then what camera rays see of it.

    Attributes
    ----------
    settings
        How passes are rendered.
    statistics
        The statistics so far.
    """

    def __init__(self, settings: Settings, max_depth: int | None, all_beams: bool = False) -> None:
        self.settings, self.statistics = settings, Statistics()
        self._all_beams = all_beams
        self._max_depth = max_depth
        self._points = Points(settings.rule)

    @abstractmethod
    def _lighting(self, world: World) -> Lighting:
        """Return the lighting of a world."""

    @abstractmethod
    def simulated(self, number: int) -> Simulated:
        """Return the beams and photons of pass `number`."""

    def _single_scattering(self, world: World, count: int, samples: Samples) -> SingleScattering | None:
        """Return what media scatter toward `count` pixels without beams, or None where that is nothing."""
        return None

    def _walkings(self, world: World) -> Mapping[str, Walking]:
        """Return how the light of those emitters is met that send no light paths, by light groups."""
        return {}

    def _clock(self, number: int) -> tuple[float, float]:
        """Return frame number and seconds of a pass, for looks that change with time."""
        return (0.0, 0.0)

    def _samples(self, number: int) -> Samples:
        return Samples(self.settings.seed, number)

    @property
    def _max_bounces(self) -> int | None:
        """The most bounces of light before it is scattered toward the camera: two edges less than the longest path."""
        return None if self._max_depth is None else self._max_depth - 2

    @property
    def _tuning(self) -> Tuning:
        settings = self.settings
        return Tuning(
            settings.seed, self._max_bounces, settings.rr_depth, settings.overlap, settings.alpha, settings.radius,
            settings.min_radius, settings.max_radius, settings.short, settings.surfaces, settings.max_depth is None,
            visible=settings.program is None and not self._all_beams,
        )  # fmt: skip

    def _lit(self, number: int) -> tuple[Simulated, PhotonMaps | None]:
        """Return the beams and photons of pass `number`, and maps of the photons, if there are any."""
        with self.statistics.phase("simulate"):
            light = self.simulated(number)
            photons = None
            if light.hits:
                photons = PhotonMaps(light.world, light.hits, light.limits, self._max_bounces)
        self.statistics.beams += sum(len(each.beams) for each in light.sets)
        return light, photons

    def _pass_picture(
        self, number: int, light: Simulated, rays: ViewRays, order: UInt32, samples: Samples, photons: PhotonMaps | None
    ) -> PassPicture:  # fmt: skip
        """Return the picture of camera rays in a pass; `order` are their numbers for samples."""
        clock, statistics = self._clock(number), self.statistics
        tracing = self._camera_tracing(light.world, rays)
        options = EstimatorOptions(
            self.settings.estimator, self._points, self._max_depth,
            lambda each: LightContext(*clock, each.light, each.to_world),
        )  # fmt: skip
        walkings = self._walkings(light.world)
        gathering = Gathering(rays.view, rays.primary, light.world.media, light.sets, options, statistics)
        sky = self._single_scattering(light.world, dr.width(rays.primary.direction), samples)
        with statistics.phase("surfaces"):
            begun = camera_paths.begin(tracing, rays.primary, order)
        picture = _CameraImage(dr.width(rays.primary.direction))
        steps = camera_paths.follow(tracing, begun, samples, photons)
        number_of_step = 0
        while True:
            with statistics.phase("surfaces"):
                step = next(steps, None)
                if step is not None:
                    picture.add(*step)
            if step is None:
                break
            with statistics.phase("beams"):
                gathering.add(*step)
                if sky is not None:
                    sky.add(*step, number_of_step)
            for group, walking in walkings.items():
                with statistics.phase("walks"):
                    found = gathering.radiance.setdefault(group, dr.zeros(Array3f, dr.width(picture.surface)))
                    walking.add(*step, samples, number_of_step, found, picture.surface)
            number_of_step += 1
        with statistics.phase("beams"):
            gathering.finish()
        beams = [*gathering.radiance.items(), *([] if sky is None else sky.radiance.items())]
        return PassPicture(picture.surface, picture.alpha, beams, picture.transmittance)

    def _camera_tracing(self, world: World, rays: ViewRays) -> CameraTracing:
        settings = self.settings
        walks = bool(self._walkings(world))
        if rays.holdout is not None:
            world = world.without_surfaces()
            return CameraTracing(world, _NoLighting(), None, settings.rr_depth, True, surfaces=False, sharp=world.sharp)
        return CameraTracing(
            world, self._lighting(world), self._max_depth, settings.rr_depth, settings.hide_emitters,
            settings.surfaces, world.sharp, walks=walks,
        )  # fmt: skip


class FrameRenderer(PassRenderer):
    """A frame that is being rendered: the films of all its views.

    Attributes
    ----------
    planned
        For how many passes the samples are chosen; None: for any number.
    about
        What the passes are of, as `FrameSums` has it.
    """

    def __init__(self, settings: Settings, max_depth: int | None, planned: int | None, all_beams: bool = False) -> None:
        super().__init__(settings, max_depth, all_beams)
        self.planned = planned
        self._films: list[Film] = []
        self.about = ""

    @abstractmethod
    def _view_rays(self, number: int, view: int, places: Array2f, samples: Samples, moving: bool) -> ViewRays:
        """Return a view's camera rays in a pass, through `places` in the pixels; `moving` tells that beams move."""

    @abstractmethod
    def _pinhole(self, view: int) -> tuple[World, ViewRays] | None:
        """Return the world and a pinhole camera's rays through the centres of pixels; None: no depth is wanted."""

    def add_pass(self, number: int) -> None:
        """Add pass `number`, which depends on nothing but the scene, the settings and its number."""
        statistics, samples = self.statistics, self._samples(number)
        light, photons = self._lit(number)
        moving = any(each.close is not None for each in light.sets)
        for view, film in enumerate(self._films):
            with statistics.phase("surfaces"):
                places = film.places(samples)
                rays = self._view_rays(number, view, places, samples, moving)
            picture = self._pass_picture(number, light, rays, film.order, samples, photons)
            if number == 0:
                self._add_first_hits(picture, view, film, samples)
            with statistics.phase("beams"):
                film.add(number, picture, places, dr.opaque(Float, rays.exposure))
        statistics.passes += 1

    def _add_first_hits(self, picture: PassPicture, view: int, film: Film, samples: Samples) -> None:
        """Add planar depths, and normals, from a pinhole at shutter open: a mean of depths is no surface's depth."""
        sharp, normals = self._pinhole(view), self.settings.normals
        if sharp is None:
            return
        world, rays = sharp
        if rays.holdout is not None:
            picture.depth = rays.holdout
            picture.normal = dr.zeros(Array3f, dr.width(rays.primary.direction)) if normals else None
            return
        tracing = replace(self._camera_tracing(world, rays), surfaces=False, walks=False, normals=normals)
        seen = _CameraImage(dr.width(rays.primary.direction))
        begun = camera_paths.begin(tracing, rays.primary, film.order)
        for step in camera_paths.follow(tracing, begun, samples, None):
            seen.add(*step)
        picture.depth = seen.distance * (1.0 if rays.primary.facing is None else rays.primary.facing)
        picture.normal = seen.normal if normals else None

    def layers(self) -> dict[str, np.ndarray]:
        """Return the layers of the first view."""
        return self._films[0].layers()

    def views(self) -> list[dict[str, np.ndarray]]:
        """Return the layers of each view, means over the passes."""
        return [film.layers() for film in self._films]

    def error(self) -> float:
        """Return the relative standard error so far, of the view whose error is the largest."""
        return self.sums().error()

    def sums(self) -> FrameSums:
        """Return the sums of the passes so far."""
        statistics = self.statistics
        views = [film.sums for film in self._films]
        return FrameSums(views, self.planned, statistics.beams, statistics.tests, self.about)

    def clear(self) -> None:
        """Begin anew, without passes."""
        self.statistics = Statistics()
        for film in self._films:
            film.sums = PassSums()

    def restore(self, sums: FrameSums) -> None:
        """Go on from the sums of another frame; SceneError where they are of another picture."""
        if len(sums.views) != len(self._films):
            raise SceneError("the checkpoint is of another picture")
        for film, each in zip(self._films, sums.views, strict=True):
            film.restore(each)
        statistics = self.statistics
        statistics.passes, statistics.beams, statistics.tests = len(sums), sums.beams, sums.tests


class _CameraImage:
    """The surfaces that camera paths see in a pass, by pixels."""

    def __init__(self, count: int) -> None:
        self.surface, self.transmittance = dr.zeros(Array3f, count), dr.zeros(Array3f, count)
        self.alpha, self.distance = dr.zeros(Float, count), dr.full(Float, dr.inf, count)
        self.normal = dr.zeros(Array3f, count)

    def add(self, step: camera_paths.CameraPaths, vertex: camera_paths.CameraVertex) -> None:
        """Add one step of camera paths."""
        dr.scatter_add(self.surface, vertex.radiance, step.pixel, step.alive)
        own = step.alive & step.primary
        dr.scatter(self.transmittance, vertex.transmittance, step.pixel, own)
        first = own & vertex.solid
        dr.scatter(self.alpha, Float(1), step.pixel, first)
        dr.scatter(self.distance, vertex.end, step.pixel, first)
        if dr.width(vertex.normal) > 1:
            dr.scatter(self.normal, vertex.normal, step.pixel, first)
        dr.eval(self.surface, self.transmittance, self.alpha, self.distance, self.normal)


class _NoLighting:
    """The lighting of a world without surfaces."""

    def lamp(self, origin: Array3f, direction: Array3f, flown: Float) -> None:
        """Return None."""
        return

    def emission(self, hit: Any, origin: Array3f, direction: Array3f, active: Bool) -> Array3f:
        """Return black."""
        return dr.zeros(Array3f, dr.width(hit.t))

    def direct(self, point: camera_paths.ShadingPoint, active: Bool) -> Array3f:
        """Return black."""
        return dr.zeros(Array3f, dr.width(point.hit.t))
