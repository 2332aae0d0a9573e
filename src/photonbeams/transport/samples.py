"""Random numbers of pixels: low-discrepancy over the passes of each pixel and over its neighbours."""

from __future__ import annotations

from typing import Any

import drjit as dr

from ..device import Array2f, Float, UInt32
from ..hashing import hash32, unit_float
from ..simulation.sampling import pixel_sample


class Samples:
    """Samples of one pass, by the numbers of pixels (or of anything else) and by names of what they are used for.

    Passes of a pixel stand next to each other in one sequence, `most` of them at most. All numbers are opaque.
    """

    def __init__(self, seed: int, number: int, most: int) -> None:
        self.seed = dr.opaque(UInt32, seed & 0xFFFFFFFF)
        self._number, self._block = dr.opaque(UInt32, number), dr.opaque(UInt32, 1 << (most - 1).bit_length())

    def _place(self, index: Any) -> Any:
        return index * self._block + self._number

    def pair(self, index: Any, *names: Any) -> Array2f:
        """Return a point of the unit square for each index."""
        return pixel_sample(self._place(index), hash32(self.seed, *(UInt32(name) for name in names)))

    def bits(self, index: Any, *names: Any) -> UInt32:
        """Return a random integer for each index."""
        return hash32(self._place(index), self.seed, *(UInt32(name) for name in names))

    def single(self, index: Any, *names: Any) -> Float:
        """Return a number in [0, 1) for each index."""
        return unit_float(self.bits(index, *names))
