"""Cryptomattes: which objects or materials cover each pixel, and how much of it.

Layers hold the three pairs of objects and coverages with the largest coverages first; objects are hashes of names.

References
----------
Friedman, Jones, "Fully automatic ID mattes with support for motion blur and transparency" (2015), and Psyop's
Cryptomatte Specification 1.2, https://github.com/Psyop/Cryptomatte.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

OBJECT, MATERIAL = "crypto_object", "crypto_material"

RANKS = 6  # objects of a pixel: two in each of three layers

_IDS, _SHARES = "ids", "shares"

_PART = 1 << 16  # pixels that are ranked at once


class Mattes:
    """The objects that samples of each of `count` pixels meet."""

    def __init__(self, count: int) -> None:
        self._names: dict[str, int] = {}
        self._all: list[np.ndarray] = []  # numbers of names, -1: none, of samples that all pixels have
        self._more: list[np.ndarray] = []  # and of samples that only `_some` have
        self._some = np.zeros(0, np.int64)
        self._count = count

    def add(self, names: Sequence[str], objects: np.ndarray, some: np.ndarray | None = None) -> None:
        """Add a sample of each pixel, or of `some`, which are the same each time: numbers in `names`, or -1.

        All pixels of which samples differ must be among `some`.
        """
        table = [self._names.setdefault(each, len(self._names)) if each else -1 for each in names]
        found = np.array([*table, -1], np.int32)[objects]
        if some is None:
            self._all.append(found)
        else:
            self._some = some
            self._more.append(found)

    def mixed(self) -> np.ndarray:
        """Return which pixels have samples of several objects, or of an object and the background."""
        return np.logical_or.reduce([each != self._all[0] for each in self._all])

    def pictures(self, layer: str) -> dict[str, np.ndarray]:
        """Return the ids, as float32, and the coverages of a layer's ranks: (3, pixels) for every other rank."""
        numbers, shares = np.full((RANKS, self._count), -1, np.int32), np.zeros((RANKS, self._count), np.float32)
        numbers[0] = self._all[0]
        shares[0] = numbers[0] >= 0
        for places in np.array_split(np.arange(len(self._some)), len(self._some) // _PART + 1):
            part = self._some[places]
            numbers[:, part], shares[:, part] = self._ranked(part, places)
        table = np.array([*map(id_of, self._names), 0.0], np.float32)
        ids = table[numbers]
        return {
            f"{layer}/{kind} {half}": np.ascontiguousarray(each[half::2])
            for kind, each in ((_IDS, ids), (_SHARES, shares))
            for half in (0, 1)
        }

    def _ranked(self, pixels: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the numbers and the coverages of the ranks of pixels, which have these places among `_some`."""
        samples = [*(each[pixels] for each in self._all), *(each[places] for each in self._more)]
        found = np.sort(np.stack(samples), axis=0)
        first = np.ones(found.shape, bool)
        first[1:] = found[1:] != found[:-1]
        run = np.cumsum(first, axis=0) - 1
        counts = np.zeros(found.shape, np.int32)
        np.add.at(counts, (run, np.arange(len(pixels))[None]), 1)
        who = np.full(found.shape, -1, np.int32)
        np.put_along_axis(who, run, found, axis=0)
        counts[who < 0] = 0
        order = np.argsort(-counts, axis=0, kind="stable")[:RANKS]
        numbers, share = (np.take_along_axis(each, order, axis=0) for each in (who, counts))
        return np.where(share > 0, numbers, -1), (share / len(found)).astype(np.float32)


def matte_layers(pictures: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the layers of cryptomattes, (H, W, 4), of which pictures (H, W, 3) are there."""
    result = {}
    for layer in (OBJECT, MATERIAL):
        if f"{layer}/{_IDS} 0" not in pictures:
            continue
        parts = [pictures[f"{layer}/{kind} {half}"] for half in (0, 1) for kind in (_IDS, _SHARES)]
        for number in range(RANKS // 2):
            result[f"{layer}{number:02d}"] = np.stack([each[..., number] for each in parts], axis=-1)
    return result


def header_of(layer: str, names: Iterable[str]) -> dict[str, str]:
    """Return what the specification asks a file's header to say of a layer, with the hashes of all names."""
    key = f"cryptomatte/{murmur3(layer.encode()):08x}"[:19]
    manifest = {name: f"{_bits(id_of(name)):08x}" for name in names}
    return {
        f"{key}/name": layer, f"{key}/hash": "MurmurHash3_32", f"{key}/conversion": "uint32_to_float32",
        f"{key}/manifest": json.dumps(manifest, ensure_ascii=False, separators=(",", ":")),
    }  # fmt: skip


def id_of(name: str) -> float:
    """Return the number that stands for a name: its hash as a float32's bits, never infinite, NaN or denormal."""
    found = murmur3(name.encode())
    if (found >> 23) & 255 in (0, 255):
        found ^= 1 << 23
    return float(struct.unpack("<f", struct.pack("<I", found))[0])


def _bits(number: float) -> int:
    return int(struct.unpack("<I", struct.pack("<f", number))[0])


def murmur3(data: bytes) -> int:
    """Return the 32-bit MurmurHash3 of bytes, with the seed 0."""

    def turned(value: int, bits: int) -> int:
        return (value << bits | value >> (32 - bits)) & 0xFFFFFFFF

    result, rest = 0, len(data) % 4
    for (block,) in struct.iter_unpack("<I", data[: len(data) - rest]):
        result ^= turned(block * 0xCC9E2D51 & 0xFFFFFFFF, 15) * 0x1B873593 & 0xFFFFFFFF
        result = (turned(result, 13) * 5 + 0xE6546B64) & 0xFFFFFFFF
    if rest:
        last = int.from_bytes(data[len(data) - rest :], "little")
        result ^= turned(last * 0xCC9E2D51 & 0xFFFFFFFF, 15) * 0x1B873593 & 0xFFFFFFFF
    result ^= len(data)
    for shift, factor in ((16, 0x85EBCA6B), (13, 0xC2B2AE35)):
        result = (result ^ result >> shift) * factor & 0xFFFFFFFF
    return result ^ result >> 16
