"""Deform meshes by skeletons: blend shapes and skinning by UsdSkel, at the time of a reading."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ...scene import Array
from ..common.openusd import Tf, Usd, UsdSkel, Vt
from ..common.reading import Reading
from .polygons import Values


@dataclass(frozen=True)
class Deformed:
    """Deformed points (P, 3) of a mesh, and the matrices (P, 3, 3) that turn its normals, as row vectors."""

    points: Array
    normal_offsets: Array
    normal_matrices: Array

    def normals(self, values: Values, indices: Array) -> Values:
        """Return deformed normals; `indices` are the points of the face vertices."""
        if values.interpolation in ("constant", "uniform"):
            return values
        point = indices if values.interpolation == "faceVarying" else np.arange(len(self.points))
        moved = values.values + self.normal_offsets[point]
        return Values(np.einsum("pi,pij->pj", moved, self.normal_matrices[point]), values.interpolation)


def is_skinned(prim: Usd.Prim) -> bool:
    """Return whether a skeleton may deform a prim."""
    return prim.HasAPI(UsdSkel.BindingAPI) or any(
        prim.GetAttribute(name).HasAuthoredValue() for name in ("primvars:skel:jointIndices", "skel:blendShapes")
    )


def deformed(reading: Reading, prim: Usd.Prim, points: Array) -> Deformed | None:
    """Return a mesh's points, deformed by its skeleton, in its own space; None if it has no skeleton."""
    if not is_skinned(prim):
        return None
    root = UsdSkel.Root.Find(prim)
    if not root:
        return None
    try:
        cache, bound = _skeletons(reading, root)
        if prim.GetPath() in bound:
            return _deformed(reading, cache, *bound[prim.GetPath()], points)
        for each in (prim, root.GetPrim()):
            find = partial(reading.targets, each, "skel:skeleton")
            reading.attempt(each, find, [], "its points are used as they are")
        return None
    except Tf.ErrorException:
        reading.warn(prim, "cannot be bound to its skeleton: its points are used as they are", "skel:skeleton")
        return None


def _skeletons(reading: Reading, root: UsdSkel.Root) -> tuple[Any, dict[Any, tuple[Any, Any]]]:
    """Return UsdSkel's cache below a SkelRoot, which keeps queries alive, and (skeleton, query) by the prims' paths."""
    key = ("skeletons", root.GetPath())
    if key not in reading.cache:
        cache = UsdSkel.Cache()
        prims = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimIsLoaded)
        cache.Populate(root, prims)
        bound = {
            query.GetPrim().GetPath(): (binding.GetSkeleton(), query)
            for binding in cache.ComputeSkelBindings(root, prims)
            for query in binding.GetSkinningTargets()
        }
        reading.cache[key] = cache, bound
    found: tuple[Any, dict[Any, tuple[Any, Any]]] = reading.cache[key]
    return found


def _deformed(
    reading: Reading, cache: UsdSkel.Cache, skeleton: UsdSkel.Skeleton, query: UsdSkel.SkinningQuery, points: Array
) -> Deformed | None:
    prim, skeleton_query = query.GetPrim(), cache.GetSkelQuery(skeleton)
    if not skeleton_query:
        reading.warn(prim, "names a skeleton without joints: its points are used as they are", "skel:skeleton")
        return None
    moved = Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(points, dtype=np.float32))
    offsets = np.zeros_like(points)
    if query.HasBlendShapes():
        moved, offsets = _blended(reading, skeleton_query, query, moved)
    if not query.HasJointInfluences():
        return Deformed(np.asarray(moved, dtype=np.float64), offsets, np.tile(np.eye(3), (len(points), 1, 1)))
    transforms = skeleton_query.ComputeSkinningTransforms(reading.time)
    if not query.ComputeSkinnedPoints(transforms, moved, reading.time):
        text = "does not fit its points and its skeleton's joints: its points are used as they are"
        reading.warn(prim, text, "primvars:skel:jointIndices")
        return None
    # UsdSkel's points are in the skeleton's space.
    to_prim = _row_matrix(reading, skeleton.GetPrim()) @ np.linalg.inv(_row_matrix(reading, prim))
    mapper = query.GetJointMapper()
    local = transforms if mapper is None else mapper.RemapTransforms(transforms, transforms, 1)
    bind = np.array(query.GetGeomBindTransform(reading.time))
    joints = bind @ np.array(local, dtype=np.float64).reshape(-1, 4, 4) @ to_prim
    # Normals are turned by the inverse transposes of the joints, which are blended as UsdSkel blends them.
    turns = np.linalg.pinv(joints[:, :3, :3]).swapaxes(1, 2)
    influences = query.ComputeVaryingJointInfluences(len(points), reading.time)
    indices, weights = (np.asarray(each).reshape(len(points), -1).T for each in influences)
    matrices = sum(weight[:, None, None] * turns[index] for index, weight in zip(indices, weights, strict=True))
    skinned = np.asarray(moved, dtype=np.float64) @ to_prim[:3, :3] + to_prim[3, :3]
    return Deformed(skinned, offsets, np.asarray(matrices))


def _row_matrix(reading: Reading, prim: Usd.Prim) -> Array:
    """Return a prim's transform to world space, for row vectors, as in USD."""
    return np.array(reading.xforms.GetLocalToWorldTransform(prim), dtype=np.float64)


def _blended(
    reading: Reading, skeleton_query: UsdSkel.SkeletonQuery, query: UsdSkel.SkinningQuery, points: Vt.Vec3fArray
) -> tuple[Vt.Vec3fArray, Array]:
    """Return points with blend shapes added, and the offsets of the normals, (P, 3)."""
    offsets, weights = Vt.Vec3fArray(len(points)), Vt.FloatArray()
    animation, mapper = skeleton_query.GetAnimQuery(), query.GetBlendShapeMapper()
    if animation and mapper is not None:
        weights = mapper.Remap(animation.ComputeBlendShapeWeights(reading.time), weights)
    shapes = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(query.GetPrim()))
    if len(weights) != shapes.GetNumBlendShapes():
        return points, np.array(offsets)
    of_points = shapes.ComputeBlendShapePointIndices()
    for weight, blend, sub in zip(*shapes.ComputeSubShapeWeights(weights), strict=True):
        inbetween, shape = shapes.GetInbetween(sub), shapes.GetBlendShape(blend)
        moves = inbetween.GetOffsets() if inbetween else shape.GetOffsetsAttr().Get()
        turns = inbetween.GetNormalOffsets() if inbetween else shape.GetNormalOffsetsAttr().Get()
        for shifts, values in ((moves, points), (turns, offsets)):
            if shifts:  # those that do not fit are ignored
                UsdSkel.ApplyBlendShape(weight, shifts, of_points[blend], values)
    return points, np.array(offsets)
