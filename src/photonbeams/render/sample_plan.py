"""The samples that each pixel has in a pass of everything but beams: as many as leave the least error at equal cost.

A pass of n samples has the variance V = B + S / n, of which B is that of its beams, and it costs C = b + n · s. After
equal cost the variance of the mean is in proportion to V · C, which is least near n = √(S b / (B s)). A pilot estimates
B and S. The cost is computed from counts, and the pilot has the same seed for all seeds and the cameras of all frames:
the plan of a scene is the same on every machine, in every crop, and for any number of passes.
"""

from __future__ import annotations

import numpy as np

from .costs import MOST_SAMPLES, of_beams, of_sample, of_tracing, surface_samples
from .light import ShotLight
from .pilots import Pilot, by_blocks
from .ray_passes import PassRenderer

# Passes of the pilot. It is asked where the usual samples of one pass cost so many times as much as the pilot.
_PASSES, _WORTH = 2, 1.0
# Rays are judged in blocks of this many, across and down.
_BLOCK = 4
# Where two samples of a pixel differ, it is an edge, where the beams have more samples.
_FEWEST = 2


def planned_samples(light: ShotLight, pixels: int, averaged: float = 1.0, seen: bool = True) -> int:
    """Return how many samples of surfaces each pixel has in a pass, a power of two.

    Parameters
    ----------
    light
        The light of the frame.
    pixels, averaged
        The pixels of the whole picture, and how many of them the pixel filter averages: it lowers the noise of surfaces
        by that factor, but not that of beams, whose strokes are many pixels wide.
    seen
        Whether rays see surfaces, which are not held out.
    """
    settings = light.settings
    walked = light.walks(light.world).surfaces is not None
    usual = surface_samples(light.paths, pixels, walked)
    plain = seen and settings.surfaces and settings.program is None and bool(light.cameras) and light.world.hazy
    spent, asking = usual * of_sample(walked) * pixels, _PASSES * of_tracing(light.paths)
    if not light.paths or not plain or spent < _WORTH * asking:
        return usual
    found = None if light.findings is None else light.findings.samples.get(pixels)
    if found is None:
        found = _best(light.seeded(0), pixels, averaged, of_sample(walked) * pixels) or usual
        if light.findings is not None:
            light.findings.samples[pixels] = found
    return found


def _best(light: ShotLight, pixels: int, averaged: float, sample: float) -> int | None:
    """Return the number of samples with the least error at equal cost; None if there is no noise.

    `sample` is the cost of a sample of all pixels.
    """
    passes = PassRenderer(light.settings, light, light.max_depth)
    pilot = Pilot(passes, light.cameras)
    pilot.add(_PASSES, each=2)
    surfaces = pilot.surfaces.reshape(_PASSES, 2, *pilot.beams.shape[1:])
    own, whole = surfaces.var(axis=1, ddof=1).mean(axis=0), surfaces.mean(axis=1) + pilot.beams
    # What samples of a pass have in common, such as photons, is noise of the pass.
    common = np.maximum(by_blocks(whole.var(axis=0, ddof=1) - 0.5 * own, _BLOCK), 0)
    own, mean = by_blocks(own / averaged, _BLOCK), by_blocks(whole.mean(axis=0), _BLOCK)
    count = passes.statistics.beams / _PASSES
    cost = of_beams(count, count, pixels)
    choices = [1 << power for power in range(_FEWEST.bit_length() - 1, MOST_SAMPLES.bit_length())]
    square = np.maximum(mean, 1e-18) ** 2
    spent = [_middle((common + own / each) / square, mean) * (cost + each * sample) for each in choices]
    return choices[int(np.argmin(spent))] if max(spent) > 0 else None


def _middle(values: np.ndarray, weight: np.ndarray) -> float:
    """Return the value that half of the weight has at most."""
    order = np.argsort(values, axis=None)
    total = np.cumsum(weight.ravel()[order], dtype=np.float64)
    return float(values.ravel()[order][np.searchsorted(total, 0.5 * total[-1])])
