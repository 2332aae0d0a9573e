"""Beams or paths: which emitters' light has less noise met by walks than by beams and photons.

A pilot renders the light of each kind of emitter both ways, along a few hundred rays and in a few passes, without
direct light, which is the same in both. Preferred is what has less noise at equal cost. Walks that miss light which
beams find are not, however little they differ: they would find it one day, in bright dots.

The cost is reckoned from counts, and measured by no clock: the same scene has the same picture on every machine.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from ..runtime.device import Array3f, Float, UInt32, mitsuba
from ..scene import Array
from ..world.cameras import View
from ..world.scene_world import SceneWorld
from ..world.sensors import PrimaryRays
from ..world.world import World
from .camera_paths import Lighting
from .costs import WALK, of_beams
from .frame import NoLighting, PassRenderer, Simulated, ViewRays
from .settings import Settings
from .walks import Walking

if TYPE_CHECKING:
    from .scene_light import SceneLight

mi = mitsuba()

# Rays of the pilot, across and down; passes that trace light, and passes of walks alone; the first ones, which are
# enough where either has so many times the noise of the other.
_COLUMNS, _ROWS = 40, 24
_TRACED, _UNTRACED = 4, 8
_FIRST, _SURE = 2, 5.0
# The pilot has one of so many light paths, and at least so many of each emitter. Fewer beams are wider, as far as the
# bounds of radii let them: they have as much noise, or more, up to in proportion. The mean of both is reckoned with.
_FEWER, _FEWEST = 4, 128
# Walks of so little noise are taken at once: a variance in units of the mean's square.
_QUIET = 0.1
# Rays are looked at in blocks of so many, across and down: of eight samples of one ray, all may miss the light.
_BLOCK = 8
# The part of the mean below which a block's light is too dark to be looked at by itself.
_DARK = 0.01
# Walks miss light if their mean is below this part of that of beams, and below it by so many standard errors.
_MISSED, _SURELY = 0.95, 3.0

#: Returns the light of the scene with some emitters met by walks, and others dark.
Lit = Callable[[tuple[int, ...], frozenset[int]], "SceneLight"]


@dataclass(frozen=True)
class Pixels:
    """How many pixels a pass has, and of how many their filter takes the mean.

    The filter lowers the noise of walks by that, and not that of beams: a stroke is many pixels wide.
    """

    count: int
    averaged: float = 1.0


def is_sharp(emitter: Any) -> bool:
    """Return whether an emitter is small as points see it: a lamp, or the sun; not a sky."""
    flags = emitter.flags()
    return not mi.has_flag(flags, mi.EmitterFlags.Infinite) or mi.has_flag(flags, mi.EmitterFlags.Delta)


def preferred(
    world: SceneWorld, emitters: Sequence[int], cameras: Sequence[View], pixels: Pixels, light: Lit, settings: Settings,
    max_depth: int | None,
) -> list[int]:  # fmt: skip
    """Return the numbers of those emitters whose light walks had better meet, for passes of such pixels.

    Without media that is all of them: direct light, the same either way, is most of the light there, and photons leave
    blotches. Without a camera to look through it is none.
    """
    if not any(max(each.medium.scattering) > 0 for each in world.media.all):
        return list(emitters)
    everyone = range(len(world.plugin.emitters()))
    kinds: dict[bool, list[int]] = {}
    for each in emitters:
        kinds.setdefault(is_sharp(world.plugin.emitters()[each]), []).append(each)
    result = []
    for own in kinds.values() if cameras else ():
        dark = frozenset(everyone) - set(own)
        walks = _Pilot(light(tuple(own), dark), settings, max_depth, cameras[0])
        walks.add(_FIRST if walks.traces else _UNTRACED)
        if walks.noise() > _QUIET:
            beams = _Pilot(light((), dark), settings, max_depth, cameras[0])
            beams.add(_FIRST)
            if light(tuple(own), dark).portal is not None:  # which the light paths' pilot has found
                walks = _Pilot(light(tuple(own), dark), settings, max_depth, cameras[0])
                walks.add(_FIRST if walks.traces else _UNTRACED)
            ratio = walks.noise() * _cost(walks, beams, pixels) / max(beams.noise(), 1e-30)
            if ratio > _SURE:
                continue
            if ratio > 1 / _SURE:
                beams.add(_TRACED - _FIRST)
                if walks.traces:
                    walks.add(_TRACED - _FIRST)
            if not prefers_walks(beams.found, walks.found, _cost(walks, beams, pixels)):
                continue
        result += own
    return sorted(result)


def _cost(walks: _Pilot, beams: _Pilot, pixels: Pixels) -> float:
    """Return the cost of passes of walks in passes of beams: of as many as the filter makes one of."""
    return walks.cost(pixels.count) / (pixels.averaged * beams.cost(pixels.count) * _FEWER**-0.5)


def prefers_walks(beams: Array, walks: Array, cost: float) -> bool:
    """Return whether walks have less noise than beams at equal cost.

    Parameters
    ----------
    beams, walks
        The radiance of rays in some passes of either, (P, H, W).
    cost
        That of a pass of walks in passes of beams.
    """
    mean = 0.5 * (beams.mean(axis=0) + walks.mean(axis=0))
    totals = [each.mean() for each in (beams, walks)]
    errors = [np.sqrt(each.var(axis=0, ddof=1).mean() / each.size) for each in (beams, walks)]
    missed = totals[0] - totals[1] > _SURELY * np.hypot(*errors)
    if missed and totals[1] < _MISSED * totals[0]:
        return False
    return noise(walks, mean) * cost <= noise(beams, mean)


def noise(found: Array, mean: Array, block: int = _BLOCK) -> float:
    """Return the variance of several pictures, (P, H, W), in units of the square of their `mean`, (H, W).

    It is that of each block of pixels, and then the mean of blocks, which count as much as they have light: dark
    corners may have some noise. What is left at the edges beside whole blocks does not count.
    """
    rows, columns = (each // block for each in mean.shape)
    variance, light = (
        each[: rows * block, : columns * block].reshape(rows, block, columns, block).mean(axis=(1, 3))
        for each in (found.var(axis=0, ddof=1), mean)
    )
    return float((variance / np.maximum(light, max(_DARK * light.mean(), 1e-30))).sum() / max(light.sum(), 1e-30))


class _Pilot(PassRenderer):
    """Passes over some of a camera's rays, with a scene's light but for what comes straight from emitters.

    Attributes
    ----------
    found
        The radiance of rays in passes, the mean of the channels, (P, H, W).
    """

    def __init__(self, light: SceneLight, settings: Settings, max_depth: int | None, camera: View) -> None:
        super().__init__(settings, max_depth)
        emission = light.simulation.emission
        fewer = [replace(each, count=max(each.count // _FEWER, min(each.count, _FEWEST))) for each in emission.strata]
        self._light, self._camera = light.with_paths(fewer), camera
        self._beams = self._photons = 0
        self._portion = sum(each.count for each in fewer) / max(emission.count, 1)
        self.found: Array = np.zeros((0, _ROWS, _COLUMNS), dtype=np.float32)

    @property
    def traces(self) -> bool:
        """Whether light paths are traced."""
        return bool(self._light.simulation.emission.strata)

    def noise(self) -> float:
        """Return the noise of what was found."""
        return noise(self.found, self.found.mean(axis=0))

    def cost(self, pixels: int) -> float:
        """Return the cost of a pass of the scene's own light."""
        scale = 1 / (max(self._portion, 1e-30) * len(self.found))
        beams, photons = scale * self._beams, scale * self._photons
        return (of_beams(beams + photons, beams, pixels) if self.traces else 0.0) + (
            WALK * pixels if self._light.walks else 0.0
        )

    def _lighting(self, world: World) -> Lighting:
        return NoLighting()

    def _walkings(self, world: World) -> Mapping[str, Walking]:
        return self._light.walks

    def simulated(self, number: int) -> Simulated:
        """Return what light leaves in pass `number`."""
        result = self._light.simulated(number)
        self._beams += sum(len(each.beams) for each in result.sets)
        self._photons += sum(dr.width(each.number) for each in result.hits)
        return result

    def add(self, passes: int) -> None:
        """Add passes."""
        origin, direction = self._camera.coarse_rays(_COLUMNS, _ROWS)
        count = dr.width(direction)
        rays = PrimaryRays(
            origin + dr.zeros(Array3f, count), direction, dr.zeros(Float, count),
            dr.full(Float, dr.largest(Float), count), dr.ones(Array3f, count),
        )  # fmt: skip
        # Without beams and photons, all passes at once.
        together = 1 if self.traces else passes
        bits = (together - 1).bit_length()
        order = self._samples(0, bits).indices(dr.arange(UInt32, count))
        rays = PrimaryRays.joined([rays] * together)
        dr.eval(order)
        first = len(self.found)
        for number in range(first, first + passes, together):
            light, photons = self._lit(number)
            samples = self._samples(number, bits)
            seen = self._seen(light, ViewRays(rays, None), order, samples, photons)
            gathered = self._gathered(number, light, ViewRays(rays, None), order, samples)
            whole = sum((*seen.scattered.values(), *gathered.values()), seen.surface)
            radiance = np.asarray(dr.mean(whole).numpy()).reshape(together, _ROWS, _COLUMNS)
            self.found = np.concatenate([self.found, radiance])
