"""Sums over the passes of a view, with the same bits whichever machine adds which passes, in whatever order.

Floating-point addition is not associative, so the order of additions is fixed: neighbouring passes are added in pairs,
pairs in fours, and so on up to blocks, and the sums of blocks are added from the first one on. Ranges of passes from
several machines thus join to the sums of one. NumPy adds them, because Dr.Jit may round denormal numbers to 0.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from math import ceil
from threading import Lock

import numpy as np

from ...scene import SceneError

#: Passes in a block. With larger blocks partial sums take more memory; with smaller ones more sums are sent.
BLOCK = 16

#: Pictures by name, each (pixels,) or (3, pixels), float32.
Pictures = Mapping[str, np.ndarray]

_MOST_PIXELS = 1 << 18  # pixels from which the error is estimated

#: Held while passes are added to sums: whoever holds it in another thread, sees sums of whole passes.
ADDING = Lock()

_MOST_PASSES = 2**31
_PASSES = re.compile(r"([0-9]{1,10})\+([0-9]{1,10})")  # the first pass of a sum, and how many it has

# Pictures of one pass, to which nothing is added, and what the names of others begin with: cryptomattes, deep pictures.
DEPTH, NORMAL, POSITION, MOTION = "depth", "normal", "position", "motion"
DEEP = "deep/"
_ONCE = re.compile(f"({DEPTH}|{NORMAL}|{POSITION}|{MOTION})$|crypto_|{DEEP}")

# The guides of denoisers: means over all samples, while `NORMAL` is the normal along one ray.
ALBEDO, MEAN_NORMAL = "albedo", "mean normal"

#: Prefix of the names of layers that are kept as they were before denoising.
NOISY = "noisy_"

# The light of pixels, and the squares of it in each pass; "light/surface" is for the layer `surface` alone.
LIGHT, SQUARES = "light", "squares"


class PassSums:
    """Sums of pictures over passes. A picture that a pass lacks is black in it."""

    def __init__(self) -> None:
        self._blocks: Pictures = {}  # the sums of the first blocks, up to the first gap
        self._whole = 0  # passes in these
        self._parts: dict[tuple[int, int], Pictures] = {}  # other sums, by first pass and number of passes

    def __len__(self) -> int:
        """Return the number of passes."""
        return self._whole + sum(count for _, count in self._parts)

    def add(self, number: int, pictures: Pictures) -> None:
        """Add pass `number`; its arrays must not be changed afterwards."""
        with ADDING:
            self._insert(number, 1, pictures)

    def join(self, other: PassSums) -> None:
        """Add all passes of `other`, and take over its arrays; raise SceneError if some passes are here already."""
        with ADDING:
            for (first, count), pictures in other._all():
                self._insert(first, count, pictures)

    def ranges(self) -> list[range]:
        """Return the passes as ranges, in order, with gaps between them."""
        result: list[range] = []
        for (first, count), _ in self._all():
            begin = result.pop().start if result and result[-1].stop == first else first
            result.append(range(begin, first + count))
        return result

    def total(self, names: Collection[str] | None = None) -> dict[str, np.ndarray]:
        """Return the sums over all passes, of the pictures with these `names` or (None) of all."""
        result: Pictures = {}
        for _, pictures in self._all():
            result = _added(result, {name: pictures[name] for name in names or pictures if name in pictures})
        return dict(result)

    def error(self) -> float:
        """Return the relative standard error of a film's mean, averaged over the middle half of the light.

        A quarter of the light is in pixels with smaller errors, a quarter in pixels with larger ones.
        The estimate takes the differences between passes as independent. But the passes continue low-discrepancy
        sequences, so the true error tends to be smaller. NaN before there are two passes, or if squares of the light
        overflow.
        """
        total = self.total((LIGHT, SQUARES))
        if len(self) < 2 or len(total) < 2:
            return float("nan")
        step = ceil(total[LIGHT].size / _MOST_PIXELS) | 1  # odd, so that rows have different columns
        mean, squares = (total[name][::step] / len(self) for name in (LIGHT, SQUARES))
        lit = mean > 0
        if not lit.any():
            return 0.0
        with np.errstate(over="ignore", invalid="ignore"):  # squares of the brightest light are infinite
            relative = np.sqrt(np.maximum(squares - mean * mean, 0)[lit] / (len(self) - 1)) / mean[lit]
        order = np.argsort(relative)
        # Without weights, many pixels that hardly any light reaches would decide alone. Where half of the light has no
        # noise, the median would be the error of either half. A mean of all would be that of fireflies.
        light = np.cumsum(mean[lit][order], dtype=np.float64)
        if not np.isfinite(light[-1]):
            return float("nan")
        shares = np.diff(np.clip(light / light[-1], 0.25, 0.75), prepend=0.25)
        counted = shares > 0
        middle = float(2 * (relative[order][counted] * shares[counted]).sum())
        return middle if np.isfinite(middle) else float("nan")

    def variance(self, layer: str) -> np.ndarray | None:
        """Return the variance of a layer's mean light by pixels, estimated as in `error`; None if it is not known."""
        names = f"{LIGHT}/{layer}", f"{SQUARES}/{layer}"
        total = self.total(names)
        if len(self) < 2 or not total or not np.isfinite(total[names[1]]).all():
            return None
        mean, squares = (total[name] / len(self) for name in names)
        return np.maximum(squares - mean * mean, 0) / (len(self) - 1)

    def state(self) -> dict[str, np.ndarray]:
        """Return the partial sums by name; `restored` makes the same sums from them."""
        return {f"{first}+{count}/{name}": each for (first, count), own in self._all() for name, each in own.items()}

    @classmethod
    def restored(cls, state: Mapping[str, np.ndarray]) -> PassSums:
        """Return the sums with this `state`; raise ValueError if it is not valid."""
        parts: dict[tuple[int, int], dict[str, np.ndarray]] = {}
        for name, each in state.items():
            place, _, picture = name.partition("/")
            if not (found := _PASSES.fullmatch(place)):
                raise ValueError(f"it has sums of {place[:40]!r}: expected first+count of passes")
            parts.setdefault((int(found[1]), int(found[2])), {})[picture] = each
        result = cls()
        for (first, count), pictures in parts.items():
            # As `_insert` joins them: whole blocks from the first pass on, and powers of two.
            blocks = first == 0 and count % BLOCK == 0
            power = 0 < count <= BLOCK and BLOCK % count == 0 and first % count == 0
            if not (blocks or power) or not 0 < first + count <= _MOST_PASSES or first < 0:
                raise ValueError(f"passes {first}+{count} are out of range")
            _check_pictures(pictures)
        for (first, count), pictures in sorted(parts.items()):
            result._insert(first, count, pictures)
        return result

    def _all(self) -> Iterator[tuple[tuple[int, int], Pictures]]:
        if self._whole:
            yield (0, self._whole), self._blocks
        yield from sorted(self._parts.items(), key=lambda part: part[0])

    def _insert(self, first: int, count: int, pictures: Pictures) -> None:
        for there in self.ranges():
            if first < there.stop and there.start < first + count:
                both = range(max(first, there.start), min(first + count, there.stop))
                raise SceneError(f"passes {both.start} to {both.stop - 1} are there twice: expected each pass once")
        while count < BLOCK and (other := self._parts.pop((first ^ count, count), None)) is not None:
            pictures = _added(other, pictures, count > 1) if first & count else _added(pictures, other, count > 1)
            first, count = first & ~count, 2 * count
        self._parts[first, count] = pictures
        while (block := self._leading()) is not None:
            self._blocks = _added(self._blocks, self._parts.pop(block), self._whole > 0)
            self._whole += block[1]

    def _leading(self) -> tuple[int, int] | None:
        """Return the part that continues where the first blocks end, if it consists of whole blocks."""
        return next((part for part in self._parts if part[0] == self._whole and part[1] % BLOCK == 0), None)


def _check_pictures(pictures: Pictures) -> None:
    """Raise ValueError for pictures that no pass can have: of different sizes, or with numbers that are not finite."""
    for name, each in pictures.items():
        if each.dtype != np.float32 or each.shape[-1:] != next(iter(pictures.values())).shape[-1:]:
            raise ValueError(f"{name[:60]} has another type or size")
        if each.ndim not in (1, 2) or (each.ndim == 2 and len(each) != 3):
            raise ValueError(f"{name[:60]} has the shape {each.shape}: expected (pixels,) or (3, pixels)"[:120])
        # The background is infinitely far away, and squares of the brightest light overflow single precision.
        wrong = np.isnan(each) if name == DEPTH or name.startswith(SQUARES) else ~np.isfinite(each)
        if wrong.any():
            raise ValueError(f"{name} has values that are not finite numbers")


def _added(first: Pictures, second: Pictures, own: bool = False) -> Pictures:
    """Return the sums of pictures; one that only one side has stays as it is. With `own`, the first is overwritten."""
    result = {**second, **first}
    for name in (each for each in first.keys() & second.keys() if not _ONCE.match(each)):
        replaced = first[name] if own and first[name].flags.writeable else None
        with np.errstate(over="ignore"):  # squares of the brightest light are infinite
            result[name] = np.add(first[name], second[name], out=replaced)
    return result
