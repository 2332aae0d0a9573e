"""Procedural noise of a point, for dust, drift and grain in beams.

Gradient noise after Perlin ("Improving Noise", SIGGRAPH 2002): every point of the integer lattice has a random
gradient, and between the points, the gradients' planes are blended by 6x⁵ − 15x⁴ + 10x³, whose first two derivatives
are zero at both ends. Three things differ from the paper. Gradients come from a hash of 32-bit coordinates, by
arithmetic alone, without tables or gathers, so that there is no period. They fill the cube [−1, 1]^n, so that the noise
does not vanish along the lattice's lines. And the noise has the same deviation in one to four dimensions, so that
animating it does not change its contrast.

The functions have the meanings of SeExpr, the expression language of the film: `noise` is from 0 to 1, `snoise` from −1
to 1, `vnoise` is a vector of three of the latter, `fbm` and `turbulence` are sums over octaves, and `cellnoise` is
constant in each cell.

A point `p` is a Dr.Jit float array (one dimension) or a vector of two or three of them, of any precision. `time` adds
one dimension. All values are Dr.Jit arrays; a Python number becomes part of the kernel. All whole coordinates beyond
±2³¹ count as the same. The hash is the same on all devices; floats agree up to rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt
from typing import Any

import drjit as dr

from ..runtime.device import UInt32
from .guarded import Operand, times, vector_type

#: Octaves are unrolled into the kernel; the eighth is finer than a hundredth of the first.
MOST_OCTAVES = 8

#: Standard deviation of `snoise`: a quarter of its bound, so that few values have to be bent into its range.
DEVIATION = 0.25

_ROUNDED = 0.75  # magnitude from which `snoise` bends toward 1
_BITS = {1: 24, 2: 16, 3: 10, 4: 8}  # of a hash, for each component of a gradient, by dimension
_VECTOR_SEEDS = (1, 2, 3)  # of the components of `vnoise`
_OCTAVE_SEED = 4  # of the first octave
_CELL_SEED = 100  # of `cellnoise` and `random`
# A corner's weight is a product of (1 − fade) or fade, and its gradient's components have the variance ⅓. Corners are
# independent, so the n-dimensional mean of the variance is n/3 · A · B^(n−1): A = 2 ∫ x² (1 − fade)² along the
# component's own axis, B = 2 ∫ (1 − fade)² along the others.
_ALONG, _ACROSS = 535 / 9009, 181 / 231
# By number of dimensions, the factor that gives the noise its standard deviation.
_SCALE = {n: DEVIATION / sqrt(n / 3 * _ALONG * _ACROSS ** (n - 1)) for n in (1, 2, 3, 4)}
_OCTAVE_SHIFT = (0.37, 0.61, 0.17, 0.83)  # without it, all octaves would vanish together at the origin


def snoise(p: Operand, time: Operand | None = None) -> Operand:
    """Return signed noise in [−1, 1] with the mean 0; it is 0 at whole coordinates."""
    return _gradient_noise(_axes(p, time), 0)


def noise(p: Operand, time: Operand | None = None) -> Operand:
    """Return noise in [0, 1] with the mean ½."""
    return dr.fma(snoise(p, time), 0.5, 0.5)


def vnoise(p: Operand, time: Operand | None = None) -> Operand:
    """Return a vector of three independent signed noises, for example to distort positions."""
    axes = _axes(p, time)
    return vector_type(axes[0])(*(_gradient_noise(axes, seed) for seed in _VECTOR_SEEDS))


def fbm(
    p: Operand, octaves: int = 6, lacunarity: Operand | float = 2.0, gain: Operand | float = 0.5,
    time: Operand | None = None,
) -> Operand:  # fmt: skip
    """Return fractional Brownian motion: ½ + ½ Σ gain^k · snoise(lacunarity^k · p), k below `octaves`.

    With the default gain it stays in [0, 1] except for rare peaks; it is not clamped.

    Parameters
    ----------
    p, time
        Point and time. Time is scaled from octave to octave like the point, so that fine details move fast.
    octaves
        A Python integer from 1 to `MOST_OCTAVES`. It is part of the kernel.
    lacunarity, gain
        Ratios of the frequency and of the amplitude of an octave to those of the octave before it.

    Raises
    ------
    ValueError
        If the number of octaves is out of range.
    """
    return dr.fma(_octaves(_axes(p, time), octaves, lacunarity, gain, lambda value: value), 0.5, 0.5)


def turbulence(
    p: Operand, octaves: int = 6, lacunarity: Operand | float = 2.0, gain: Operand | float = 0.5,
    time: Operand | None = None,
) -> Operand:  # fmt: skip
    """Return turbulence, with creases and billows: ½ + ½ Σ gain^k · |snoise(lacunarity^k · p)|, at least ½.

    Parameters and errors are those of `fbm`.
    """
    return dr.fma(_octaves(_axes(p, time), octaves, lacunarity, gain, dr.abs), 0.5, 0.5)


def cellnoise(p: Operand, time: Operand | None = None) -> Operand:
    """Return a random number in [0, 1) that is constant in each cell of the integer lattice."""
    axes = _axes(p, time)
    state = _start(_CELL_SEED)
    for axis in axes:
        state = _mixed(state + _cell(axis))
    return _fraction(state, type(axes[0]))


def random(x: Operand, seed: Operand | float = 0.0) -> Operand:
    """Return a random number in [0, 1) for each value of x (a float or a vector) and of `seed`.

    Values are rounded to float32 before they are hashed, so that float64 gives the same numbers.
    """
    numbers: list[Any] = [*_axes(x, None), seed]
    single: Any = dr.float32_array_t(type(numbers[0]))
    state = _start(_CELL_SEED)
    for number in numbers:
        value = single(number)
        # 0 and −0 have different bits.
        bits: Any = dr.reinterpret_array(UInt32, dr.select(value == 0, single(0), value))
        state = _mixed(state + bits)
    return _fraction(state, type(numbers[0]))


def _axes(p: Operand, time: Operand | None) -> list[Operand]:
    """Return a point's coordinates, and time as the last, all of one type."""
    axes = [p[i] for i in range(len(p))] if dr.depth_v(p) > 1 else [p]
    if time is None:
        return axes
    kind = type(axes[0] + time)
    return [kind(axis) for axis in (*axes, time)]


def _octaves(
    axes: list[Operand], octaves: int, lacunarity: Operand | float, gain: Operand | float,
    of: Callable[[Operand], Operand],
) -> Operand:  # fmt: skip
    """Return Σ gain^k · of(snoise(lacunarity^k · p))."""
    if not 1 <= octaves <= MOST_OCTAVES:
        raise ValueError(f"octaves is {octaves}: expected 1 to {MOST_OCTAVES}")
    total: Any = of(_gradient_noise(axes, 0))
    amplitude: Any = gain
    for k in range(1, octaves):
        axes = [times(axis, lacunarity) for axis in axes]
        shifted = [axis + k * shift for axis, shift in zip(axes, _OCTAVE_SHIFT, strict=False)]
        total = total + amplitude * of(_gradient_noise(shifted, _OCTAVE_SEED + k))
        amplitude = times(amplitude, gain)
    return total


def _gradient_noise(axes: list[Operand], seed: int) -> Operand:
    """Return signed noise of one to four coordinates."""
    cells = [_cell(axis) for axis in axes]
    offsets = [axis - dr.floor(axis) for axis in axes]
    fades = [x * x * x * dr.fma(dr.fma(x, 6, -15), x, 10) for x in offsets]

    def blended(state: UInt32, toward: list[Operand]) -> Operand:
        """Return the noise in the slice of the lattice whose hash is `state`, at `toward` from its first corner."""
        k = len(toward)
        if k == len(axes):
            return _plane(state, toward)
        low = blended(_mixed(state + cells[k]), [*toward, offsets[k]])
        high = blended(_mixed(state + cells[k] + 1), [*toward, offsets[k] - 1])
        return dr.lerp(low, high, fades[k])

    return _kept_inside(blended(_start(seed), []) * _SCALE[len(axes)])


def _plane(state: UInt32, offset: list[Operand]) -> Operand:
    """Return gradient · offset; the gradient's components are uniform over [−1, 1], from the bits of a hash."""
    bits = _BITS[len(offset)]
    most = (1 << bits) - 1
    kind: Any = type(offset[0])
    total: Any = 0
    for k, distance in enumerate(offset):
        number = (state >> (32 - bits * (k + 1))) & most
        total = dr.fma(dr.fma(kind(number), 2 / most, -1), distance, total)
    return total


def _kept_inside(value: Operand) -> Any:
    """Return a value, bent into ±1 by a parabola beyond ±`_ROUNDED`, without a kink."""
    room = 1 - _ROUNDED
    size = dr.minimum(dr.abs(value), 1 + room)
    above = dr.maximum(size - _ROUNDED, 0)
    return dr.copysign(dr.fma(above * above, -1 / (4 * room), size), value)


def _start(seed: int) -> UInt32:
    """Return the initial hash for a seed."""
    return UInt32((seed * 0x9E3779B9 + 0x7F4A7C15) & 0xFFFFFFFF)


def _cell(x: Operand) -> UInt32:
    """Return floor(x) as 32 bits, clamped to the range of floats that fit into them."""
    whole = dr.clip(dr.floor(x), -(2.0**31), 2.0**31 - 128)
    return UInt32(dr.int32_array_t(type(x))(whole))


def _mixed(state: UInt32) -> UInt32:
    """Return 32 bits that depend on every bit of `state`: the finaliser of MurmurHash3 (Appleby 2011)."""
    state = (state ^ (state >> 16)) * 0x85EBCA6B
    state = (state ^ (state >> 13)) * 0xC2B2AE35
    return state ^ (state >> 16)


def _fraction(state: UInt32, kind: type[Operand]) -> Operand:
    """Return the upper 24 bits, which fit into a float32, as a number in [0, 1)."""
    return kind(state >> 8) * 2.0**-24
