"""One frame: the mean of independent passes, each with light paths and camera paths of its own.

A stage and a Mitsuba scene differ in where their worlds, light paths and camera rays come from; all else is the same.
Where anything moves, each pass looks at its own slice of the shutter. Within a slice all motion is linear: light
straight from its lamp is traced at its two ends with the same samples, the camera stands at both, and rays have times
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
from ..runtime.device import Array3f, Bool, Float
from ..transport import paths
from ..transport.radii import Limits
from ..transport.simulation import Tuning
from ..world.sensors import Primary
from ..world.world import World
from . import camera_paths
from .camera_paths import CameraTracing, Lighting
from .film import Film, PassPicture, films_state, restore_films
from .gathering import Estimating, Gathering
from .passes import Statistics, subpixel
from .photons import PhotonMaps
from .settings import Settings

_WIDEST_TURN = 30.0  # degrees: half of it in the middle of the way, the camera's axes are shorter by 3.4 %

_LENS, _TIME = 101, 102  # streams of samples

# Passes of a pixel have a block of 2^_BITS places in a sequence, where nobody knows how many there will be.
_BITS = 16


@dataclass(frozen=True)
class Simulated:
    """What light leaves in a pass: beams, photons on surfaces with the bounds of their radii.

    `world` is what camera paths meet in the pass.
    """

    world: World
    sets: list[BeamSet]
    hits: list[paths.PhotonHits]
    limits: Limits


@dataclass(frozen=True)
class ViewRays:
    """A view's rays in a pass, its screen (None where it has none), and a factor on its light.

    `held` is where rays end that see no surfaces, in units of distance, or None.
    """

    primary: Primary
    view: Projection | None
    exposure: float = 1.0
    held: Any = None


class FrameRenderer(ABC):
    """The films of all views of a frame.

    Attributes
    ----------
    settings, statistics
        How the frame is rendered, and what it took so far.
    """

    def __init__(self, settings: Settings, max_depth: int | None) -> None:
        self.settings, self.statistics = settings, Statistics()
        self._max_depth = max_depth
        self._points = Points(settings.rule)
        self._films: list[Film] = []

    @abstractmethod
    def _lighting(self, world: World) -> Lighting:
        """Return what lights it."""

    @abstractmethod
    def simulated(self, number: int) -> Simulated:
        """Return what light leaves in pass `number`."""

    @abstractmethod
    def _eye(self, number: int, view: int, samples: Samples, moving: bool) -> ViewRays:
        """Return the rays of a view in a pass; `moving` tells that beams move while it looks."""

    @abstractmethod
    def _sharp(self, view: int) -> tuple[World, ViewRays] | None:
        """Return the pinhole by which depths are seen, and what it sees, where the view itself is blurred."""

    def _clock(self, number: int) -> tuple[float, float]:
        """Return frame number and seconds of a pass, for looks that change with time."""
        return (0.0, 0.0)

    def _samples(self, number: int) -> Samples:
        return Samples(self.settings.seed, number)

    @property
    def _tuning(self) -> Tuning:
        settings = self.settings
        return Tuning(
            settings.seed, None if self._max_depth is None else self._max_depth - 2, settings.rr_depth,
            settings.overlap, settings.alpha, settings.radius, settings.min_radius, settings.max_radius,
            settings.short, settings.surfaces, settings.max_depth is None,
        )  # fmt: skip

    def add_pass(self, number: int) -> None:
        """Add pass `number`, which depends on nothing but the scene, the settings and its number."""
        statistics, samples = self.statistics, self._samples(number)
        with statistics.phase("simulate"):
            light = self.simulated(number)
            most = None if self._max_depth is None else self._max_depth - 2
            photons = PhotonMaps(light.hits, light.limits, most, light.world.translucent) if light.hits else None
        statistics.beams += sum(len(each.beams) for each in light.sets)
        moving = any(each.close is not None for each in light.sets)
        for view, film in enumerate(self._films):
            with statistics.phase("surfaces"):
                eye = self._eye(number, view, samples, moving)
            seen = self._seen(number, light, eye, film, samples, photons)
            if number == 0:
                seen.depth = self._depth(view, film, samples, seen.depth)
            with statistics.phase("beams"):
                film.add(seen, subpixel(number), dr.opaque(Float, eye.exposure))
        statistics.passes += 1

    def _seen(
        self, number: int, light: Simulated, eye: ViewRays, film: Film, samples: Samples, photons: PhotonMaps | None
    ) -> PassPicture:  # fmt: skip
        """Return what a view sees in a pass."""
        clock, statistics = self._clock(number), self.statistics
        viewing = self._viewing(light.world, eye)
        estimating = Estimating(
            self.settings.estimator, self._points, self._max_depth,
            lambda each: LightContext(*clock, each.light, each.to_world),
        )  # fmt: skip
        gathering = Gathering(eye.view, eye.primary, light.world.media, light.sets, estimating, statistics)
        with statistics.phase("surfaces"):
            begun = camera_paths.begin(viewing, eye.primary, film.order)
        picture = _Picture(dr.width(eye.primary.direction))
        steps = camera_paths.follow(viewing, begun, samples, photons)
        while True:
            with statistics.phase("surfaces"):
                step = next(steps, None)
                if step is not None:
                    picture.add(*step)
            if step is None:
                break
            with statistics.phase("beams"):
                gathering.add(*step)
        with statistics.phase("beams"):
            gathering.finish()
        facing = 1.0 if eye.primary.facing is None else eye.primary.facing
        return PassPicture(
            picture.surface, picture.alpha, [*gathering.radiance.items()], picture.transmittance,
            picture.distance * facing,
        )  # fmt: skip

    def _viewing(self, world: World, eye: ViewRays) -> CameraTracing:
        settings = self.settings
        if eye.held is not None:
            world = world.without_surfaces()
            return CameraTracing(world, _Nothing(), None, settings.rr_depth, True, surfaces=False, sharp=world.sharp)
        return CameraTracing(
            world, self._lighting(world), self._max_depth, settings.rr_depth, settings.hide_emitters,
            settings.surfaces, world.sharp,
        )  # fmt: skip

    def _depth(self, view: int, film: Film, samples: Samples, own: Any) -> Any:
        """Return planar depths as a pinhole at shutter open sees them: a blurred depth is the depth of nothing."""
        sharp = self._sharp(view)
        if sharp is None:
            return own
        world, eye = sharp
        if eye.held is not None:
            return eye.held
        viewing = replace(self._viewing(world, eye), surfaces=False)
        picture = _Picture(dr.width(eye.primary.direction))
        begun = camera_paths.begin(viewing, eye.primary, film.order)
        for step in camera_paths.follow(viewing, begun, samples, None):
            picture.add(*step)
        return picture.distance * eye.primary.facing

    def layers(self) -> dict[str, np.ndarray]:
        """Return the layers of the first view."""
        return self._films[0].layers()

    def views(self) -> list[dict[str, np.ndarray]]:
        """Return the layers of each view, means over the passes."""
        return [film.layers() for film in self._films]

    def error(self) -> float:
        """Return the relative standard error so far, of the view whose error is the largest."""
        return max(film.error() for film in self._films)

    def state(self) -> dict[str, np.ndarray]:
        """Return what another frame of the same content goes on from."""
        return films_state(self._films, self.statistics)

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Go on from the state of another frame; raises SceneError where that is of another picture."""
        restore_films(self._films, self.statistics, state)


class _Picture:
    """What camera paths see in a pass, by pixels."""

    def __init__(self, count: int) -> None:
        self.surface, self.transmittance = dr.zeros(Array3f, count), dr.zeros(Array3f, count)
        self.alpha, self.distance = dr.zeros(Float, count), dr.full(Float, dr.inf, count)

    def add(self, step: camera_paths.CameraPaths, vertex: camera_paths.CameraVertex) -> None:
        """Add what paths see in one step."""
        dr.scatter_add(self.surface, vertex.radiance, step.pixel, step.alive)
        own = step.alive & step.primary
        dr.scatter(self.transmittance, vertex.transmittance, step.pixel, own)
        first = own & vertex.solid
        dr.scatter(self.alpha, Float(1), step.pixel, first)
        dr.scatter(self.distance, vertex.end, step.pixel, first)
        dr.eval(self.surface, self.transmittance, self.alpha, self.distance)


class _Nothing:
    """What lights a world in which nothing is seen."""

    def lamp(self, origin: Array3f, direction: Array3f) -> None:
        """Return None."""
        return

    def emission(self, hit: Any, origin: Array3f, direction: Array3f, active: Bool) -> Array3f:
        """Return black."""
        return dr.zeros(Array3f, dr.width(hit.t))

    def direct(self, point: camera_paths.ShadingPoint, active: Bool) -> Array3f:
        """Return black."""
        return dr.zeros(Array3f, dr.width(point.hit.t))
