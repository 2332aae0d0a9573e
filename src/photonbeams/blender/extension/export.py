"""Blender's own USD export writes beams, looks and fog, too, so that the command renders the same picture.

It tells nothing of what is not rendered: the command does.
"""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from .reading.beams import BeamReader, is_cycles_portal, portals_of
from .reading.images import Images
from .reading.lights import light_prim, nodes_of
from .reading.linking import links_of, ray_values
from .reading.media import APIS, hides_sky, medium_of, world_medium
from .reading.prims import Prim, Targets, Values, free_path, group_name, typed
from .reading.shading.materials import has_surface

_OBJECT = "userProperties:blender:object_name"  # what Blender writes of an object into its prim
_SKY = "DomeLight"
_OF_LAMPS = ("inputs:color", "inputs:shadow:enable", "inputs:shaping:cone:softness")


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
                        self._set(each, ray_values(thing, thing, self._depsgraph.view_layer, _untold))
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
            values["photonbeams:lightGroup"] = group_name(thing.lightgroup)
        values |= ray_values(thing, thing, self._depsgraph.view_layer, _untold)
        ours = light_prim(thing.data, "", _untold).values  # Blender writes the others alike
        values |= {name: ours[name] for name in _OF_LAMPS if name in ours}
        self._set(lamp, {**values, "inputs:enableColorTemperature": False}, targets)
        strength, _ = nodes_of(thing.data, _untold)
        if strength != 1:
            intensity = lamp.GetAttribute("inputs:intensity")
            intensity.Set((intensity.Get() or 0.0) * strength)

    def _add_links(self, thing: Any, prims: list[Any]) -> None:
        """Link a lamp, or a mesh that may glow."""
        values, targets = links_of(thing.original, self._places)
        for each in prims if values else ():
            self._set(each, values, targets)

    def _add_curves(self, thing: Any) -> None:
        group = group_name(thing.lightgroup) if thing.lightgroup else ""
        for each in self._beams.of_curve(thing, self._path("/Beams", thing.name), group):
            self._define(replace(each, matrix=np.array(thing.matrix_world).T))

    def _add_medium(self, thing: Any, prims: list[Any]) -> None:
        """Make a mesh that has a volume and no surface a box of that fog."""
        slots = [each.material for each in thing.material_slots]
        mesh = next((each for each in prims if each.GetTypeName() == "Mesh"), None)
        if mesh is None or not slots or any(has_surface(each) for each in slots):
            return
        if (medium := medium_of(slots[0], _untold)) is not None:
            for name in APIS:
                mesh.AddAppliedSchema(name)
            self._set(mesh, medium)

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
            self._define(Prim(self._path("", "Fog"), "Scope", medium, apis=APIS))

    def _define(self, prim: Prim) -> None:
        """Define a prim."""
        from pxr import Gf, UsdGeom

        defined = self._stage.DefinePrim(prim.path, prim.type)
        for name in prim.apis:
            defined.AddAppliedSchema(name)
        if prim.matrix is not None:
            UsdGeom.Xformable(defined).AddTransformOp().Set(Gf.Matrix4d(np.asarray(prim.matrix, float).tolist()))
        self._set(defined, prim.values, prim.targets)

    def _set(self, prim: Any, values: Values, targets: Targets | None = None) -> None:
        """Set attributes and relationships of a prim of the stage."""
        from pxr import Sdf, Vt

        arrays = {"int[]": Vt.IntArray, "float[]": Vt.FloatArray, "texCoord2f[]": Vt.Vec2fArray}
        for name, (kind, value, *interpolation) in typed(values).items():
            attribute = prim.CreateAttribute(name, Sdf.ValueTypeNames.Find(kind), custom=False)
            if isinstance(value, np.ndarray):
                value = arrays.get(kind, Vt.Vec3fArray).FromNumpy(value)
            elif isinstance(value, list):
                value = tuple(value)
            attribute.Set(self._asset(value) if kind == "asset" else value)
            if interpolation:
                attribute.SetMetadata("interpolation", interpolation[0])
        for name, paths in (targets or {}).items():
            prim.CreateRelationship(name, custom=False).SetTargets(paths)

    def _asset(self, file: str) -> str:
        """Return the path of a file relative to the stage, as Blender writes it."""
        folder = self._stage.GetRootLayer().realPath
        try:
            return Path("./", Path(file).resolve().relative_to(Path(folder).resolve().parent)).as_posix()
        except ValueError:
            return file


def _untold(_text: str) -> None:
    """Do nothing with a sentence."""


#: The hook, if this Blender can call one: without OpenUSD's modules for Python it would end.
CLASSES = (PhotonBeamsExport,) if find_spec("pxr") is not None else ()
