"""Blender's own USD export writes beams, looks and fog, too, so that the command renders the same picture.

It tells nothing of what is not rendered: the command does.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from .reading.beams import BeamReader, is_cycles_portal, portals_of
from .reading.images import Images
from .reading.lights import nodes_of, shadow_values, softness_values, tint_of
from .reading.linking import links_of
from .reading.media import APIS, hides_sky, medium_of, world_medium
from .reading.names import free_path, group_name
from .reading.shading.materials import has_surface
from .reading.shading.profiles import profile_values
from .reading.visibility import ray_values

_OBJECT = "userProperties:blender:object_name"  # what Blender writes of an object into its prim
_SKY = "DomeLight"


class PhotonBeamsExport(bpy.types.USDHook):
    """Writes what an artist sets for beams."""

    bl_idname = "PHOTONBEAMS_usd_export"
    bl_label = "Photon Beams"
    bl_description = "Writes beams, looks and fog for the command photonbeams"

    @staticmethod
    def on_export(context: Any) -> bool:
        """Add to the stage that Blender exports."""
        depsgraph = context.get_depsgraph()
        if depsgraph.scene.render.engine == "PHOTONBEAMS":
            _Stage(context.get_stage(), depsgraph).write()
        return True


class _Stage:
    """A stage that Blender has exported."""

    def __init__(self, stage: Any, depsgraph: Any) -> None:
        self._stage, self._depsgraph, self._taken = stage, depsgraph, set[str]()
        self._root = str(stage.GetDefaultPrim().GetPath()) if stage.GetDefaultPrim() else ""
        folder = Path(stage.GetRootLayer().realPath).parent / "textures"
        self._images = Images(str(folder))
        self._beams = BeamReader(self._images, self._path, _untold)
        self._found: dict[str, list[Any]] = {}  # the prims of objects' data, by the names of objects
        self._instancers = {each.name for each in depsgraph.objects if each.instance_type == "COLLECTION"}
        self._places = list[tuple[tuple[str, ...], str]]()  # their paths, each with what it is a copy for
        for each in stage.Traverse():
            if each.HasAttribute(_OBJECT):
                # An object is an Xform with its data and other objects below it, or, merged, the data itself.
                data = [child for child in each.GetChildren() if not child.HasAttribute(_OBJECT)]
                own = data if each.GetTypeName() == "Xform" else [each]
                name, *instancers = self._names(each)
                self._found.setdefault(name, []).extend(own)
                self._places += [((name, *instancers), str(child.GetPath())) for child in own]

    def write(self) -> None:
        """Add to lamps, curves, volumes and the world what Blender does not write."""
        portals, sky = portals_of(self._depsgraph), list[str]()
        for thing in self._depsgraph.objects:
            prims = self._found.get(thing.name, [])
            if thing.type == "CURVE" and thing.data.photonbeams.enabled:
                self._add_curves(thing)
            elif thing.name_full in portals:
                pass
            elif thing.type == "LIGHT" and is_cycles_portal(thing.data):
                sky.append(self._beams.portal(thing))
            else:
                if thing.type == "LIGHT":
                    self._add_light(thing, prims)
                elif thing.type == "MESH":
                    self._add_medium(thing, prims)
                    for each in prims:
                        self._set(each, ray_values(thing, thing, self._depsgraph.view_layer, _untold), {})
                self._add_links(thing, prims)
                continue
            for each in prims:  # it is no surface, and no lamp
                each.SetActive(False)
        self._add_world(self._depsgraph.scene.world, sky)
        for each in self._beams.prims:
            self._define(each)

    def _names(self, prim: Any) -> list[str]:
        """Return the names of the object of a prim, and of what instances it, from the inside."""
        above = prim.GetPath().GetPrefixes()[-2::-1]
        names = [each.Get() for path in above if (each := self._stage.GetPrimAtPath(path).GetAttribute(_OBJECT))]
        return [prim.GetAttribute(_OBJECT).Get(), *(each for each in names if each in self._instancers)]

    def _path(self, parent: str, name: str) -> str:
        """Return a path that no prim has."""
        path = free_path(self._root + parent, name, lambda path: path in self._taken or self._stage.GetPrimAtPath(path))
        self._taken.add(path)
        return path

    def _add_light(self, thing: Any, prims: list[Any]) -> None:
        lamp = next((each for each in prims if each.GetTypeName().endswith("Light")), None)
        if lamp is None:
            return
        values, targets = self._beams.of_light(thing.data)
        if thing.lightgroup:
            values["photonbeams:lightGroup"] = ["token", group_name(thing.lightgroup)]
        values = profile_values(thing.data, self._images, _untold) | values
        values |= ray_values(thing, thing, self._depsgraph.view_layer, _untold)
        values |= shadow_values(thing.data) | (softness_values(thing.data) if thing.data.type == "SPOT" else {})
        self._set(lamp, values, targets)
        strength, tint = nodes_of(thing.data, _untold)  # which Blender does not write
        if strength != 1:
            intensity = lamp.GetAttribute("inputs:intensity")
            intensity.Set((intensity.Get() or 0.0) * strength)
        if thing.data.use_temperature or np.any(tint != 1):
            color = {"inputs:color": ["color3f", (tint_of(thing.data) * tint).tolist()]}
            self._set(lamp, color | {"inputs:enableColorTemperature": ["bool", False]}, {})

    def _add_links(self, thing: Any, prims: list[Any]) -> None:
        """Link a lamp, or a mesh that may glow."""
        values, targets = links_of(thing.original, self._places)
        for each in prims if values else ():
            self._set(each, values, targets)

    def _add_curves(self, thing: Any) -> None:
        group = group_name(thing.lightgroup) if thing.lightgroup else ""
        for each in self._beams.of_curve(thing, self._path("/Beams", thing.name), group):
            self._define({**each, "matrix": np.array(thing.matrix_world).T})

    def _add_medium(self, thing: Any, prims: list[Any]) -> None:
        """Make a mesh that has a volume and no surface a box of that fog."""
        slots = [each.material for each in thing.material_slots]
        mesh = next((each for each in prims if each.GetTypeName() == "Mesh"), None)
        if mesh is None or not slots or any(has_surface(each) for each in slots):
            return
        if (medium := medium_of(slots[0], _untold)) is not None:
            for name in APIS:
                mesh.AddAppliedSchema(name)
            self._set(mesh, medium, {})

    def _add_world(self, world: Any, portals: list[str]) -> None:
        if world is None:
            return
        dome = next((each for each in self._stage.Traverse() if each.GetTypeName() == _SKY), None)
        medium = world_medium(world, _untold)
        if dome is not None and medium is not None and hides_sky(world, medium):
            dome.SetActive(False)
        elif dome is not None:
            self._set(dome, *self._beams.of_world(world, portals))
        if medium is not None:
            self._define({"path": self._path("", "Fog"), "type": "Scope", "apis": APIS, "values": medium})

    def _define(self, given: dict[str, Any]) -> None:
        """Define the prim of a description (`usd/authoring/prims.py`)."""
        from pxr import Gf, UsdGeom

        prim = self._stage.DefinePrim(given["path"], given["type"])
        for name in given.get("apis", []):
            prim.AddAppliedSchema(name)
        if "matrix" in given:
            UsdGeom.Xformable(prim).AddTransformOp().Set(Gf.Matrix4d(np.asarray(given["matrix"], float).tolist()))
        self._set(prim, given["values"], given.get("targets", {}))

    def _set(self, prim: Any, values: dict[str, Any], targets: dict[str, list[str]]) -> None:
        from pxr import Sdf, Vt

        for name, (kind, value, *interpolation) in values.items():
            attribute = prim.CreateAttribute(name, Sdf.ValueTypeNames.Find(kind), custom=False)
            attribute.Set(_plain(kind, value, Vt) if kind != "asset" else self._asset(value))
            if interpolation:
                attribute.SetMetadata("interpolation", interpolation[0])
        for name, paths in targets.items():
            prim.CreateRelationship(name, custom=False).SetTargets(paths)

    def _asset(self, file: str) -> str:
        """Return the path of a file relative to the stage, as Blender writes it."""
        folder = self._stage.GetRootLayer().realPath
        try:
            return Path("./", Path(file).resolve().relative_to(Path(folder).resolve().parent)).as_posix()
        except ValueError:
            return file


def _plain(kind: str, value: Any, vt: Any) -> Any:
    """Return a value as OpenUSD takes it."""
    if not isinstance(value, np.ndarray):
        return tuple(value) if isinstance(value, list) else value
    arrays = {"int[]": vt.IntArray, "float[]": vt.FloatArray}
    return arrays.get(kind, vt.Vec2fArray if kind == "texCoord2f[]" else vt.Vec3fArray).FromNumpy(value)


def _untold(_text: str) -> None:
    """Do nothing with a sentence."""


def register() -> None:
    """Add the hook, if this Blender can call one: without OpenUSD's modules for Python it would end."""
    if find_spec("pxr") is not None:
        bpy.utils.register_class(PhotonBeamsExport)


def unregister() -> None:
    """Remove the hook."""
    if PhotonBeamsExport.is_registered:
        bpy.utils.unregister_class(PhotonBeamsExport)
