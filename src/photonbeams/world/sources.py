"""Sources of light: an emitter, or several that share a light group and a look."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..looks import Look
    from ..scene import Array

#: Choices for a lamp's scattered beams: physical, with the lamp's look, or left out.
SCATTERED = ("physical", "look", "off")


@dataclass(frozen=True)
class Source:
    """The attributes that all beams of a source share.

    Attributes
    ----------
    number, name
        The emitter's place among those of the world, and its name.
    group, look
        Its light group, and the look of its beams (None: physical).
    beams, beam_scale, scattered
        Whether it makes beams; a factor on their power; and the choice for scattered beams, one of `SCATTERED`.
    surfaces
        Whether it lights surfaces.
    bounces
        The most bounces of its light before it is scattered toward the camera; None: the settings'.
    scattered_beams
        Of one that makes no beams: whether its light makes some in media that domes light, once it was scattered.
    caustics
        Whether its light paths count only as caustics: where a mirror or glass turns them before anything else.
    to_world
        (4, 4) from the light's own space, for looks.
    guides
        Points along each of the curves that lead its beams.
    """

    number: int = 0
    name: str = ""
    group: str = ""
    look: Look | None = None
    beams: bool = True
    beam_scale: float = 1.0
    scattered: str = "physical"
    surfaces: bool = True
    bounces: int | None = None
    to_world: Array | None = None
    guides: tuple[Any, ...] = ()
    scattered_beams: bool = False
    caustics: bool = False
