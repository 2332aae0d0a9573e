"""Checks of plain numbers for the classes of a scene."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Sequence
from functools import partial
from numbers import Integral, Real
from types import NoneType
from typing import Annotated, Any, TypeAlias

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]


Color = tuple[float, float, float]

#: A colour as `color` takes it: one number, or three.
ColorLike: TypeAlias = float | Sequence[float] | Array


# In scene units, from the origin. Kernels square distances in single precision, which ends at 1e38.
FARTHEST = 1e12


# How far light that meets no surface goes on beyond the bounding sphere, in radii of that sphere. If it ended there,
# beams with nothing behind them would end in view; what is farther away adds less than a percent of a beam's light.
ESCAPE = 8.0


BLACK: Color = (0.0, 0.0, 0.0)

WHITE: Color = (1.0, 1.0, 1.0)


LONGEST = 300  # characters of a message
_PATH = re.compile(r"(\S{30})\S{20,}(\S{60})")
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")  # the last turn text around
_LONGEST_VALUE = 60  # characters of a value in a message


def printable(text: str) -> str:
    """Return text with escapes for control characters but line breaks: names hold any, which terminals obey."""
    return _CONTROL.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


def shortened(text: str, less: int = 0) -> str:
    """Return a message, `printable`, cut to `LONGEST` characters, `less` of which are kept free for what follows it.

    Long words, which are paths, are cut in the middle first.
    """
    text = printable(text)
    most = max(LONGEST - less, 1)
    if len(text) > most:
        text = brief(text)
    return text if len(text) <= most else f"{text[: most - 1]}…"


def brief(text: str) -> str:
    """Return a text whose long words, which are paths, are cut in the middle."""
    return _PATH.sub(r"\1…\2", text)


class SceneError(ValueError):
    """An error in what the user gave: something that cannot be read or rendered.

    The text is one sentence of at most 300 characters: what is wrong, where, and what was expected.

    Examples
    --------
    >>> try:
    ...     pb.Medium(scattering=-0.1)
    ... except pb.SceneError as error:
    ...     print(error)
    scattering is -0.1: expected one or three finite numbers of at least 0
    """

    def __str__(self) -> str:
        return shortened(self.whole)

    @property
    def whole(self) -> str:
        """The sentence, however long it is: for messages that shorten it themselves."""
        return super().__str__()


def shown(value: object) -> str:
    """Return a value as text for a message: on one line, of at most 61 characters."""
    try:
        array = np.array2string(value, separator=", ", threshold=9) if isinstance(value, np.ndarray) else None
        text = " ".join((array or (str(value) if isinstance(value, Real) else repr(value))).split())
    except Exception:
        text = f"a {type(value).__name__}"
    return text if len(text) <= _LONGEST_VALUE else f"{text[:_LONGEST_VALUE]}…"


def has_gradients(value: object) -> bool:
    """Return whether a value is, or holds, a Dr.Jit array with gradients enabled."""
    drjit = sys.modules.get("drjit")
    try:
        return drjit is not None and bool(drjit.grad_enabled(value))
    except RuntimeError:  # a record whose fields are no arrays of Dr.Jit's
        return False


def numbers(value: object, name: str, expected: str) -> Array:
    """Return numbers of any shape as a NumPy array; a Dr.Jit array of vectors becomes (N, 3).

    Parameters
    ----------
    value
        Numbers, lists of them, or arrays of any library.
    name, expected
        What the message calls the value, and what it says was expected.

    Raises
    ------
    SceneError
        Anything but real numbers, rows of unequal length, and what NumPy would lose: gradients of Dr.Jit arrays, and
        masks of NumPy's own.
    """
    if has_gradients(value):
        raise SceneError(f"{name} has gradients enabled, which would be lost: expected {expected}, without them")
    if _is_masked(value):
        raise SceneError(f"{name} has masked entries, which would be lost: expected {expected}, without a mask")
    try:
        found = np.asarray(_rows(value))
        if found.dtype.kind == "O" and all(isinstance(each, Real) for each in found.flat):
            found = found.astype(np.float64)
    except Exception:  # of whatever library the user's arrays are from
        found = np.asarray(None)
    if found.dtype.kind not in "buif":
        raise SceneError(f"{name} is {shown(value)}: expected {expected}")
    return found


def _is_masked(value: object) -> bool:
    """Return whether a value is, or holds in lists, a masked array of which entries are masked."""
    if isinstance(value, list | tuple):
        return any(map(_is_masked, value))
    return isinstance(value, np.ma.MaskedArray) and bool(np.any(value.mask))


def at_bounds(values: Array, *bounds: float) -> Array:
    """Return numbers in double precision; those that are a bound in single precision are that bound.

    Kernels have single precision, and numbers are often given in it: the float32 of 0.99 is above 0.99.
    """
    result = values.astype(np.float64)
    if values.dtype.kind == "f":
        kind = np.float16 if values.dtype.itemsize == 2 else np.float32
        with np.errstate(over="ignore"):
            for bound in bounds:
                near = (values.astype(kind) == kind(bound)) & np.isfinite(kind(bound))
                result = np.where(near, bound, result)
    return result


def choice(value: object, name: str, choices: Iterable[str]) -> str:
    """Return `value` if it is one of these words, else raise a SceneError that lists them."""
    listed = tuple(choices)
    if not isinstance(value, str) or value not in listed:
        raise SceneError(f"{name} is {shown(value)}: expected one of {', '.join(listed)}")
    return value


def instance(value: object, name: str, *kinds: type) -> None:
    """Raise SceneError if a value is of none of these types."""
    if not isinstance(value, kinds):
        known = " or ".join("None" if each is NoneType else f"a {each.__name__}" for each in kinds)
        raise SceneError(f"{name} is {shown(value)}: expected {known}")


def _rows(value: Any) -> Any:
    """Return Dr.Jit arrays, also those in lists, as NumPy arrays: vectors become rows, a single vector one row."""
    drjit = sys.modules.get("drjit")
    if drjit is None:
        return value
    if isinstance(value, list | tuple):
        return [_rows(each) for each in value]
    if not drjit.is_jit_v(value) or drjit.is_tensor_v(value):
        return value
    rows = value.numpy().T
    return rows[0] if len(rows) == 1 else rows


def color(value: ColorLike, name: str, minimum: float = 0.0) -> Color:
    """Return `value`, one number or three, as a colour; SceneError unless they are finite and at least `minimum`."""
    expected = f"one or three finite numbers of at least {minimum:g}"
    found = at_bounds(numbers(value, name, expected), minimum)
    if found.size not in (1, 3) or not np.all(np.isfinite(found)) or np.any(found < minimum):
        raise SceneError(f"{name} is {shown(value)}: expected {expected}")
    first, second, third = np.broadcast_to(found.ravel(), (3,))
    return float(first), float(second), float(third)


def rgb(pixels: Array) -> Array:
    """Return an image's colours, (…, 3): the first three of its channels, or the first one three times."""
    return pixels[..., :3] if pixels.shape[-1] >= 3 else np.repeat(pixels[..., :1], 3, axis=-1)


def number(value: float, name: str, minimum: float = -np.inf, maximum: float = np.inf) -> float:
    """Return `value` as a float; SceneError unless it is finite and from `minimum` to `maximum`."""
    # Stages have thousands of numbers, and what comes below takes fifty times as long.
    if isinstance(value, float) and minimum <= value <= maximum and np.isfinite(value):
        return float(value)
    bounds = [
        words
        for words, bound in ((f"at least {minimum:g}", minimum), (f"at most {maximum:g}", maximum))
        if np.isfinite(bound)
    ]
    expected = " ".join(["a finite number", " and ".join(bounds)]).strip()
    found = at_bounds(numbers(value, name, expected), minimum, maximum).ravel()
    if len(found) != 1 or not np.isfinite(found[0]) or not minimum <= found[0] <= maximum:
        raise SceneError(f"{name} is {shown(value)}: expected {expected}")
    return float(found[0])


def array(
    value: object, name: str, expected: str, shape: tuple[int, ...], least: float = -np.inf, inverse: bool = False
) -> Array:
    """Return `value` as finite float64 numbers of a shape; SceneError for others.

    It is one too if a number is below `least`, or, with `inverse`, if a matrix has none.
    """
    found = numbers(value, name, expected).astype(np.float64)
    fits = found.shape == shape and np.all(np.isfinite(found)) and np.all(found >= least)
    if not fits or (inverse and np.linalg.matrix_rank(found[:3, :3]) < 3):
        raise SceneError(f"{name} is {shown(value)}: expected {expected}")
    return found


def count(value: object, name: str, maximum: float = np.inf, minimum: float = 0) -> int:
    """Return a whole number, 0 or more; SceneError for anything else."""
    return int(number(whole(value, name), name, minimum, maximum))


def plain(value: Any) -> Any:
    """Return the number in an array without axes, and NumPy's True and False as Python's; other values as they are."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]  # it keeps its precision, which `at_bounds` needs
    return bool(value) if isinstance(value, np.bool_) else value


def whole(value: object, name: str, of: str = "") -> int:
    """Return a whole number, also a NumPy one, as an int; SceneError for anything else, such as 64.0 and "4"."""
    value = plain(value)
    if not isinstance(value, Integral):
        raise SceneError(f"{name} is {shown(value)}: expected a whole number{of}")
    return int(value)


def as_float(value: Real) -> float:
    """Return a number as a float, also a whole one that is too large: infinity."""
    try:
        return float(value)
    except OverflowError:
        return np.inf


# Types of fields that hold what a check returns: see `declared.arguments`.
Finite = Annotated[float, number]
NotNegative = Annotated[float, partial(number, minimum=0.0)]
Count = Annotated[int, count]
#: A colour, given as one number or three.
Tint = Annotated[Color, color]
#: A point or a direction, (3,).
Vector = Annotated[Array, partial(array, expected="3 finite numbers", shape=(3,))]
#: A transform for column vectors, (4, 4).
Frame = Annotated[Array, partial(array, expected="4 x 4 finite numbers", shape=(4, 4))]
Transform = Annotated[
    Array, partial(array, expected="4 x 4 finite numbers, a transform that can be inverted", shape=(4, 4), inverse=True)
]

# Defaults of such fields.
ORIGIN: Any = (0.0, 0.0, 0.0)
AHEAD: Any = (0.0, 0.0, -1.0)
IDENTITY: Any = tuple(map(tuple, np.eye(4)))
