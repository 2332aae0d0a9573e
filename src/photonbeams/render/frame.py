"""One frame: the mean of independent passes, each with beams, camera rays and light samples of its own.

Where anything moves, each pass looks at its own slice of the shutter. Within a slice all motion is linear: beams are
traced at its two ends with the same samples, the camera stands at both, and rays have times in between.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any

import drjit as dr
import numpy as np

from .. import scene
from ..beams.programs import Program
from ..beams.sets import BeamSet
from ..estimators.estimate import DEFAULT_RULE, ENDLESS, check_estimator
from ..estimators.image import PixelRays, estimate_image
from ..estimators.points import Points
from ..looks import Context, Look
from ..numerics.hashing import hash32
from ..numerics.sampling import pixel_sample, z_order
from ..quadrature import Rule
from ..runtime import device
from ..runtime.device import Array3f, Bool, Float, UInt32
from ..transport.portal_visibility import lights_seen
from ..transport.stage_paths import pieces_of, trace
from ..world.cameras import CameraRays, View, Window
from ..world.shutter import Moment, Shutter, slice_of, turn, with_lens
from ..world.stage_world import StageWorld
from .holdouts import Held
from .passes import OVERLAP, SHRINKAGE, Statistics, accumulate, subpixel, to_picture
from .surfaces import shade

DEFAULT_PASSES = 16
# Bytes at the peak of a pass on the CPU: resident memory of renders of 2 to 20 million pixels and 1 to 3 million beams.
PIXEL_BYTES, BEAM_BYTES = 300, 350


@dataclass(frozen=True)
class Settings:
    """How a frame is rendered.

    Attributes
    ----------
    passes, time_limit
        Number of passes, and seconds after which no further pass is begun (None: no limit).
    beams
        Light paths a pass of each light that does not say itself.
    estimator, rule
        "auto", "billboard" or "frustum", and the frustum's quadrature.
    seed, overlap
        Seed of all samples; width of beams in spacings of their neighbours.
    program
        What is done to the beams of each pass, or None.
    """

    passes: int = DEFAULT_PASSES
    time_limit: float | None = None
    beams: int = scene.DEFAULT_BEAMS
    estimator: str = "auto"
    rule: Rule = DEFAULT_RULE
    seed: int = 0
    overlap: float = OVERLAP
    program: Program | None = None

    def __post_init__(self) -> None:
        check_estimator(self.estimator)
        for name in ("passes", "beams", "seed"):
            object.__setattr__(self, name, scene.whole(getattr(self, name), name))
        object.__setattr__(self, "overlap", scene.real(self.overlap, "overlap", above=0.0))
        if not isinstance(self.rule, Rule):
            raise scene.SceneError(f"rule is {self.rule!r}: expected a Rule, such as gauss_legendre(6)")
        if self.passes < 1:
            raise scene.SceneError(f"passes is {self.passes}: expected at least 1")
        if not 1 <= self.beams <= scene.MOST_BEAMS:
            raise scene.SceneError(f"beams is {self.beams}: expected 1 to {scene.MOST_BEAMS:,} beams a pass and light")
        if self.time_limit is not None and not (isinstance(self.time_limit, Real) and self.time_limit > 0):
            raise scene.SceneError(f"time limit is {self.time_limit!r}: expected a positive number of seconds")


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
    settings: Settings = Settings(),
    progress: Callable[[int, Statistics], None] | None = None,
    holdouts: Sequence[Held] = (),
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

    Raises
    ------
    SceneError
        There is no medium, or nothing that makes beams; a portal has no area; a pass does not fit into memory.
    """
    description = shutter.at(0.0).scene
    check(description)
    _check_memory(description, window, settings)
    frame = accumulate(
        lambda: _Frame(shutter, window, settings, Statistics(), holdouts), settings.passes, settings.time_limit,
        None if progress is None else lambda number, frame: progress(number, frame.statistics),
    )  # fmt: skip
    if progress is not None:
        progress(frame.statistics.passes, frame.statistics)
    return Picture(frame.views(), frame.statistics)


def simulate(shutter: Shutter, window: Window, settings: Settings = Settings(), number: int = 0) -> list[BeamSet]:
    """Return the beams of pass `number` of a frame, as `render` has them; a fog is not needed for that."""
    description = shutter.at(0.0).scene
    if description.medium is None:
        check(replace(description, media=(scene.Medium(scene.BLACK),)))
    else:
        check(description)
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
    counts = [settings.beams if light.beam_count is None else light.beam_count for light in description.lights]
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
    groups = dict.fromkeys(_group_layers(description).values())
    return ["rgba", "surface", "beams", *groups, "transmittance", "depth"]


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
        self._worlds: list[StageWorld] = []
        self._light_side: frozenset[str] = frozenset()
        with statistics.phase("build"):
            for moment in ends:
                world = self._world(moment)
                for camera in moment.cameras:
                    self._light_side |= lights_seen(world, *View(camera, window).coarse_rays(128, 72))
        self._points = Points(settings.rule)
        self._block = dr.opaque(UInt32, 1 << (settings.passes - 1).bit_length())
        self._seed = dr.opaque(UInt32, settings.seed & 0xFFFFFFFF)
        self._description = ends[0].scene
        self._sums = [_Sums(View(camera, window)) for camera in ends[0].cameras]
        self._holdouts: Sequence[Held | None] = holdouts or [None] * len(self._sums)
        self._default_look = Look()
        self._turned = False
        self._slices = None if settings.time_limit is not None else settings.passes

    def _world(self, moment: Moment) -> StageWorld:
        """Return the world of a moment; of those before it, what is still the same is kept."""
        for world in self._worlds:
            if world.description is moment.scene:
                return world
        world = StageWorld.build(moment.scene, self._eyes, like=self._worlds[-1] if self._worlds else None)
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
        for eye, sums in enumerate(self._sums):
            cameras = [moment.cameras[eye] for moment in moments]
            self._warn_of_turn(cameras)
            view = View(
                with_lens(cameras[0], between.cameras[eye]),
                self._window,
                cameras[-1] if cameras[-1] is not cameras[0] else None,
            )
            exposure = dr.opaque(Float, view.camera.exposure_scale)
            film = view.film or any(each.close is not None for each in sets)
            with statistics.phase("surfaces"):
                sample = self._samples(number) if film else None
                rays = view.rays(subpixel(number), sample)
                held = self._holdouts[eye]
                if held is not None:
                    shaded = held.shade(middle, view, rays, subpixel(number), view.on_lens(sample))
                    sums.depth = held.depth
                else:
                    shaded = self._shade(middle, sums.order, rays, number)
                    if number == 0:
                        sums.depth = self._depth(eye, sums) if film else rays.facing * shaded.depth
                sums.add_surfaces(shaded, exposure)
            pixels = _pixel_rays(middle, rays, shaded.depth)
            with statistics.phase("beams"):
                for each in sets:
                    context = Context(*clock, each.light, each.to_world)
                    radiance = self._radiance(each, view, pixels, between.scene.medium, context)
                    sums.add_beams(each.group, radiance, exposure)
                dr.eval(sums.groups)
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
            beams_per_light=settings.beams,
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

    def _shade(self, world: StageWorld, order: Any, rays: CameraRays, number: int) -> Any:
        always = dr.full(Bool, True, dr.width(rays.direction))
        index = order * self._block + dr.opaque(UInt32, number)
        shaded = shade(world, rays.origin, rays.direction, always, index, self._seed)
        dr.eval(shaded)  # apart from the sums, which begin as constants: the first pass would have kernels of its own
        return shaded

    def _depth(self, eye: int, sums: _Sums) -> Any:
        """Return planar depths as a pinhole at shutter open sees them: a blurred depth is the depth of nothing."""
        moment = self._shutter.at(0.0)
        sharp = View(replace(moment.cameras[eye], lens_radius=0.0), self._window).rays(subpixel(0))
        return sharp.facing * self._shade(self._world(moment), sums.order, sharp, 0).depth

    def _radiance(
        self, each: BeamSet, view: View, pixels: PixelRays, medium: scene.Medium | None, context: Context
    ) -> Any:
        look = each.look or self._default_look
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
        return [sums.layers(self._description, max(self.statistics.passes, 1)) for sums in self._sums]


class _Sums:
    """One view's sums over the passes."""

    def __init__(self, view: View) -> None:
        count = view.projection.width * view.projection.height
        self._shape = view.window.shape
        (x, y), (left, top) = view.pixels(), view.window.crop[:2]
        self.order = z_order(x + dr.opaque(UInt32, left), y + dr.opaque(UInt32, top))
        self.surface, self.transmittance = dr.zeros(Array3f, count), dr.zeros(Array3f, count)
        self.alpha, self.depth = dr.zeros(Float, count), dr.zeros(Float, count)
        self.groups: dict[str, Any] = {}
        dr.eval(self.order)

    def add_beams(self, group: str, radiance: Any, exposure: Float) -> None:
        """Add the radiance of beams of a light group."""
        self.groups[group] = self.groups.get(group, 0) + radiance * exposure

    def add_surfaces(self, shaded: Any, exposure: Float) -> None:
        """Add what a pass sees of surfaces; the camera's exposure multiplies their light alone."""
        self.surface += shaded.radiance * exposure
        self.transmittance += shaded.transmittance
        self.alpha += shaded.alpha
        dr.eval(self.surface, self.transmittance, self.alpha, self.depth)

    def layers(self, description: scene.Scene, passes: int) -> dict[str, np.ndarray]:
        """Return the layers, means over the passes."""
        scale = np.float32(1 / passes)
        groups = {name: to_picture(self.groups[name], self._shape) * scale for name in sorted(self.groups)}
        surface, alpha = (to_picture(value, self._shape) * scale for value in (self.surface, self.alpha))
        beams = sum(groups.values(), np.zeros_like(surface))
        layers = {
            "rgba": np.concatenate([surface + beams, alpha], axis=2),
            "surface": surface,
            "beams": beams,
            "transmittance": to_picture(self.transmittance, self._shape) * scale,
            "depth": to_picture(self.depth, self._shape),
        }
        for group, name in _group_layers(description).items():
            # Black where no beam of the group was in the fog; a group called "default" is one with the unnamed one.
            layers[name] = layers.get(name, 0) + groups.get(group, np.zeros_like(surface))
        return {name: layers[name] for name in layer_names(description)}


def _pixel_rays(world: StageWorld, rays: CameraRays, depth: Any) -> PixelRays:
    fog = world.fog
    assert fog is not None  # `check` has seen to it
    enter, leave, _ = fog.interval(rays.origin, rays.direction)
    t_max = dr.minimum(dr.minimum(depth, leave), ENDLESS)
    t_min = dr.minimum(enter, t_max) + 0 * t_max
    dr.eval(t_max, t_min)
    return PixelRays(rays.origin, rays.direction, rays.facing, t_max, t_min, rays.lanes)
