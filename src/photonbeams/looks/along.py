"""Along the beam: its colour from the light to its end, and its change toward the camera (`eye`).

The physical falloff is exp(−σt s) (Art, table 1; theory of Jarosz et al. 2011). Everything else is the artist's.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, get_args

import drjit as dr
import numpy as np
import numpy.typing as npt

from ..numerics.arrays import opaque
from ..runtime.device import Float
from .at import At
from .factors import Corner, Decay, Factor
from .ramp import RESOLUTION, Interpolation, ramp_table
from .table import Table

#: What a ramp, a texture or a polynomial runs over: fractions of the beam, scene units along the factor's own way,
#: radii from the axis, or degrees from the view into the light.
Space = Literal["fraction", "distance", "radius", "angle"]


class Attenuation(Decay):
    """Physical attenuation exp(−σt x), x the distance in the medium; for along and for eye."""

    def exponent(self, at: At) -> Any:
        """Return minus the optical depth, per channel."""
        return -at.medium.extinction * at.depth


class Exponential(Decay):
    """exp(−x / length): an exponential falloff of the artist's own length, one or one per channel (scene units).

    Raises
    ------
    ValueError
        A length that is not positive.
    """

    def __init__(self, length: float | Sequence[float]) -> None:
        lengths = _positive(length, "an exponential falloff's length")
        self._rate = opaque(1 / lengths)

    def exponent(self, at: At) -> Any:
        """Return minus the distance in lengths, per channel."""
        return -self._rate * at.distance


class Power(Factor):
    """(1 + x / length)^(−exponent): a power falloff without the singularity at the light.

    Raises
    ------
    ValueError
        An exponent that is not finite, a length that is not positive.
    """

    def __init__(self, exponent: float = 2.0, length: float = 1.0) -> None:
        if not np.isfinite(exponent):
            raise ValueError(f"a power falloff's exponent is {exponent}: expected a finite number")
        self._exponent = dr.opaque(Float, float(exponent))
        self._rate = dr.opaque(Float, 1 / float(_positive(length, "a power falloff's length")[0]))

    def evaluate(self, at: At) -> Any:
        """Return the falloff."""
        return dr.exp2(-self._exponent * dr.log2(1 + dr.maximum(at.distance, 0) * self._rate))


class Polynomial(Factor):
    """Σ c_i x^i, not below zero, of x = 0 at `begin` to 1 at `end` (clamped outside).

    Parameters
    ----------
    coefficients
        (M,) or (M, 3), from the constant term up.
    begin, end, space
        Where x is 0 and 1, in the units of `space`: "fraction" of the beam, "distance" in scene units, "radius" in
        radii from the axis, "angle" in degrees.

    Raises
    ------
    ValueError
        Coefficients of another shape or not finite, an end that is not behind its begin.
    """

    def __init__(
        self, coefficients: npt.ArrayLike, begin: float = 0.0, end: float = 1.0, space: Space = "fraction"
    ) -> None:
        numbers = np.asarray(coefficients, dtype=np.float64)
        if numbers.ndim not in (1, 2) or not len(numbers) or not np.all(np.isfinite(numbers)):
            raise ValueError("a polynomial falloff expects finite coefficients, (M,) or (M, 3)")
        rows = np.broadcast_to(numbers.reshape(len(numbers), -1), (len(numbers), 3))
        self._coefficients = [opaque(row) for row in rows]
        self._interval = _Interval(begin, end, space)
        self.corners = self._interval.corners((0.0, 1.0))

    def evaluate(self, at: At) -> Any:
        """Return the polynomial by Horner's rule."""
        x = self._interval.parameter(at)
        result = self._coefficients[-1]
        for coefficient in reversed(self._coefficients[:-1]):
            result = dr.fma(result, x, coefficient)
        return dr.maximum(result, 0)


class ColorRamp(Factor):
    """Colours at knots, interpolated: the Talk's colour change as the beams extinguish.

    Parameters
    ----------
    knots, colors
        (M,) ascending positions and (M, 3) colours, M ≥ 1.
    interpolation
        "none" (steps), "linear", "smooth", "catmull-rom" or "monotone".
    begin, end, space
        Where knot position 0 and 1 lie: fractions of the light's path ("fraction"), scene units from the light or, for
        the eye, to the camera ("distance"), radii from the axis ("radius"), or degrees ("angle").

    Raises
    ------
    ValueError
        Knots that do not ascend, shapes that do not agree, numbers that are not finite.
    """

    def __init__(
        self,
        knots: npt.ArrayLike,
        colors: npt.ArrayLike,
        interpolation: Interpolation = "linear",
        begin: float = 0.0,
        end: float = 1.0,
        space: Space = "fraction",
    ) -> None:
        positions = np.asarray(knots, dtype=np.float64)
        values, low, high = ramp_table(positions, np.asarray(colors, dtype=np.float64), interpolation)
        width = end - begin
        self._interval = _Interval(begin + low * width, begin + high * width, space)
        self._table = Table(values)
        inside = (positions - low) / (high - low)
        if interpolation == "none":  # in the table a step is a line between two entries: a corner at each
            entries = np.ceil(inside[1:] * (RESOLUTION - 1))
            inside = np.sort(np.concatenate([entries - 1, entries])) / (RESOLUTION - 1)
        if interpolation in ("none", "linear"):
            self.corners = self._interval.corners(tuple(inside))

    def evaluate(self, at: At) -> Any:
        """Return the ramp's colour."""
        return self._table(self._interval.parameter(at))


class Fade(ColorRamp):
    """1 up to the inner distance, then to 0 at the outer one: scene units from the light, unless `space` says else.

    Raises
    ------
    ValueError
        An outer distance that is not beyond the inner one.
    """

    def __init__(
        self, inner: float, outer: float, interpolation: Interpolation = "smooth", space: Space = "distance"
    ) -> None:
        super().__init__([0.0, 1.0], [(1.0,) * 3, (0.0,) * 3], interpolation, inner, outer, space)


class Texture(Factor):
    """A one-dimensional colour texture along the beam: `pixels` (M, 3), or an image (H, W, 3) whose rows are averaged.

    The first column lies at `begin`, the last at `end`. An `Array3f` of pixels may have gradients enabled.

    Raises
    ------
    ValueError
        Pixels of another shape or not finite, an end that is not behind its begin.
    """

    def __init__(self, pixels: Any, begin: float = 0.0, end: float = 1.0, space: Space = "fraction") -> None:
        self._interval = _Interval(begin, end, space)
        if dr.is_jit_v(pixels):
            self._table = Table(pixels)
            return
        numbers = np.asarray(pixels, dtype=np.float64)
        if numbers.ndim == 3:
            numbers = numbers.mean(axis=0)
        if numbers.ndim != 2 or numbers.shape[1] not in (1, 3) or not len(numbers) or not np.all(np.isfinite(numbers)):
            raise ValueError(f"a texture along the beam has shape {numbers.shape}: expected finite colours, (M, 3)")
        row = np.broadcast_to(numbers, (len(numbers), 3))
        self._table = Table(row if len(row) > 1 else np.repeat(row, 2, axis=0))

    def evaluate(self, at: At) -> Any:
        """Return the texture's colour."""
        return self._table(self._interval.parameter(at))


class _Interval:
    """The map from an input to [0, 1]."""

    def __init__(self, begin: float, end: float, space: Space) -> None:
        if space not in get_args(Space):
            raise ValueError(f"space is {space!r}: expected one of {', '.join(get_args(Space))}")
        if not (np.isfinite(begin) and np.isfinite(end) and end > begin):
            raise ValueError(f"a falloff goes from {begin} to {end}: expected its end behind its begin")
        self._begin, self._width, self._space = float(begin), float(end - begin), space
        self._offset = dr.opaque(Float, self._begin)
        self._scale = dr.opaque(Float, 1 / self._width)

    def parameter(self, at: At) -> Any:
        return dr.clip((getattr(at, self._space) - self._offset) * self._scale, 0, 1)

    def corners(self, inside: Sequence[float]) -> tuple[Corner, ...]:
        """Return corners at these parameters; the angle is one for all of a ray."""
        if self._space == "angle":
            return ()
        return tuple((self._space, self._begin + float(x) * self._width) for x in inside)


def _positive(value: float | Sequence[float], name: str) -> npt.NDArray[np.float64]:
    numbers = np.broadcast_to(np.asarray(value, dtype=np.float64), (3,))
    if not np.all(np.isfinite(numbers)) or np.any(numbers <= 0):
        raise ValueError(f"{name} is {value}: expected a positive number")
    return numbers
