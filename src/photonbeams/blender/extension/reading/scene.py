"""The prims of a whole scene, from the depsgraph of a render or a viewport."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from itertools import count
from typing import Any

import bpy
import numpy as np

from .beams import BeamReader, is_cycles_portal, portals_of
from .cameras import camera_prim
from .fogs import fog_prims
from .glow import GlowingMeshes, areas
from .kept import Kept
from .lights import light_prim, stretch_of, world_prims
from .linking import Links
from .media import APIS, has_volume, hides_sky, volume_of, world_medium
from .meshes import faces_by_material, mesh_values, points_of
from .motion import is_blurred
from .names import free_path, group_name
from .shading.bumps import scale_of_heights
from .shading.materials import emitted_by, has_surface, lets_through, material_prims
from .shading.profiles import profile_values
from .strands import Strands, strands_of
from .visibility import ray_values
from .volumes import scale_of, smoke_of, volume_prims

CAMERA = "/Camera"
#: Before names in messages, by the parents of paths; objects have none.
_KINDS = {"/Materials": "Material ", "/Looks": "Look "}
_UNREAD = {"GREASEPENCIL": "a drawing"}
_SPACE = "Linear Rec.709"  # of images and temperatures, whatever the working space


class SceneReader:
    """Reads the prims of a scene.

    Parameters
    ----------
    depsgraph
        What Blender has evaluated.
    kept
        Meshes and files of images of earlier readings.
    told
        Called with a sentence about each thing that is not rendered as in Blender.
    """

    def __init__(self, depsgraph: Any, kept: Kept, told: Callable[[str], None]) -> None:
        self._depsgraph, self._told, self._images = depsgraph, told, kept.images
        self._layer = depsgraph.view_layer
        #: The names of light groups here, by those in Blender.
        self.groups: dict[str, str] = {}
        self._names: dict[str, str] = {}  # what messages call prims, by their paths
        self._beams = BeamReader(self._images, self._path, told)
        # Names of objects that are portals of lamps, or curves that are beams, and the paths of Cycles' portals.
        self._no_surfaces, self._sky_portals = portals_of(depsgraph), list[str]()
        self._places: dict[Any, str] = {}  # the paths of what may move
        self._rays: dict[Any, dict[str, Any]] = {}  # attributes of what some rays do not meet
        self._materials: dict[tuple[str, float], str] = {}
        self._kept, self._used = kept, set[tuple[str, int]]()
        self._prims: list[dict[str, Any]] = []
        self._links = Links(told)
        self._glowing, self._emitted = GlowingMeshes(told), dict[str, Any]()
        self._clear = set[str]()  # the names of materials that light passes

    def prims(self) -> list[dict[str, Any]]:
        """Return the prims of all but the camera."""
        if (space := bpy.data.colorspace.working_space) != _SPACE:
            self._told(f"the file's working space is {space}: images, skies and temperatures have colours of {_SPACE}")
        for thing, matrix, key in self._things():
            self._links.see(thing, key)
            if thing.type == "CURVE" and thing.data.photonbeams.enabled:
                self._add_curves(thing, matrix)
            elif thing.name_full in self._no_surfaces:
                pass
            elif thing.type == "LIGHT" and is_cycles_portal(thing.data):
                self._sky_portals.append(self._beams.portal(thing))
            elif thing.type == "LIGHT":
                self._add_light(thing, matrix, key)
            elif thing.type == "VOLUME" or smoke_of(thing) is not None:
                self._add_volume(thing, matrix, key)
            elif thing.type == "MESH":  # curves, text and the like come as meshes, too
                self._add_mesh(thing, matrix, key)
            elif thing.type in _UNREAD:
                self._told(f"{thing.name} is {_UNREAD[thing.type]}, which is not rendered")
        for strands, thing, matrix, key in self._strands():
            self._add_strands(strands, thing, matrix, key)
        self._glowing.enable()
        self._add_world(self._layer.world_override or self._depsgraph.scene.world)
        self._links.write(self._prims, self._places, self._names)
        for key in self._kept.meshes.keys() - self._used:
            del self._kept.meshes[key]
        prims = self._prims + self._beams.prims
        return [{**each, "name": self._names[each["path"]]} if each["path"] in self._names else each for each in prims]

    def moved(self) -> dict[str, dict[str, Any]]:
        """Return what may move, by path, as Blender has evaluated it now: transforms, lights, shapes that differ."""
        first = {each["path"]: each.get("values", {}) for each in self._prims}
        found, shapes = dict[str, dict[str, Any]](), dict[Any, dict[str, Any]]()
        for thing, matrix, key in self._things():
            path = self._places.get(key, "")
            if path not in first or not is_blurred(thing):
                continue
            if thing.type == "LIGHT":
                found[path] = self._light(thing, matrix, path, key)
                continue
            found[path] = {"matrix": matrix.T}
            if "points" in first[path]:
                own = _geometry_of(thing)
                if own not in shapes:
                    shapes[own] = _reshaped(thing, first[path]["points"][1])
                found[path]["values"] = shapes[own]
        for strands, thing, matrix, key in self._strands():
            path = self._places.get(key, "")
            if path in first and is_blurred(thing):
                found[path] = {"matrix": matrix.T, "values": strands.read() or {}}
        return found

    def _things(self) -> Iterator[tuple[Any, Any, Any]]:
        """Yield the objects that are rendered, and their copies: object, transform, and what names it at all times."""
        seen = Counter[Any]()
        for each in self._depsgraph.object_instances:
            thing = each.object
            if not each.show_self:
                continue
            key = _key_of(each)
            seen[key] += 1
            key = (*key, seen[key])
            self._rays[key] = ray_values(thing, each.parent or thing, self._layer, self._told)
            yield thing, np.array(each.matrix_world), key

    def _strands(self) -> Iterator[tuple[Strands, Any, Any, Any]]:
        """Yield hair and points: themselves, their object, transform, and what names them at all times."""
        for each in self._depsgraph.object_instances:
            thing = each.object
            shown = each.show_self if thing.type in ("CURVES", "POINTCLOUD") else each.show_particles
            if shown:
                for place, strands in enumerate(strands_of(thing, self._depsgraph.mode == "RENDER", self._told)):
                    key = (*_key_of(each), "strands", place)
                    self._rays[key] = ray_values(thing, each.parent or thing, self._layer, self._told)
                    yield strands, thing, np.array(each.matrix_world), key

    def camera(self, camera: Any, to_world: Any, size: tuple[int, int], shift: float = 0.0) -> dict[str, Any]:
        """Return the prim of a camera that sees the picture of this size; arguments as for `camera_prim`."""
        render = self._depsgraph.scene.render
        aspect = render.pixel_aspect_x, render.pixel_aspect_y
        evaluated = camera.evaluated_get(self._depsgraph)
        prim = camera_prim(evaluated, to_world, self._depsgraph, CAMERA, size, aspect, shift, self._told)
        return {**prim, "name": camera.name}

    def _path(self, parent: str, name: str) -> str:
        """Return a path that no other prim has, of something of this name."""
        path = free_path(parent, name, self._names.__contains__)
        self._names[path] = _KINDS.get(parent, "") + name
        return path

    def _add_light(self, thing: Any, matrix: Any, key: Any) -> None:
        self._places[key] = path = self._path("/Lights", thing.name)
        prim = self._light(thing, matrix, path, key)
        values, prim["targets"] = self._beams.of_light(thing.data)
        prim["values"] |= values | profile_values(thing.data, self._images, self._told)
        self._prims.append(prim)

    def _light(self, thing: Any, matrix: Any, path: str, key: Any) -> dict[str, Any]:
        """Return the prim of a light, without its beams."""
        light = thing.data
        prim = light_prim(light, path, self._told)
        prim["values"] |= self._rays[key]
        pose = matrix.copy()
        scale = np.linalg.norm(pose[:3, :3], axis=0)
        if light.type == "SPOT" and np.ptp(scale) > 1e-4 * scale.max():
            self._told(f"{thing.name} is scaled unevenly: its cone is round")
        # Only area lights have the size of their object.
        pose[:3, :3] *= (1 if light.type == "AREA" else 1 / np.maximum(scale, 1e-30)) * stretch_of(light)
        prim["matrix"] = pose.T
        if thing.lightgroup:
            prim["values"]["photonbeams:lightGroup"] = ["token", self._group(thing.lightgroup)]
        return prim

    def _add_curves(self, thing: Any, matrix: Any) -> None:
        self._no_surfaces.add(thing.name_full)
        group = self._group(thing.lightgroup) if thing.lightgroup else ""
        path = self._path("/Beams", thing.name)
        self._prims += [{**each, "matrix": matrix.T} for each in self._beams.of_curve(thing, path, group)]

    def _group(self, name: str) -> str:
        """Return the name of a light group here, which consists of fewer letters than Blender allows."""
        if name not in self.groups:
            valid, taken = group_name(name), set(self.groups.values())
            self.groups[name] = next(each for k in count() if (each := f"{valid}_{k}" if k else valid) not in taken)
        return self.groups[name]

    def _add_mesh(self, thing: Any, matrix: Any, key: Any) -> None:
        found = self._mesh(thing)
        if found is None:
            return
        values, faces = found
        override = self._layer.material_override
        slots = [override or each.material for each in thing.material_slots] or [override]
        materials = {slot: slots[min(slot, len(slots) - 1)] for slot in faces}
        self._places[key] = path = self._path("/Objects", thing.name)
        prim: dict[str, Any] = {
            "path": path, "type": "Mesh", "matrix": matrix.T, "values": {**values, **self._rays[key]},
        }  # fmt: skip
        if any(has_surface(each) for each in materials.values()):
            parts = self._bound(prim, materials, faces)
            self._prims += parts
            names = {_name_of(each) for each in materials.values()}
            if any(has_volume(each) for each in materials.values()) and names & self._clear:
                self._told(f"{thing.name} has a surface: the volume inside it is not rendered")
            emitted = {slot: self._emitted[_name_of(material)] for slot, material in materials.items()}
            if not thing.visible_volume_scatter:
                self._told(f"{thing.name} is hidden from fog: it makes no beams, but the light that it reflects does")
            elif any(np.any(each > 0) for each in emitted.values()):
                area = areas(values, faces, matrix)
                self._glowing.add(parts[0], emitted, area)
        else:
            self._tell_rays(thing, key)
            self._prims += fog_prims(prim, next(iter(materials.values())), self._kept, self._told)

    def _tell_rays(self, thing: Any, key: Any) -> None:
        """Say that some rays do not meet a volume, if so."""
        if self._rays[key]:
            self._told(f"{thing.name} is a volume that some rays do not meet, which is not rendered: all meet it")

    def _add_strands(self, strands: Strands, thing: Any, matrix: Any, key: Any) -> None:
        kept, own = self._kept.meshes, (_geometry_of(thing)[0], strands.number)
        self._used.add(own)
        if own not in kept:
            values = strands.read()
            kept[own] = None if values is None else (values, {})
        found = kept[own]
        if found is None:
            return
        slots = thing.material_slots
        material = slots[min(max(strands.slot, 0), len(slots) - 1)].material if len(slots) else None
        self._places[key] = path = self._path("/Objects", strands.name)
        prim = {"path": path, "type": strands.kind, "matrix": matrix.T, "values": {**found[0], **self._rays[key]}}
        self._prims += self._bound(prim, {0: self._layer.material_override or material}, {})

    def _add_volume(self, thing: Any, matrix: Any, key: Any) -> None:
        slots = [each.material for each in thing.material_slots]
        volume = volume_of(self._layer.material_override or next(iter(slots), None), self._told)
        if volume is None:
            self._told(f"{thing.name} is not rendered: its material has no volume that is")
            return
        files = self._kept.grids.of(thing, {volume.density, volume.color, volume.glow_grid} - {""}, self._told)
        if files is None:
            return
        if volume.density in files:
            self._tell_rays(thing, key)
            self._places[key] = path = self._path("/Objects", thing.name)
            self._prims += volume_prims(path, matrix, volume, files, scale_of(thing, matrix))
        else:
            self._told(f"{thing.name} is not rendered: it has no grid {volume.density}")

    def _bound(
        self, prim: dict[str, Any], materials: dict[int, Any], faces: dict[int, Any]
    ) -> list[dict[str, Any]]:  # fmt: skip
        """Return the prim of a mesh with its material, or with a part of its faces for each of several."""
        bound, matrix = {**prim, "apis": ["MaterialBindingAPI"]}, prim["matrix"]
        if len(materials) == 1:
            (only,) = materials.values()
            return [{**bound, "targets": {"material:binding": [self._material(only, matrix)]}}]
        parts = [
            {
                "path": f"{prim['path']}/Part{slot}", "type": "GeomSubset", "apis": ["MaterialBindingAPI"],
                "values": {"elementType": ["token", "face"], "familyName": ["token", "materialBind"],
                           "indices": ["int[]", faces[slot]]},
                "targets": {"material:binding": [self._material(material, matrix)]},
            }
            for slot, material in materials.items()
        ]  # fmt: skip
        return [bound, *parts]

    def _mesh(self, thing: Any) -> tuple[dict[str, Any], dict[int, Any]] | None:
        """Return the attributes and the faces of an object's mesh, which its instances share; None if it has none."""
        key = _geometry_of(thing)
        meshes = self._kept.meshes
        self._used.add(key)
        if key not in meshes:
            mesh = thing.to_mesh()
            meshes[key] = None
            if mesh is not None and len(mesh.polygons):
                meshes[key] = mesh_values(mesh), faces_by_material(mesh)
            thing.to_mesh_clear()
        return meshes[key]

    def _material(self, material: Any, matrix: Any) -> str:
        """Return the path of a material on an object, whose prims are added once, if its scale makes no difference."""
        name = _name_of(material)
        key = name, scale_of_heights(material, matrix)
        if key not in self._materials:
            self._materials[key] = path = self._path("/Materials", name or "Default")
            self._emitted[name] = np.zeros(3)
            if material is None:
                shader = {"info:id": ["token", "UsdPreviewSurface"], "inputs:diffuseColor": ["color3f", [0.8] * 3],
                          "outputs:surface": ["token", None]}  # fmt: skip
                out = {"outputs:surface": ["token", f"{path}/Shader.outputs:surface"]}
                self._prims.append({"path": path, "type": "Material", "sources": out})
                self._prims.append({"path": f"{path}/Shader", "type": "Shader", "values": shader})
            else:
                make = partial(material_prims, material, path, key[1], self._images, self._told)
                prims = self._kept.once((*key, path), make)
                self._prims += prims
                self._emitted[name] = emitted_by(prims)
                self._clear |= {name} if lets_through(prims) else set()
        return self._materials[key]

    def _add_world(self, world: Any) -> None:
        medium = world_medium(world, self._told)
        path = self._path("", "World")
        sky = (
            []
            if world is None
            else self._kept.once((world.name_full, path), partial(world_prims, world, path, self._images, self._told))
        )
        sky = [{**each, "values": {**each["values"]}} for each in sky]
        if sky and medium is not None and hides_sky(world, medium):
            self._told(f"World {world.name}: its volume hides the sky, as in Cycles")
            sky = []
        for each in sky:
            if each["type"] == "DomeLight":
                values, each["targets"] = self._beams.of_world(world, self._sky_portals)
                each["values"] |= values
        self._prims += sky
        if medium is not None:
            path = self._path("", "Fog")
            self._names[path] = "World > Volume"
            self._prims.append({"path": path, "type": "Scope", "apis": APIS, "values": medium})


def _key_of(instance: Any) -> tuple[Any, ...]:
    """Return what names an object, or a copy of it, at all times, unless several copies have the same name."""
    thing, parent = instance.object, instance.parent.original.name_full if instance.is_instance else ""
    return parent, thing.original.name_full, thing.type, tuple(instance.persistent_id)


def _geometry_of(thing: Any) -> Any:
    """Return what names the geometry of an object, which its instances share."""
    return thing.original.name_full, thing.data.session_uid if thing.data is not None else 0


def _reshaped(thing: Any, points: Any) -> dict[str, Any]:
    """Return the attributes of an object's mesh if it has other points than these; else none."""
    mesh = thing.to_mesh()
    differs = mesh is not None and len(mesh.polygons) and not np.array_equal(points_of(mesh), points)
    found = mesh_values(mesh) if differs else {}
    thing.to_mesh_clear()
    return found


def _name_of(material: Any) -> str:
    """Return the name of a material, "" for none."""
    return "" if material is None else material.name_full
