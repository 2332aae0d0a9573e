"""Random numbers of pixels: low-discrepancy over the passes of each pixel and over its neighbours."""

from __future__ import annotations

import drjit as dr

from ..runtime.device import Array2f, Float, UInt32
from .arrays import joined
from .hashing import hash32, unit_float
from .sampling import pixel_sample

# Of the 32 bits of a place in a sequence, this many are for the pass, the others for the pixel.
BITS = 16


class Samples:
    """Samples of one pass, by the numbers of pixels (or of anything else) and by the names of streams.

    The passes of a pixel are neighbours in one sequence, in a block of 2^`bits`, and the blocks are in the order of the
    pixels. If this is the order of a Z-order curve, samples are well distributed in each pixel and over each square of
    pixels, and the remaining noise is fine-grained (Ahmed and Wonka 2020, "Screen-space blue-noise diffusion of Monte
    Carlo sampling error"). Further passes, and pixels beyond 2^(32 − `bits`), begin other sequences. All numbers are
    opaque.

    With `together`, the object has the samples of 2^`together` passes from `number` on, all of one sequence; `indices`
    returns the indices of pixels in all of these passes.
    """

    def __init__(self, seed: int, number: int, bits: int = BITS, together: int = 0) -> None:
        self.seed = dr.opaque(UInt32, (seed + 0x9E3779B9 * (number >> bits)) & 0xFFFFFFFF)
        self._number = dr.opaque(UInt32, number & ((1 << bits) - 1))
        self._bits, self._rest = dr.opaque(UInt32, bits), dr.opaque(UInt32, 31 - bits)
        self._together, self._which = dr.opaque(UInt32, together), dr.opaque(UInt32, (1 << together) - 1)

    def indices(self, pixels: UInt32) -> UInt32:
        """Return the indices of `pixels` in all passes, those of the first pass first."""
        which = range(int(self._which[0]) + 1)
        result: UInt32 = joined([(pixels << self._together) + dr.opaque(UInt32, each) for each in which])
        return result

    def like(self, pixels: UInt32, index: UInt32) -> UInt32:
        """Return the indices of `pixels`, or of anything else, in the passes that `index` has.

        Of their numbers 22 bits count, however many passes there are.
        """
        return ((pixels & 0x3FFFFF) << self._together) + (index & self._which)

    def _place(self, index: UInt32) -> UInt32:
        return ((index >> self._together) << self._bits) + (self._number + (index & self._which))

    def _key(self, index: UInt32, names: tuple[int | UInt32, ...]) -> UInt32:
        pixel = index >> self._together
        return hash32(self.seed, (pixel >> self._rest) >> 1, *(UInt32(name) for name in names))

    def pair(self, index: UInt32, *names: int | UInt32) -> Array2f:
        """Return a point of the unit square for each index."""
        return pixel_sample(self._place(index), self._key(index, names))

    def bits(self, index: UInt32, *names: int | UInt32) -> UInt32:
        """Return a random integer for each index."""
        return hash32(self._place(index), self._key(index, names))

    def single(self, index: UInt32, *names: int | UInt32) -> Float:
        """Return a number in [0, 1) for each index."""
        return unit_float(self.bits(index, *names))


class CountedSamples(Samples):
    """Samples of one pass in which each pixel has its own number of samples, n, a power of two up to `most`.

    The samples of a pixel's pass are neighbours in its sequence, as those of n passes in a row would be. The index of
    the sample s < n has n + s in the lowest bits.
    """

    def __init__(self, seed: int, number: int, bits: int, most: int) -> None:
        super().__init__(seed, number, min(bits, BITS + 1 - most.bit_length()), most.bit_length())

    def index(self, pixels: UInt32, each: UInt32, sample: UInt32) -> UInt32:
        """Return the indices of samples of `pixels` that have `each`."""
        return (pixels << self._together) + each + sample

    def _place(self, index: UInt32) -> UInt32:
        code = index & self._which
        power = self._power(code)
        return ((index >> self._together) << (self._bits + power)) + ((self._number - 1) << power) + code

    def _key(self, index: UInt32, names: tuple[int | UInt32, ...]) -> UInt32:
        rest = self._rest - self._power(index & self._which)
        return hash32(self.seed, (index >> self._together >> rest) >> 1, *(UInt32(name) for name in names))

    def _power(self, code: UInt32) -> UInt32:
        """Return the logarithm of the number of samples."""
        return 31 - dr.lzcnt(code)
