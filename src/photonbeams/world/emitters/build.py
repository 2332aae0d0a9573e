"""The emitters of a stage: the lamp of each light, with its images and its portal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ... import scene
from ..surfaces.shapes import shape_of
from .emitter import Emitter, Links
from .gobos import Images, projected
from .kinds.cylinder import CylinderLamp
from .kinds.distant import DistantLamp
from .kinds.dome import DomeLamp
from .kinds.flat import FlatLamp
from .kinds.mesh import MeshLamp
from .kinds.sphere import SphereLamp
from .kinds.stretched import EllipsoidLamp, EllipticCylinderLamp
from .lamp import Lamp
from .portals import Portal

if TYPE_CHECKING:
    from ...runtime.mitsuba_types import MiScene

#: The kinds of lamps. Those that are packed come first, and their places here are part of their samples' names.
KINDS: tuple[Any, ...] = (
    SphereLamp, FlatLamp, CylinderLamp, DistantLamp, EllipsoidLamp, EllipticCylinderLamp, MeshLamp, DomeLamp,
)  # fmt: skip


def lamp_of(light: scene.Light, host: MiScene | None = None, around: Sequence[MiScene] = ()) -> Lamp:
    """Return a light's lamp; for mesh lights, `host` is explained in `scene_of`, `around` in `MeshLamp`."""
    for kind in KINDS:
        if kind.describes(light):
            result: Lamp = kind.of(light, host, around)
            return result
    raise scene.SceneError(f"{light.name}: a {type(light).__name__} cannot be sampled")


def emitters_of(
    lights: Sequence[scene.Light], meshes: Sequence[scene.Mesh], host: MiScene, around: Sequence[MiScene],
    known: Sequence[Emitter],
) -> tuple[Emitter, ...]:  # fmt: skip
    """Return the emitters of a stage.

    Parameters
    ----------
    lights, meshes
        The lights, and the meshes that are surfaces.
    host, around
        As for `lamp_of`.
    known
        Emitters of the same stage at another time, whose lamps and portals serve where their lights are identical.
    """
    lamps = {id(each.beams): each.lamp for each in known}
    portals = {id(each.beams.portal): each.portal for each in known if each.portal is not None}
    images: Images = {
        id(image.image): (image.image, each.lamp.pixels[name])  # type: ignore[attr-defined]
        for each in known
        for name, image in each.lamp.images.items()
    }
    every, clear = frozenset(each.name for each in meshes), frozenset(each.name for each in meshes if not each.blocks)
    links = [links_of(light, every, clear) for light in lights]
    blocking = sorted({each.unshadowed for each in links} - {frozenset()}, key=sorted)
    result = []
    for number, (light, own) in enumerate(zip(lights, links, strict=True)):
        portal = None
        if light.portal is not None:
            portal = portals.get(id(light.portal)) or Portal(light.portal, shape_of(light.portal), host)
        lamp = lamps.get(id(light)) or projected(lamp_of(light, host, around), light, portal, images)
        link = blocking.index(own.unshadowed) + 1 if own.unshadowed else 0
        result.append(Emitter(light.name, lamp, light, portal, own, link, number))
    return tuple(result)


def links_of(light: scene.Light, meshes: frozenset[str], clear: frozenset[str] = frozenset()) -> Links:
    """Return which of the meshes a light does not light, which do not block it, and how it lights the others.

    `clear` are meshes that block no light.
    """
    shining = light.shadow_distance, light.surface_scale, light.shadow_color, light.seen
    return Links(light.unlit & meshes, light.unshadowed & meshes | clear, *shining)
