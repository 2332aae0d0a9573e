"""The prims of a whole scene, from the depsgraph of a render or a viewport."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import count
from typing import Any

import bpy
import numpy as np

from .beams import BeamReader, is_cycles_portal, portals_of
from .cameras import camera_prim
from .fogs import fog_prims
from .glow import GlowingMeshes
from .kept import Kept
from .lights import light_prim, stretch_of, world_prims
from .linking import Links, ray_values
from .media import APIS, has_volume, hides_sky, volume_of, world_medium
from .meshes import faces_by_material, mesh_values, points_of
from .motion import is_blurred
from .prims import Prim, Told, Values, free_path, group_name, typed
from .shading.bumps import scale_of_heights
from .shading.materials import emitted_by, has_surface, lets_through, material_prims
from .strands import Strands, strands_of
from .volumes import scale_of, smoke_of, volume_prims

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

    def __init__(self, depsgraph: Any, kept: Kept, told: Told) -> None:
        self._depsgraph, self._told, self._images = depsgraph, told, kept.images
        self._layer = depsgraph.view_layer
        #: The names of light groups here, by those in Blender.
        self.groups: dict[str, str] = {}
        self._names: dict[str, str] = {}  # what messages call prims, by their paths
        self._beams = BeamReader(self._images, self._path, told)
        # Names of objects that are portals of lamps, or curves that are beams, and the paths of Cycles' portals.
        self._no_surfaces, self._sky_portals = portals_of(depsgraph), list[str]()
        self._places: dict[Any, str] = {}  # the paths of what may move
        self._rays: dict[Any, Values] = {}  # attributes of what some rays do not meet
        self._materials: dict[tuple[str, float], str] = {}
        self._kept, self._used = kept, set[tuple[str, int]]()
        self._prims: list[Prim] = []
        self._links = Links(told)
        self._glowing, self._emitted = GlowingMeshes(told), dict[str, Any]()
        self._clear = set[str]()  # the names of materials that light passes

    def prims(self) -> list[dict[str, Any]]:
        """Return the prims of all but the camera."""
        if (space := bpy.data.colorspace.working_space) != _SPACE:
            self._told(f"the file's working space is {space}: images, skies and temperatures have colours of {_SPACE}")
        for thing, matrix, key, strands in self._things():
            self._links.see(thing, key)
            if strands is not None:
                self._add_strands(strands, thing, matrix, key)
            elif thing.type == "CURVE" and thing.data.photonbeams.enabled:
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
        self._glowing.enable()
        self._add_world(self._layer.world_override or self._depsgraph.scene.world)
        self._links.write(self._prims, self._places, self._names)
        for key in self._kept.meshes.keys() - self._used:
            del self._kept.meshes[key]
        return [prim.described(self._names.get(prim.path, "")) for prim in self._prims + self._beams.prims]

    def moved(self) -> dict[str, dict[str, Any]]:
        """Return what may move, by path, as Blender has evaluated it now: transforms, lights, shapes that differ."""
        first = {prim.path: prim.values for prim in self._prims}
        descriptions, shapes = dict[str, dict[str, Any]](), dict[Any, dict[str, Any]]()
        for thing, matrix, key, strands in self._things():
            path = self._places.get(key, "")
            if path not in first or not is_blurred(thing):
                continue
            if thing.type == "LIGHT":
                descriptions[path] = self._light(thing, matrix, path, key).described()
                continue
            shape = _geometry_of(thing) if strands is None else key
            if shape not in shapes:
                values = _reshaped(thing, first[path].get("points")) if strands is None else strands.read()
                shapes[shape] = typed(values or {})
            descriptions[path] = {"matrix": matrix.T, "values": shapes[shape]}
        return descriptions

    def _things(self) -> Iterator[tuple[Any, Any, Any, Strands | None]]:
        """Yield what is rendered, copies too: object, transform, what names it at all times, and its hair or points."""
        seen, final = Counter[Any](), self._depsgraph.mode == "RENDER"
        for each in self._depsgraph.object_instances:
            thing, matrix, key = each.object, np.array(each.matrix_world), _key_of(each)
            parts = dict[Any, Strands | None]()
            if each.show_self:
                seen[key] += 1
                parts[*key, seen[key]] = None
            if each.show_self if thing.type in ("CURVES", "POINTCLOUD") else each.show_particles:
                for place, strands in enumerate(strands_of(thing, final, self._told)):
                    parts[*key, "strands", place] = strands
            for name, part in parts.items():
                self._rays[name] = ray_values(thing, each.parent or thing, self._layer, self._told)
                yield thing, matrix, name, part

    def camera(self, camera: Any, to_world: Any, size: tuple[int, int], shift: float = 0.0) -> dict[str, Any]:
        """Return the prim of a camera that sees the picture of this size; arguments as for `camera_prim`."""
        evaluated = camera.evaluated_get(self._depsgraph)
        prim = camera_prim(evaluated, to_world, self._depsgraph, size, shift=shift, told=self._told)
        return prim.described(camera.name)

    def _path(self, parent: str, name: str) -> str:
        """Return a path that no other prim has, of something of this name."""
        path = free_path(parent, name, self._names.__contains__)
        self._names[path] = _KINDS.get(parent, "") + name
        return path

    def _add_light(self, thing: Any, matrix: Any, key: Any) -> None:
        self._places[key] = path = self._path("/Lights", thing.name)
        prim = self._light(thing, matrix, path, key)
        values, prim.targets = self._beams.of_light(thing.data)
        prim.values |= values
        self._prims.append(prim)

    def _light(self, thing: Any, matrix: Any, path: str, key: Any) -> Prim:
        """Return the prim of a light, without its beams."""
        light = thing.data
        prim = light_prim(light, path, self._told)
        prim.values |= self._rays[key]
        pose = matrix.copy()
        scale = np.linalg.norm(pose[:3, :3], axis=0)
        if light.type == "SPOT" and np.ptp(scale) > 1e-4 * scale.max():
            self._told(f"{thing.name} is scaled unevenly: its cone is round")
        # Only area lights have the size of their object.
        pose[:3, :3] *= (1 if light.type == "AREA" else 1 / np.maximum(scale, 1e-30)) * stretch_of(light)
        prim.matrix = pose.T
        if thing.lightgroup:
            prim.values["photonbeams:lightGroup"] = self._group(thing.lightgroup)
        return prim

    def _add_curves(self, thing: Any, matrix: Any) -> None:
        self._no_surfaces.add(thing.name_full)
        group = self._group(thing.lightgroup) if thing.lightgroup else ""
        path = self._path("/Beams", thing.name)
        self._prims += [replace(prim, matrix=matrix.T) for prim in self._beams.of_curve(thing, path, group)]

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
        prim = Prim(path, "Mesh", values | self._rays[key], matrix=matrix.T)
        if any(has_surface(each) for each in materials.values()):
            self._prims += self._bound(prim, materials, faces)
            names = {_name_of(each) for each in materials.values()}
            if any(has_volume(each) for each in materials.values()) and names & self._clear:
                self._told(f"{thing.name} has a surface: the volume inside it is not rendered")
            emitted = {slot: self._emitted[_name_of(material)] for slot, material in materials.items()}
            if not thing.visible_volume_scatter:
                self._told(f"{thing.name} is hidden from fog: it makes no beams, but the light that it reflects does")
            else:
                self._glowing.add(prim, faces, emitted)
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
        prim = Prim(path, strands.kind, found[0] | self._rays[key], matrix=matrix.T)
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

    def _bound(self, prim: Prim, materials: dict[int, Any], faces: dict[int, Any]) -> list[Prim]:
        """Return the prim of a mesh with its material, or with a part of its faces for each of several."""
        paths = {slot: [self._material(material, prim.matrix)] for slot, material in materials.items()}
        prim.apis = ["MaterialBindingAPI"]
        if len(paths) == 1:
            (prim.targets["material:binding"],) = paths.values()
            return [prim]
        parts: Values = {"elementType": "face", "familyName": "materialBind"}
        return [prim, *(
            Prim(f"{prim.path}/Part{slot}", "GeomSubset", {**parts, "indices": faces[slot]},
                 {"material:binding": path}, apis=prim.apis)
            for slot, path in paths.items()
        )]  # fmt: skip

    def _mesh(self, thing: Any) -> tuple[Values, dict[int, Any]] | None:
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
            make = partial(material_prims, material, path, key[1], self._images, self._told)
            prims = self._kept.once((*key, path), make)
            self._prims += prims
            self._emitted[name] = emitted_by(prims)
            self._clear |= {name} if lets_through(prims) else set()
        return self._materials[key]

    def _add_world(self, world: Any) -> None:
        medium, path = world_medium(world, self._told), self._path("", "World")
        sky: list[Prim] = []
        if world is not None:
            make = partial(world_prims, world, path, self._images, self._told)
            sky = self._kept.once((world.name_full, path), make)
        if sky and medium is not None and hides_sky(world, medium):
            self._told(f"World {world.name}: its volume hides the sky, as in Cycles")
            sky = []
        for prim in sky:
            if prim.type == "DomeLight":
                values, targets = self._beams.of_world(world, self._sky_portals)
                prim = replace(prim, values=prim.values | values, targets=targets)
            self._prims.append(prim)
        if medium is not None:
            path = self._path("", "Fog")
            self._names[path] = "World > Volume"
            self._prims.append(Prim(path, "Scope", medium, apis=APIS))


def _key_of(instance: Any) -> tuple[Any, ...]:
    """Return what names an object, or a copy of it, at all times, unless several copies have the same name."""
    thing, parent = instance.object, instance.parent.original.name_full if instance.is_instance else ""
    return parent, thing.original.name_full, thing.type, tuple(instance.persistent_id)


def _geometry_of(thing: Any) -> Any:
    """Return what names the geometry of an object, which its instances share."""
    return thing.original.name_full, thing.data.session_uid if thing.data is not None else 0


def _reshaped(thing: Any, points: Any) -> Values:
    """Return the attributes of an object's mesh if it has other points than these; else none, as without points."""
    if points is None:
        return {}
    mesh = thing.to_mesh()
    differs = mesh is not None and len(mesh.polygons) and not np.array_equal(points_of(mesh), points)
    values = mesh_values(mesh) if differs else {}
    thing.to_mesh_clear()
    return values


def _name_of(material: Any) -> str:
    """Return the name of a material, "" for none."""
    return "" if material is None else material.name_full
