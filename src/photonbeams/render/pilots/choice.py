"""Beams or paths: the choice of the emitters whose light has less noise by walks than by beams and photons.

A pilot renders the light of each kind of emitter both ways, along several hundred rays and in a few passes, without
direct light, which is the same in both. It prefers the way with less noise at equal cost. Walks that miss light which
beams find are never preferred, however little noise they have: they would find it at some time, as bright dots.

The cost is computed from counts, not measured by a clock: the same scene has the same picture on every machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...scene import Array
from ..costs import WALK, of_beams
from ..ray_passes import PassRenderer
from .coarse_passes import FEWER, Pilot, Pixels, by_blocks, with_fewer_paths

if TYPE_CHECKING:
    from ..lights import Lights

# Passes that trace light, and passes of walks alone. The number of first passes, which are enough if either way has
# this many times the noise of the other.
_TRACED, _UNTRACED = 4, 8
_FIRST, _SURE = 2, 5.0
# The noise of walks counts as so many times less: it differs from pixel to pixel, so that eyes and denoisers see
# through it, while that of beams is blotches.
_GRAIN = 4.0
# Walks with less noise than this are preferred at once: a variance in units of the mean's square.
_QUIET = 0.1
# Rays are judged in blocks of this many, across and down: all eight samples of a single ray may miss the light.
_BLOCK = 8
# The fraction of the mean below which a block is too dark to be judged by its own light.
_DARK = 0.01
# Walks miss light if their mean is below this fraction of that of beams, and by more than so many standard errors.
_MISSED, _SURELY = 0.95, 3.0


def preferred(lights: Lights, emitters: Sequence[int], pixels: Pixels) -> list[int]:
    """Return the numbers of those emitters whose light walks should meet, for passes of these pixels.

    Without media that is all of them: most of the light is then direct, which is the same either way, and photons leave
    blotches. Else it includes those whose beams do not reach all fog. Without a camera it is none.
    """
    world = lights.world
    if not world.hazy:
        return list(emitters)
    everyone, result = range(len(world.emitters)), world.short_of_fog(emitters)
    kinds: dict[bool, list[int]] = {}
    for each in emitters:
        if each not in result:
            kinds.setdefault(world.emitters[each].lamp.bare.sharp, []).append(each)
    for own in kinds.values() if lights.cameras else ():
        if _prefers_walks(lights, own, frozenset(everyone) - set(own), pixels):
            result += own
    return sorted(result)


def _prefers_walks(lights: Lights, own: Sequence[int], dark: frozenset[int], pixels: Pixels) -> bool:
    """Return whether walks should meet the light of some emitters, while others are `dark`."""
    portal = lights.portal
    walks = _Trial(lights, own, dark)
    if walks.noise() <= _QUIET:
        return True
    beams = _Trial(lights, (), dark)
    if lights.portal is not portal:  # the pilot of the light paths has found one
        walks = _Trial(lights, own, dark)
    ratio = walks.noise() * _cost(walks, beams, pixels) / max(beams.noise(), 1e-30)
    if ratio > _SURE:
        return False
    if ratio > 1 / _SURE:
        beams.add(_TRACED - _FIRST)
        if walks.traces:
            walks.add(_TRACED - _FIRST)
    sharp = lights.world.emitters[own[0]].lamp.bare.sharp  # all of a kind
    return prefers_walks(beams.found, walks.found, _cost(walks, beams, pixels), may_miss=sharp)


def _cost(walks: _Trial, beams: _Trial, pixels: Pixels) -> float:
    """Return the cost of walks that look as quiet as a pass of them, in passes of beams."""
    return walks.cost(pixels.count) / (_GRAIN * pixels.averaged * beams.cost(pixels.count) * FEWER**-0.5)


def prefers_walks(beams: Array, walks: Array, cost: float, may_miss: bool = True) -> bool:
    """Return whether walks have less noise than beams at equal cost.

    Parameters
    ----------
    beams, walks
        The radiance of rays in some passes of each, (P, H, W).
    cost
        The cost of a pass of walks over that of a pass of beams.
    may_miss
        Whether walks may miss the light. They meet that of a sky; its beams are wide, and bring too much.
    """
    mean = 0.5 * (beams.mean(axis=0) + walks.mean(axis=0))
    totals = [each.mean() for each in (beams, walks)]
    errors = [np.sqrt(each.var(axis=0, ddof=1).mean() / each.size) for each in (beams, walks)]
    missed = totals[0] - totals[1] > _SURELY * np.hypot(*errors)
    if may_miss and missed and totals[1] < _MISSED * totals[0]:
        return False
    return noise(walks, mean) * cost <= noise(beams, mean)


def noise(found: Array, mean: Array, block: int = _BLOCK) -> float:
    """Return the variance of several pictures, (P, H, W), in units of the square of their `mean`, (H, W).

    The variance of each block of pixels is taken relative to its light, and then averaged over the blocks, weighted by
    their light: dark corners may have some noise. Pixels at the edges beside whole blocks do not count.
    """
    variance, light = (by_blocks(each, block) for each in (found.var(axis=0, ddof=1), mean))
    return float((variance / np.maximum(light, max(_DARK * light.mean(), 1e-30))).sum() / max(light.sum(), 1e-30))


class _Trial:
    """A pilot of a scene's light except what comes straight from emitters, and what its passes cost.

    It begins with the first passes over the rays of the first camera.
    """

    def __init__(self, lights: Lights, walked: Sequence[int], dark: frozenset[int]) -> None:
        fewer, self._portion = with_fewer_paths(lights.light(walked, dark))
        self._light = replace(fewer, shines=False)
        self._passes = PassRenderer(fewer.settings, self._light, fewer.max_depth)
        self._pilot = Pilot(self._passes, lights.cameras[:1])
        self.add(_FIRST if self.traces else _UNTRACED)

    @property
    def traces(self) -> bool:
        """Whether light paths are traced."""
        return self._light.varies

    @property
    def found(self) -> Array:
        """The radiance of rays in passes, the mean of the channels, (P, H, W)."""
        return self._pilot.surfaces + self._pilot.beams

    def noise(self) -> float:
        """Return the noise of the radiance so far."""
        return noise(self.found, self.found.mean(axis=0))

    def cost(self, pixels: int) -> float:
        """Return the cost of a pass over this many pixels, with all of the scene's light paths."""
        scale = 1 / (max(self._portion, 1e-30) * len(self.found))
        beams, photons = scale * self._passes.statistics.beams, scale * self._pilot.photons
        return (of_beams(beams + photons, beams, pixels) if self.traces else 0.0) + (
            WALK * pixels if self._light.walks(self._light.world).media else 0.0
        )

    def add(self, passes: int) -> None:
        """Add passes; without beams and photons, all at once."""
        self._pilot.add(passes, 1 if self.traces else passes)
