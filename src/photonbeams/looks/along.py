"""Factors along the beam: its colour from the light to its end, and its change toward the camera (`eye`).

The physical falloff is exp(−σt s) (Art, table 1; theory of Jarosz et al. 2011). All other factors are artistic.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, get_args

import drjit as dr
import numpy as np

from ..numerics.given import LARGEST, SMALLEST, Given, derived, given, given_color, given_number, table
from ..numerics.types import Floats
from ..runtime.device import Float
from ..scene import Array, SceneError, choice, has_gradients, shown
from .context import ShadingContext
from .described import constructor
from .factors import Corner, Decay, Factor, Number, Numbers, Value
from .ramp import Interpolation, check_ramp, ramp_ends, ramp_table
from .table import Table

#: The input of a ramp, a texture or a polynomial: the fraction of the light path, the factor's own distance in scene
#: units, the distance from the axis in radii, or the angle in degrees between the light's direction and that to the
#: camera.
Space = Literal["fraction", "distance", "radius", "angle"]


# A texture of more pixels is taken as a smooth curve.
_FEW_PIXELS = 64


class Attenuation(Decay):
    """Physical attenuation exp(−σt x), where x is the distance in the medium; the default of along and of eye.

    Notes
    -----
    It needs a medium: `estimate` raises SceneError without one.

    References
    ----------
    Nowrouzezahrai et al., "A Programmable System for Artistic Volumetric Lighting" (2011), table 1.

    Examples
    --------
    A beam that the fog dims, but that looks equally bright from any distance:

    >>> look = pb.Look(along=pb.looks.Attenuation(), eye=1.0)
    >>> bound = look.bind(pb.Medium(scattering=0.25), reach=4.0)
    >>> round(bound.along(distance=2.0, depth=2.0, fraction=0.5)[0][0], 3)  # exp(−0.25 · 2)
    0.607
    """

    def exponent(self, at: ShadingContext) -> Value:
        """Return the negative optical depth, per channel."""
        return -at.medium.extinction * at.depth


class Exponential(Decay):
    """An exponential falloff exp(−x / length), whatever the medium; x is the distance from the light, or to the camera.

    Parameters
    ----------
    length
        Distance over which the light falls to 1/e, in scene units: one number, or one for each channel.

    Raises
    ------
    SceneError
        If a length is not positive.

    Examples
    --------
    >>> falloff = pb.looks.Exponential([4.0, 2.0, 1.0])  # blue fades first
    >>> value = falloff.evaluate(pb.looks.ShadingContext(distance=2.0))
    >>> [round(channel[0], 3) for channel in value]
    [0.607, 0.368, 0.135]
    """

    @constructor
    def __init__(self, length: Numbers) -> None:
        lengths = given_color(length, "an exponential falloff's length", "a positive number, or three", SMALLEST)
        self._rate = derived(lambda each: 1 / each, lengths, color=True)

    def exponent(self, at: ShadingContext) -> Value:
        """Return −x / length, per channel."""
        return -self._rate * at.distance


class Power(Decay):
    """A power falloff (1 + x / length)^(−exponent), without the singularity of x^(−exponent) at the light.

    Parameters
    ----------
    exponent
        Exponent of the falloff. Default: 2.
    length
        Distance at which the falloff is 2^(−exponent), in scene units. Default: 1.

    Raises
    ------
    SceneError
        If the exponent is not finite, or if the length is not positive.

    Notes
    -----
    x is the distance from the light (along) or to the camera (eye); a negative x counts as 0.

    Examples
    --------
    >>> falloff = pb.looks.Power(exponent=2.0, length=1.0)
    >>> round(falloff.evaluate(pb.looks.ShadingContext(distance=3.0))[0], 4)
    0.0625
    """

    @constructor
    def __init__(self, exponent: Number = 2.0, length: Number = 1.0) -> None:
        self._exponent = given_number(exponent, "a power falloff's exponent", "a finite number").value
        size = given_number(length, "a power falloff's length", "a positive number", SMALLEST)
        self._rate = derived(lambda each: 1 / each, size)

    def exponent(self, at: ShadingContext) -> Value:
        """Return −exponent · log(1 + x / length)."""
        return -self._exponent * dr.log(1 + dr.maximum(at.distance, 0) * self._rate)


class Polynomial(Factor):
    """A polynomial Σ c_i x^i, clamped to 0 or more; x goes from 0 at `begin` to 1 at `end` and is constant outside.

    Parameters
    ----------
    coefficients
        (M,) numbers or (M, 3) colours, from the constant term up.
    begin, end
        Positions of x = 0 and x = 1, in the units of `space`. Default: 0 and 1.
    space
        Input that x runs over: "fraction" of the light path (the default), "distance" in scene units from the light
        or, for the eye, to the camera, "radius" in radii from the axis, or "angle" in degrees.

    Raises
    ------
    SceneError
        If coefficients have another shape or are not finite, or if `end` is not greater than `begin`.

    Examples
    --------
    >>> falloff = pb.looks.Polynomial([1, 0, -1])  # 1 − x²: the beam ends softly
    >>> round(falloff.evaluate(pb.looks.ShadingContext(fraction=0.5))[0][0], 3)
    0.75
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
    """A colour ramp: colours at knots, interpolated between them and constant outside.

    Parameters
    ----------
    knots
        (M,) ascending positions, M ≥ 1; 0 lies at `begin` and 1 at `end`.
    colors
        (M, 3) scene-linear colours at the knots.
    interpolation
        "none" (steps), "linear" (the default), "smooth" (eased by 3t² − 2t³ at each knot), "catmull-rom" (may
        overshoot, but not below 0) or "monotone" (never overshoots; Fritsch and Carlson 1980).
    begin, end
        Positions of knot 0 and knot 1, in the units of `space`. Default: 0 and 1.
    space
        Input that the ramp runs over: "fraction" of the light path (the default), "distance" in scene units from the
        light or, for the eye, to the camera, "radius" in radii from the axis, or "angle" in degrees.

    Raises
    ------
    SceneError
        If knots do not ascend, if shapes do not agree, if numbers are not finite, if `end` is not greater than `begin`,
        or if the positions of steps ("none") have gradients enabled: a step has no derivative with respect to its
        position.

    Notes
    -----
    A kernel reads the ramp from a table of 1024 entries.

    References
    ----------
    Johnson, Lacewell, Selle, Jarosz, "Gaussian Quadrature for Photon Beams in Tangled" (2011): a colour change as the
    beams extinguish, `ColorRamp(...) * Attenuation()`.

    Examples
    --------
    >>> ramp = pb.looks.ColorRamp([0, 1], [[1.0, 1.0, 1.0], [1.0, 0.5, 0.0]])  # white to orange
    >>> value = ramp.evaluate(pb.looks.ShadingContext(fraction=0.5))
    >>> [round(channel[0], 3) for channel in value]
    [1.0, 0.75, 0.5]
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
            text = "a ramp of steps has gradients enabled for their positions: expected plain numbers, or another"
            raise SceneError(f"{text} interpolation than none, since a step has no derivative by its position")
        self._interval = _Interval(begin, end, space, ramp_ends(places))
        inside = (places.plain - places.plain[0]) / (places.plain[-1] - places.plain[0] or 1.0)
        steps = inside[1:] if interpolation == "none" else ()
        self._table = Table(table(lambda x, y: ramp_table(x, y, interpolation), places, shades), steps)
        self.corners = self._interval.corners(tuple(inside))

    def evaluate(self, at: ShadingContext) -> Value:
        """Return the ramp's colour."""
        return self._table(self._interval.parameter(at))


class Fade(ColorRamp):
    """A fade from 1, up to the inner distance, to 0, from the outer distance on.

    Parameters
    ----------
    inner, outer
        Positions where the fade begins and ends, in the units of `space`.
    interpolation
        Shape of the fade, as in `ColorRamp`. Default: "smooth".
    space
        Input that the fade runs over: "distance" in scene units from the light or, for the eye, to the camera (the
        default), "fraction" of the light path, "radius" in radii from the axis, or "angle" in degrees.

    Raises
    ------
    SceneError
        If `outer` is not greater than `inner`.

    Examples
    --------
    >>> fade = pb.looks.Fade(inner=1.0, outer=3.0)
    >>> [round(fade.evaluate(pb.looks.ShadingContext(distance=s))[0][0], 3) for s in (0.5, 2.0, 4.0)]
    [1.0, 0.5, 0.0]
    """

    @constructor
    def __init__(
        self, inner: Number, outer: Number, interpolation: Interpolation = "smooth", space: Space = "distance"
    ) -> None:
        super().__init__([0.0, 1.0], [(1.0,) * 3, (0.0,) * 3], interpolation, inner, outer, space)


class Texture(Factor):
    """A one-dimensional colour texture along the beam, interpolated linearly.

    Parameters
    ----------
    pixels
        (M, 3) scene-linear colours, or an image (H, W, 3) whose rows are averaged. The first column lies at `begin`,
        the last at `end`. Pixels of shape (M, 3) may have gradients enabled.
    begin, end
        Positions of the first and the last column, in the units of `space`. Default: 0 and 1.
    space
        Input that the texture runs over: "fraction" of the light path (the default), "distance" in scene units from
        the light or, for the eye, to the camera, "radius" in radii from the axis, or "angle" in degrees.

    Raises
    ------
    SceneError
        If pixels have another shape or are not finite, if `end` is not greater than `begin`, or if an image (H, W, 3)
        has gradients enabled.

    Examples
    --------
    >>> texture = pb.looks.Texture([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    >>> value = texture.evaluate(pb.looks.ShadingContext(fraction=0.25))
    >>> [round(channel[0], 3) for channel in value]
    [0.75, 0.0, 0.25]
    """

    @constructor
    def __init__(self, pixels: Numbers, begin: Number = 0.0, end: Number = 1.0, space: Space = "fraction") -> None:
        self._interval = _Interval(begin, end, space)
        image = given(pixels, "a texture along the beam", "finite colours, (M, 3)").at_least(2)
        row = image.plain.mean(axis=0) if image.plain.ndim == 3 and len(image.plain) else image.plain
        if row.ndim != 2 or row.shape[1] not in (1, 3) or not len(row) or not _finite(row):
            raise SceneError(f"a texture along the beam has shape {row.shape}: expected finite colours, (M, 3)")
        if len(row) <= _FEW_PIXELS:
            self.corners = self._interval.corners(np.linspace(0, 1, len(row)).tolist())
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
    """The linear map from an input to [0, 1]."""

    def __init__(self, begin: Number, end: Number, space: Space, knots: Given | None = None) -> None:
        choice(space, "space", get_args(Space))
        ends = [given_number(each, "a falloff's begin or end", "a number") for each in (begin, end)]
        if not ends[0].plain < ends[1].plain:
            raise SceneError(f"a falloff goes from {shown(begin)} to {shown(end)}: expected an end beyond its begin")
        ends += [] if knots is None else [knots.rows[0], knots.rows[-1]]
        low, high = (float(each) for each in _ends(*(each.plain for each in ends)))
        self._begin, self._width, self._space = low, high - low, space
        self._offset = derived(lambda *parts: _ends(*parts)[0], *ends)
        self._scale = derived(lambda *parts: 1 / (_ends(*parts)[1] - _ends(*parts)[0]), *ends)

    def parameter(self, at: ShadingContext) -> Float:
        return dr.clip((getattr(at, self._space) - self._offset) * self._scale, 0, 1)

    def corners(self, inside: Sequence[float]) -> tuple[Corner, ...]:
        """Return corners at these parameters; none over the angle, which is the same along all of a ray."""
        if self._space == "angle":
            return ()
        return tuple((self._space, self._begin + float(x) * self._width) for x in inside)


def _ends(begin: Floats, end: Floats, first: Any = None, last: Any = None) -> tuple[Any, Any]:
    """Return the ends of an interval, or the positions in it of a ramp's `first` and `last` knot."""
    if first is None:
        return begin, end
    width = end - begin
    return begin + first * width, begin + last * width


def _finite(numbers: Array) -> bool:
    return bool(np.all(np.abs(numbers) <= LARGEST))
