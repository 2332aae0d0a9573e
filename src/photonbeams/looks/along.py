"""Along the beam: its colour from the light to its end, and its change toward the camera (`eye`).

The physical falloff is exp(−σt s) (Art, table 1; theory of Jarosz et al. 2011). Everything else is the artist's.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, get_args

import drjit as dr
import numpy as np
import numpy.typing as npt

from ..numerics.given import LARGEST, SMALLEST, Given, derived, given, given_color, given_number, table
from ..scene import SceneError, choice, has_gradients, shown
from .context import ShadingContext
from .described import constructor
from .factors import Corner, Decay, Factor, Number, Numbers, Value
from .ramp import RESOLUTION, Interpolation, check_ramp, ramp_ends, ramp_table
from .table import Table

#: What a ramp, a texture or a polynomial runs over: fractions of the beam, scene units along the factor's own axis,
#: radii from the axis, or degrees from the view into the light.
Space = Literal["fraction", "distance", "radius", "angle"]


class Attenuation(Decay):
    """Physical attenuation exp(−σt x), x the distance in the medium; for along and for eye."""

    def exponent(self, at: ShadingContext) -> Value:
        """Return minus the optical depth, per channel."""
        return -at.medium.extinction * at.depth


class Exponential(Decay):
    """exp(−x / length): an exponential falloff of the artist's own length, one or one per channel (scene units).

    Raises
    ------
    SceneError
        A length that is not positive.
    """

    @constructor
    def __init__(self, length: Numbers) -> None:
        lengths = given_color(length, "an exponential falloff's length", "a positive number, or three", SMALLEST)
        self._rate = derived(lambda each: 1 / each, lengths, color=True)

    def exponent(self, at: ShadingContext) -> Value:
        """Return minus the distance in lengths, per channel."""
        return -self._rate * at.distance


class Power(Factor):
    """(1 + x / length)^(−exponent): a power falloff without the singularity at the light.

    Raises
    ------
    SceneError
        An exponent that is not finite, a length that is not positive.
    """

    @constructor
    def __init__(self, exponent: Number = 2.0, length: Number = 1.0) -> None:
        self._exponent = given_number(exponent, "a power falloff's exponent", "a finite number").value
        size = given_number(length, "a power falloff's length", "a positive number", SMALLEST)
        self._rate = derived(lambda each: 1 / each, size)

    def evaluate(self, at: ShadingContext) -> Value:
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
    SceneError
        Coefficients of another shape or not finite, an end that is not behind its begin.
    """

    @constructor
    def __init__(
        self, coefficients: Numbers, begin: Number = 0.0, end: Number = 1.0, space: Space = "fraction"
    ) -> None:
        expected = "finite coefficients, (M,) or (M, 3)"
        numbers = given(coefficients, "a polynomial falloff", expected)
        shape = numbers.plain.shape
        if len(shape) not in (1, 2) or shape[1:] not in ((), (1,), (3,)) or not shape[0] or not _finite(numbers.plain):
            raise SceneError(f"a polynomial falloff is {shown(coefficients)}: expected {expected}")
        self._coefficients = [derived(lambda each: each, row, color=True) for row in numbers.rows]
        self._interval = _Interval(begin, end, space)
        self.corners = self._interval.corners((0.0, 1.0))

    def evaluate(self, at: ShadingContext) -> Value:
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
    SceneError
        Knots that do not ascend, shapes that do not agree, numbers that are not finite. Places of steps ("none") whose
        gradients are enabled: a step has no derivative by its place.
    """

    @constructor
    def __init__(
        self,
        knots: Numbers,
        colors: Numbers,
        interpolation: Interpolation = "linear",
        begin: Number = 0.0,
        end: Number = 1.0,
        space: Space = "fraction",
    ) -> None:
        places = given(knots, "a ramp's knots", "positions (M,) that ascend")
        shades = given(colors, "a ramp's colours", "colours (M, 3), one a knot")
        places, shades = places.at_least(1), shades.at_least(2)
        check_ramp(places.plain, shades.plain, interpolation)
        if interpolation == "none" and has_gradients((knots, begin, end)):
            text = "a ramp of steps has gradients enabled for their places: expected plain numbers, or another"
            raise SceneError(f"{text} interpolation than none, for a step has no derivative by its place")
        self._interval = _Interval(begin, end, space, ramp_ends(places))
        self._table = Table(table(lambda x, y: ramp_table(x, y, interpolation), places, shades))
        inside = (places.plain - places.plain[0]) / (places.plain[-1] - places.plain[0] or 1.0)
        if interpolation == "none":  # in the table a step is a line between two entries: a corner at each
            entries = np.ceil(inside[1:] * (RESOLUTION - 1))
            inside = np.sort(np.concatenate([entries - 1, entries])) / (RESOLUTION - 1)
        if interpolation in ("none", "linear"):
            self.corners = self._interval.corners(tuple(inside))

    def evaluate(self, at: ShadingContext) -> Value:
        """Return the ramp's colour."""
        return self._table(self._interval.parameter(at))


class Fade(ColorRamp):
    """1 up to the inner distance, then to 0 at the outer one: scene units from the light, unless `space` says else.

    Raises
    ------
    SceneError
        An outer distance that is not beyond the inner one.
    """

    @constructor
    def __init__(
        self, inner: Number, outer: Number, interpolation: Interpolation = "smooth", space: Space = "distance"
    ) -> None:
        super().__init__([0.0, 1.0], [(1.0,) * 3, (0.0,) * 3], interpolation, inner, outer, space)


class Texture(Factor):
    """A one-dimensional colour texture along the beam: `pixels` (M, 3), or an image (H, W, 3) whose rows are averaged.

    The first column lies at `begin`, the last at `end`. Pixels may have gradients enabled, (M, 3) of them.

    Raises
    ------
    SceneError
        Pixels of another shape or not finite, an end that is not behind its begin.
    """

    @constructor
    def __init__(self, pixels: Numbers, begin: Number = 0.0, end: Number = 1.0, space: Space = "fraction") -> None:
        self._interval = _Interval(begin, end, space)
        image = given(pixels, "a texture along the beam", "finite colours, (M, 3)").at_least(2)
        row = image.plain.mean(axis=0) if image.plain.ndim == 3 and len(image.plain) else image.plain
        if row.ndim != 2 or row.shape[1] not in (1, 3) or not len(row) or not _finite(row):
            raise SceneError(f"a texture along the beam has shape {row.shape}: expected finite colours, (M, 3)")
        if image.attached is None:
            row = np.broadcast_to(row, (len(row), 3))
            self._table = Table(row if len(row) > 1 else np.repeat(row, 2, axis=0))
        elif image.plain.ndim == 2 and row.shape[1] == 3:
            self._table = Table(image.vectors)
        else:
            text = f"a texture of shape {image.plain.shape} has gradients enabled: expected one row of colours, (M, 3)"
            raise SceneError(text)

    def evaluate(self, at: ShadingContext) -> Value:
        """Return the texture's colour."""
        return self._table(self._interval.parameter(at))


class _Interval:
    """The map from an input to [0, 1]."""

    def __init__(self, begin: Number, end: Number, space: Space, knots: Given | None = None) -> None:
        choice(space, "space", get_args(Space))
        ends = [given_number(each, "a falloff's begin or end", "a number") for each in (begin, end)]
        if not ends[0].plain < ends[1].plain:
            raise SceneError(f"a falloff goes from {shown(begin)} to {shown(end)}: expected its end behind its begin")
        ends += [] if knots is None else [knots.rows[0], knots.rows[-1]]
        low, high = (float(each) for each in _ends(*(each.plain for each in ends)))
        self._begin, self._width, self._space = low, high - low, space
        self._offset = derived(lambda *parts: _ends(*parts)[0], *ends)
        self._scale = derived(lambda *parts: 1 / (_ends(*parts)[1] - _ends(*parts)[0]), *ends)

    def parameter(self, at: ShadingContext) -> Any:
        return dr.clip((getattr(at, self._space) - self._offset) * self._scale, 0, 1)

    def corners(self, inside: Sequence[float]) -> tuple[Corner, ...]:
        """Return corners at these parameters; the angle is one for all of a ray."""
        if self._space == "angle":
            return ()
        return tuple((self._space, self._begin + float(x) * self._width) for x in inside)


def _ends(begin: Any, end: Any, first: Any = None, last: Any = None) -> tuple[Any, Any]:
    """Return where an interval begins and ends; of a ramp, whose first and last knot lie elsewhere in it, these."""
    if first is None:
        return begin, end
    width = end - begin
    return begin + first * width, begin + last * width


def _finite(numbers: npt.NDArray[np.float64]) -> bool:
    return bool(np.all(np.abs(numbers) <= LARGEST))
