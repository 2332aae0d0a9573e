"""Frames of stages: with shutter, stereo and holdouts."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import drjit as dr
import numpy as np

from .. import scene
from ..beams.guides import known_guides, pieces_along
from ..beams.sets import BeamSet
from ..estimators.lanes import Lattice
from ..estimators.tiles import Projection
from ..numerics.arrays import taken, to_uint
from ..numerics.samples import BITS, Samples
from ..runtime.device import Array2f, Array3f, Float, UInt32, mitsuba
from ..transport.portal_visibility import lights_seen
from ..transport.simulation import StageSimulation, renumbering
from ..world.cameras.cameras import CameraRays, View, Window
from ..world.cameras.sensors import PrimaryRays
from ..world.shutter import Moment, Shutter, slice_of, turn, with_lens
from ..world.stage_world import StageWorld
from ..world.world import World
from .camera_paths import Lighting
from .checkpoint import identity
from .film import Film, group_layers, reconstruction_filter
from .film import layer_names as names_of
from .frame import DEFAULTS, FrameRenderer, Simulated, ViewRays
from .holdouts import HoldoutDepth
from .memory import check_memory
from .passes import PLAIN_RUN, RunOptions, accumulate
from .settings import Settings, as_passes
from .single_scattering import SingleScattering
from .stage_lighting import StageLighting

LOG = logging.getLogger("photonbeams")
_WIDEST_TURN = 30.0  # degrees: interpolated axes of the camera are then 3.4 % too short in the middle of the turn

_LENS, _TIME = 101, 102  # streams of samples


def render(
    shutter: Shutter,
    window: Window,
    settings: Settings = DEFAULTS,
    run: RunOptions = PLAIN_RUN,
    holdouts: Sequence[HoldoutDepth] = (),
    content: str = "",
    viewers: Callable[[], Sequence[scene.Camera]] | None = None,
) -> StageRenderer:
    """Render one frame.

    Parameters
    ----------
    shutter, window
        The scene and cameras over the shutter interval, and the size of the picture with its crop.
    settings
        Passes, estimator, seed.
    run
        Which passes, callbacks, and what is kept: see `RunOptions`.
    holdouts
        For each view, the depth at which beams end. The scene's own surfaces are then not seen, but still stop light.
    content
        A hash of the content; passes of another content are refused.
    viewers
        Returns the cameras of all frames, for which emission is guided; None: the cameras of this frame.

    Raises
    ------
    SceneError
        If there is nothing to see, a portal has no area, a pass does not fit into memory, or a checkpoint is of another
        picture.
    """
    check(shutter.at(0.0).scene)
    shutter = _in_medium(shutter)
    _check_memory(shutter.at(0.0).scene, window, settings)

    def begin(planned: int | None) -> StageRenderer:
        return StageRenderer(shutter, window, settings, holdouts, viewers, planned)

    about = identity(content, *_identity(shutter, window, settings, holdouts)) if run.named else ""
    return accumulate(begin, settings, run, about)


def _identity(shutter: Shutter, window: Window, settings: Settings, holdouts: Sequence[HoldoutDepth]) -> list[Any]:
    """Return what has to be the same for passes to be of one picture, beside the shot's content."""
    program = settings.program and (settings.program.modifier, settings.program.frame)
    return [
        shutter.moving, shutter.at(0.0).cameras, window, program,
        replace(as_passes(settings), program=None), [each.depth for each in holdouts],
    ]  # fmt: skip


def simulate(
    shutter: Shutter, window: Window, settings: Settings = DEFAULTS, number: int = 0,
    viewers: Callable[[], Sequence[scene.Camera]] | None = None,
) -> list[BeamSet]:  # fmt: skip
    """Return the beams of pass `number` of a frame, as in `render`; the scene needs no fog for that."""
    description = shutter.at(0.0).scene
    if not makers(description) and not description.groups:
        raise scene.SceneError("the stage has no light that makes beams: expected a UsdLux light, or drawn beams")
    shutter = _in_medium(shutter)
    _check_memory(shutter.at(0.0).scene, window, settings)
    return StageRenderer(shutter, window, settings, (), viewers, settings.passes, all_beams=True).simulated(number).sets


def _in_medium(shutter: Shutter) -> Shutter:
    """Return the shot; if it has no medium, with a vacuum as its medium."""
    if shutter.at(0.0).scene.media:
        return shutter
    return replace(shutter, at=_in_vacuum(shutter.at), before=shutter.before and _in_vacuum(shutter.before))


def _in_vacuum(at: Callable[[float], Moment]) -> Callable[[float], Moment]:
    """Return `at` with a medium that does not change light: there are beams only in media."""

    @lru_cache(maxsize=8)
    def moment(fraction: float) -> Moment:
        found = at(fraction)
        return found._replace(scene=replace(found.scene, media=(_VACUUM,)))

    return moment


_VACUUM = scene.Medium(scene.BLACK)


def check(description: scene.Scene) -> None:
    """Raise SceneError if a scene has nothing to see: nothing at all, or no light."""
    if not (description.meshes or description.lights or description.media or description.drawn or description.groups):
        raise scene.SceneError("there is nothing to render: expected meshes, lights, fog or drawn beams")
    glowing = any(_glows(mesh.material) for mesh in description.meshes)
    if not (description.lights or description.drawn or description.groups or glowing):
        text = "there is no light, and the picture would be black: expected a UsdLux light, a surface that glows, or "
        raise scene.SceneError(f"{text}drawn beams")


def _glows(material: scene.Material) -> bool:
    return not isinstance(material.emissive, tuple) or any(material.emissive)


def makers(description: scene.Scene) -> list[str]:
    """Return the names of the lights and drawn beams that make beams."""
    lights = [light.name for light in description.lights if light.emits_beams]
    return lights + [each.name for each in description.drawn]


def black(description: scene.Scene) -> list[str]:
    """Return the names of all lights and drawn beams if all of them are black; else an empty list."""
    emitting = [light for light in description.lights if light.emits_beams]
    shining = any(light.beam_scale * max(light.radiance) > 0 for light in emitting)
    if shining or any(len(each.start) and np.max(each.power) > 0 for each in description.drawn):
        return []
    return makers(description)


def _check_memory(description: scene.Scene, window: Window, settings: Settings) -> None:
    """Raise SceneError if a pass does not fit into memory."""
    usual = settings.beams or scene.DEFAULT_BEAMS
    counts = [usual if light.beam_count is None else light.beam_count for light in description.lights]
    pieces = [_pieces(light) for light in description.lights]
    beams = sum(
        count * each for light, count, each in zip(description.lights, counts, pieces, strict=True) if light.emits_beams
    )
    check_memory(window, beams)


def layer_names(description: scene.Scene) -> list[str]:
    """Return the names of a frame's layers, in their order."""
    return names_of(groups_of(description))


def groups_of(description: scene.Scene) -> dict[str, str]:
    """Return the layer of each light group of the shot."""
    groups = {light.group for light in description.lights if light.emits_beams}
    groups |= {light.group for light in description.sky}
    return group_layers(groups | {drawn.group for drawn in description.drawn} | description.groups)


class StageRenderer(FrameRenderer):
    """A frame of a stage.

    Parameters
    ----------
    shutter, window
        The scene and cameras over the shutter interval, and the size of the picture with its crop.
    settings
        Passes, estimator, seed.
    holdouts
        For each view, the depth at which beams end. The scene's own surfaces are then not seen, but still stop light.
    viewers
        Returns the cameras of all frames, for which emission is guided; None: the cameras of this frame.
    planned
        How many passes share the shutter interval and each pixel's sample sequence; further passes begin both again.
        None: the number of passes is not known.
    all_beams
        Whether beams are made even if no medium and no look shows them.
    """

    def __init__(
        self, shutter: Shutter, window: Window, settings: Settings, holdouts: Sequence[HoldoutDepth] = (),
        viewers: Callable[[], Sequence[scene.Camera]] | None = None, planned: int | None = None,
        all_beams: bool = False,
    ) -> None:  # fmt: skip
        mitsuba(color=True)
        super().__init__(settings, settings.depth(2 + shutter.at(0.0).scene.bounces), planned, all_beams)
        self._shutter, self._window = shutter, window
        ends = shutter.ends(0.0, 1.0)
        self._eyes = [np.asarray(camera.to_world)[:3, 3] for moment in ends for camera in moment.cameras]
        self._worlds = self._known_worlds()
        light_side: frozenset[str] = frozenset()
        beyond: set[str] = set()
        inside = window.inside()
        with self.statistics.phase("build"):
            for moment in ends:
                world = self._world_of(moment)
                for camera in moment.cameras:
                    view = View(camera, window)
                    light_side |= self._seen_past_portals(world, view)
                    if inside != (0, 0, *window.shape[::-1]):
                        beyond |= lights_seen(world, *view.coarse_rays(128, 72, overscan=True))
        for name in sorted(beyond - light_side):
            LOG.warning("%s is seen before its portal in overscan alone, where its beams are left out", name)
        self._simulation = StageSimulation(self._tuning, settings.beams or scene.DEFAULT_BEAMS, light_side)
        if settings.guiding in (None, True):
            whole = window.whole()  # a crop and overscan have the guides of the whole picture
            with self.statistics.phase("guide"):
                views = [View(camera, whole).projection for camera in (viewers() if viewers else ends[0].cameras)]
                self._simulation = self._guided(self._simulation, self._world_of(ends[0]), views)
        reconstruction, groups = reconstruction_filter(settings.filter_name), groups_of(ends[0].scene)
        self._films = [
            Film(window.shape, window.crop[:2], reconstruction, groups, settings.denoise, (window.width, window.height))
            for _ in ends[0].cameras
        ]
        self._holdouts: Sequence[HoldoutDepth | None] = holdouts or [None] * len(self._films)
        self._turned = False
        self._plan(window)

    def _known_worlds(self) -> list[StageWorld]:
        """Return earlier worlds, parts of which may be used again."""
        return []

    def _seen_past_portals(self, world: StageWorld, view: View) -> frozenset[str]:
        """Return the names of the lights whose light a view also sees past their portals."""
        return lights_seen(world, *view.coarse_rays(128, 72))

    def _guided(
        self, simulation: StageSimulation, world: StageWorld, views: Sequence[Projection]
    ) -> StageSimulation:  # fmt: skip
        """Return a simulation whose light paths are guided toward what the views see."""
        return simulation.guided(world, views)

    def _light_paths(self) -> int:
        description, usual = self._shutter.at(0.0).scene, self.settings.beams or scene.DEFAULT_BEAMS
        counts = [usual if light.beam_count is None else light.beam_count for light in description.lights]
        return sum(counts) + sum(len(each.start) for each in description.drawn)

    def _world_of(self, moment: Moment) -> StageWorld:
        """Return the world of a moment; parts of earlier worlds that are still the same are used again."""
        for world in self._worlds:
            if world.description is moment.scene:
                return world
        world = StageWorld.build(
            moment.scene, self._eyes, like=self._worlds[-1] if self._worlds else None, sharp=self._max_depth != 2
        )
        self._worlds = [*self._worlds[-2:], world]
        return world

    def _samples(self, number: int, together: int = 0, each: int = 1, other: int = 0) -> Samples:
        if self.planned is None:
            return super()._samples(number, together, each, other)
        return Samples(self.settings.seed + other, number, min((each * self.planned - 1).bit_length(), BITS), together)

    def _slice(self, number: int) -> tuple[float, float]:
        """Return the slice of the shutter interval that a pass covers, as fractions."""
        return slice_of(number if self.planned is None else number % self.planned, self.planned)

    def _times(self, number: int) -> list[float]:
        """Return the fractions of the shutter at which a pass opens and, where anything moves, closes."""
        return [*self._slice(number)] if self._shutter.moving else [0.0]

    def _between(self, number: int) -> Moment:
        times = self._times(number)
        return self._shutter.at(0.5 * (times[0] + times[-1]))

    def _single_scattering(self, world: World, count: int, samples: Samples) -> SingleScattering | None:
        assert isinstance(world, StageWorld)
        return SingleScattering(world, count, samples, self._max_depth) if world.sky else None

    def _clock(self, number: int) -> tuple[float, float]:
        return self._shutter.clock(0.5 * sum(self._slice(number)))

    def _lighting(self, world: World) -> Lighting:
        assert isinstance(world, StageWorld)
        return StageLighting(world)

    def simulated(self, number: int) -> Simulated:
        """Return the beams and photons of pass `number`."""
        settings, times, between = self.settings, self._times(number), self._between(number)
        worlds = [self._world_of(moment) for moment in self._shutter.ends(times[0], times[-1])]
        sets, hits = self._simulation.simulated(worlds, number, between.scene.looks(), self.statistics.step)
        world = self._world_of(between)
        media = renumbering(worlds[0], world)
        sets = [each._replace(medium=media.get(each.medium, each.medium)) for each in sets]
        if settings.program is not None:
            x, y, z = (float(each[0]) for each in worlds[0].bounds.center)
            bounds = (x, y, z), worlds[0].radius
            # Programs get the times of the pass whether or not anything moves.
            sets = settings.program(sets, number, settings.seed, self._slice(number), between.scene.medium, bounds)
        dr.eval([(each.beams, each.close) for each in sets])
        return Simulated(world, sets, hits, self._tuning.limits(number, worlds[0].radius))

    def _view_rays(
        self, number: int, view: int, places: Array2f, samples: Samples, moving: bool = False
    ) -> ViewRays:  # fmt: skip
        own = self._view(number, view, self._window)
        sample = (lambda groups: _on_lens(samples, groups)) if own.film or moving else None
        rays = own.rays(places, sample)
        holdout = self._holdouts[view]
        far = None if holdout is None else holdout.distances(own, rays.facing, places, own.on_lens(sample))
        return ViewRays(_primary(rays, far), own.projection, own.camera.exposure_scale, far)

    def _view(self, number: int, view: int, window: Window) -> View:
        """Return a view of a pass in a window of the picture."""
        times, between = self._times(number), self._between(number)
        cameras = [moment.cameras[view] for moment in self._shutter.ends(times[0], times[-1])]
        self._warn_of_turn(cameras)
        close = cameras[-1] if cameras[-1] is not cameras[0] else None
        return View(with_lens(cameras[0], between.cameras[view]), window, close)

    def _inside(
        self, number: int, view: int, rays: ViewRays, places: Array2f, samples: Samples, moving: bool
    ) -> tuple[UInt32, ViewRays] | None:
        left, top, right, bottom = self._window.inside()
        (height, width), (x, y) = self._window.shape, self._window.crop[:2]
        if (left, top, right, bottom) == (0, 0, width, height) or left >= right or top >= bottom:
            return None
        row, column = np.mgrid[top:bottom, left:right]
        index = to_uint((row * width + column).ravel())
        own = self._view(number, view, replace(self._window, crop=(x + left, y + top, x + right, y + bottom)))
        found = own.rays(taken(places, index), (lambda groups: _on_lens(samples, groups)) if moving else None)
        far = None if rays.holdout is None else taken(rays.primary.far, index)
        assert rays.lattice is not None
        lattice = Lattice.of(own.window.width, own.window.height, own.window.crop[:2], rays.lattice.place)
        return index, ViewRays(_primary(found, far), own.projection, rays.exposure, far, lattice)

    def _pinhole(self, view: int) -> tuple[World, ViewRays]:
        holdout = self._holdouts[view]
        moment = self._shutter.at(0.0)
        sharp = View(replace(moment.cameras[view], lens_radius=0.0), self._window)
        rays = sharp.rays(self._films[view].centers())
        return self._world_of(moment), ViewRays(
            _primary(rays), sharp.projection, holdout=None if holdout is None else holdout.depth
        )

    def _warn_of_turn(self, cameras: list[scene.Camera]) -> None:
        """Warn once if a camera turns so far within a pass that linear interpolation does not show its motion."""
        angle = turn(cameras[0], cameras[-1])
        if angle > _WIDEST_TURN and not self._turned:
            self._turned = True
            LOG.warning(
                "%s turns by %.0f degrees within one pass, but its motion blur is straight: expected more passes",
                cameras[0].name, angle,
            )  # fmt: skip


def _on_lens(samples: Samples, groups: UInt32) -> tuple[Any, Any]:
    """Return the place on the lens, in the unit square, and the time in the pass of groups of pixels."""
    return samples.pair(groups, _LENS), samples.pair(groups, _TIME).x


def _primary(rays: CameraRays, far: Any = None) -> PrimaryRays:
    count = dr.width(rays.direction)
    far = dr.full(Float, dr.largest(Float), count) if far is None else far
    ones = dr.ones(Array3f, count)
    return PrimaryRays(
        rays.origin, rays.direction, dr.zeros(Float, count), far, ones, rays.facing, rays.origins, rays.times
    )


def _pieces(light: scene.Light) -> int:
    """Return how many beams a light's guides make from one."""
    return pieces_along(known_guides(light.guides)) + 2 if light.guides else 1
