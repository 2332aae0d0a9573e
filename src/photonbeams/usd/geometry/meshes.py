"""Read UsdGeom meshes and implicit gprims as triangle meshes in world space."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ...scene import FARTHEST, Array, Material, Mesh
from ...scene.changes import equal
from ...scene.surfaces import is_closed as closed
from ...scene.vectors import unit
from ..common.blender import wrote_prim
from ..common.openusd import Usd, UsdGeom, UsdShade
from ..common.reading import Reading, may_vary
from ..common.selection import refinement_level
from ..common.sizes import lowered, room
from ..common.visibility import rays_of
from ..materials.bound import Bound, bound_material, bound_to
from .gprims import GPRIMS, gprim_polygons
from .on_mesh import on_mesh, primvars_of
from .polygons import Polygons, Tessellation, Triangles, Values, triangles_of
from .primvars import Instance, find_primvar, read_declared, read_instanced, read_primvar
from .skinning import deformed, is_skinned
from .tubes import read_spheres, read_tubes
from .velocities import Carried, carried

_SCHEMES = ("catmullClark", "loop")


@dataclass(frozen=True)
class _MeshPart:
    """Triangles in a prim's own space and their material; `lasting` triangles are the same at all times."""

    suffix: str  # of the mesh's name
    triangles: Triangles
    material: Material
    lasting: bool


def is_gprim(prim: Usd.Prim) -> bool:
    """Return whether a prim is a mesh or an implicit shape."""
    return prim.IsA(UsdGeom.Mesh) or prim.GetTypeName() in GPRIMS


def is_surface(prim: Usd.Prim) -> bool:
    """Return whether a prim has a surface: as in `is_gprim`, or any other kind that is tessellated."""
    return is_gprim(prim) or any(prim.IsA(kind) for kind in _TESSELLATED)


def triangle_count(reading: Reading, prim: Usd.Prim) -> int:
    """Return how many triangles the surface of a prim will have, about so many if it is no mesh or implicit shape."""
    if prim.GetTypeName() in GPRIMS:
        counts = gprim_polygons(reading, prim).counts
        return int(np.sum(counts - 2))

    def length(name: str) -> int:
        value = reading.value(prim, name, ())
        return len(value) if hasattr(value, "__len__") else 0

    if not prim.IsA(UsdGeom.Mesh):
        return 24 * length("points") if prim.IsA(UsdGeom.PointBased) else 4096
    corners, faces = length("faceVertexIndices"), length("faceVertexCounts")
    made, quads = max(corners - 2 * faces, 0), corners
    if level := _level(reading, prim, find_primvar(prim, "normals") is not None):
        from .subdivision import MOST_FACES  # SciPy takes long to import

        while level and quads <= MOST_FACES:
            made, quads, level = 2 * quads, 4 * quads, level - 1
    return made


def _level(reading: Reading, prim: Usd.Prim, has_normals: bool) -> int:
    """Return how often a mesh is to be refined: 0 if it is no subdivision surface."""
    is_smooth = reading.value(prim, "subdivisionScheme", "catmullClark") in _SCHEMES
    return refinement_level(prim, has_normals) if is_smooth else 0


def read_meshes(
    reading: Reading, prim: Usd.Prim, to_world: Array, name: str, instances: Sequence[Instance] = ()
) -> list[Mesh]:
    """Return a gprim's surface: a mesh for each material bound to it or to its face subsets.

    `instances` are those of the point instancers that repeat the prim, the innermost first; it inherits their primvars.

    Raises
    ------
    SceneError
        Topology and points contradict each other.
    """
    key = ("surfaces", prim.GetPath(), tuple(each.instancer.GetPath() for each in instances))
    surfaces = reading.cache.get(key)
    if surfaces is None:
        surfaces, alike = _surfaces(reading, prim, instances)
        if alike:
            reading.cache[key] = surfaces
    meshes = [_placed(reading, prim, each, to_world, name) for each in surfaces]
    return [mesh for mesh in meshes if len(mesh.faces)]


def _surfaces(reading: Reading, prim: Usd.Prim, instances: Sequence[Instance]) -> tuple[list[_MeshPart], bool]:
    """Return a prim's triangles by material, and whether all copies of the prim share them."""
    result = []
    alike = True
    _warn_of_lost_volume(reading, prim)
    for bound, suffix, faces in _parts(reading, prim):
        constants, varying = primvars_of(reading, prim, bound)
        for field, wanted in bound.primvars.items():
            own = read_instanced(reading, prim, wanted.name, 3 if field == "diffuse" else 1, instances)
            alike &= own is None
            constants |= {} if own is None else {field: own[None]}
        triangles, lasting = _triangles(reading, prim, bound.uv_name, varying)
        if faces is not None:
            triangles = _chosen(reading, (prim.GetPath(), suffix), triangles, faces)
        material = on_mesh(reading, prim, bound, triangles, constants)
        result.append(_MeshPart(suffix, triangles, material, lasting))
    return result, alike


def _chosen(reading: Reading, key: tuple[object, ...], triangles: Triangles, faces: Array) -> Triangles:
    """Return the triangles of some faces; the same object at all times if the faces are the same."""
    known = reading.lasting.get(("chosen", key))
    if known is None or known[0] is not triangles or not np.array_equal(known[1], faces):
        known = triangles, faces, triangles.chosen(np.isin(triangles.faces, faces))
        reading.lasting["chosen", key] = known
    return known[2]


def _placed(reading: Reading, prim: Usd.Prim, surface: _MeshPart, to_world: Array, name: str) -> Mesh:
    """Return a surface in world space; the same object as at another time if nothing has changed."""
    reading.triangles += len(surface.triangles.faces)
    if reading.triangles > room():
        text = f"has more triangles than fit into memory, with those before it: expected a total of at most {room():,}"
        raise reading.fail(prim, "", text)
    name += surface.suffix
    rays = rays_of(reading, prim)
    known = reading.lasting.get(("placed", name, *rays.values()))
    if known is not None and known[0] is surface.triangles and np.array_equal(known[1], to_world):
        mesh: Mesh = known[2]
        if _alike(reading, mesh.material, surface.material):
            return mesh
    mesh = _in_world(surface.triangles, to_world, name, surface.material, **rays)
    reading.within_reach(prim, mesh.points)
    if surface.lasting:
        reading.lasting["placed", name, *rays.values()] = surface.triangles, to_world, mesh
    return mesh


def _alike(reading: Reading, known: Material, material: Material) -> bool:
    """Return whether two materials are equal; materials that meshes share are compared once."""
    key = ("alike", id(known), id(material))
    if key not in reading.cache:
        reading.cache[key] = equal(known, material), known, material  # keeps both alive, and so their ids unique
    return bool(reading.cache[key][0])


def _warn_of_lost_volume(reading: Reading, prim: Usd.Prim) -> None:
    """Warn about a material without shaders that may have been a volume, and say how to make the mesh fog."""
    subsets = UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets() if prim.IsA(UsdGeom.Mesh) else []
    bound = (bound_to(reading, each) for each in (prim, *(each.GetPrim() for each in subsets)))
    empty = (each for each in bound if each and wrote_prim(each.GetPrim()) and not each.GetPrim().GetAllChildren())
    material = next(empty, None)
    if material:
        text = f"is {material.GetPath()}, which Blender wrote without shaders, as it does with volumes: it is grey"
        flag = f"--set '{prim.GetPath()}.photonbeams:scattering=0.1'"
        reading.warn(prim, f"{text}; for fog in it, use {flag}", "material:binding")


def read_solid(reading: Reading, prim: Usd.Prim, to_world: Array) -> Mesh:
    """Return only the triangles of a gprim, as one mesh, for portals and media."""
    mesh = _in_world(_triangles(reading, prim, "")[0], to_world, str(prim.GetPath()), Material())
    reading.within_reach(prim, mesh.points)
    return mesh


def is_closed(reading: Reading, prim: Usd.Prim) -> bool:
    """Return whether the triangles of a gprim are closed."""
    triangles, _ = _triangles(reading, prim, "")
    return closed(triangles.points, triangles.vertices)


def _parts(reading: Reading, prim: Usd.Prim) -> list[tuple[Bound, str, Array | None]]:
    """Return (material, suffix of the name, faces) for each material subset, and for the faces in none of them."""
    subsets = UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets() if prim.IsA(UsdGeom.Mesh) else []
    if not subsets:
        return [(bound_material(reading, prim), "", None)]
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
            reading.warn(own, f"names face {bad}: expected faces from 0 to {count - 1}; the others are used", "indices")
        faces = faces[there]
        faces = faces[free[faces]]
        free[faces] = False
        parts.append((bound_material(reading, own), f"/{own.GetName()}", faces))
    return [*parts, (bound_material(reading, prim), "", np.flatnonzero(free))]


def _triangles(
    reading: Reading, prim: Usd.Prim, uv_name: str, varying: Mapping[str, UsdGeom.Primvar] | None = None
) -> tuple[Triangles, bool]:
    """Return a gprim's triangles in its own space, and whether they are the same at all times.

    They include what a material takes from primvars; instances share them.
    """
    varying = varying or {}
    # Instances may have skeletons of their own, and inherit different primvars.
    skinned = is_skinned(prim)
    uvs = find_primvar(prim, uv_name or "st")
    inherited = {**({} if uvs is None else {"uvs": uvs}), **varying}
    sources = tuple((name, _source(primvar)) for name, primvar in inherited.items())
    used = [*inherited.values(), find_primvar(prim, "normals")]
    lasting = not (skinned or reading.varies(prim) or any(each and may_vary(each) for each in used))
    cache = reading.lasting if lasting else reading.cache
    key = ("triangles", (prim if skinned else in_prototype(prim)).GetPath(), uv_name, sources)
    if key not in cache:
        polygons = _polygons(reading, prim, uv_name, varying)
        triangles = triangles_of(polygons)
        if is_gprim(prim) and not len(polygons.counts):
            has_counts = prim.IsA(UsdGeom.Mesh) and len(reading.value(prim, "faceVertexCounts", ())) > 0
            reading.warn(prim, f"has no {'points' if has_counts else 'faces'}: it is skipped")
        elif triangles.dropped and is_gprim(prim):
            reading.warn(prim, f"has {triangles.dropped} faces without area: they are skipped")
        cache[key] = triangles
    return cache[key], lasting


def _polygons(reading: Reading, prim: Usd.Prim, uv_name: str, varying: Mapping[str, UsdGeom.Primvar]) -> Polygons:
    """Return a prim's surface as polygons, with the primvars that its material needs."""
    moved = carried(reading, prim) if prim.IsA(UsdGeom.Mesh) else None
    found = tessellation(reading, prim, moved)
    # The rest of a mesh comes from the sample that velocities start from: topology may differ between samples.
    reading = moved.reading if moved is not None else reading
    if found is None:
        return Polygons(np.zeros((0, 3)), np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))
    own = {field: read_primvar(reading, prim, primvar, None, found.lengths) for field, primvar in varying.items()}
    uvs = None if prim.GetTypeName() in GPRIMS else _uvs(reading, prim, found.lengths, uv_name)
    spread = {name: found.spread(each) for name, each in {"uvs": uvs, **own}.items() if each is not None}
    polygons = replace(found.polygons, primvars={**found.polygons.primvars, **spread})
    if not prim.IsA(UsdGeom.Mesh):
        return polygons
    return _without_holes(_refined(reading, prim, polygons), reading.integers(prim, "holeIndices"))


def _refined(reading: Reading, prim: Usd.Prim, polygons: Polygons) -> Polygons:
    """Return a mesh's polygons, subdivided where it is a subdivision surface."""
    level = _level(reading, prim, "normals" in polygons.primvars)
    if not level or not len(polygons.counts):
        return polygons
    from .subdivision import subdivided  # SciPy takes long to import

    fitting = lowered(level, len(polygons.indices), room() - reading.triangles)
    if fitting < level:
        text = f"is refined {fitting} times instead of {level}, to limit memory"
        reading.warn(prim, text, "subdivisionScheme")
    if not fitting:
        return polygons
    return subdivided(reading, prim, polygons, str(reading.value(prim, "subdivisionScheme", "catmullClark")), fitting)


def _patch(reading: Reading, prim: Usd.Prim) -> Tessellation | None:
    from .patches import read_patch  # SciPy takes long to import

    return read_patch(reading, prim)


def _tetrahedra(reading: Reading, prim: Usd.Prim) -> Tessellation | None:
    from .patches import read_tetrahedra

    return read_tetrahedra(reading, prim)


def tessellation(reading: Reading, prim: Usd.Prim, moved: Carried | None) -> Tessellation | None:
    """Return the polygons of a prim's surface, or None; those of a mesh as velocities have `moved` it."""
    if prim.IsA(UsdGeom.Mesh):
        polygons = _cage(reading, prim, moved)
    elif prim.GetTypeName() in GPRIMS:
        polygons = gprim_polygons(reading, prim)
    else:
        return next(read for kind, read in _TESSELLATED.items() if prim.IsA(kind))(reading, prim)
    return Tessellation(polygons, polygons.lengths, lambda values: values)


def _source(primvar: UsdGeom.Primvar) -> str:
    """Return the path of a primvar, in the prototype if its prim belongs to an instance."""
    return f"{in_prototype(primvar.GetAttr().GetPrim()).GetPath()}.{primvar.GetName()}"


def in_prototype(prim: Usd.Prim) -> Usd.Prim:
    """Return the prototype's prim for a prim inside an instance, or else the prim itself."""
    return prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim


def _cage(reading: Reading, prim: Usd.Prim, moved: Carried | None) -> Polygons:
    """Return a mesh's polygons before subdivision, deformed, with their normals."""
    reading = moved.reading if moved is not None else reading
    points = moved.points if moved is not None else reading.array(prim, "points", 3)
    bent = None if moved is not None or points is None else deformed(reading, prim, points)
    points = points if bent is None else bent.points
    counts = reading.integers(prim, "faceVertexCounts")
    indices = reading.integers(prim, "faceVertexIndices")
    if points is None:
        return Polygons(np.zeros((0, 3)), counts[:0], indices[:0])
    if np.any(counts < 0):
        raise reading.fail(prim, "faceVertexCounts", f"holds {counts.min()}: expected 0 or more")
    if counts.sum() != len(indices):
        raise reading.fail(
            prim,
            "faceVertexIndices",
            f"has {len(indices)} values: expected {counts.sum()}, the sum of faceVertexCounts",
        )
    if len(indices) and not (indices.min() >= 0 and indices.max() < len(points)):
        bad = indices[(indices < 0) | (indices >= len(points))][0]
        raise reading.fail(prim, "faceVertexIndices", f"names point {bad}: expected points from 0 to {len(points) - 1}")
    scheme = reading.value(prim, "subdivisionScheme", "catmullClark")
    polygons = Polygons(
        points,
        counts,
        indices,
        left_handed=reading.value(prim, "orientation") == "leftHanded",
        smooth=scheme in _SCHEMES,
    )
    primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar("normals")  # as in UsdGeomMesh, it overrides normals
    normals = read_declared(reading, prim, primvar, "normals", 3, polygons.lengths)
    if bent is not None and normals is not None:
        normals = bent.normals(normals, indices)
    return polygons if normals is None else replace(polygons, primvars={"normals": normals})


def _without_holes(polygons: Polygons, holes: Array) -> Polygons:
    if not len(holes):
        return polygons
    origin = np.arange(len(polygons.counts)) if polygons.origin is None else polygons.origin
    return polygons.chosen(~np.isin(origin, holes))


def _uvs(reading: Reading, prim: Usd.Prim, lengths: Mapping[str, int], uv_name: str) -> Values | None:
    """Return the texture coordinates that the material names, else `st`, else the first usable ones."""
    others = [
        each.GetPrimvarName()
        for each in UsdGeom.PrimvarsAPI(prim).GetPrimvarsWithValues()
        if str(each.GetTypeName()).startswith("texCoord2")
    ]
    for name in dict.fromkeys([*([uv_name] if uv_name else []), "st", *others]):
        primvar = find_primvar(prim, name)
        uvs = None if primvar is None else read_primvar(reading, prim, primvar, 2, lengths)
        if uvs is None:
            continue
        farthest = np.abs(uvs.values).max(initial=0)
        if farthest <= FARTHEST:
            return uvs
        text = f"holds {farthest:g}: expected no more than {FARTHEST:g}; it is left out"
        reading.warn(prim, text, f"primvars:{name}")
    return None


def _in_world(triangles: Triangles, to_world: Array, name: str, material: Material, **rays: bool) -> Mesh:
    """Return triangles in world space, wound around the outward normal even if mirrored; `rays` as of `rays_of`."""
    vertices = triangles.vertices
    linear = to_world[:3, :3]
    determinant = np.linalg.det(linear)
    if determinant < 0:
        vertices = vertices[:, ::-1]
    normals = None
    if "normals" in triangles.values:
        # The cofactor matrix is the inverse transpose up to a factor, and exists even if a scale is zero.
        (x0, y0, z0), (x1, y1, z1), (x2, y2, z2) = linear.tolist()  # thrice as fast as `np.cross`; there may be many
        cofactors = np.array(
            [
                [y1 * z2 - y2 * z1, z1 * x2 - z2 * x1, x1 * y2 - x2 * y1],
                [y2 * z0 - y0 * z2, z2 * x0 - z0 * x2, x2 * y0 - x0 * y2],
                [y0 * z1 - y1 * z0, z0 * x1 - z1 * x0, x0 * y1 - x1 * y0],
            ]
        )
        normals = unit(np.sign(determinant or 1.0) * triangles.values["normals"] @ cofactors.T)
    return Mesh(
        name=name,
        points=triangles.points @ linear.T + to_world[:3, 3],
        faces=vertices,
        normals=normals,
        uvs=triangles.values.get("uvs"),
        material=material,
        **rays,
    )


_TESSELLATED: dict[Any, Callable[[Reading, Usd.Prim], Tessellation | None]] = {
    UsdGeom.BasisCurves: read_tubes,
    UsdGeom.NurbsCurves: read_tubes,
    UsdGeom.HermiteCurves: read_tubes,
    UsdGeom.Points: read_spheres,
    UsdGeom.NurbsPatch: _patch,
    UsdGeom.TetMesh: _tetrahedra,
}
