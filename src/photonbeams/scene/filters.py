"""Filters of lights: shapes in whose shadow, or in whose inside, there is less light, and ramps by distance.

A filter acts on light straight from its lamp, on beams and on surfaces. Light that was scattered or reflected is not
filtered any more.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, Any, ClassVar

import numpy as np

from .checks import BLACK, IDENTITY, Array, NotNegative, SceneError, Tint, Transform, array, choice, numbers, shown

#: Where a blocker filters light: behind the shape, in it, or all along the rays that meet it.
WHERE = ("behind", "inside", "along")

_MOST_KNOTS = 64  # of a ramp, since each costs every beam a piece

_HALF: Any = (0.5, 0.5, 0.5)
_Sides = Annotated[Array, partial(array, expected="3 finite numbers, 0 or more", shape=(3,), least=0.0)]


@dataclass(frozen=True, eq=False)
class LightFilter:
    """What all filters of lights have in common; `Light.filters` holds them.

    Attributes
    ----------
    name
        Prim path, for messages.
    left_out
        Names of meshes and media on which the filter does not act. Default: none.
    """

    called = "{name}: {field}"

    name: str
    left_out: frozenset[str] = field(default=frozenset(), kw_only=True)

    #: Whether the filter acts on light in media.
    in_media: ClassVar[bool] = True


@dataclass(frozen=True, eq=False)
class Blocker(LightFilter):
    """A rounded box that changes the light of a lamp: a flag, a rod, or the opening between barn doors.

    Attributes
    ----------
    name
        Prim path, for messages.
    half
        Half of the box's width, height and depth, (3,), in the filter's space, each 0 or more. At 0 all: a sphere with
        `radius`. One above 0: a capsule. The last one 0, with `flat`: a rectangle.
    radius
        How far the shape reaches beyond the box, with round corners. Default 0.
    edge
        Width of the soft edge around the shape, over which its effect fades. Default 0: the edge is hard.
    color
        The fraction of the light that is left where the filter acts, per channel; it may be above 1. Default: 0.
    where
        "behind" (the default): in the shadow of the shape. "inside": in the shape itself, as a rod. "along": on whole
        rays that meet the shape, also before it, as doors at the lamp.
    invert
        Whether light is changed where else it would not be. Behind a flat shape that is inverted, all light is changed
        that does not pass through it, as through a window; with solid shapes, rays are changed that pass beside it,
        from the point that is closest to its center.
    flat
        Whether the shape is the rectangle, with round corners, in the plane z = 0 of the filter's space.
    frame
        (4, 4) transform from the filter's space to the world, for column vectors. Default: the identity.
    left_out
        Names of meshes and media on which the filter does not act. Default: none.

    Raises
    ------
    SceneError
        Lengths that are negative or not finite, a flat shape without inside, a transform without an inverse.

    Examples
    --------
    >>> flag = pb.scene.Blocker("/Flag", half=(0.5, 0.5, 0.01))
    >>> lamp = pb.scene.SphereLight("/Lamp", 50.0, filters=(flag,))
    >>> lamp.filters[0].where
    'behind'
    """

    half: _Sides = _HALF
    radius: NotNegative = 0.0
    edge: NotNegative = 0.0
    color: Tint = BLACK
    where: Annotated[str, partial(choice, choices=WHERE)] = "behind"
    invert: bool = False
    flat: bool = False
    frame: Transform = IDENTITY

    def __post_init__(self) -> None:
        if self.flat and self.where == "inside":
            raise SceneError(f"{self.name}: where is 'inside' of a flat shape: expected 'behind' or 'along'")


@dataclass(frozen=True, eq=False)
class DistanceRamp(LightFilter):
    """A factor on light by its distance from the lamp, linear between knots, and constant beyond the first and last.

    Attributes
    ----------
    name
        Prim path, for messages.
    knots
        (K,) distances from the lamp in scene units, ascending; equal ones are a step.
    colors
        (K, 3) factors there, 0 or more, or (K,) grey ones.
    left_out
        As of a `Blocker`.

    Raises
    ------
    SceneError
        Arrays that do not fit each other, no knots or more than 64, numbers that are not finite, distances that do not
        ascend, factors below 0.

    Examples
    --------
    >>> pb.scene.DistanceRamp("/Decay", [2, 4], [1, 0]).colors.tolist()
    [[1.0, 1.0, 1.0], [0.0, 0.0, 0.0]]
    """

    knots: Array
    colors: Array

    def __post_init__(self) -> None:
        knots = numbers(self.knots, f"{self.name}: knots", "distances").astype(np.float64)
        colors = numbers(self.colors, f"{self.name}: colors", "factors").astype(np.float64)
        colors = np.repeat(colors[:, None], 3, axis=1) if colors.ndim == 1 else colors
        if knots.ndim != 1 or not 0 < len(knots) <= _MOST_KNOTS or colors.shape != (len(knots), 3):
            text = f"{knots.shape} knots and {colors.shape} colors: expected up to {_MOST_KNOTS}, with 3 numbers each"
            raise SceneError(f"{self.name}: {text}")
        if not (np.all(np.isfinite(knots)) and np.all(np.diff(knots) >= 0)):
            raise SceneError(f"{self.name}: knots are {shown(self.knots)}: expected finite distances that ascend")
        if not (np.all(np.isfinite(colors)) and np.all(colors >= 0)):
            raise SceneError(f"{self.name}: colors are {shown(self.colors)}: expected finite numbers, 0 or more")
        object.__setattr__(self, "knots", knots)
        object.__setattr__(self, "colors", colors)
