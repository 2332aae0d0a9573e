"""The tint of surfaces by a look: what the beams hit has the colour that the look gives them along their way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar, TypeVar

from ..runtime.device import Array3f, Float
from ..scene import Array, BeamSettings, LightFilter
from ..scene.places import ZERO, Point
from .along import Attenuation
from .context import LightContext, ShadingContext, inputs_of
from .factors import Constant, Factor, Product

S = TypeVar("S", bound=BeamSettings)

# The inputs that a place on a surface has: there the light path ends.
_OF_SURFACES = frozenset({"fraction", "distance", "from_light", "position", "local", "time", "frame"})


@dataclass(frozen=True, eq=False)
class Tint(LightFilter):
    """A filter of light on surfaces alone: a look's factor along the beam, at its end.

    Attributes
    ----------
    factor
        The factor.
    clock, to_world, zero
        As of a `LightContext`: frame number and seconds, and the space of the light.
    """

    factor: Factor
    clock: tuple[float, float] = (0.0, 0.0)
    to_world: Array | None = None
    zero: Point = ZERO

    in_media: ClassVar[bool] = False


def tinted(
    settings: S, name: str, warn: Callable[[str], None], clock: tuple[float, float] = (0.0, 0.0),
    to_world: Array | None = None,
) -> S:  # fmt: skip
    """Return the settings of a light with the filter by which its look tints surfaces, if it does.

    Parameters
    ----------
    settings, name
        The settings, and the light's name.
    warn
        Called with a sentence if the look depends on what surfaces do not have; they are then not tinted.
    clock, to_world
        Frame number and seconds, and the transform from the light's space, (4, 4).
    """
    look = settings.look
    if look is None or look.surfaces == "off":
        return settings
    factors = look.along.factors if isinstance(look.along, Product) else (look.along,)
    kept = [each for each in factors if not isinstance(each, Attenuation)]  # by which fog dims light anyway
    factor = Product(tuple(kept)) if kept else Constant(1.0)
    one = Float(1)
    at = ShadingContext(one, one, one, one, one, place=lambda: Array3f(0), context=LightContext())
    asked = inputs_of(factor.evaluate, at)
    if missing := sorted(asked - _OF_SURFACES):
        warn(f"{name} tints no surfaces: along its beams, its look depends on {', '.join(missing)}, which they lack")
        return settings
    # Only what is asked for: a lamp whose filters change with time counts as one that moves.
    now = clock if asked & {"time", "frame"} else (0.0, 0.0)
    tint = Tint(name, factor, now, to_world if "local" in asked else None)
    return replace(settings, filters=(*settings.filters, tint))
