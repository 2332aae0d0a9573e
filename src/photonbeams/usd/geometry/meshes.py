"""Read UsdGeom meshes and implicit gprims as triangle meshes in world space."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ...scene import FARTHEST, Array, Material, Mesh
from ...scene.changes import same
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
from .patches import read_patch, read_tetrahedra
from .polygons import MOST_FACES, Polygons, Tessellation, Triangles, Values, triangles_of
from .primvars import Instance, find_primvar, read_instanced, read_primvar
from .skinning import deformed, is_skinned
from .tubes import read_spheres, read_tubes
from .velocities import PointSample

_SCHEMES = ("catmullClark", "loop")
_NOTHING = Polygons(np.zeros((0, 3)), np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))


@dataclass(frozen=True)
class _MeshPart:
    """Triangles in a prim's own space and their material."""

    suffix: str  # of the mesh's name
    triangles: Triangles
    material: Material


def is_gprim(prim: Usd.Prim) -> bool:
    """Return whether a prim is a mesh or an implicit shape."""
    return prim.IsA(UsdGeom.Mesh) or prim.GetTypeName() in GPRIMS


def is_surface(prim: Usd.Prim) -> bool:
    """Return whether a prim has a surface: as in `is_gprim`, or any other kind that is tessellated."""
    return is_gprim(prim) or any(prim.IsA(kind) for kind in _TESSELLATED)


def triangle_count(reading: Reading, prim: Usd.Prim) -> int:
    """Return how many triangles the surface of a prim will have, about so many if it is no mesh or implicit shape."""
    if prim.GetTypeName() in GPRIMS:
        return int(np.sum(gprim_polygons(reading, prim).counts - 2))

    def length(name: str) -> int:
        value = reading.value(prim, name, ())
        return len(value) if hasattr(value, "__len__") else 0

    if not prim.IsA(UsdGeom.Mesh):
        return 24 * length("points") if prim.IsA(UsdGeom.PointBased) else 4096
    quads = length("faceVertexIndices")
    made = max(quads - 2 * length("faceVertexCounts"), 0)
    for _ in range(_level(reading, prim, find_primvar(prim, "normals") is not None)):
        if quads <= MOST_FACES:
            made, quads = 2 * quads, 4 * quads
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
    parts = reading.cache.get(key)
    if parts is None:
        parts, shared = _mesh_parts(reading, prim, name, instances)
        if shared:
            reading.cache[key] = parts
    meshes = [_placed(reading, prim, part, to_world, name=name + part.suffix) for part in parts]
    return [mesh for mesh in meshes if len(mesh.faces)]


def _mesh_parts(
    reading: Reading, prim: Usd.Prim, name: str, instances: Sequence[Instance]
) -> tuple[list[_MeshPart], bool]:
    """Return a prim's triangles by material, and whether all copies of the prim share them."""
    parts, shared = [], True
    _warn_of_lost_volume(reading, prim)
    for bound, suffix, faces in _bound_faces(reading, prim):
        constants, varying = primvars_of(reading, prim, bound)
        for field, wanted in bound.primvars.items():
            value = read_instanced(reading, prim, wanted.name, 3 if field == "diffuse" else 1, instances=instances)
            if value is not None:
                constants[field], shared = value[None], False
        triangles = _triangles(reading, prim, bound.uv_name, varying)
        if faces is not None:
            triangles = triangles.of_faces(faces)
        material = on_mesh(reading, prim, bound, triangles, constants=constants)
        key = ("material", name + suffix)
        reading.lasting[key] = same(reading.lasting.get(key, material), material)
        parts.append(_MeshPart(suffix, triangles, reading.lasting[key]))
    return parts, shared


def _placed(reading: Reading, prim: Usd.Prim, part: _MeshPart, to_world: Array, *, name: str) -> Mesh:
    """Return a part in world space; the same object as at another time if nothing has changed."""
    reading.triangles += len(part.triangles.faces)
    if reading.triangles > room():
        text = f"has more triangles than fit into memory, with those before it: expected a total of at most {room():,}"
        raise reading.fail(prim, "", text)
    rays = rays_of(reading, prim)
    key = ("placed", name, *rays.values())
    triangles, matrix, mesh = reading.lasting.get(key, (None, None, None))
    if triangles is part.triangles and np.array_equal(matrix, to_world) and mesh.material is part.material:
        return mesh  # type: ignore[no-any-return]
    mesh = _in_world(part.triangles, to_world, name, part.material, **rays)
    reading.within_reach(prim, mesh.points)
    if part.triangles.lasting:
        reading.lasting[key] = part.triangles, to_world, mesh
    return mesh


def _warn_of_lost_volume(reading: Reading, prim: Usd.Prim) -> None:
    """Warn about a material without shaders that may have been a volume, and say how to make the mesh fog."""
    bound = (bound_to(reading, each) for each in (prim, *_subsets(prim)))
    empty = (each for each in bound if each and wrote_prim(each.GetPrim()) and not each.GetPrim().GetAllChildren())
    if material := next(empty, None):
        text = f"is {material.GetPath()}, which Blender wrote without shaders, as it does with volumes: it is grey"
        flag = f"--set '{prim.GetPath()}.photonbeams:scattering=0.1'"
        reading.warn(prim, f"{text}; for fog in it, use {flag}", "material:binding")


def read_solid(reading: Reading, prim: Usd.Prim, to_world: Array) -> Mesh:
    """Return only the triangles of a gprim, as one mesh, for portals and media."""
    mesh = _in_world(_triangles(reading, prim, "", {}), to_world, str(prim.GetPath()), Material())
    reading.within_reach(prim, mesh.points)
    return mesh


def is_closed(reading: Reading, prim: Usd.Prim) -> bool:
    """Return whether the triangles of a gprim are closed."""
    triangles = _triangles(reading, prim, "", {})
    return closed(triangles.points, triangles.vertices)


def _subsets(prim: Usd.Prim) -> list[Usd.Prim]:
    """Return the prims of a mesh's subsets of faces with materials."""
    subsets = UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets() if prim.IsA(UsdGeom.Mesh) else []
    return [each.GetPrim() for each in subsets]


def _bound_faces(reading: Reading, prim: Usd.Prim) -> list[tuple[Bound, str, Array | None]]:
    """Return (material, suffix of the name, faces) for each material subset, and for the faces in none of them."""
    subsets = _subsets(prim)
    if not subsets:
        return [(bound_material(reading, prim), "", None)]
    sample = PointSample.of(reading, prim).reading
    count = len(sample.value(prim, "faceVertexCounts", ()))
    free = np.ones(count, dtype=bool)
    parts = []
    for subset in subsets:
        faces = reading.attempt(subset, partial(sample.integers, subset, "indices"), _NOTHING.counts, "it is empty")
        there = (faces >= 0) & (faces < count)
        if not there.all():
            text = f"names face {faces[~there][0]}: expected faces from 0 to {count - 1}; the others are used"
            reading.warn(subset, text, "indices")
        faces = faces[there]
        faces = faces[free[faces]]
        free[faces] = False
        parts.append((bound_material(reading, subset), f"/{subset.GetName()}", faces))
    return [*parts, (bound_material(reading, prim), "", np.flatnonzero(free))]


def _triangles(reading: Reading, prim: Usd.Prim, uv_name: str, varying: Mapping[str, UsdGeom.Primvar]) -> Triangles:
    """Return a gprim's triangles in its own space, with what a material takes from primvars; instances share them."""
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
        triangles = replace(triangles_of(polygons), lasting=lasting)
        if is_gprim(prim) and not len(polygons.counts):
            has_counts = prim.IsA(UsdGeom.Mesh) and len(reading.value(prim, "faceVertexCounts", ())) > 0
            reading.warn(prim, f"has no {'points' if has_counts else 'faces'}: it is skipped")
        elif triangles.dropped and is_gprim(prim):
            reading.warn(prim, f"has {triangles.dropped} faces without area: they are skipped")
        cache[key] = triangles
    found: Triangles = cache[key]
    return found


def _polygons(reading: Reading, prim: Usd.Prim, uv_name: str, varying: Mapping[str, UsdGeom.Primvar]) -> Polygons:
    """Return a prim's surface as polygons, with the primvars that its material needs."""
    surface, is_mesh = tessellation(reading, prim), prim.IsA(UsdGeom.Mesh)
    if surface is None:
        return _NOTHING
    if is_mesh:  # topology may differ between samples
        reading = PointSample.of(reading, prim).reading
    lengths = surface.lengths
    names = {name: str(each.GetPrimvarName()) for name, each in varying.items()}
    values = {name: read_primvar(reading, prim, each, None, lengths=lengths) for name, each in names.items()}
    if prim.GetTypeName() not in GPRIMS:
        values["uvs"] = _uvs(reading, prim, lengths, uv_name)
    spread = {name: surface.spread(each) for name, each in values.items() if each is not None}
    polygons = replace(surface.polygons, primvars={**surface.polygons.primvars, **spread})
    if not is_mesh:
        return polygons
    polygons = _refined(reading, prim, polygons)
    return polygons.chosen(~np.isin(polygons.origins, reading.integers(prim, "holeIndices")))


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
    return subdivided(reading, prim, polygons, level=fitting)


def tessellation(reading: Reading, prim: Usd.Prim) -> Tessellation | None:
    """Return the polygons of a prim's surface, or None."""
    if prim.IsA(UsdGeom.Mesh):
        polygons = _cage(reading, prim)
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


def _cage(reading: Reading, prim: Usd.Prim) -> Polygons:
    """Return a mesh's polygons before subdivision, deformed, with their normals."""
    sample = PointSample.of(reading, prim)
    reading, points = sample.reading, sample.points
    counts, indices = (reading.integers(prim, name) for name in ("faceVertexCounts", "faceVertexIndices"))
    if points is None:
        return _NOTHING
    bent = deformed(reading, prim, points) if sample.moved is None else None
    if np.any(counts < 0):
        raise reading.fail(prim, "faceVertexCounts", f"holds {counts.min()}: expected 0 or more")
    if counts.sum() != len(indices):
        text = f"has {len(indices)} values: expected {counts.sum()}, the sum of faceVertexCounts"
        raise reading.fail(prim, "faceVertexIndices", text)
    wrong = indices[(indices < 0) | (indices >= len(points))]
    if len(wrong):
        text = f"names point {wrong[0]}: expected points from 0 to {len(points) - 1}"
        raise reading.fail(prim, "faceVertexIndices", text)
    polygons = Polygons(
        points if bent is None else bent.points,
        counts,
        indices,
        left_handed=reading.value(prim, "orientation") == "leftHanded",
        smooth=reading.value(prim, "subdivisionScheme", "catmullClark") in _SCHEMES,
    )
    # As in UsdGeomMesh, a primvar overrides normals.
    normals = read_primvar(reading, prim, "normals", 3, lengths=polygons.lengths)
    if normals is None:
        return polygons
    return replace(polygons, primvars={"normals": normals if bent is None else bent.normals(normals, indices)})


def _uvs(reading: Reading, prim: Usd.Prim, lengths: Mapping[str, int], uv_name: str) -> Values | None:
    """Return the texture coordinates that the material names, else `st`, else the first usable ones."""
    others = [
        each.GetPrimvarName()
        for each in UsdGeom.PrimvarsAPI(prim).GetPrimvarsWithValues()
        if str(each.GetTypeName()).startswith("texCoord2")
    ]
    for name in dict.fromkeys(filter(None, [uv_name, "st", *others])):
        uvs = read_primvar(reading, prim, name, 2, lengths=lengths)
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
        cofactors = np.cross(linear[[1, 2, 0]], linear[[2, 0, 1]])
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
    UsdGeom.NurbsPatch: read_patch,
    UsdGeom.TetMesh: read_tetrahedra,
}
