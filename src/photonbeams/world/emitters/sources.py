"""Sources of light: one emitter, or several that share a light group and a look."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ...looks import Look
    from ...scene import Array

#: Choices for a lamp's scattered beams: physical, with the lamp's look, or left out.
SCATTERED = ("physical", "look", "off")


@dataclass(frozen=True)
class Source:
    """The attributes that all beams of a source share.

    Attributes
    ----------
    number, name
        The source's number in the world, and its name.
    group, look
        Its light group, and the look of its beams (None: physical).
    beams, beam_scale, scattered
        Whether it makes beams, a factor on their power, and the choice for scattered beams, one of `SCATTERED`.
    surfaces
        Whether it lights surfaces.
    bounces
        Most bounces of its light before it is scattered toward the camera; None: as the settings say.
    scattered_beams
        If it makes no beams: whether its light, once scattered, makes beams in media that domes light.
    endless
        Whether its light goes on through endless media until it no longer matters, rather than to the end of the
        bounds.
    to_world
        Transform from the light's own space to the world, (4, 4), for looks.
    guides
        Points along each of the curves that guide its beams.
    filters
        The filters of its light, a `FilterChain`, or None.
    unlit
        Numbers of the media that its light passes unseen, straight from the emitter.
    unseen
        Numbers of the media in which it makes no beams.
    tallied
        Whether a tally has its light, once scattered, straight ahead of cameras.
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
    unlit: frozenset[int] = frozenset()
    unseen: frozenset[int] = frozenset()
    tallied: bool = False
    endless: bool = True
    filters: Any = None
