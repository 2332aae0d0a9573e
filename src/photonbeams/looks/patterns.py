"""Procedural factors: expressions, noise in space, and variation between beams."""

from __future__ import annotations

from typing import Literal, get_args

import drjit as dr

from ..numerics.given import SMALLEST, derived, given_number
from ..scene import SceneError, choice, shown, whole
from .context import INPUTS, ShadingContext
from .described import constructor
from .expression import parse
from .factors import Factor, Number, Numbers, Value
from .noise import MOST_OCTAVES, fbm

NoiseSpace = Literal["world", "light"]


class Expression(Factor):
    """A factor from an expression, such as `smoothstep(0, 1, s) * (0.6 + 0.4 * noise(4 * P + time))`.

    Parameters
    ----------
    text
        The expression. It may use numbers, operators, comparisons, `a if c else b`, vectors `[x, y, z]`, the inputs
        s, distance, r, t, angle, cosine, P, Pl, time, frame, random, id, light and generation, and functions such as
        mix, smoothstep, pulse, noise and fbm.

    Raises
    ------
    ExpressionError
        If the text is not an expression; the message names the column. It is a SceneError.

    Notes
    -----
    The value is finite, and not below 0, for any text and any inputs. The text is never run as Python. The functions
    are those of SeExpr and GLSL; `photonbeams.looks.expression.describe()` lists inputs and functions.

    Wherever a factor is expected, the text alone is enough: `pb.Look(along="1 - s")`.

    Examples
    --------
    >>> glow = pb.looks.Expression("[1, 0.8, 0.5] * (1 - s)")
    >>> value = glow.evaluate(pb.looks.ShadingContext(fraction=0.5))
    >>> [round(channel[0], 3) for channel in value]
    [0.5, 0.4, 0.25]
    """

    rough = True

    @constructor
    def __init__(self, text: str) -> None:
        self.parsed = parse(text)

    def evaluate(self, at: ShadingContext) -> Value:
        """Return the expression's value."""
        return dr.maximum(self.parsed.evaluate(lambda name: getattr(at, INPUTS[name])), 0)


class Noise(Factor):
    """Dust and wisps in space: 1 + amount · contrast · (2 fbm − 1), clamped to 0 or more; the mean is about 1.

    Parameters
    ----------
    amount
        Strength of the noise, 0 to 1. Default: 1.
    scale
        Size of the largest wisps in scene units. Default: 1.
    octaves
        Number of octaves, 1 to 8; each has finer wisps than the one before. Default: 4.
    contrast
        Contrast of the wisps, 0 or more, from soft to torn: at 2, a tenth of the space is dark. Default: 2.
    drift
        (3,) velocity of the wisps in scene units per second. Default: none.
    evolution
        How many times per second the wisps change into others. Default: 0.
    space
        "world" if the wisps stay in the world (the default), "light" if they move with the light.

    Raises
    ------
    SceneError
        If a number is out of range or not finite, or if the space is unknown.

    Notes
    -----
    fbm is fractional Brownian motion: a sum over octaves of gradient noise after Perlin. The number of octaves is part
    of a kernel; all other numbers are not.

    References
    ----------
    Perlin, "Improving Noise" (2002).

    Examples
    --------
    >>> import drjit as dr
    >>> from photonbeams.runtime.device import Array3f
    >>> points = Array3f(np.random.default_rng(0).uniform(0, 10, (3, 10000)))
    >>> dust = pb.looks.Noise(scale=0.5).evaluate(pb.looks.ShadingContext(place=lambda: points))
    >>> abs(dr.mean(dust)[0] - 1) < 0.1, dr.min(dust)[0]
    (True, 0.0)
    """

    @constructor
    def __init__(
        self,
        amount: Number = 1.0,
        scale: Number = 1.0,
        octaves: int = 4,
        contrast: Number = 2.0,
        drift: Numbers = (0.0, 0.0, 0.0),
        evolution: Number = 0.0,
        space: NoiseSpace = "world",
    ) -> None:
        parts = (
            given_number(amount, "a noise's amount", "a number from 0 to 1", 0, 1),
            given_number(contrast, "a noise's contrast", "a number that is not negative", 0),
        )
        self._gain = derived(lambda each, more: each * more, *parts)
        self._rate = derived(lambda each: 1 / each, given_number(scale, "a noise's scale", "a positive size", SMALLEST))
        self._octaves = whole(octaves, "a noise's octaves", f" from 1 to {MOST_OCTAVES}")
        if not 1 <= self._octaves <= MOST_OCTAVES:
            raise SceneError(f"a noise's octaves is {shown(octaves)}: expected a whole number from 1 to {MOST_OCTAVES}")
        self._drift = given_number(drift, "a noise's drift", "three finite numbers", shapes=((3,),)).value
        changes = given_number(evolution, "a noise's evolution", "a number")
        self._evolution, self._still = changes.value, changes.attached is None and not changes.plain
        self._space = choice(space, "a noise's space", get_args(NoiseSpace))

    def evaluate(self, at: ShadingContext) -> Value:
        """Return the noise."""
        point = at.local if self._space == "light" else at.position
        moved = (point - self._drift * at.time) * self._rate
        # The fourth dimension doubles the work, so noise that does not evolve has three.
        time = None if self._still else self._evolution * at.time
        if dr.grad_enabled(time):
            # One entry for each point: a derivative by one number is summed by a kernel for each use of the number.
            time = time + dr.detach(moved.x - moved.x)
        return dr.maximum(dr.fma(self._gain, 2 * fbm(moved, self._octaves, time=time) - 1, 1), 0)


class Variation(Factor):
    """Variation of brightness between beams: 1 + amount · (2 random − 1), the same for a beam in all frames.

    Parameters
    ----------
    amount
        Greatest relative change of a beam's brightness, 0 to 1. Default: 0.5.

    Raises
    ------
    SceneError
        If the amount is not 0 to 1.

    Examples
    --------
    Two beams, one dimmed by 40 % and one brightened by 40 %:

    >>> beams = pb.Beams([[0, 0, 0]] * 2, [[0, 0, 4]] * 2, 0.1, 0.5, power=[9, 9, 9], random=[0, 1])
    >>> look = pb.Look(along=pb.looks.Variation(0.4), eye=1.0, angle=1.0)
    >>> dim, bright = (
    ...     pb.estimate(beam, [-3, 0, 2], [1, 0, 0], look=look).numpy()[0] for beam in (beams[0], beams[1])
    ... )
    >>> round(float(bright / dim), 3)  # 1.4 / 0.6
    2.333
    """

    @constructor
    def __init__(self, amount: Number = 0.5) -> None:
        self._amount = given_number(amount, "a variation", "a number from 0 to 1", 0, 1).value

    def evaluate(self, at: ShadingContext) -> Value:
        """Return the beam's brightness."""
        return dr.fma(self._amount, 2 * at.random - 1, 1)
