"""Hashes of integers in kernels, and random numbers made from them."""

from __future__ import annotations

import zlib

from ..runtime.device import Float, UInt32


def hash32(*values: UInt32) -> UInt32:
    """Return a hash of integers.

    After each value, the bits are mixed by the function [16 21f0aaad 15 d35a2d97 15] of Wellons' page on the
    hash-prospector (https://github.com/skeeto/hash-prospector), whose bias is 0.108; that of his lowbias32 is 0.174.
    """
    state = UInt32(0x9E3779B9)
    for value in values:
        state = (state ^ value) * 0x85EBCA6B + 0x68BC21EB
        state ^= state >> 16
        state *= 0x21F0AAAD
        state ^= state >> 15
        state *= 0xD35A2D97
        state ^= state >> 15
    return state


def unit_float(bits: UInt32) -> Float:
    """Return the upper 24 bits as a number in [0, 1)."""
    return Float(bits >> 8) * 2.0**-24


def key_of(*names: int | str) -> int:
    """Return a 32-bit number for the stream of samples with these names, the same in every process."""
    return zlib.crc32(repr(names).encode())
