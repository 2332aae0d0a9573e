"""A shot at one time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from .beams import DrawnBeams
from .checks import Array
from .lights import Light
from .media import Medium
from .surfaces import Mesh

if TYPE_CHECKING:
    from ..looks import Look


@dataclass(frozen=True)
class Scene:
    """A shot at one time, without its camera.

    `bounds` are centre and radius of a sphere around everything at all times, so that beams do not change with what
    moves elsewhere; None: of what is there. `groups` are the light groups that make beams at any time: a frame has the
    layers of these, too, black where nothing of a group shines.
    """

    meshes: tuple[Mesh, ...] = ()
    lights: tuple[Light, ...] = ()
    drawn: tuple[DrawnBeams, ...] = ()
    media: tuple[Medium, ...] = ()
    bounds: tuple[Array, float] | None = None
    groups: frozenset[str] = frozenset()

    @property
    def medium(self) -> Medium | None:
        """The first homogeneous medium, or None."""
        return next((each for each in self.media if each.grid is None), None)

    def looks(self) -> dict[str, Look | None]:
        """Return the looks of lights and drawn beams by their names."""
        return {light.name: light.look for light in self.lights} | {each.name: each.look for each in self.drawn}
