"""What an artist sets for beams: the attributes of lamps and of the world, looks, portals and drawn curves."""

from __future__ import annotations

from collections.abc import Callable
from math import degrees
from typing import Any

import bpy
import numpy as np

from .curves import curve_prims
from .images import Images
from .lights import image_of, size_of
from .looks import look_prim
from .meshes import mesh_values
from .prims import Prim, Targets, Told, Values
from .shading.profiles import profile_values

_PREFIX = "photonbeams:"


class BeamReader:
    """Reads the attributes of beams, and the prims that these name.

    Parameters
    ----------
    path
        Returns a path that no other prim has, for a parent and a name.

    Attributes
    ----------
    prims
        The looks and portals that were read.
    """

    def __init__(self, images: Images, path: Callable[[str, str], str], told: Told) -> None:
        self._images, self._path, self._told = images, path, told
        self._looks: dict[str, str] = {}
        self._portals: dict[str, str] = {}
        self.prims: list[Prim] = []

    def of_light(self, light: Any) -> tuple[Values, Targets]:
        """Return the attributes and the relationships of a lamp's profile and beams."""
        own, kind = light.photonbeams, light.type
        values, targets = self._shared(own)
        if not own.enabled:
            values["enabled"] = False
        if (gobo := own.gobo or image_of(light, self._told)) is not None:
            values["gobo"] = self._images.file_of(gobo)
            if kind == "SUN":
                values["gobo:width"] = own.gobo_width
            elif kind != "AREA" and own.gobo_angle > 0:
                values["gobo:angle"] = degrees(own.gobo_angle)
            if kind != "AREA" and own.gobo_wrap != "black":
                values["gobo:wrap"] = own.gobo_wrap
        return _named(values) | profile_values(light, self._images, self._told), _named(targets)

    def of_world(self, world: Any, portals: list[str]) -> tuple[Values, Targets]:
        """Return those of the sky's beams; `portals` are the paths of Cycles' own portals."""
        own = world.photonbeams
        if not own.enabled:
            if portals:
                self._told(f"World {world.name}: its portals are not used, as it makes no beams: see World > Beams")
            return {}, {}
        values, targets = self._shared(own)
        values["enabled"] = True
        if portals:
            targets["portal"] = [*targets.get("portal", []), *portals]
        return _named(values), _named(targets)

    def of_curve(self, thing: Any, path: str, group: str) -> list[Prim]:
        """Return the prims of a curve object that is beams, without their transform."""
        prims = curve_prims(thing, path, self._told)
        for each in prims:
            if group:
                each.values[f"{_PREFIX}lightGroup"] = group
            if (look := thing.data.photonbeams.look) is not None:
                each.targets[f"{_PREFIX}look"] = [self.look(look)]
        return prims

    def look(self, tree: Any) -> str:
        """Return the path of a look, whose prim is read once."""
        if tree.name_full not in self._looks:
            path = self._looks[tree.name_full] = self._path("/Looks", tree.name)
            self.prims.append(look_prim(tree, path, self._images, self._told))
        return self._looks[tree.name_full]

    def portal(self, thing: Any) -> str:
        """Return the path of an object as a portal, whose prim is read once; "" if it has no faces."""
        name = thing.name_full
        if name not in self._portals:
            values = _rectangle(thing.data) if thing.type == "LIGHT" else _faces(thing)
            self._portals[name] = ""
            if values is None:
                self._told(f"{thing.name} is a portal without faces, at which no beams are aimed")
            else:
                path = self._portals[name] = self._path("/Portals", thing.name)
                matrix = np.array(thing.matrix_world).T
                self.prims.append(Prim(path, "Mesh", values, matrix=matrix))
        return self._portals[name]

    def _shared(self, own: Any) -> tuple[Values, Targets]:
        """Return what lamps and the world have in common, by names without the prefix."""
        names = "intensity", "count", "seed", "scattered"
        values: Values = {name: getattr(own, name) for name in names if own.is_property_set(name)}
        targets: Targets = {}
        if own.portal is not None and (path := self.portal(own.portal)):
            targets["portal"] = [path]
            if own.portal_gobo is not None:
                values["portal:gobo"] = self._images.file_of(own.portal_gobo)
        if own.look is not None:
            targets["look"] = [self.look(own.look)]
        return values, targets


def portals_of(depsgraph: Any) -> set[str]:
    """Return the names of the objects that are portals of lamps, or of the world."""
    owners = (each.photonbeams for each in depsgraph.ids if isinstance(each, (bpy.types.Light, bpy.types.World)))
    return {own.portal.name_full for own in owners if own.portal is not None}


def is_cycles_portal(light: Any) -> bool:
    """Return whether an area light is one of Cycles' portals of the sky."""
    return light.type == "AREA" and getattr(getattr(light, "cycles", None), "is_portal", False)


def _named(given: dict[str, Any]) -> Values:
    return {_PREFIX + name: value for name, value in given.items()}


def _rectangle(light: Any) -> Values:
    """Return the attributes of an area light's rectangle, or of a disc of 32 corners, as a mesh."""
    if light.shape in ("DISK", "ELLIPSE"):
        turn = np.linspace(0, 2 * np.pi, 32, endpoint=False)
        corners = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    else:
        corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    wide, high = size_of(light)
    points = np.zeros((len(corners), 3), np.float32)
    points[:, :2] = corners * (wide / 2, high / 2)
    return {
        "points": points, "faceVertexIndices": np.arange(len(points), dtype=np.int32),
        "faceVertexCounts": np.array([len(points)], np.int32), "subdivisionScheme": "none",
    }  # fmt: skip


def _faces(thing: Any) -> Values | None:
    """Return the attributes of an object's mesh; None if it has no faces."""
    try:
        mesh = thing.to_mesh()
    except RuntimeError:  # an empty, or a camera
        return None
    values = mesh_values(mesh) if mesh is not None and len(mesh.polygons) else None
    thing.to_mesh_clear()
    return values
