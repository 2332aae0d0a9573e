"""How fog varies in space: it thins out with height, and has wisps."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .checks import SceneError, choice, number, numbers, shown, whole
from .places import ZERO, Point

#: The most octaves of wisps, as in looks.
MOST_OCTAVES = 8
_AXES = ("X", "Y", "Z")


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

    amount: float = 1.0
    scale: float = 1.0
    octaves: int = 4
    contrast: float = 2.0
    drift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    evolution: float = 0.0

    def __post_init__(self) -> None:
        number(self.amount, "amount of a fog's noise", 0, 1)
        number(self.scale, "scale of a fog's noise", 1e-30)
        number(whole(self.octaves, "octaves of a fog's noise"), "octaves of a fog's noise", 1, MOST_OCTAVES)
        number(self.contrast, "contrast of a fog's noise", 0)
        number(self.evolution, "evolution of a fog's noise")
        drift = numbers(self.drift, "drift of a fog's noise", "three finite numbers").ravel()
        if drift.shape != (3,) or not np.all(np.isfinite(drift)):
            raise SceneError(f"drift of a fog's noise is {shown(self.drift)}: expected three finite numbers")
        object.__setattr__(self, "drift", tuple(map(float, drift)))

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

    falloff: float | None = None
    ground: float = 0.0
    noise: FogNoise | None = None
    up: str | None = None
    seconds: float | None = None
    zero: Point = ZERO

    def __post_init__(self) -> None:
        if self.falloff is not None:
            number(self.falloff, "falloff of fog", 1e-30)
        number(self.ground, "ground of fog")
        if self.up is not None:
            choice(self.up, "up of fog", _AXES)
        if self.seconds is not None:
            number(self.seconds, "seconds of fog")
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
