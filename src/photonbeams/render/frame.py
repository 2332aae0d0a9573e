"""One frame: the mean of independent passes, each with beams, camera rays and light samples of its own."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import drjit as dr
import numpy as np

from .. import device, scene
from ..device import Array3f, Bool, Float, UInt32
from ..estimators.estimate import DEFAULT_RULE, ENDLESS, check_estimator
from ..estimators.frustum import Points
from ..estimators.image import PixelRays, estimate_image
from ..looks import Look
from ..quadrature import Rule
from ..simulation.sampling import z_order
from ..simulation.sides import lights_seen
from ..simulation.trace import trace
from .camera import View, Window
from .surfaces import shade
from .world import World

# Width of a beam in spacings of its neighbours in the first pass. One pass of 4,096 beams of the comparison scene is
# then within 1.5 % of the integral in the median, from beside (1.0 %) and from inside the shaft (1.4 %, worst of three
# seeds); at 1.5 the inside has 3 %, at 2.5 the blur of the shaft's edge has cost half a percent of its light.
OVERLAP = 2.2
# Passes continue one low-discrepancy sequence, whose spacing in four dimensions shrinks with this power of its length.
SHRINKAGE = -0.25
DEFAULT_BEAMS = 4096
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
    """

    passes: int = DEFAULT_PASSES
    time_limit: float | None = None
    beams: int = DEFAULT_BEAMS
    estimator: str = "auto"
    rule: Rule = DEFAULT_RULE
    seed: int = 0
    overlap: float = OVERLAP

    def __post_init__(self) -> None:
        check_estimator(self.estimator)
        if self.passes < 1:
            raise scene.SceneError(f"passes is {self.passes}: expected at least 1")
        if not 1 <= self.beams <= 100_000_000:
            raise scene.SceneError(f"beams is {self.beams}: expected 1 to 100,000,000 beams a pass and light")
        if self.time_limit is not None and not self.time_limit > 0:
            raise scene.SceneError(f"time limit is {self.time_limit}: expected a positive number of seconds")


@dataclass
class Statistics:
    """What a frame took: beams and passes, seconds by phase, ray–beam tests, and what was compiled."""

    passes: int = 0
    beams: int = 0
    tests: int = 0
    seconds: dict[str, float] = field(default_factory=dict)
    kernels_compiled: int = 0
    compile_seconds: float = 0.0

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Add the time within to a phase."""
        begin = time.perf_counter()
        yield
        dr.sync_thread()
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begin

    def count_kernels(self) -> None:
        """Add what was compiled since the last call."""
        for entry in dr.kernel_history():
            if entry["type"].name == "JIT" and not entry["cache_hit"]:
                self.kernels_compiled += 1
                self.compile_seconds += entry["backend_time"] / 1e3


@dataclass(frozen=True)
class Picture:
    """A frame's layers, (H, W, C) float32, by name, and what they took."""

    layers: dict[str, np.ndarray]
    statistics: Statistics


def render(
    description: scene.Scene,
    camera: scene.Camera,
    window: Window,
    settings: Settings = Settings(),
    progress: Callable[[int, Statistics], None] | None = None,
) -> Picture:
    """Render one frame.

    Parameters
    ----------
    description, camera, window
        What is seen, from where, and how large.
    settings
        Passes, estimator, seed.
    progress
        Called with the number of finished passes, before the first and after each.

    Raises
    ------
    SceneError
        There is no medium, or nothing that makes beams; a portal has no area; a pass does not fit into memory.
    """
    check(description)
    _check_memory(description, window, settings)
    statistics = Statistics()
    begin = time.perf_counter()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        frame = _Frame(description, View(camera, window), settings, statistics)
        for number in range(settings.passes):
            if progress is not None:
                progress(number, statistics)
            frame.add_pass(number)
            statistics.count_kernels()
            if settings.time_limit is not None and time.perf_counter() - begin > settings.time_limit:
                break
        if progress is not None:
            progress(statistics.passes, statistics)
        return Picture(frame.layers(), statistics)


def check(description: scene.Scene) -> None:
    """Raise SceneError where a scene has no medium or nothing that makes beams."""
    if description.medium is None:
        raise scene.SceneError(
            "the stage has no medium: expected a prim with PhotonBeamsMediumAPI, or a fog given by --scattering"
        )
    lights, drawn = description.lights, description.drawn
    shining = any(light.emits_beams and light.beam_scale * max(light.radiance) > 0 for light in lights)
    if shining or any(len(each.start) for each in drawn):
        return
    text = "the stage has no light that makes beams: expected a UsdLux light, or drawn beams"
    names = ", ".join([light.name for light in lights] + [each.name for each in drawn])
    if names:  # all black or empty, or switched off, which a dome is from the start
        text = f"the stage has no light that makes beams: {names} expected to shine and to have photonbeams:enabled on"
    raise scene.SceneError(text)


def _check_memory(description: scene.Scene, window: Window, settings: Settings) -> None:
    """Raise SceneError for a pass that the system would end for want of memory, which it does without a word.

    On CUDA Dr.Jit says so itself.
    """
    height, width = window.shape
    counts = [settings.beams if light.beam_count is None else light.beam_count for light in description.lights]
    beams = sum(count for light, count in zip(description.lights, counts, strict=True) if light.emits_beams)
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
    """Return the layer of each light group; none where all beams are of the unnamed one."""
    groups = {light.group for light in description.lights if light.emits_beams}
    groups |= {drawn.group for drawn in description.drawn}
    return {group: f"beams_{group or 'default'}" for group in sorted(groups)} if groups - {""} else {}


class _Frame:
    """The sums over passes."""

    def __init__(self, description: scene.Scene, view: View, settings: Settings, statistics: Statistics) -> None:
        self._view, self._settings, self._statistics = view, settings, statistics
        with statistics.phase("build"):
            self._world = World.build(description, [np.asarray(view.camera.to_world)[:3, 3]])
            self._light_side = lights_seen(self._world, *view.coarse_rays(128, 72))
        self._points = Points(settings.rule)
        count = view.projection.width * view.projection.height
        (x, y), (left, top) = view.pixels(), view.window.crop[:2]
        block = 1 << (settings.passes - 1).bit_length()
        self._order = z_order(x + dr.opaque(UInt32, left), y + dr.opaque(UInt32, top)) * dr.opaque(UInt32, block)
        dr.eval(self._order)
        self._surface, self._transmittance = dr.zeros(Array3f, count), dr.zeros(Array3f, count)
        self._alpha, self._depth = dr.zeros(Float, count), dr.zeros(Float, count)
        self._groups: dict[str, Any] = {}
        self._default_look = Look()

    def add_pass(self, number: int) -> None:
        """Add pass `number`, which depends on nothing but the scene, the seed and its number."""
        view, statistics, settings = self._view, self._statistics, self._settings
        with statistics.phase("simulate"):
            sets = trace(
                self._world,
                beams_per_light=settings.beams,
                pass_index=number,
                seed=settings.seed,
                light_side=self._light_side,
                overlap=settings.overlap * (number + 1) ** SHRINKAGE,
            )
            dr.eval([each.beams for each in sets])
        origin, direction = view.rays(subpixel(number))
        with statistics.phase("surfaces"):
            shaded = self._shade(origin, direction, number)
        rays = self._pixel_rays(origin, direction, shaded.depth)
        with statistics.phase("beams"):
            for each in sets:
                part = estimate_image(
                    each.beams,
                    view.projection,
                    rays,
                    look=each.look or self._default_look,
                    medium=self._world.description.medium,
                    estimator=settings.estimator,
                    points=self._points,
                )
                self._groups[each.group] = self._groups.get(each.group, 0) + part.radiance
                statistics.tests += part.billboard_tests + part.frustum_tests
                statistics.beams += len(each.beams)
            dr.eval(self._groups)
        statistics.passes += 1

    def _shade(self, origin: Any, direction: Any, number: int) -> Any:
        count = dr.width(direction)
        shaded = shade(
            self._world, origin, direction, dr.full(Bool, True, count), self._order + dr.opaque(UInt32, number),
            dr.opaque(UInt32, self._settings.seed & 0xFFFFFFFF),
        )  # fmt: skip
        dr.eval(shaded)  # apart from the sums, which begin as constants: the first pass would have kernels of its own
        self._surface += shaded.radiance
        self._transmittance += shaded.transmittance
        self._alpha += shaded.alpha
        if number == 0:  # a mean of depths is the depth of nothing: the first pass looks through pixel centres
            self._depth = self._view.planar_depth(direction, shaded.depth)
        dr.eval(self._surface, self._transmittance, self._alpha, self._depth)
        return shaded

    def _pixel_rays(self, origin: Any, direction: Any, depth: Any) -> PixelRays:
        fog = self._world.fog
        assert fog is not None  # `check` has seen to it
        enter, leave, _ = fog.interval(origin, direction)
        t_max = dr.minimum(dr.minimum(depth, leave), ENDLESS)
        t_min = dr.minimum(enter, t_max) + 0 * t_max
        dr.eval(t_max, t_min)
        return PixelRays(origin, direction, t_max, t_min)

    def layers(self) -> dict[str, np.ndarray]:
        """Return the layers, means over the passes."""
        height, width = self._view.window.shape
        scale = 1 / max(self._statistics.passes, 1)

        def picture(value: Any) -> np.ndarray:
            return np.ascontiguousarray(value.numpy().reshape(-1, height, width).transpose(1, 2, 0))

        groups = {name: picture(self._groups[name]) * np.float32(scale) for name in sorted(self._groups)}
        surface, alpha = (picture(value) * np.float32(scale) for value in (self._surface, self._alpha))
        beams = sum(groups.values(), np.zeros_like(surface))
        layers = {
            "rgba": np.concatenate([surface + beams, alpha], axis=2),
            "surface": surface,
            "beams": beams,
            "transmittance": picture(self._transmittance) * np.float32(scale),
            "depth": picture(self._depth),
        }
        description = self._world.description
        for group, name in _group_layers(description).items():
            # Black where no beam of the group was in the fog; a group called "default" is one with the unnamed one.
            layers[name] = layers.get(name, 0) + groups.get(group, np.zeros_like(surface))
        return {name: layers[name] for name in layer_names(description)}


def subpixel(number: int) -> tuple[float, float]:
    """Return where in its pixel a pass looks: the R2 sequence (Roberts 2018), from the centre on.

    One offset for all pixels: edges are then as smooth after a few passes as the passes are many, without noise.
    """
    g = 1.32471795724474602596  # the plastic number
    return (0.5 + number / g) % 1.0, (0.5 + number / g**2) % 1.0
