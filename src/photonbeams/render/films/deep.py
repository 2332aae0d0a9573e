"""Deep pictures of beams: their light in bins along each pixel's ray, with the fog's opacity.

Flattened, as OpenEXR defines it, the bins give the layer `beams`, and their opacity is that of the fog.

References
----------
Kainz, "Interpreting OpenEXR Deep Pixels", https://openexr.com/en/latest/InterpretingDeepPixels.html.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...scene import Array
from .sums import DEEP

#: Bins of a pixel at most.
BINS = 20

# The least transmittance: what is behind it is divided by it.
_DARKEST = 1e-3
# Bins with a smaller part of the light of their pixel are one with their neighbours.
_LEAST = 2e-3


@dataclass(frozen=True)
class DeepPicture:
    """The samples of a deep picture, in the order of its pixels, row by row, and from front to back.

    Attributes
    ----------
    counts
        (H, W) samples of each pixel.
    front, back
        (N,) float32, planar depths at which samples begin and end.
    color
        (N, 4) float32, premultiplied light and opacity of each sample by itself.
    """

    counts: Array
    front: Array
    back: Array
    color: Array

    def part(self, top: int, left: int, rows: int, columns: int) -> DeepPicture:
        """Return a part of the picture."""
        inside = np.zeros(self.counts.shape, bool)
        inside[top : top + rows, left : left + columns] = True
        chosen = np.repeat(inside.ravel(), self.counts.ravel())
        counts = np.ascontiguousarray(self.counts[top : top + rows, left : left + columns])
        return DeepPicture(counts, self.front[chosen], self.back[chosen], self.color[chosen])

    def flat(self) -> Array:
        """Return light and opacity, (H, W, 4), as OpenEXR flattens samples that do not overlap."""
        result = np.zeros((self.counts.size, 4))
        counts = self.counts.ravel()
        ends = np.cumsum(counts)
        for number in range(int(counts.max(initial=0))):
            there = np.flatnonzero(counts > number)
            sample = self.color[ends[there] - counts[there] + number]
            result[there] += (1 - result[there, 3:]) * sample
        return result.reshape(*self.counts.shape, 4)


def pictures_of(
    low: np.ndarray, high: np.ndarray, light: np.ndarray, passed: np.ndarray, mirrored: np.ndarray | None = None
) -> dict[str, np.ndarray]:
    """Return bins, (B, N), as pictures: sorted, with their parts of the light, (B, N, 3), and transmittance.

    `passed` is the transmittance up to the end of each, and `mirrored` the light, (N, 3), that is seen in mirrors and
    through glass. Bins that do not exist have no length.
    """
    there = high > low
    there[0] = True
    order = np.argsort(np.where(there, low, np.inf), axis=0, kind="stable")
    low, high, passed, there = (np.take_along_axis(each, order, axis=0) for each in (low, high, passed, there))
    # Estimates in smoke may rise and fall along a ray.
    light = np.maximum(np.take_along_axis(light, order[..., None], axis=0), 0)
    if mirrored is not None:
        light = np.concatenate([light, mirrored[None]])
    whole = light.sum(axis=0)
    share = np.divide(light, whole, out=np.zeros_like(light), where=whole > 0)
    passed = np.minimum.accumulate(np.where(there, np.clip(passed, 0, 1), 1), axis=0)
    result = {f"{DEEP}near": low[0]}
    for each in range(len(low)):
        result[f"{DEEP}end {each:02d}"] = np.where(there[each], high[each], 0).astype(np.float32)
        result[f"{DEEP}passed {each:02d}"] = passed[each].astype(np.float32)
    for each, own in enumerate(share):
        result[f"{DEEP}share {each:02d}"] = np.ascontiguousarray(own.T, dtype=np.float32)
    return result


def deep_picture(pictures: Mapping[str, Array], gathered: Array, scattered: Array) -> DeepPicture | None:
    """Return the deep picture of which these are the pictures (H, W, C); None if there is none.

    Parameters
    ----------
    pictures
        All pictures of the sums.
    gathered, scattered
        (H, W, 3) the light of beams, and the light in fog that comes by paths from the camera or from domes. The latter
        is spread as the fog hides what is behind it.
    """
    if f"{DEEP}near" not in pictures:
        return None
    count = sum(name.startswith(f"{DEEP}end") for name in pictures)
    end, passed = (
        np.stack([pictures[f"{DEEP}{name} {each:02d}"].reshape(-1) for each in range(count)])
        for name in ("end", "passed")
    )
    shares = sum(name.startswith(f"{DEEP}share") for name in pictures)
    share = np.stack([pictures[f"{DEEP}share {each:02d}"].reshape(-1, 3) for each in range(shares)])
    there = end > 0
    there[0] = True
    if shares > count:  # what mirrors and glass show is where they are
        end, passed = (np.concatenate([each, each.max(axis=0, keepdims=True)]) for each in (end, passed))
        passed[-1] = passed[:-1].min(axis=0)
        there = np.concatenate([there, share[-1:].any(axis=2)])
    begin = np.concatenate([pictures[f"{DEEP}near"].reshape(1, -1), end[:-1]])
    passed = np.maximum(passed, _DARKEST)
    before = np.concatenate([np.ones_like(passed[:1]), passed[:-1]])
    hidden = np.where(there, before - passed, 0)
    of_fog = hidden.sum(axis=0)
    spread = np.where(of_fog > 1e-6, hidden / np.maximum(of_fog, 1e-6), there / there.sum(axis=0))
    unknown = (share.sum(axis=0) == 0) & (gathered.reshape(-1, 3) != 0)  # other passes have light there
    share = np.where(unknown, spread[..., None], share)
    light = share * gathered.reshape(-1, 3) + spread[..., None] * scattered.reshape(-1, 3)
    light, kept, end, passed = _merged(light, there, end, passed)
    return _samples(light, kept, begin[0], end, passed, gathered.shape[:2])


def _merged(
    light: np.ndarray, there: np.ndarray, end: np.ndarray, passed: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return bins of which dark ones are one with the next, and which of them are left."""
    least = _LEAST * np.abs(light).sum(axis=(0, 2))
    light, kept = light.copy(), there.copy()
    for each in range(len(light) - 1):
        # What is before the first light keeps its place: it is where the fog begins.
        onward = there[each + 1] & there[each] & (np.abs(light[each]).sum(axis=1) < least)
        light[each + 1] += np.where(onward[:, None], light[each], 0)
        kept[each] &= ~onward
    return light, kept, end, passed


def _samples(
    light: np.ndarray, kept: np.ndarray, near: np.ndarray, end: np.ndarray, passed: np.ndarray, shape: tuple[int, ...]
) -> DeepPicture:  # fmt: skip
    """Return the samples of bins: each begins where the last one that is kept ends."""
    kept = kept & (end > 0) & ((np.abs(light).sum(axis=2) > 0) | (passed < 1))
    begin, before = np.empty_like(end), np.empty_like(passed)
    last, clear = near.copy(), np.ones_like(near)
    for each in range(len(end)):
        begin[each], before[each] = last, clear
        last, clear = np.where(kept[each], end[each], last), np.where(kept[each], passed[each], clear)
    color = np.concatenate([light / before[..., None], (1 - passed / before)[..., None]], axis=2)
    chosen = kept.T  # pixels first, then from front to back
    return DeepPicture(
        chosen.sum(axis=1).reshape(shape).astype(np.int32), begin.T[chosen], end.T[chosen],
        color.transpose(1, 0, 2)[chosen].astype(np.float32),
    )  # fmt: skip
