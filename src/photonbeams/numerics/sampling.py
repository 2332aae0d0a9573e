"""Scrambled Sobol points: in four dimensions for the light paths of a pass, in two for the samples of a pixel.

`world.warp` maps such points to discs, cones and spheres. Sources: Joe and Kuo 2008 (Sobol), Burley 2020, "Practical
hash-based Owen scrambling" (samples of a pixel).
"""

from __future__ import annotations

import drjit as dr
import numpy as np

from ..runtime.device import Array2f, Float, UInt32
from ..scene import Array
from .arrays import to_float
from .hashing import hash32, unit_float

# Joe and Kuo's polynomials and initial numbers of the second to fourth dimension.
_SOBOL = ((1, 0, (1,)), (2, 1, (1, 3)), (3, 1, (1, 3, 1)))
_HASH = (0x6C50B47C, 0xB82F1E52, 0xC7AFE638, 0x8D22F6E6)  # Burley 2020: each bit is flipped by the bits above it


def _direction_numbers() -> Array:
    """Return the direction numbers of four dimensions, (4, 32), their bits reversed: the first digit is bit 0."""
    rows = [[1] * 32]
    for degree, polynomial, initial in _SOBOL:
        m = list(initial)
        for k in range(degree, 32):
            value = m[k - degree] ^ (m[k - degree] << degree)
            for i in range(1, degree):
                value ^= ((polynomial >> (degree - 1 - i)) & 1) * (m[k - i] << i)
            m.append(value)
        rows.append(m)
    # Number k is a numerator over 2^(k + 1): its digits are k + 1 bits, the first digit is the highest bit.
    reversed_rows = [[int(f"{value:b}".zfill(k + 1)[::-1], 2) for k, value in enumerate(row)] for row in rows]
    return np.array(reversed_rows, dtype=np.uint32)


_DIRECTIONS = _direction_numbers()


def sobol_points(count: int, block: int, key: tuple[int, ...]) -> Array:
    """Return points [block·count, (block + 1)·count) of the 4D Sobol sequence scrambled by `key`, (count, 4).

    Consecutive blocks continue one sequence, so passes stratify each other.
    """
    points = sobol_digits(block * count, count)
    points = points + np.random.SeedSequence(key).generate_state(4)[:, None]
    for factor in _HASH:
        points ^= points * np.uint32(factor)
    return (_reversed(points) >> 8).T * np.float32(2.0**-24)


def sobol_digits(first: int, count: int) -> Array:
    """Return points from number `first` on before they are scrambled, (4, count): binary digits, the first in bit 0.

    SciPy has this sequence, too, but takes longer to import than everything else that a render needs.
    """
    low = (count - 1).bit_length()
    digits = np.zeros((4, 1), dtype=np.uint32)
    for bit in range(low):
        digits = np.concatenate([digits, digits ^ _DIRECTIONS[:, bit : bit + 1]], axis=1)
    index = first + np.arange(count)
    result = digits[:, index & ((1 << low) - 1)]
    above = index >> low
    for value in np.unique(above):  # two at most
        bits = [bit for bit in range(32 - low) if int(value) >> bit & 1]
        result[:, above == value] ^= np.bitwise_xor.reduce(_DIRECTIONS[:, low:][:, bits], axis=1)[:, None]
    return result


def _reversed(bits: Array) -> Array:
    """Return 32 bits in reversed order."""
    for shift, mask in ((1, 0x55555555), (2, 0x33333333), (4, 0x0F0F0F0F)):
        kept = np.uint32(mask)
        bits = ((bits >> np.uint32(shift)) & kept) | ((bits & kept) << np.uint32(shift))
    return bits.byteswap()


def sobol_block(count: int, block: int, key: tuple[int, ...]) -> tuple[Array2f, Array2f]:
    """Return `sobol_points` as two pairs."""
    return pairs(sobol_points(count, block, key))


def pairs(points: Array) -> tuple[Array2f, Array2f]:
    """Return points (N, 4) as two pairs."""
    columns = [to_float(column) for column in points.T]
    return Array2f(columns[0], columns[1]), Array2f(columns[2], columns[3])


def pixel_sample(index: UInt32, seed: UInt32) -> Array2f:
    """Return point number `index` of the 2D Sobol sequence, scrambled by `seed`.

    Each seed gives an independent sequence, for one use, which is well distributed over aligned blocks of indices. The
    indices are shuffled, too (Burley 2020, section 4); otherwise two uses would be correlated over the passes.
    """
    shuffled = _scramble(index, hash32(seed, UInt32(1)))
    x = _scramble(dr.brev(shuffled), hash32(seed, UInt32(2)))
    y = _scramble(_pascal(shuffled), hash32(seed, UInt32(3)))
    return Array2f(unit_float(x), unit_float(y))


def power_heuristic(own: Float, other: Float) -> Float:
    """Return own² / (own² + other²) (Veach 1997), computed from the ratio, because the squares may overflow."""
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
    for factor in _HASH:
        x ^= x * factor
    return dr.brev(x)


def _pascal(index: UInt32) -> UInt32:
    """Return the second Sobol dimension's bits for `index`: the Pascal matrix modulo 2 (Ahmed 2024), reversed."""
    x = UInt32(index)
    for shift, mask in ((16, 0xFFFF0000), (8, 0xFF00FF00), (4, 0xF0F0F0F0), (2, 0xCCCCCCCC), (1, 0xAAAAAAAA)):
        x ^= (x & mask) >> shift
    return dr.brev(x)
