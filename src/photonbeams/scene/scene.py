"""A shot at one time."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

from .beams import DrawnBeams
from .checks import Array, SceneError
from .lights import DomeLight, Light
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

    Raises
    ------
    SceneError
        Something among meshes, lights, drawn beams or media that is of another class.
    """

    meshes: tuple[Mesh, ...] = ()
    lights: tuple[Light, ...] = ()
    drawn: tuple[DrawnBeams, ...] = ()
    media: tuple[Medium, ...] = ()
    bounds: tuple[Array, float] | None = None
    groups: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        kinds = {"meshes": Mesh, "lights": Light, "drawn": DrawnBeams, "media": Medium}
        for each in fields(self)[:4]:
            given, kind = getattr(self, each.name), kinds[each.name]
            parts = tuple(given) if isinstance(given, Iterable) else (given,)
            for part in parts:
                if not isinstance(part, kind):
                    raise SceneError(f"{each.name} hold a {type(part).__name__}: expected each to be a {kind.__name__}")
            object.__setattr__(self, each.name, parts)

    @property
    def medium(self) -> Medium | None:
        """The first homogeneous medium, or None."""
        return next((each for each in self.media if each.grid is None), None)

    @property
    def sky(self) -> tuple[DomeLight, ...]:
        """The domes that light media without beams of their own."""
        if not any(medium.lit_by_domes for medium in self.media):
            return ()
        domes = (light for light in self.lights if isinstance(light, DomeLight) and light.lights_media)
        return tuple(light for light in domes if max(light.radiance) > 0)

    @property
    def bounces(self) -> int:
        """How often light may be scattered before it is scattered toward the camera, as its lights and media say."""
        own = [light.bounces for light in self.lights] + [medium.bounces for medium in self.media]
        return max((each for each in own if each is not None), default=0)

    def looks(self) -> dict[str, Look | None]:
        """Return the looks of lights and drawn beams by their names."""
        return {light.name: light.look for light in self.lights} | {each.name: each.look for each in self.drawn}
