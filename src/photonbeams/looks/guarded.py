"""Arithmetic for expressions that returns a finite number for all numbers, so that no frame gets a NaN.

Values are Dr.Jit floats and vectors of three, of any precision. Where a result is undefined, these rules hold:

- The result of every operation that can grow is clamped to ±`LARGEST`, 10¹⁸, which leaves room below float32's limit
  for sums, squares and the factors of a beam. Nothing is ever infinite.
- x / 0, x % 0 and the normalised zero vector are 0. So is the square root of a negative number.
  A divisor that a GPU flushes to 0 counts as 0 everywhere.
- log(x) of x below `SMALLEST`, 10⁻¹⁸, is that of `SMALLEST`. asin and acos, in `vocabulary`, clamp theirs to ±1.
- x ** y for negative x is real for whole y, and 0 for other y; 0 ** 0 is 1, and 0 to a negative power is 0.
"""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import drjit as dr

from ..runtime.device import Array3f

#: A float or a vector of three, of any precision.
Operand: TypeAlias = dr.ArrayBase

LARGEST = 1e18
SMALLEST = 1e-18

_TINY = 1e-30  # a shorter length counts as zero: float32's numbers end at 1e-38
_LEAST_DIVISOR = 1.2e-38  # GPUs flush smaller numbers to 0
_TURN = 2 * math.pi
_EXACT_TURNS = 8192.0  # the angle up to which float32's sine reduces its argument exactly


def vector_type(like: Operand | type[Operand]) -> Any:
    """Return the type of vectors of three that matches a float, or a type of floats."""
    return dr.float64_array_t(Array3f) if dr.type_v(like) == dr.VarType.Float64 else Array3f


def saturated(x: Operand) -> Operand:
    """Return x, clamped to ±LARGEST."""
    return dr.clip(x, -LARGEST, LARGEST)


def finite(x: Operand) -> Operand:
    """Return x, clamped to ±LARGEST, and 0 for a NaN."""
    return dr.select(dr.isnan(x), 0, saturated(x))


def truth(mask: dr.ArrayBase, like: Operand) -> Operand:
    """Return 1 where `mask` holds and 0 elsewhere, as floats of the type of `like`."""
    return dr.select(mask, type(like)(1), type(like)(0))


def times(a: Operand, b: Operand | float) -> Operand:
    """Return the product."""
    return saturated(a * b)


def _is_zero(x: Operand) -> Any:
    return dr.abs(x) < _LEAST_DIVISOR


def divided(a: Operand, b: Operand) -> Operand:
    """Return the quotient; 0 where b is 0."""
    none = _is_zero(b)
    return dr.select(none, 0, saturated(a / dr.select(none, 1, b)))


def remainder(a: Operand, b: Operand) -> Operand:
    """Return the remainder of a by b, with the sign of b; 0 where b is 0."""
    return dr.select(_is_zero(b), 0, saturated(a - b * dr.floor(divided(a, b))))


def power(x: Operand, y: Operand) -> Operand:
    """Return x to the power y, with the module's rules for negative and zero x."""
    size = saturated(dr.exp2(y * dr.log2(dr.maximum(dr.abs(x), _TINY))))
    whole, odd = dr.round(y) == y, dr.floor(0.5 * y) != 0.5 * y
    signed = dr.select(x < 0, dr.select(whole, dr.select(odd, -size, size), 0), size)
    return dr.select(x == 0, dr.select(y == 0, type(size)(1), 0), signed)


def logarithm(x: Operand) -> Operand:
    """Return the natural logarithm."""
    return dr.log(dr.maximum(x, SMALLEST))


def fraction(x: Operand) -> Operand:
    """Return x minus floor(x)."""
    return x - dr.floor(x)


def sine(x: Operand) -> Operand:
    """Return the sine of an angle in radians."""
    return dr.sin(_turned(x))


def cosine(x: Operand) -> Operand:
    """Return the cosine of an angle in radians."""
    return dr.cos(_turned(x))


def tangent(x: Operand) -> Operand:
    """Return the tangent of an angle in radians."""
    return divided(sine(x), cosine(x))


def _turned(x: Operand) -> Operand:
    """Return an angle, without its whole turns where it is large: there, the device's sine may be infinite."""
    rest = dr.clip(x - _TURN * dr.round(x / _TURN), -_TURN, _TURN)
    return dr.select(dr.abs(x) <= _EXACT_TURNS, x, rest)


def dot(a: Operand, b: Operand) -> Operand:
    """Return the scalar product of two vectors."""
    return times(a.x, b.x) + times(a.y, b.y) + times(a.z, b.z)


def cross(a: Operand, b: Operand) -> Operand:
    """Return the vector product of two vectors."""
    return type(a)(
        times(a.y, b.z) - times(a.z, b.y),
        times(a.z, b.x) - times(a.x, b.z),
        times(a.x, b.y) - times(a.y, b.x),
    )


def length(v: Operand) -> Operand:
    """Return the length of a vector; its squares may leave float32's range."""
    largest = _largest(v)
    return saturated(largest * dr.norm(v / largest))


def normalized(v: Operand) -> Operand:
    """Return the unit vector of v's direction; 0 for the zero vector."""
    largest = _largest(v)
    unit = v / largest
    return dr.select(largest > _TINY, unit / dr.maximum(dr.norm(unit), 1), 0)


def _largest(v: Operand) -> Operand:
    """Return the magnitude of the largest component, at least _TINY."""
    return dr.maximum(dr.maximum(dr.abs(v.x), dr.maximum(dr.abs(v.y), dr.abs(v.z))), _TINY)
