"""Pictures of Mitsuba scenes with several seeds, and a test of whether two sets of them have the same means."""

import numpy as np

from tests.helpers.mitsuba_scenes import by_beams, frames, rgb

SEEDS = 8
SMALL = {"radius": 0.01, "alpha": 1.0}


def pictures(scene, seeds=SEEDS, **given):
    found = frames(scene, by_beams(**{"passes": 1, "beams": 16384, **given}), seeds)
    return np.array([each.layers()["rgba"][..., :3] for each in found])


def blocks(picture):
    """Return the means of 16 square blocks of pixels of a square picture, (…, blocks, 3)."""
    *more, height, width, channels = picture.shape
    size = height // 4
    cut = picture.reshape(*more, height // size, size, width // size, size, channels)
    return cut.mean(axis=(-4, -2)).reshape(*more, -1, channels)


def agree(ours, reference, bias):
    """Assert that two sets of pictures have the same mean and the same means of blocks; return True.

    Each mean has a Z-test against the spread between the pictures of both sets, beyond a bias: beams of the settings'
    `radius` blur edges. The bias is `bias` times the mean, and for blocks three times that fraction of the brightest
    block. The largest of the 48 deviations may be 4.5 by chance, as few pictures give the spread. The relative spread
    of a block is at least the median of all blocks.
    """
    means = [each.mean(axis=(1, 2)) for each in (ours, reference)]
    own = [blocks(each) for each in (ours, reference)]
    for values, allowed in ((means, bias), (own, 3 * bias)):
        center = [each.mean(axis=0) for each in values]
        scale = center[1].max(axis=0) if values is own else center[1]
        spread = [each.std(axis=0, ddof=1) / np.sqrt(SEEDS) for each in values]
        if values is own:
            spread = [np.maximum(each, np.median(each / np.maximum(mid, 1e-9)) * mid)
                      for each, mid in zip(spread, center, strict=True)]  # fmt: skip
        error = np.sqrt(spread[0] ** 2 + spread[1] ** 2)
        off = np.abs(center[0] - center[1]) - allowed * scale
        assert (off < 4.5 * error).all(), (center[0] / center[1], error / center[1])
    return True


LAMP = {"type": "sphere", "center": [-2.0, 1.5, 0.5], "radius": 0.3, "emitter": {"type": "area", "radiance": rgb(30.0)}}
INSIDE = {"type": "point", "position": [0.3, 0.4, 0.2], "intensity": rgb([3.0, 2.0, 1.0])}
