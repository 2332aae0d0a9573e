"""Plain numbers and what they may be: the checks that every class of a scene makes."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral, Real
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]


Color = tuple[float, float, float]


DEFAULT_BEAMS = 4096  # a pass, of each light that does not say


MOST_BEAMS = 100_000_000  # that a light may say


MOST_PIXELS = 65536  # of a picture, each way


# In scene units, from the origin. Kernels square distances in single precision, which ends at 1e38.
FARTHEST = 1e12


# How far beyond the bounding sphere, in its radii, light of a lamp goes on that meets no surface. With nothing behind
# them the beams would otherwise end in view; what is further away adds less than a percent of a beam's light.
ESCAPE = 8.0


BLACK: Color = (0.0, 0.0, 0.0)


class SceneError(ValueError):
    """Something in a scene cannot be rendered; the text is one sentence for the user."""


def color(value: float | Sequence[float] | Array, name: str, minimum: float = 0.0) -> Color:
    """Return `value`, a number or three of them, as a colour of finite numbers not below `minimum`."""
    numbers = np.broadcast_to(np.asarray(value, dtype=np.float64), (3,)) if np.size(value) in (1, 3) else None
    if numbers is None or not np.all(np.isfinite(numbers)) or np.any(numbers < minimum):
        raise SceneError(f"{name} is {value}: expected one or three finite numbers of at least {minimum:g}")
    return (float(numbers[0]), float(numbers[1]), float(numbers[2]))


def rgb(pixels: Array) -> Array:
    """Return an image's colours, (…, 3): the first three of its channels, or the first one three times."""
    return pixels[..., :3] if pixels.shape[-1] >= 3 else np.repeat(pixels[..., :1], 3, axis=-1)


def number(value: float, name: str, minimum: float = -np.inf, maximum: float = np.inf) -> float:
    """Return `value` as a finite float between `minimum` and `maximum`."""
    result = float(value)
    if not np.isfinite(result) or not minimum <= result <= maximum:
        bounds = " ".join(
            words
            for words, bound in ((f"at least {minimum:g}", minimum), (f"at most {maximum:g}", maximum))
            if np.isfinite(bound)
        )
        raise SceneError(f"{name} is {value}: expected a finite number {bounds}".rstrip())
    return result


def whole(value: Any, name: str, of: str = "") -> int:
    """Return a whole number, NumPy's too, as an int; SceneError where it is none, as 64.0 and "4" are."""
    if not isinstance(value, Integral):
        raise SceneError(f"{name} is {value!r}: expected a whole number{of}")
    return int(value)


def real(value: Any, name: str, above: float = -np.inf) -> float:
    """Return a finite number, NumPy's too, as a float; SceneError where it is none, or not above `above`."""
    if isinstance(value, Real) and above < float(value) < np.inf:
        return float(value)
    shown = value if isinstance(value, Real) else repr(value)
    raise SceneError(f"{name} is {shown}: expected a finite number" + (f" above {above:g}" if above > -np.inf else ""))
