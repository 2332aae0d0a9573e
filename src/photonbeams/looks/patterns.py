"""Procedural factors: expressions, noise in space, and variation between beams."""

from __future__ import annotations

from typing import Literal, get_args

import drjit as dr

from ..numerics.given import SMALLEST, derived, given_color, given_number
from ..scene import SceneError, choice, shown, whole
from .context import INPUTS, ShadingContext
from .described import constructor
from .expression import parse
from .factors import Factor, Number, Numbers, Value
from .noise import MOST_OCTAVES, fbm

NoiseSpace = Literal["world", "light"]


class Expression(Factor):
    """An artist's expression, such as `smoothstep(0, 1, s) * (0.6 + 0.4 * noise(4 * P + time))`.

    Its value is not below 0, and finite whatever the line says. `looks.expression` tells the language, and raises
    ExpressionError, a SceneError that names the column, for what is no expression.
    """

    rough = True

    @constructor
    def __init__(self, text: str) -> None:
        if not isinstance(text, str):
            raise SceneError(f"an expression is {shown(text)}: expected a text, such as '1 - s'")
        self.parsed = parse(text)

    def evaluate(self, at: ShadingContext) -> Value:
        """Return the expression's value."""
        return dr.maximum(self.parsed.evaluate(lambda name: getattr(at, INPUTS[name])), 0)


class Noise(Factor):
    """Dust and wisps: 1 + amount · contrast · (2 fbm − 1), not below 0; about 1 in the mean.

    Parameters
    ----------
    amount
        How much of it, 0 to 1.
    scale
        Size of the largest wisps in scene units.
    octaves
        How often there are finer ones in them, 1 to 8; their number is part of the kernel.
    contrast
        From soft to torn: at 2 a tenth of the space is dark.
    drift
        How the wisps move, scene units a second.
    evolution
        How often they change into others within a second.
    space
        Whether they stand in the "world" or go with the "light".

    Raises
    ------
    SceneError
        A number outside of its range, or not finite; an unknown space.
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
        motion = given_color(drift, "a noise's drift", "three finite numbers")
        if motion.plain.shape != (3,):
            raise SceneError(f"a noise's drift is {shown(drift)}: expected three finite numbers")
        self._drift = motion.value
        changes = given_number(evolution, "a noise's evolution", "a number")
        self._evolution, self._still = changes.value, changes.attached is None and not changes.plain
        self._space = choice(space, "a noise's space", get_args(NoiseSpace))

    def evaluate(self, at: ShadingContext) -> Value:
        """Return the noise."""
        point = at.local if self._space == "light" else at.position
        moved = (point - self._drift * at.time) * self._rate
        # The fourth dimension doubles the work, so noise that only drifts has three.
        time = None if self._still else self._evolution * at.time
        return dr.maximum(dr.fma(self._gain, 2 * fbm(moved, self._octaves, time=time) - 1, 1), 0)


class Variation(Factor):
    """Variation of brightness between beams: 1 + amount · (2 random − 1), each beam the same in all frames.

    Raises
    ------
    SceneError
        An amount that is not 0 to 1.
    """

    @constructor
    def __init__(self, amount: Number = 0.5) -> None:
        self._amount = given_number(amount, "a variation", "a number from 0 to 1", 0, 1).value

    def evaluate(self, at: ShadingContext) -> Value:
        """Return the beam's brightness."""
        return dr.fma(self._amount, 2 * at.random - 1, 1)
