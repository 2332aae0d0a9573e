"""What an artist writes or lets grow: expressions, noise in space, and differences between beams, as factors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, get_args

import drjit as dr
import numpy as np

from ..numerics.arrays import opaque
from ..runtime.device import Float
from .at import INPUTS, At
from .expression import parse
from .factors import Factor
from .noise import MOST_OCTAVES, fbm

NoiseSpace = Literal["world", "light"]


class Expression(Factor):
    """A line that an artist wrote, such as `smoothstep(0, 1, s) * (0.6 + 0.4 * noise(4 * P + time))`.

    Its value is not below 0, and finite whatever the line says. `looks.expression` tells the language, and raises
    ExpressionError, a ValueError that names the column, for what is no expression.
    """

    rough = True

    def __init__(self, text: str) -> None:
        self.parsed = parse(text)

    def evaluate(self, at: At) -> Any:
        """Return the expression's value."""
        return dr.maximum(self.parsed.evaluate(lambda name: getattr(at, INPUTS[name])), 0)

    def __repr__(self) -> str:
        return f"Expression({self.parsed.text!r})"


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
    ValueError
        A number outside of its range, or not finite; an unknown space.
    """

    def __init__(
        self,
        amount: float = 1.0,
        scale: float = 1.0,
        octaves: int = 4,
        contrast: float = 2.0,
        drift: Sequence[float] = (0.0, 0.0, 0.0),
        evolution: float = 0.0,
        space: NoiseSpace = "world",
    ) -> None:
        numbers = np.asarray([amount, scale, contrast, evolution, *drift], dtype=np.float64)
        if numbers.shape != (7,) or not np.all(np.isfinite(numbers)):  # four and a drift of three
            raise ValueError("noise expects finite numbers, and a drift of three")
        if not 0 <= amount <= 1 or not contrast >= 0:
            raise ValueError(f"noise has amount {amount} and contrast {contrast}: expected 0 to 1, and not negative")
        if not scale > 0 or octaves not in range(1, MOST_OCTAVES + 1):
            text = f"noise has scale {scale} and {octaves} octaves: expected a positive size and 1 to {MOST_OCTAVES}"
            raise ValueError(text)
        if space not in get_args(NoiseSpace):
            raise ValueError(f"noise has space {space!r}: expected one of {', '.join(get_args(NoiseSpace))}")
        self._gain, self._rate = dr.opaque(Float, amount * contrast), dr.opaque(Float, 1 / scale)
        self._drift, self._evolution = opaque(drift), dr.opaque(Float, evolution)
        self._octaves, self._space = int(octaves), space
        self._still = evolution == 0

    def evaluate(self, at: At) -> Any:
        """Return the noise."""
        point = at.local if self._space == "light" else at.position
        moved = (point - self._drift * at.time) * self._rate
        # The fourth dimension doubles the work, so noise that only drifts has three.
        time = None if self._still else self._evolution * at.time
        return dr.maximum(dr.fma(self._gain, 2 * fbm(moved, self._octaves, time=time) - 1, 1), 0)


class Variation(Factor):
    """Some beams brighter, some dimmer: 1 + amount · (2 random − 1), each beam the same in all frames.

    Raises
    ------
    ValueError
        An amount that is not 0 to 1.
    """

    def __init__(self, amount: float = 0.5) -> None:
        if not 0 <= amount <= 1:
            raise ValueError(f"variation is {amount}: expected 0 to 1")
        self._amount = dr.opaque(Float, float(amount))

    def evaluate(self, at: At) -> Any:
        """Return the beam's brightness."""
        return dr.fma(self._amount, 2 * at.random - 1, 1)
