"""How fog varies in space: it thins out with height, and has wisps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated

from .checks import Finite, NotNegative, SceneError, array, choice, count, number
from .places import ZERO, Point

#: The most octaves of wisps, as in looks.
MOST_OCTAVES = 8
_AXES = ("X", "Y", "Z")

_Length = Annotated[float, partial(number, minimum=1e-30)]


def _drift(value: object, name: str) -> Point:
    first, second, third = array(value, name, "three finite numbers", (3,)).tolist()
    return first, second, third


@dataclass(frozen=True)
class FogNoise:
    """Wisps in fog: a factor 1 + amount · contrast · (2 fbm − 1) on its density, 0 or more; its mean is about 1.

    It is `looks.Noise`, in world space.

    Attributes
    ----------
    amount
        Strength, 0 to 1. Default: 1.
    scale
        Size of the largest wisps in scene units, above 0. Default: 1.
    octaves
        Number of sizes of wisps, each half of the one before, 1 to 8. Default: 4.
    contrast
        How torn the wisps are, 0 or more. Default: 2.
    drift
        (3,) velocity in scene units per second. Default: none.
    evolution
        How many times per second wisps change into others. Default: 0.

    Raises
    ------
    SceneError
        A number that is out of range or not finite.

    Examples
    --------
    >>> pb.scene.FogNoise(scale=0.5, drift=(0.2, 0, 0)).moves
    True
    """

    called = "{field} of a fog's noise"

    amount: Annotated[float, partial(number, minimum=0, maximum=1)] = 1.0
    scale: _Length = 1.0
    octaves: Annotated[int, partial(count, minimum=1, maximum=MOST_OCTAVES)] = 4
    contrast: NotNegative = 2.0
    drift: Annotated[Point, _drift] = ZERO
    evolution: Finite = 0.0

    @property
    def moves(self) -> bool:
        """Whether the wisps change with time."""
        return self.amount > 0 and (any(self.drift) or self.evolution != 0)


@dataclass(frozen=True)
class FogDensity:
    """A factor on the coefficients of fog: exp(−(h − ground) / falloff) at heights h above `ground`, times noise.

    Attributes
    ----------
    falloff
        Scene units of height over which the fog falls to 1 / e, above 0. Default: None, it is the same at all heights.
    ground
        The height above which it falls, in scene units; below it is even. Default: 0.
    noise
        Its wisps, a `FogNoise`. Default: None.
    up
        The axis of heights, "X", "Y" or "Z". Default: None, that of the stage, and "Y" where there is no stage.
    seconds
        The time for the noise. Default: None, that of the frame.
    zero
        (x, y, z) from where heights and wisps are measured. Default: the origin.

    Raises
    ------
    SceneError
        A number that is out of range or not finite; an axis of another name.

    Examples
    --------
    Mist that is half as dense 2 units above the ground:

    >>> mist = pb.Medium(scattering=0.2, density=pb.scene.FogDensity(falloff=2 / np.log(2)))
    >>> mist.density.up is None
    True
    """

    called = "{field} of fog"

    falloff: _Length | None = None
    ground: Finite = 0.0
    noise: FogNoise | None = None
    up: Annotated[str, partial(choice, choices=_AXES)] | None = None
    seconds: Finite | None = None
    zero: Point = ZERO

    def __post_init__(self) -> None:
        if self.noise is not None and not isinstance(self.noise, FogNoise):
            raise SceneError(f"noise of fog is a {type(self.noise).__name__}: expected a FogNoise, or None")

    @property
    def axis(self) -> int:
        """Index of the axis of heights."""
        return _AXES.index(self.up or "Y")

    @property
    def even(self) -> bool:
        """Whether the density is 1 everywhere."""
        return self.falloff is None and (self.noise is None or self.noise.amount * self.noise.contrast == 0)

    def at(self, up: str, seconds: float) -> FogDensity:
        """Return this density with an axis `up`, and a time in `seconds`, where it has none."""
        moves = self.noise is not None and self.noise.moves
        own_time = self.seconds if self.seconds is not None or not moves else seconds
        own_up = self.up or up
        same = (own_up, own_time) == (self.up, self.seconds)
        return self if same else replace(self, up=own_up, seconds=own_time)
