"""Noise along beams: computed once for each of many places on their axes, and read from there.

A pixel sees a beam at a distance of up to a radius from its axis. Beams are a blur of that size anyway, so this matters
little where the radius is at most half a cell of the finest octave. Wider beams have the noise of the pixel's place.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr

from ..runtime.device import Array3f, Float, UInt32

# Places for each cell of the lattice of the finest octave.
_PLACES = 4
# The greatest radius of beams, in cells of that lattice.
_WIDEST = 0.5
# Places of all beams, at most (64 MiB), and of a beam: with more, pixels would not be as many.
_MOST, _EACH = 1 << 24, 1 << 12


class NoiseAlongBeams:
    """A function of places, on the axes of beams.

    Parameters
    ----------
    function
        Returns the values at points of world space.
    start, end
        Where the beams begin and end.
    cell
        Size of the cells of the finest octave's lattice, in scene units.
    """

    def __init__(self, function: Callable[[Array3f], Float], start: Array3f, end: Array3f, cell: float) -> None:
        beams = dr.width(start)
        self._count = dr.opaque(UInt32, _places(start, end, cell))
        place = dr.arange(UInt32, beams * int(self._count[0]))
        beam = place // self._count
        along = Float(place - beam * self._count) * dr.rcp(Float(self._count) - 1)
        first, last = (dr.gather(Array3f, each, beam) for each in (start, end))
        self._values = function(dr.lerp(first, last, along))
        self._widest = dr.opaque(Float, _WIDEST * cell)
        dr.eval(self._values)

    @classmethod
    def worth(cls, start: Array3f, end: Array3f, moved: float, cell: float) -> bool:
        """Return whether the places are few enough, and near enough to where the beams are `moved`."""
        count = _places(start, end, cell)
        return moved <= _WIDEST * cell and count <= _EACH and count * dr.width(start) <= _MOST

    def at(self, beam: Any, along: Float, radius: Float, exact: Callable[[], Float]) -> Float:
        """Return the value at a place `along` a beam's axis, or the `exact` one where the beam is wide."""
        place = dr.clip(along * dr.rcp(dr.maximum(beam.length, 1e-20)), 0, 1) * (Float(self._count) - 1)
        low = dr.minimum(UInt32(place), self._count - 2)
        first = beam.number * self._count + low

        def read(first: UInt32, part: Float) -> Float:
            return Float(
                dr.lerp(dr.gather(Float, self._values, first), dr.gather(Float, self._values, first + 1), part)
            )

        value: Float = dr.if_stmt(
            (first, place - Float(low)), radius <= self._widest, read, lambda *_: exact(), label="noise along beams"
        )
        return value


def _places(start: Array3f, end: Array3f, cell: float) -> int:
    """Return how many places each beam has: as many as the longest one needs."""
    needed = float(dr.max(dr.norm(end - start))[0]) / cell * _PLACES
    return int(needed) + 2 if needed < _MOST else _MOST
