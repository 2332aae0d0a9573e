"""UsdGeom meshes and implicit gprims as triangle meshes in world space."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom, UsdShade

from ..scene import FARTHEST, Array, Material, Mesh
from ..scene.vectors import unit
from .gprims import GPRIMS, gprim_polygons
from .materials import Bound, bound_material, flattened, on_mesh, primvars_of
from .polygons import Polygons, Triangles, Values, triangles_of
from .reading import Reading
from .velocities import carried

_INTERPOLATIONS = ("constant", "uniform", "varying", "vertex", "faceVarying")


def is_gprim(prim: Usd.Prim) -> bool:
    """Return whether a prim is a mesh, or a shape that becomes one."""
    return prim.IsA(UsdGeom.Mesh) or prim.GetTypeName() in GPRIMS


def read_meshes(reading: Reading, prim: Usd.Prim, to_world: Array, name: str) -> list[Mesh]:
    """Return a gprim's surface: a mesh for each material bound to it or to its face subsets.

    Raises
    ------
    SceneError
        Topology, normals or points that contradict each other.
    """
    result = []
    for bound, label, faces in _parts(reading, prim, name):
        constants, varying = primvars_of(reading, prim, bound)
        triangles = _triangles(reading, prim, bound.uv_name, varying)
        if faces is not None:
            triangles = triangles.chosen(np.isin(triangles.faces, faces))
        at_vertices = {"diffuse": triangles.colors, "opacity": triangles.opacities}
        given = {**{name: each for name, each in at_vertices.items() if each is not None}, **constants}
        material = on_mesh(reading, prim, bound, triangles.uvs, given)
        mesh = _in_world(triangles, to_world, label, material)
        reading.within_reach(prim, mesh.points)
        if len(mesh.faces):
            result.append(mesh)
    return result


def read_solid(reading: Reading, prim: Usd.Prim, to_world: Array) -> Mesh:
    """Return a gprim's triangles alone, as one mesh: what portals and media need."""
    mesh = _in_world(_triangles(reading, prim, ""), to_world, str(prim.GetPath()), Material())
    reading.within_reach(prim, mesh.points)
    return mesh


def is_closed(reading: Reading, prim: Usd.Prim) -> bool:
    """Return whether every edge has a triangle on each side, vertices at the same place counted as one."""
    triangles = _triangles(reading, prim, "")
    _, place = np.unique(triangles.points, axis=0, return_inverse=True)
    corners = place.reshape(-1)[triangles.vertices]
    edges = np.concatenate([corners[:, [i, (i + 1) % 3]] for i in range(3)])
    count = int(place.max(initial=0)) + 1
    there, back = np.sort(edges @ [count, 1]), np.sort(edges @ [1, count])
    return len(there) > 0 and bool(np.array_equal(there, back))


def _parts(reading: Reading, prim: Usd.Prim, name: str) -> list[tuple[Bound, str, Array | None]]:
    """Return (material, name, faces) of the prim's material subsets, and of the faces that are in none."""
    subsets = UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets() if prim.IsA(UsdGeom.Mesh) else []
    if not subsets:
        return [(bound_material(reading, prim), name, None)]
    moved = carried(reading, prim)
    sample = moved.reading if moved is not None else reading
    count = len(sample.value(prim, "faceVertexCounts", ()))
    free = np.ones(count, dtype=bool)
    parts = []
    for subset in subsets:
        own = subset.GetPrim()
        faces = reading.attempt(
            own, partial(sample.integers, own, "indices"), np.zeros(0, dtype=np.int64), "it is empty"
        )
        there = (faces >= 0) & (faces < count)
        if not there.all():
            bad = faces[~there][0]
            reading.warn(own, f"name face {bad}: expected faces from 0 to {count - 1}; the others are used", "indices")
        faces = faces[there]
        faces = faces[free[faces]]
        free[faces] = False
        parts.append((bound_material(reading, own), f"{name}/{own.GetName()}", faces))
    return [*parts, (bound_material(reading, prim), name, np.flatnonzero(free))]


def _triangles(
    reading: Reading, prim: Usd.Prim, uv_name: str, varying: Mapping[str, UsdGeom.Primvar] | None = None
) -> Triangles:
    """Return a gprim's triangles in its own space, with what a material takes from primvars; instances share them."""
    source = prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim
    varying = varying or {}
    names = tuple((field, str(primvar.GetName())) for field, primvar in varying.items())
    key = ("triangles", source.GetPath(), uv_name, names)
    if key not in reading.cache:
        is_mesh = prim.IsA(UsdGeom.Mesh)
        polygons = _mesh_polygons(reading, prim, uv_name) if is_mesh else gprim_polygons(reading, prim)
        polygons = _colored(reading, prim, polygons, varying)
        triangles = triangles_of(polygons)
        if not len(polygons.counts):
            has_counts = is_mesh and len(reading.value(prim, "faceVertexCounts", ())) > 0
            reading.warn(prim, f"has no {'points' if has_counts else 'faces'}: it is skipped")
        elif triangles.dropped:
            reading.warn(prim, f"has {triangles.dropped} faces without area: they are skipped")
        reading.cache[key] = triangles
    return reading.cache[key]


def _mesh_polygons(reading: Reading, prim: Usd.Prim, uv_name: str) -> Polygons:
    moved = carried(reading, prim)
    # The rest of a mesh is that of the sample which velocities carry on: its topology may be another at each.
    reading = moved.reading if moved is not None else reading
    points = moved.points if moved is not None else reading.array(prim, "points", 3)
    counts = np.asarray(reading.value(prim, "faceVertexCounts", ()), dtype=np.int64)
    indices = np.asarray(reading.value(prim, "faceVertexIndices", ()), dtype=np.int64)
    if points is None:
        return Polygons(np.zeros((0, 3)), counts[:0], indices[:0])
    if np.any(counts < 0):
        raise reading.fail(prim, "faceVertexCounts", f"holds {counts.min()}: expected numbers of at least 0")
    if counts.sum() != len(indices):
        raise reading.fail(
            prim,
            "faceVertexIndices",
            f"has {len(indices)} values: expected {counts.sum()}, the sum of faceVertexCounts",
        )
    if len(indices) and not (indices.min() >= 0 and indices.max() < len(points)):
        bad = indices[(indices < 0) | (indices >= len(points))][0]
        raise reading.fail(prim, "faceVertexIndices", f"name point {bad}: expected points from 0 to {len(points) - 1}")
    scheme = reading.value(prim, "subdivisionScheme", "catmullClark")
    polygons = Polygons(
        points,
        counts,
        indices,
        left_handed=reading.value(prim, "orientation") == "leftHanded",
        smooth=scheme in ("catmullClark", "loop"),
    )
    polygons = replace(polygons, normals=_normals(reading, prim, polygons), uvs=_uvs(reading, prim, polygons, uv_name))
    return _without_holes(polygons, np.asarray(reading.value(prim, "holeIndices", ()), dtype=np.int64))


def _without_holes(polygons: Polygons, holes: Array) -> Polygons:
    holes = holes[(holes >= 0) & (holes < len(polygons.counts))]
    if not len(holes):
        return polygons
    # A face of no vertices keeps the numbering of faces; its own corners are left out of the list.
    keep = np.ones(len(polygons.counts), dtype=bool)
    keep[holes] = False
    corners = np.repeat(keep, polygons.counts)
    changes: dict[str, Any] = {"counts": np.where(keep, polygons.counts, 0), "indices": polygons.indices[corners]}
    for key in ("normals", "uvs"):
        values = getattr(polygons, key)
        if values is not None and values.interpolation == "faceVarying":
            changes[key] = Values(values.values[corners], "faceVarying")
    return replace(polygons, **changes)


def _normals(reading: Reading, prim: Usd.Prim, polygons: Polygons) -> Values | None:
    """Return authored normals; primvars:normals win over normals, as UsdGeomMesh has it."""
    primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar("normals")
    if primvar and primvar.HasValue():
        return _primvar(reading, prim, primvar, 3, polygons)
    numbers = reading.array(prim, "normals", 3)
    if numbers is None:
        return None
    return _checked(reading, prim, "normals", Values(numbers, UsdGeom.Mesh(prim).GetNormalsInterpolation()), polygons)


def _uvs(reading: Reading, prim: Usd.Prim, polygons: Polygons, uv_name: str) -> Values | None:
    """Return the texture coordinates that the material asks for, else `st`, else the first there are."""
    api = UsdGeom.PrimvarsAPI(prim)
    others = [
        each.GetPrimvarName() for each in api.GetPrimvarsWithValues() if str(each.GetTypeName()).startswith("texCoord2")
    ]
    for name in [*([uv_name] if uv_name else []), "st", *others]:
        primvar = api.FindPrimvarWithInheritance(name)
        if primvar and primvar.HasValue():
            uvs = _primvar(reading, prim, primvar, 2, polygons)
            if uvs is not None and np.abs(uvs.values).max() > FARTHEST:
                text = f"holds {np.abs(uvs.values).max():g}: expected no more than {FARTHEST:g}"
                raise reading.fail(prim, str(primvar.GetName()), text)
            return uvs
    return None


def _primvar(
    reading: Reading, prim: Usd.Prim, primvar: UsdGeom.Primvar, columns: int, polygons: Polygons
) -> Values | None:
    name = str(primvar.GetName())
    try:
        flat = primvar.ComputeFlattened(reading.time)
    except Exception:
        flat = None
    if flat is None:
        raise reading.fail(prim, f"{name}:indices", f"name values that {name} does not have")
    if not hasattr(flat, "__len__") or np.ndim(flat) == 1:
        flat = [flat]
    numbers = reading.array(prim, name, columns, flat)
    if numbers is None:
        return None
    return _checked(reading, prim, name, Values(numbers, str(primvar.GetInterpolation())), polygons)


def _checked(reading: Reading, prim: Usd.Prim, name: str, values: Values, polygons: Polygons) -> Values:
    count = values.expected(polygons)
    if values.interpolation not in _INTERPOLATIONS or len(values.values) != count:
        raise reading.fail(
            prim,
            name,
            f"has {len(values.values)} values of interpolation '{values.interpolation}': expected {count}",
        )
    return values


def _colored(reading: Reading, prim: Usd.Prim, polygons: Polygons, varying: Mapping[str, UsdGeom.Primvar]) -> Polygons:
    """Return polygons with what a material takes from primvars that vary; with their mean where they do not fit."""
    for field, primvar in varying.items():
        values = Values(flattened(reading, prim, primvar), str(primvar.GetInterpolation()))
        count = values.expected(polygons)
        if len(values.values) != count:
            text = f"has {len(values.values)} values of interpolation '{values.interpolation}': expected {count}"
            reading.warn(prim, f"{text}; their mean is used", str(primvar.GetName()))
            values = Values(values.values.mean(axis=0, keepdims=True), "constant")
        changes: dict[str, Any] = {"colors" if field == "diffuse" else "opacities": values}
        polygons = replace(polygons, **changes)
    return polygons


def _in_world(triangles: Triangles, to_world: Array, name: str, material: Material) -> Mesh:
    """Return triangles in world space: wound around the outward normal, also where mirrored."""
    vertices = triangles.vertices
    linear = to_world[:3, :3]
    determinant = np.linalg.det(linear)
    if determinant < 0:
        vertices = vertices[:, ::-1]
    normals = None
    if triangles.normals is not None:
        # The cofactor matrix is the inverse transpose up to its scale, and exists where a scale is zero.
        x, y, z = linear.T
        cofactors = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=1)
        normals = unit(np.sign(determinant or 1.0) * triangles.normals @ cofactors.T)
    return Mesh(
        name=name,
        points=triangles.points @ linear.T + to_world[:3, 3],
        faces=vertices,
        normals=normals,
        uvs=triangles.uvs,
        material=material,
    )
