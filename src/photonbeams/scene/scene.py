"""A shot at one time."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from .beams import DrawnBeams
from .checks import Array, SceneError
from .light import Light
from .lights import DomeLight
from .media import Medium
from .places import ZERO, Point
from .surfaces import Mesh

if TYPE_CHECKING:
    from ..looks import Look


@dataclass(frozen=True)
class Scene:
    """What a shot shows at one time, without the camera.

    Attributes
    ----------
    meshes, lights, drawn, media
        The surfaces (`Mesh`), the lights, beams that are given rather than traced (`DrawnBeams`), and the fog
        (`Medium`): each several, or one.
    bounds
        Centre (3,) and radius of a sphere around everything at all times, so that beams do not change when something
        moves elsewhere. None, the default: a sphere around this scene.
    groups
        Light groups that make beams at other times of the shot: a frame has a layer for each of these, too, and it is
        black while nothing of the group shines. Default: none.
    zero
        (x, y, z) where the user's coordinates begin, in a scene that was moved: see `scene.places`. Default: at 0.

    Raises
    ------
    SceneError
        Something among meshes, lights, drawn beams or media that is of another class.

    Examples
    --------
    >>> floor = pb.scene.Mesh("/Floor", [[0, 0, 0], [0, 0, 2], [2, 0, 2], [2, 0, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> lamp = pb.scene.SphereLight("/Lamp", 50.0, center=(1, 2, 1), axis=(0, -1, 0))
    >>> content = pb.scene.Scene(floor, lamp, media=pb.Medium(scattering=0.1))
    >>> content.lights[0].name, content.medium.scattering
    ('/Lamp', (0.1, 0.1, 0.1))

    `pb.Shot(content, pb.scene.Camera.look_at((6, 1, 0), (0, 1, 0)))` renders it.
    """

    meshes: tuple[Mesh, ...] = ()
    lights: tuple[Light, ...] = ()
    drawn: tuple[DrawnBeams, ...] = ()
    media: tuple[Medium, ...] = ()
    bounds: tuple[Array, float] | None = None
    groups: frozenset[str] = frozenset()
    zero: Point = ZERO

    def __post_init__(self) -> None:
        kinds = {"meshes": Mesh, "lights": Light, "drawn": DrawnBeams, "media": Medium}
        for name, kind in kinds.items():
            given = getattr(self, name)
            several = isinstance(given, Iterable) and getattr(given, "shape", None) != ()
            parts = tuple(given) if several else (given,)
            for part in parts:
                if not isinstance(part, kind):
                    raise SceneError(f"{name} hold a {type(part).__name__}: expected each to be a {kind.__name__}")
            object.__setattr__(self, name, parts)

    def within(self, bounds: tuple[Array, float]) -> Scene:
        """Return the scene with `bounds`, a centre (3,) and a radius, at which fog that varies ends."""
        media = tuple(each.within(*bounds) for each in self.media)
        known = all(a is b for a, b in zip(media, self.media, strict=True))
        return replace(self, bounds=bounds, media=self.media if known else media)

    @property
    def medium(self) -> Medium | None:
        """The first homogeneous medium, or None if there is none."""
        return next((each for each in self.media if each.grid is None), None)

    @property
    def sky(self) -> tuple[DomeLight, ...]:
        """The domes that light media without making beams."""
        if not self.media:
            return ()
        domes = (light for light in self.lights if isinstance(light, DomeLight) and light.lights_media)
        return tuple(light for light in domes if max(light.radiance) > 0)

    @property
    def bounces(self) -> int:
        """The most bounces, scattering events before the one toward the camera, that a light or a medium asks for."""
        own = [light.bounces for light in self.lights] + [medium.bounces for medium in self.media]
        return max((each for each in own if each is not None), default=0)

    def looks(self) -> dict[str, Look | None]:
        """Return the looks of lights and drawn beams by their names."""
        return {light.name: light.look for light in self.lights} | {each.name: each.look for each in self.drawn}
