"""Where along each pixel's ray the light of beams comes from, for deep files.

The light in front of a depth is what a holdout at that depth would show: the gather, with shorter rays. One pass tells
it, at depths that are chosen pixel by pixel. Each round halves the bin of a pixel that has the most light. So a thin
shaft is found in a wide room, and the light of the brightest bin bounds the error of an object at any depth.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from ...numerics.arrays import channel_mean, to_float, to_numpy
from ...numerics.samples import Samples
from ...runtime.device import Array2f, Array3f, Float, UInt32
from ...scene import SceneError
from ..films.deep import BINS, pictures_of
from ..gathering import EstimatorOptions, Gathering
from ..paths import camera_paths
from ..paths.surface_light import NO_LIGHT
from ..ray_passes import unshaded

if TYPE_CHECKING:
    from ...world.cameras.cameras import Pinhole
    from ..films.film import Film
    from ..frame import FrameRenderer
    from ..light import TracedLight
    from ..paths.branches import CameraPaths
    from ..ray_passes import ViewRays
    from ..tallied import TalliedView
    from ..views import FrameView

# The pass whose beams tell it is the last one of so many: later passes have narrower beams.
_PASS = 16
# How many rays of each pixel tell it, and an offset of their seed.
_SAMPLES, _SEED = 2, 0x6A09E667
# No bin is halved that has a smaller part of its pixel's light.
_BOUND = 1 / 64


def deep_pass(planned: int | None) -> int:
    """Return the number of the pass that tells where light comes from, of as many as are `planned`."""
    return 0 if planned is None else min(planned, _PASS) - 1


def deep_pictures(
    renderer: FrameRenderer, eye: FrameView, film: Film, light: TracedLight, tallied: Sequence[TalliedView],
    number: int, moving: bool, pinhole: Pinhole | None,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Return bins along the rays of pass `number`, with their parts of the light, by the names of their sums.

    `tallied` is the light of the pass's tally toward the view; `moving` and `pinhole` are as for `FrameView.rays`.

    Raises
    ------
    SceneError
        The rays are those of a sensor that is no camera.
    """

    def seen(samples: Samples, places: Array2f) -> ViewRays:
        return eye.rays(number, places, film.order, samples, moving, pinhole)

    with renderer.statistics.phase("deep"):
        return _bins(renderer, _LightAlong(renderer, film, light, tallied, number, seen))


def _bins(renderer: FrameRenderer, lit: _LightAlong) -> dict[str, np.ndarray]:
    """Return what `deep_pictures` returns."""
    count = lit.count
    low, high = np.zeros((BINS, count), np.float32), np.zeros((BINS, count), np.float32)
    low[0], high[0] = lit.near, lit.far
    before, after = np.zeros((BINS, count, 3), np.float32), np.zeros((BINS, count, 3), np.float32)
    passed, leaving = np.ones((BINS, count), np.float32), np.ones((BINS, count), np.float32)
    after[0], leaving[0] = lit.until(lit.far, whole=True)
    most = _BOUND * after[0].sum(axis=1)
    pixels = np.arange(count)
    for number_of_bins in range(1, BINS):
        renderer.statistics.step()
        found = (after - before)[:number_of_bins].sum(axis=2)
        brightest = found.argmax(axis=0)
        some = pixels[found[brightest, pixels] > most]
        if not len(some):
            break
        old, middle = brightest[some], np.zeros(count, np.float32)
        middle[some] = 0.5 * (low[old, some] + high[old, some])
        light_there, clear_there = lit.until(middle)
        for begin, end, there in ((low, high, middle), (before, after, light_there), (passed, leaving, clear_there)):
            end[number_of_bins, some], begin[number_of_bins, some] = end[old, some], there[some]
            end[old, some] = there[some]
    return pictures_of(low, high, after - before, leaving, lit.mirrored())


class _LightAlong:
    """The light of beams along the straight rays of a pass, up to planar depths: the mean over some rays of each pixel.

    Attributes
    ----------
    count, near, far
        How many pixels there are, and the planar depths at which the first of their rays enters a medium and at which
        the last one ends; fog without an end counts as far as the world's bounds.
    """

    def __init__(
        self, renderer: FrameRenderer, film: Film, light: TracedLight, tallied: Sequence[TalliedView], number: int,
        seen: Callable[[Samples, Array2f], ViewRays],
    ) -> None:  # fmt: skip
        self.count, self._rays = dr.width(film.order), list[_DeepRays]()
        for sample in range(_SAMPLES):
            samples = Samples(renderer.settings.seed ^ _SEED, _SAMPLES * number + sample)
            rays = seen(samples, film.places(samples))
            self._rays.append(_DeepRays(renderer, film.order, light, tallied, rays, renderer.options(number), samples))
        self.far = np.maximum.reduce([each.far for each in self._rays])
        self.near = np.minimum(np.minimum.reduce([each.near for each in self._rays]), self.far)

    def until(self, depth: np.ndarray, *, whole: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Return the light in front of planar depths, (N, 3), and the mean transmittance up to them, (N,).

        Where a depth is 0 nothing is gathered. The `whole` light is also that beyond the world's bounds.
        """
        light, passed = zip(*(each.until(depth, whole=whole) for each in self._rays), strict=True)
        return np.mean(light, axis=0), np.mean(passed, axis=0)

    def mirrored(self) -> np.ndarray | None:
        """Return the light, (N, 3), along paths that are no longer straight; None if there are none."""
        found = [each for rays in self._rays if (each := rays.mirrored()) is not None]
        return np.sum(found, axis=0) / len(self._rays) if found else None


class _DeepRays:
    """A ray of each pixel; methods and attributes are those of `_LightAlong`."""

    def __init__(
        self, renderer: FrameRenderer, order: UInt32, light: TracedLight, tallied: Sequence[TalliedView],
        rays: ViewRays, options: EstimatorOptions, samples: Samples,
    ) -> None:  # fmt: skip
        if rays.view is None:
            raise SceneError("deep files are of perspective or orthographic cameras: expected one of these")
        self._renderer, self._light, self._tallied, self._rays = renderer, light, tallied, rays
        self._options = replace(options, tolerance=0.0)
        tracing = unshaded(renderer.camera_tracing(light.world, rays))
        begun = camera_paths.begin(tracing, rays.primary, order)
        self._all = [*camera_paths.follow(tracing, begun, samples, NO_LIGHT)]
        self._count = dr.width(order)
        straight = [(_with_alive(paths, paths.alive & paths.primary), vertex) for paths, vertex in self._all]
        self._steps = [each for each in straight if bool(dr.any(each[0].alive))]
        facing = Float(1.0) if rays.primary.facing is None else rays.primary.facing
        self._facing = facing + dr.zeros(Float, self._count)
        near, far = dr.full(Float, dr.inf, self._count), dr.zeros(Float, self._count)
        for paths, vertex in self._steps:
            own = paths.alive
            near = dr.select(own & (paths.medium > 0), dr.minimum(near, paths.near), near)
            far = dr.select(own, vertex.end, far)
        dr.eval(self._facing, near, far)
        self.far = np.minimum((far * self._facing).numpy(), self._depth_of_world())
        self.near = np.minimum((near * self._facing).numpy(), self.far)

    def _depth_of_world(self) -> float:
        """Return the planar depth of the farthest point of the world's bounds."""
        view, bounds = self._rays.view, self._light.world.bounds
        assert view is not None
        along = dr.dot(bounds.center - view.origin, view.poses[0].forward) + bounds.radius
        return max(float(along[0]), 1e-6)

    def until(self, depth: np.ndarray, *, whole: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Return the light in front of planar depths, and the mean transmittance up to them."""
        ends = to_float(depth) / self._facing
        rays, world = self._rays, self._light.world
        gathering = Gathering(
            rays.view, rays.primary, world.media, self._light.sets, self._options, self._renderer.statistics,
            tallied=self._tallied,
        )  # fmt: skip
        clear = dr.ones(Array3f, self._count)
        for paths, vertex in self._steps:
            shorter = copy(vertex)
            shorter.end = vertex.end if whole else dr.minimum(vertex.end, ends)
            dr.eval(shorter.end)
            if self._light.sets or self._tallied:
                gathering.add(paths, shorter)
            clear = dr.select(paths.alive & (ends > paths.near), self._clear(paths, vertex, ends), clear)
        passed = channel_mean(clear)
        return _rows(sum(gathering.radiance.values(), dr.zeros(Array3f, self._count))), passed.numpy()

    def mirrored(self) -> np.ndarray | None:
        """Return the light along paths that are no longer straight; None if there are none."""
        rays = self._rays
        apart = [(_with_alive(paths, paths.alive & ~paths.primary), vertex) for paths, vertex in self._all]
        others = [each for each in apart if bool(dr.any(each[0].alive))]
        if not others or not self._light.sets:
            return None
        gathering = Gathering(
            rays.view, rays.primary, self._light.world.media, self._light.sets, self._options, self._renderer.statistics
        )
        for each in others:
            gathering.add(*each)
        gathering.finish()
        return _rows(sum(gathering.radiance.values(), dr.zeros(Array3f, self._count)))

    def _clear(self, paths: Any, vertex: Any, ends: Float) -> Array3f:
        """Return the transmittance up to distances along a step, as surfaces feel it."""
        media, start = self._light.world.media, paths.origin + paths.near * paths.direction
        flown = dr.maximum(dr.minimum(vertex.end, ends) - paths.near, 0)
        passed = media.transmittance(paths.medium, start, paths.direction, flown, vertex.seed, paths.alive)
        return Array3f(paths.clear * media.felt(paths.medium, passed))


def _with_alive(paths: CameraPaths, alive: Any) -> CameraPaths:
    result = copy(paths)
    result.alive = alive
    dr.eval(result.alive)
    return result


def _rows(light: Array3f) -> np.ndarray:
    return np.ascontiguousarray(to_numpy(light).T)
