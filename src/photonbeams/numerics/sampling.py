"""Points in the unit square and the measure-preserving maps that carry them to discs, cones and spheres.

All maps keep neighbours together, so that what is stratified in the square stays stratified on the light: a beam's
footprint is the size of its cell. Sources: Shirley and Chiu 1997 (square to disc), Clarberg 2008 (square to sphere),
Joe and Kuo 2008 (Sobol), Burley 2020, "Practical hash-based Owen scrambling" (samples of a pixel).
"""

from __future__ import annotations

import drjit as dr
import numpy as np
import numpy.typing as npt
from scipy.stats import qmc

from ..runtime.device import Array2f, Float, UInt32
from .arrays import to_float
from .hashing import hash32, unit_float

_BELOW_ONE = float(np.nextafter(np.float32(1), np.float32(0)))


def sobol_points(count: int, block: int, key: tuple[int, ...]) -> npt.NDArray[np.float32]:
    """Return points [block·count, (block + 1)·count) of the scrambled 4D Sobol sequence that `key` names, (count, 4).

    Consecutive blocks continue one sequence, so passes stratify each other; skipping ahead costs about 2 ns a point.
    """
    sequence = qmc.Sobol(4, scramble=True, rng=np.random.default_rng(key))
    parts = []
    if block > 0:
        sequence.fast_forward(block * count)
    else:  # alone, or SciPy warns of counts that are no power of two
        parts.append(sequence.random(1))
    points = np.concatenate([*parts, sequence.random(count - sum(map(len, parts)))]).astype(np.float32)
    return np.minimum(points, np.float32(_BELOW_ONE))


def sobol_block(count: int, block: int, key: tuple[int, ...]) -> tuple[Array2f, Array2f]:
    """Return such points as two pairs."""
    return pairs(sobol_points(count, block, key))


def pairs(points: npt.NDArray[np.float32]) -> tuple[Array2f, Array2f]:
    """Return points (N, 4) as two pairs."""
    columns = [to_float(column) for column in points.T]
    return Array2f(columns[0], columns[1]), Array2f(columns[2], columns[3])


def pixel_sample(index: UInt32, seed: UInt32) -> Array2f:
    """Return point number `index` of the 2D Sobol sequence, scrambled by `seed`.

    A different seed gives an independent sequence, one per use, each well distributed over aligned blocks of indices.
    The indices are shuffled too (Burley 2020, section 4), or two uses would march in step over the passes.
    """
    shuffled = _scramble(index, hash32(seed, UInt32(1)))
    x = _scramble(dr.brev(shuffled), hash32(seed, UInt32(2)))
    y = _scramble(_pascal(shuffled), hash32(seed, UInt32(3)))
    return Array2f(unit_float(x), unit_float(y))


def power_heuristic(own: Float, other: Float) -> Float:
    """Return own² / (own² + other²) (Veach 1997); of the ratio, for the squares may overflow."""
    return dr.rcp(1 + dr.square(other / dr.maximum(own, 1e-20)))


def z_order(x: UInt32, y: UInt32) -> UInt32:
    """Return the place of a pixel on the Z-order curve (Morton 1966): 16 bits of each coordinate, interleaved."""

    def spread(bits: UInt32) -> UInt32:
        for shift, mask in ((8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
            bits = (bits | (bits << shift)) & mask
        return bits

    return spread(UInt32(x)) | (spread(UInt32(y)) << 1)


def _scramble(bits: UInt32, seed: UInt32) -> UInt32:
    """Return a nested uniform scramble: each bit is flipped by a hash of those above it (Laine and Karras 2011)."""
    x = dr.brev(bits)
    x += seed
    x ^= x * 0x6C50B47C
    x ^= x * 0xB82F1E52
    x ^= x * 0xC7AFE638
    x ^= x * 0x8D22F6E6
    return dr.brev(x)


def _pascal(index: UInt32) -> UInt32:
    """Return the second Sobol dimension's bits for `index`: the Pascal matrix modulo 2 (Ahmed 2024), reversed."""
    x = UInt32(index)
    for shift, mask in ((16, 0xFFFF0000), (8, 0xFF00FF00), (4, 0xF0F0F0F0), (2, 0xCCCCCCCC), (1, 0xAAAAAAAA)):
        x ^= (x & mask) >> shift
    return dr.brev(x)
