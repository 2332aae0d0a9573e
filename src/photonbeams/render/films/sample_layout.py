"""Which samples of a film's pixels are followed at once, and where they are in arrays.

Pixels may have different numbers of samples. Those with the same number are a piece, in which one sample of all its
pixels comes after the other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import drjit as dr

from ...numerics.arrays import joined, taken
from ...runtime.device import Bool, UInt32


class SamplePiece(NamedTuple):
    """Some samples of pixels that have `each` in a pass; `pixels` are their numbers, or None: all."""

    pixels: UInt32 | None
    each: int
    samples: range

    def numbers(self, count: int) -> UInt32:
        """Return the numbers of the pixels, of a film that has so many."""
        return dr.arange(UInt32, count) if self.pixels is None else self.pixels


class PixelSamples(NamedTuple):
    """Samples that are followed at once: the pixel of each, how many samples that has, and which of them it is."""

    pixel: UInt32
    each: UInt32
    sample: UInt32

    @classmethod
    def of(cls, count: int, pieces: Sequence[SamplePiece]) -> PixelSamples:
        """Return the samples of pieces of a film with so many pixels."""
        result: PixelSamples = joined([cls._of_piece(count, piece) for piece in pieces])
        dr.make_opaque(result)
        return result

    @classmethod
    def _of_piece(cls, count: int, piece: SamplePiece) -> PixelSamples:
        width = count if piece.pixels is None else dr.width(piece.pixels)
        lane, pixels = dr.arange(UInt32, width * len(piece.samples)), dr.opaque(UInt32, width)
        pixel, sample = lane % pixels, lane // pixels + dr.opaque(UInt32, piece.samples.start)
        each = dr.opaque(UInt32, piece.each, dr.width(lane))
        return cls(pixel if piece.pixels is None else taken(piece.pixels, pixel), each, sample)


def parts(pieces: Sequence[SamplePiece], count: int, most: int) -> Iterator[list[SamplePiece]]:
    """Yield pieces that are followed at once: up to `most` samples, or one sample of all pixels of a piece.

    The pieces are of a film with `count` pixels.
    """
    part, left = list[SamplePiece](), most
    for pixels, each, samples in pieces:
        width = count if pixels is None else dr.width(pixels)
        while samples:
            if part and left < width:
                yield part
                part, left = [], most
            now = samples[: max(left // width, 1)]
            part.append(SamplePiece(pixels, each, now))
            samples, left = samples[len(now) :], left - len(now) * width
    if part:
        yield part


@dataclass(frozen=True)
class SampleLayout:
    """Sample s of pixel p is number `first[p] + s · stride[p]` of an array, for s below `count[p]`.

    If `first` is None, it is p, and the others are one number for all pixels.
    """

    first: UInt32 | None
    stride: UInt32
    count: UInt32

    @classmethod
    def of(cls, count: int, pieces: Sequence[SamplePiece]) -> SampleLayout:
        """Return the layout of pieces that follow one another, of a film with so many pixels.

        Only the last piece that has a pixel counts.
        """
        if len(pieces) == 1 and pieces[0].pixels is None:
            return cls(None, dr.opaque(UInt32, count), dr.opaque(UInt32, len(pieces[0].samples)))
        begin, (first, stride, samples) = 0, (dr.zeros(UInt32, count) for _ in range(3))
        for own in pieces:
            numbers = own.numbers(count)
            dr.scatter(first, dr.arange(UInt32, dr.width(numbers)) + dr.opaque(UInt32, begin), numbers)
            dr.scatter(stride, dr.opaque(UInt32, dr.width(numbers)), numbers)
            dr.scatter(samples, dr.opaque(UInt32, len(own.samples)), numbers)
            begin += len(own.samples) * dr.width(numbers)
        dr.eval(first, stride, samples)
        return cls(first, stride, samples)

    def of_pixels(self, index: UInt32, active: Bool | bool = True) -> tuple[UInt32, UInt32, UInt32]:
        """Return where the samples of pixels begin, the distance from one to the next, and how many each has."""
        if self.first is None:
            return index, self.stride, self.count
        first, stride, count = (
            dr.gather(UInt32, each, index, active) for each in (self.first, self.stride, self.count)
        )
        return first, stride, count
