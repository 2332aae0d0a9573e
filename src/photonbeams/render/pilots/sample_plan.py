"""The samples that each pixel has in a pass of everything but beams: no more than lower the picture's error.

A pass of n samples has the variance V = B + S / n, of which B is that of its beams, and it costs C = b + n · s. After
equal cost, the mean absolute error of a picture is in proportion to Σ √V · √C, a sum over its parts: the least is near
n = √(S b / (B s)). A pilot estimates B and S, where the usual number, which follows from counts alone, is not small.
The cost is computed from counts, too, and the pilot has a seed of its own and the cameras of all frames: the plan of a
scene is the same on every machine, in every crop, and for any number of passes.
"""

from __future__ import annotations

import numpy as np

from ..costs import of_beams, of_sample, of_tracing, surface_samples
from ..light import ShotLight
from ..passes import Statistics
from ..ray_passes import PassRenderer
from .coarse_passes import Pilot, Pixels, by_blocks, with_fewer_paths

# Passes of the pilot. It is asked where it costs less than the usual samples of one pass.
_PASSES = 2
# Rays are judged in blocks of this many, across and down.
_BLOCK = 4
# Where two samples of a pixel differ, it is an edge, where the beams have more samples.
_FEWEST = 2
# Of numbers that are nearly as good as the best, the least is taken: then the same time has more passes.
_NEARLY = 1.05


def planned_samples(light: ShotLight, pixels: Pixels, statistics: Statistics, seen: bool = True) -> int:
    """Return how many samples of surfaces each pixel has in a pass, a power of two.

    Parameters
    ----------
    light
        The light of the frame.
    pixels
        The pixels of the whole picture.
    statistics
        Statistics of the frame: the time of the pilot is added, and they may interrupt it.
    seen
        Whether rays see surfaces, which are not held out.
    """
    settings = light.settings
    walked = light.walks(light.world).surfaces is not None
    usual, sample = surface_samples(light.paths, pixels.count, walked), of_sample(walked) * pixels.count
    plain = seen and settings.surfaces and settings.program is None and bool(light.cameras) and light.world.hazy
    if not plain or usual <= _FEWEST or usual * sample < _PASSES * of_tracing(light.paths):
        return usual
    known = light.findings.samples
    if pixels.count not in known:
        own, portion = with_fewer_paths(light.seeded(0))
        passes = _PilotPasses(own.settings, own, own.max_depth, statistics.fresh())
        with statistics.phase("plan"):
            known[pixels.count] = _best(Pilot(passes, light.cameras), passes, portion, pixels, sample, usual)
    return known[pixels.count]


class _PilotPasses(PassRenderer):
    """Passes in which looks do not change with time: all frames of a film have one plan."""

    def clock(self, number: int) -> tuple[float, float]:
        """Return (0, 0)."""
        return 0.0, 0.0


def _best(pilot: Pilot, passes: PassRenderer, portion: float, pixels: Pixels, sample: float, most: int) -> int:
    """Return the number of samples, up to `most`, with the least error at equal cost.

    The `passes` of the pilot have a `portion` of the light paths; `sample` is the cost of a sample of all pixels.
    """
    pilot.add(_PASSES, each=2)
    # Photons, which samples of a pass share, are not in S. They are left out of B, too: two passes tell too little.
    single = pilot.surfaces.reshape(_PASSES, 2, *pilot.beams.shape[1:]).var(axis=1, ddof=1).mean(axis=0)
    apart = pilot.beams.var(axis=0, ddof=1) * portion**0.5
    surfaces, beams = (by_blocks(each, _BLOCK) for each in (single / pixels.averaged, apart))
    count, coarse = (each / (_PASSES * portion) for each in (passes.statistics.beams, pilot.coarse))
    cost = of_beams(count, count, pixels.count, coarse)
    choices = [1 << power for power in range(_FEWEST.bit_length() - 1, most.bit_length())]
    spent = [np.sqrt(beams + surfaces / each).sum() ** 2 * (cost + each * sample) for each in choices]
    return next(choice for choice, each in zip(choices, spent, strict=True) if each <= _NEARLY * min(spent))
