"""One frame: the mean of independent passes, each with beams, camera rays and light samples of its own.

Where anything moves, each pass looks at its own slice of the shutter. Within a slice all motion is linear: beams are
traced at its two ends with the same samples, the camera stands at both, and rays have times in between.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import numpy as np

from .. import scene
from ..beams.sets import BeamSet
from ..estimators.estimate import ENDLESS
from ..estimators.image import PixelRays, estimate_image
from ..estimators.points import Points
from ..looks import Context, Look
from ..numerics.hashing import hash32
from ..numerics.sampling import pixel_sample
from ..runtime import device
from ..runtime.device import Bool, Float, UInt32
from ..transport.portal_visibility import lights_seen
from ..transport.stage_paths import pieces_of, trace
from ..world.cameras import CameraRays, View, Window
from ..world.shutter import Moment, Shutter, slice_of, turn, with_lens
from ..world.world import World
from .checkpoint import Checkpoint
from .film import Film, PassPicture, films_state, reconstruction_filter, restore_films
from .film import layer_names as names_of
from .holdouts import Held
from .passes import SHRINKAGE, Progress, Statistics, accumulate, subpixel
from .settings import DEFAULTS, Settings
from .surfaces import shade

# Bytes at the peak of a pass on the CPU: resident memory of renders of 2 to 20 million pixels and 1 to 3 million beams.
PIXEL_BYTES, BEAM_BYTES = 300, 350


@dataclass(frozen=True)
class Picture:
    """A frame's layers, (H, W, C) float32, by name, for each view, and what they took."""

    views: list[dict[str, np.ndarray]]
    statistics: Statistics

    @property
    def layers(self) -> dict[str, np.ndarray]:
        """The layers of the first view."""
        return self.views[0]


def render(
    shutter: Shutter,
    window: Window,
    settings: Settings = DEFAULTS,
    progress: Progress | None = None,
    holdouts: Sequence[Held] = (),
    checkpoint: Checkpoint | None = None,
    content: str = "",
) -> Picture:
    """Render one frame.

    Parameters
    ----------
    shutter, window
        What is seen, from where, and how large.
    settings
        Passes, estimator, seed.
    progress
        Called with the number of finished passes, before the first and after each.
    holdouts
        For each view, where beams end, instead of at the scene's own surfaces: these are not seen then, but stop light.
    checkpoint, content
        Where passes are kept on the way, and a hash of what is rendered: passes of another content are refused.

    Raises
    ------
    SceneError
        There is no medium, or nothing that makes beams; a portal has no area; a pass does not fit into memory; a
        checkpoint of another picture.
    """
    description = shutter.at(0.0).scene
    check(description)
    _check_settings(settings)
    _check_memory(description, window, settings)
    state = None
    if checkpoint is not None:
        state = checkpoint.begin(content, *_identity(shutter, window, settings, holdouts))

    def begin() -> _Frame:
        frame = _Frame(shutter, window, settings, Statistics(), holdouts)
        if state is not None:
            frame.restore(state)
        return frame

    frame = accumulate(begin, settings, progress, checkpoint)
    return Picture(frame.views(), frame.statistics)


def _identity(shutter: Shutter, window: Window, settings: Settings, holdouts: Sequence[Held]) -> list[Any]:
    """Return what, beside a shot's content, has to be the same for passes to be of one picture."""
    program = settings.program and (settings.program.modifier, settings.program.frame)
    return [
        shutter.moving and _slices(settings), _block(settings), shutter.at(0.0).cameras, window, program,
        replace(settings, passes=1, time_limit=None, program=None), [each.depth for each in holdouts],
    ]  # fmt: skip


def _slices(settings: Settings) -> int | None:
    """Return into how many slices the shutter is divided; None where nobody knows how many passes there will be."""
    return None if settings.time_limit is not None else settings.passes


def _block(settings: Settings) -> int:
    """Return the length of the part of a sample sequence that each pixel has: a power of two, for all passes."""
    return 1 << (settings.passes - 1).bit_length()


def _check_settings(settings: Settings) -> None:
    """Raise SceneError for what Mitsuba scenes alone can do so far."""
    plain = Settings(max_depth=2)
    for name in ("max_depth", "hide_emitters", "radius", "min_radius", "max_radius", "alpha", "short", "surfaces"):
        value = getattr(settings, name)
        if value not in (None, getattr(plain, name)):
            raise scene.SceneError(f"{name} is {value}: expected {getattr(plain, name)}, for a stage has no other yet")
    if settings.guiding:
        raise scene.SceneError("guiding is True: expected None or False, for a stage has none yet")


def simulate(shutter: Shutter, window: Window, settings: Settings = DEFAULTS, number: int = 0) -> list[BeamSet]:
    """Return the beams of pass `number` of a frame, as `render` has them; a fog is not needed for that."""
    description = shutter.at(0.0).scene
    if description.medium is None:
        check(replace(description, medium=scene.Medium(scene.BLACK)))
    else:
        check(description)
    _check_settings(settings)
    _check_memory(description, window, settings)
    return _Frame(shutter, window, settings, Statistics()).simulated(number)


def check(description: scene.Scene) -> None:
    """Raise SceneError where a scene has no medium, or nothing that ever makes beams."""
    if description.medium is None:
        raise scene.SceneError(
            "the stage has no medium: expected a prim with PhotonBeamsMediumAPI, or a fog given by --scattering"
        )
    if makers(description) or description.groups:
        return
    text = "the stage has no light that makes beams: expected a UsdLux light, or drawn beams"
    if description.lights:  # switched off, which a dome is from the start
        names = ", ".join(light.name for light in description.lights)
        text = f"the stage has no light that makes beams: expected photonbeams:enabled on {names}"
    raise scene.SceneError(text)


def makers(description: scene.Scene) -> list[str]:
    """Return the names of the lights and drawn beams that make beams."""
    lights = [light.name for light in description.lights if light.emits_beams]
    return lights + [each.name for each in description.drawn]


def black(description: scene.Scene) -> list[str]:
    """Return the names of all lights and drawn beams where none of them has any light; else nothing."""
    emitting = [light for light in description.lights if light.emits_beams]
    shining = any(light.beam_scale * max(light.radiance) > 0 for light in emitting)
    if shining or any(len(each.start) and np.max(each.power) > 0 for each in description.drawn):
        return []
    return makers(description)


def _check_memory(description: scene.Scene, window: Window, settings: Settings) -> None:
    """Raise SceneError for a pass that the system would end for want of memory, which it does without a word.

    On CUDA Dr.Jit says so itself.
    """
    height, width = window.shape
    usual = settings.beams or scene.DEFAULT_BEAMS
    counts = [usual if light.beam_count is None else light.beam_count for light in description.lights]
    pieces = [pieces_of(light) for light in description.lights]
    beams = sum(
        count * each for light, count, each in zip(description.lights, counts, pieces, strict=True) if light.emits_beams
    )
    needed, present = PIXEL_BYTES * width * height + BEAM_BYTES * beams, device.memory()
    if device.backend() == "llvm" and present is not None and needed > present:
        raise scene.SceneError(
            f"{width} x {height} pixels and {beams:,} beams take {needed / 2**30:,.0f} GiB, and this machine has "
            f"{present / 2**30:,.0f}: expected fewer, or a part of the picture by --crop"
        )


def layer_names(description: scene.Scene) -> list[str]:
    """Return the names of a frame's layers, in their order."""
    return names_of(_group_layers(description))


def _group_layers(description: scene.Scene) -> dict[str, str]:
    """Return the layer of each light group of the shot; none where all beams are of the unnamed one."""
    groups = {light.group for light in description.lights if light.emits_beams}
    groups |= {drawn.group for drawn in description.drawn} | description.groups
    return {group: f"beams_{group or 'default'}" for group in sorted(groups)} if groups - {""} else {}


_WIDEST_TURN = 30.0  # degrees: half of it in the middle of the way, the camera's axes are shorter by 3.4 %

# Names of samples in seeds.
_LENS, _TIME = 101, 102


class _Frame:
    """The sums over passes of all views."""

    def __init__(
        self,
        shutter: Shutter,
        window: Window,
        settings: Settings,
        statistics: Statistics,
        holdouts: Sequence[Held] = (),
    ) -> None:
        self._shutter, self._window, self._settings, self.statistics = shutter, window, settings, statistics
        ends = shutter.ends(0.0, 1.0)
        self._eyes = [np.asarray(camera.to_world)[:3, 3] for moment in ends for camera in moment.cameras]
        self._worlds: list[World] = []
        self._light_side: frozenset[str] = frozenset()
        with statistics.phase("build"):
            for moment in ends:
                world = self._world(moment)
                for camera in moment.cameras:
                    self._light_side |= lights_seen(world, *View(camera, window).coarse_rays(128, 72))
        self._points = Points(settings.rule)
        self._block = dr.opaque(UInt32, _block(settings))
        self._seed = dr.opaque(UInt32, settings.seed & 0xFFFFFFFF)
        reconstruction = reconstruction_filter(settings.pixel_filter)
        groups, corner = _group_layers(ends[0].scene), window.crop[:2]
        self._films = [Film(window.shape, corner, reconstruction, groups) for _ in ends[0].cameras]
        self._holdouts: Sequence[Held | None] = holdouts or [None] * len(self._films)
        self._default_look = Look()
        self._turned = False
        self._slices = _slices(settings)

    def _world(self, moment: Moment) -> World:
        """Return the world of a moment; of those before it, what is still the same is kept."""
        for world in self._worlds:
            if world.description is moment.scene:
                return world
        world = World.build(moment.scene, self._eyes, like=self._worlds[-1] if self._worlds else None)
        self._worlds = [*self._worlds[-2:], world]
        return world

    def add_pass(self, number: int) -> None:
        """Add pass `number`, which depends on nothing but the scene, the settings and its number."""
        statistics = self.statistics
        times = self._times(number)
        moments, between = self._shutter.ends(times[0], times[-1]), self._shutter.at(0.5 * (times[0] + times[-1]))
        with statistics.phase("simulate"):
            sets = self.simulated(number)
            middle = self._world(between)
            clock = self._shutter.clock(0.5 * sum(slice_of(number, self._slices)))
        statistics.beams += sum(len(each.beams) for each in sets)
        for eye, film in enumerate(self._films):
            cameras = [moment.cameras[eye] for moment in moments]
            self._warn_of_turn(cameras)
            view = View(
                with_lens(cameras[0], between.cameras[eye]),
                self._window,
                cameras[-1] if cameras[-1] is not cameras[0] else None,
            )
            blurred = view.film or any(each.close is not None for each in sets)
            with statistics.phase("surfaces"):
                sample = self._samples(number) if blurred else None
                rays = view.rays(subpixel(number), sample)
                held = self._holdouts[eye]
                if held is not None:
                    shaded = held.shade(middle, view, rays, subpixel(number), view.on_lens(sample))
                else:
                    shaded = self._shade(middle, film.order, rays, number)
                seen = PassPicture(shaded.radiance, shaded.alpha, transmittance=shaded.transmittance)
                if number == 0:
                    seen.depth = rays.facing * shaded.depth if held is None else held.depth
                    if held is None and blurred:
                        seen.depth = self._depth(eye, film)
                    dr.eval(seen.depth)
            pixels = _pixel_rays(middle, rays, shaded.depth)
            with statistics.phase("beams"):
                seen.beams = [
                    (each.group, self._radiance(each, view, pixels, between.scene.medium, clock)) for each in sets
                ]
                film.add(seen, subpixel(number), dr.opaque(Float, view.camera.exposure_scale))
        statistics.passes += 1

    def _times(self, number: int) -> list[float]:
        """Return the fractions of the shutter at which a pass opens and, where anything moves, closes."""
        if not self._shutter.moving:
            return [0.0]
        return [*slice_of(number, self._slices)]

    def simulated(self, number: int) -> list[BeamSet]:
        """Return the beams of pass `number`."""
        settings, times = self._settings, self._times(number)
        between = self._shutter.at(0.5 * (times[0] + times[-1]))
        worlds = [self._world(moment) for moment in self._shutter.ends(times[0], times[-1])]
        sets = trace(
            worlds[0],
            beams_per_light=settings.beams or scene.DEFAULT_BEAMS,
            pass_index=number,
            seed=settings.seed,
            light_side=self._light_side,
            overlap=settings.overlap * (number + 1) ** SHRINKAGE,
            close=worlds[1] if len(worlds) > 1 and worlds[1] is not worlds[0] else None,
            looks=between.scene.looks(),
        )
        if settings.program is not None:
            x, y, z = (float(each[0]) for each in worlds[0].bounds.center)
            bounds = (x, y, z), worlds[0].radius
            sets = settings.program(sets, number, settings.seed, times, between.scene.medium, bounds)
        dr.eval([(each.beams, each.close) for each in sets])
        return sets

    def _warn_of_turn(self, cameras: list[scene.Camera]) -> None:
        """Warn once of a camera that turns so far within a pass that a straight line is no picture of its way."""
        angle = turn(cameras[0], cameras[-1])
        if angle > _WIDEST_TURN and not self._turned:
            self._turned = True
            logging.getLogger("photonbeams").warning(
                "%s turns by %.0f degrees within one pass, and is blurred as if straight: expected more passes",
                cameras[0].name, angle,
            )  # fmt: skip

    def _samples(self, number: int) -> Callable[[Any], tuple[Any, Any]]:
        """Return what gives groups of pixels their place on the lens and their time in this pass."""
        index = dr.opaque(UInt32, number)

        def sample(groups: Any) -> tuple[Any, Any]:
            place = groups * self._block + index
            lens = pixel_sample(place, hash32(self._seed, UInt32(_LENS)))
            return lens, pixel_sample(place, hash32(self._seed, UInt32(_TIME))).x

        return sample

    def _shade(self, world: World, order: Any, rays: CameraRays, number: int) -> Any:
        always = dr.full(Bool, True, dr.width(rays.direction))
        index = order * self._block + dr.opaque(UInt32, number)
        shaded = shade(world, rays.origin, rays.direction, always, index, self._seed)
        dr.eval(shaded)  # apart from the sums, which begin as constants: the first pass would have kernels of its own
        return shaded

    def _depth(self, eye: int, film: Film) -> Any:
        """Return planar depths as a pinhole at shutter open sees them: a blurred depth is the depth of nothing."""
        moment = self._shutter.at(0.0)
        sharp = View(replace(moment.cameras[eye], lens_radius=0.0), self._window).rays(subpixel(0))
        return sharp.facing * self._shade(self._world(moment), film.order, sharp, 0).depth

    def _radiance(
        self, each: BeamSet, view: View, pixels: PixelRays, medium: scene.Medium | None, clock: tuple[float, float]
    ) -> Any:
        look, context = each.look or self._default_look, Context(*clock, each.light, each.to_world)
        try:
            part = estimate_image(
                each.beams, view.projection, pixels, look=look, medium=medium, estimator=self._settings.estimator,
                points=self._points, close=each.close, context=context,
            )  # fmt: skip
        except scene.SceneError as error:  # of a look: whose it is, only this one knows
            raise scene.SceneError(f"{each.name}: {error}") from error
        self.statistics.tests += part.billboard_tests + part.frustum_tests
        return part.radiance

    def views(self) -> list[dict[str, np.ndarray]]:
        """Return the layers of each view, means over the passes."""
        return [film.layers() for film in self._films]

    def error(self) -> float:
        """Return the relative standard error so far, of the view whose error is the largest."""
        return max(film.error() for film in self._films)

    def state(self) -> dict[str, np.ndarray]:
        """Return what another frame of the same shot goes on from."""
        return films_state(self._films, self.statistics)

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Go on from the state of another frame; raises SceneError where that is of another picture."""
        restore_films(self._films, self.statistics, state)


def _pixel_rays(world: World, rays: CameraRays, depth: Any) -> PixelRays:
    fog = world.fog
    assert fog is not None  # `check` has seen to it
    enter, leave, _ = fog.interval(rays.origin, rays.direction)
    t_max = dr.minimum(dr.minimum(depth, leave), ENDLESS)
    t_min = dr.minimum(enter, t_max) + 0 * t_max
    dr.eval(t_max, t_min)
    return PixelRays(rays.origin, rays.direction, rays.facing, t_max, t_min, rays.lanes)
