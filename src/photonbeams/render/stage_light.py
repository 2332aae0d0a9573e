"""The light of a stage over the shutter interval, pass by pass."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import drjit as dr
import numpy as np

from .. import scene
from ..estimators.projection import Projection
from ..numerics.samples import Samples
from ..transport.portal_visibility import lights_seen
from ..transport.stage_simulation import StageSimulation, renumbering
from ..world.cameras.cameras import View, Window
from ..world.shutter import Moment, Shutter, slice_of
from ..world.stage_world import StageWorld
from ..world.world import World
from .light import TracedLight, tuning_of
from .passes import Statistics
from .paths.camera_paths import Lighting
from .paths.single_scattering import SingleScattering
from .paths.stage_lighting import StageLighting
from .paths.walks import Walking
from .settings import Settings
from .views import CameraMotion

LOG = logging.getLogger("photonbeams")


class Earlier(Protocol):
    """An earlier frame of the same shot, parts of which may be used again.

    Attributes
    ----------
    worlds
        Its worlds.
    light_side
        Names of the lights that are seen past their portals; None: they have to be found again.
    """

    worlds: Sequence[StageWorld]
    light_side: frozenset[str] | None

    def guided(self, simulation: StageSimulation, world: StageWorld) -> StageSimulation | None:
        """Return a simulation with the earlier frame's guides; None if these have to be found again."""


class StageLight:
    """The light of a stage.

    Parameters
    ----------
    shutter, window
        The scene and cameras over the shutter interval, and the size of the picture with its crop.
    settings
        Passes, light paths, seed.
    statistics
        Statistics to which the time for this is added.
    viewers
        Returns the cameras of all frames, for which emission is guided; None: the cameras of this frame.
    planned
        How many passes share the shutter interval; further passes begin it again. None: the number is not known.
    all_beams
        Whether beams are made even if no medium and no look shows them.
    earlier
        An earlier frame of the same shot.
    """

    walks: Mapping[str, Walking] = {}
    varies = True

    def __init__(
        self, shutter: Shutter, window: Window, settings: Settings, statistics: Statistics,
        viewers: Callable[[], Sequence[scene.Camera]] | None = None, planned: int | None = None,
        all_beams: bool = False, earlier: Earlier | None = None,
    ) -> None:  # fmt: skip
        self.shutter, self.settings, self.planned = shutter, settings, planned
        self.max_depth = settings.depth(2 + shutter.at(0.0).scene.bounces)
        self._tuning = tuning_of(settings, self.max_depth, all_beams)
        ends = shutter.ends(0.0, 1.0)
        self._eyes = [np.asarray(camera.to_world)[:3, 3] for moment in ends for camera in moment.cameras]
        self.worlds: list[StageWorld] = [] if earlier is None else list(earlier.worlds)
        with statistics.phase("build"):
            light_side = self._seen_past_portals(window, None if earlier is None else earlier.light_side)
        self.simulation = StageSimulation(self._tuning, settings.beams or scene.DEFAULT_BEAMS, light_side)
        if settings.guiding in (None, True):
            with statistics.phase("guide"):
                world = self._world_of(ends[0])
                known = None if earlier is None else earlier.guided(self.simulation, world)
                whole = window.whole()  # a crop and overscan have the guides of the whole picture
                self.simulation = known or self.simulation.guided(world, _projections(viewers, ends[0], whole))

    def _seen_past_portals(self, window: Window, known: frozenset[str] | None) -> frozenset[str]:
        """Return the names of lights that cameras see past their portals; warn of those in overscan alone."""
        result, beyond, inside = known or frozenset(), set[str](), window.inside()
        for moment in self.shutter.ends(0.0, 1.0):
            world = self._world_of(moment)
            for camera in moment.cameras:
                view = View(camera, window)
                if known is None:
                    result |= lights_seen(world, *view.coarse_rays(128, 72))
                if inside != (0, 0, *window.shape[::-1]):
                    beyond |= lights_seen(world, *view.coarse_rays(128, 72, overscan=True))
        for name in sorted(beyond - result):
            LOG.warning("%s is seen before its portal in overscan alone, where its beams are left out", name)
        return result

    @property
    def world(self) -> StageWorld:
        """The world when the shutter opens."""
        return self._world_of(self.shutter.at(0.0))

    @property
    def paths(self) -> int:
        """The number of light paths in a pass, and of drawn beams."""
        description, usual = self.shutter.at(0.0).scene, self.settings.beams or scene.DEFAULT_BEAMS
        counts = [usual if light.beam_count is None else light.beam_count for light in description.lights]
        return sum(counts) + sum(len(each.start) for each in description.drawn)

    def _world_of(self, moment: Moment) -> StageWorld:
        """Return the world of a moment; parts of earlier worlds that are still the same are used again."""
        for world in self.worlds:
            if world.description is moment.scene:
                return world
        like = self.worlds[-1] if self.worlds else None
        world = StageWorld.build(moment.scene, self._eyes, like=like, sharp=self.max_depth != 2)
        self.worlds = [*self.worlds[-2:], world]
        return world

    def _slice(self, number: int) -> tuple[float, float]:
        """Return the slice of the shutter interval that a pass covers, as fractions."""
        return slice_of(number if self.planned is None else number % self.planned, self.planned)

    def _times(self, number: int) -> list[float]:
        """Return the fractions of the shutter at which a pass opens and, where anything moves, closes."""
        return [*self._slice(number)] if self.shutter.moving else [0.0]

    def _moments(self, number: int) -> tuple[Sequence[Moment], Moment]:
        """Return the moments at which a pass opens and closes, one if nothing moves, and that of its middle."""
        times = self._times(number)
        return self.shutter.ends(times[0], times[-1]), self.shutter.at(0.5 * (times[0] + times[-1]))

    def camera(self, number: int, view: int) -> CameraMotion:
        """Return the camera of a view in pass `number`."""
        ends, middle = self._moments(number)
        return CameraMotion(ends[0].cameras[view], middle.cameras[view], ends[-1].cameras[view])

    def clock(self, number: int) -> tuple[float, float]:
        """Return the frame number and the time in seconds of a pass, for looks that change with time."""
        return self.shutter.clock(0.5 * sum(self._slice(number)))

    def lighting(self, world: World) -> Lighting:
        """Return the lighting of a world."""
        assert isinstance(world, StageWorld)
        return StageLighting(world)

    def single_scattering(self, world: World, count: int, samples: Samples) -> SingleScattering | None:
        """Return the light that media scatter toward `count` pixels without beams, or None."""
        assert isinstance(world, StageWorld)
        return SingleScattering(world, count, samples, self.max_depth) if world.sky else None

    def traced(self, number: int, step: Callable[[], None]) -> TracedLight:
        """Return the beams and photons of pass `number`; `step` is called between parts of the pass."""
        settings, (ends, between) = self.settings, self._moments(number)
        worlds = [self._world_of(moment) for moment in ends]
        sets, hits = self.simulation.simulated(worlds, number, between.scene.looks(), step)
        world = self._world_of(between)
        media = renumbering(worlds[0], world)
        sets = [each._replace(medium=media.get(each.medium, each.medium)) for each in sets]
        if settings.program is not None:
            x, y, z = (float(each[0]) for each in worlds[0].bounds.center)
            bounds = (x, y, z), worlds[0].radius
            # Programs get the times of the pass whether or not anything moves.
            sets = settings.program(sets, number, settings.seed, self._slice(number), between.scene.medium, bounds)
        dr.eval([(each.beams, each.close) for each in sets])
        return TracedLight(world, sets, hits, self._tuning.limits(number, worlds[0].radius))


def _projections(
    viewers: Callable[[], Sequence[scene.Camera]] | None, moment: Moment, window: Window
) -> list[Projection]:  # fmt: skip
    return [View(camera, window).projection for camera in (viewers() if viewers else moment.cameras)]
