"""The surfaces of a scene as Mitsuba's shapes, one for all meshes of a material: kernels record rays shape by shape."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ... import scene
from ...runtime.device import mitsuba
from .shapes import bsdf_of, emitter_of, glows, is_pane, shape_of, sharp_bsdf_of

if TYPE_CHECKING:
    from ...runtime.mitsuba_types import MiMedium, MiShape

mi = mitsuba()

#: Some of a scene's meshes.
Group = tuple[scene.Mesh, ...]

# The most vertices of a group of several meshes. If one of them moves, its whole group is built again.
_MOST = 1 << 16


def grouped(
    meshes: Sequence[scene.Mesh], glass: Collection[int], linked: Collection[frozenset[str]], sharp: bool
) -> list[Group]:
    """Return meshes in groups of the same material, which all cameras see and lights treat alike.

    Parameters
    ----------
    meshes
        The meshes.
    glass
        Ids of the meshes that stay by themselves.
    linked
        Sets of names of meshes that are apart from the rest: a light is linked otherwise for them, or they glow in a
        light group.
    sharp
        Whether flat sheets of transparent materials are panes of glass.
    """
    groups: list[list[scene.Mesh]] = []
    room: dict[object, tuple[list[scene.Mesh], int]] = {}  # the last group of each kind, with its number of vertices
    for mesh in meshes:
        kind = (
            id(mesh) if id(mesh) in glass else id(mesh.material), sharp and is_pane(mesh), mesh.normals is None,
            mesh.uvs is None, mesh.seen, mesh.blocks, mesh.holdout, *(mesh.name in names for names in linked),
        )  # fmt: skip
        last, count = room.get(kind, ([], _MOST))
        if count + len(mesh.points) > _MOST:
            last, count = [], 0
            groups.append(last)
        last.append(mesh)
        room[kind] = last, count + len(mesh.points)
    return [tuple(group) for group in groups]


def joined(group: Group) -> scene.Mesh:
    """Return the meshes of a group as one, with the name of the first."""
    first, *more = group
    if not more:
        return first
    starts = np.cumsum([0, *(len(each.points) for each in group[:-1])])
    faces = [np.asarray(each.faces, np.int64) + start for each, start in zip(group, starts, strict=True)]
    values: dict[str, Any] = {
        name: np.concatenate([getattr(each, name) for each in group])
        for name in ("points", "normals", "uvs")
        if getattr(first, name) is not None
    }
    return replace(first, faces=np.concatenate(faces), **values)


def shapes_of(
    groups: Sequence[Group], glass: Collection[int], sharp: bool, around: Mapping[str, MiMedium],
    known: Mapping[tuple[int, ...], MiShape],
) -> tuple[MiShape, ...]:  # fmt: skip
    """Return groups of meshes as Mitsuba shapes; a material's BSDF is shared.

    Parameters
    ----------
    groups
        The meshes.
    glass
        Ids of those that are bodies of glass.
    sharp
        Whether there are mirrors and glass.
    around
        The media around bodies that are empty inside, by the names of their meshes.
    known
        Shapes that are not built again, by the ids of their meshes.
    """
    keys = [(id(group[0].material), sharp and is_pane(group[0])) for group in groups]
    result: list[Any] = [known.get(ids_of(group)) for group in groups]
    bsdfs = {key: shape.bsdf() for key, shape in zip(keys, result, strict=True) if shape is not None}
    for index, (group, key) in enumerate(zip(groups, keys, strict=True)):
        if result[index] is not None:
            continue
        mesh = joined(group)
        if key not in bsdfs:
            own = sharp_bsdf_of(mesh.material, thin=key[1]) if sharp else None
            bsdfs[key] = mi.load_dict(own or bsdf_of(mesh.material))
        emitter = mi.load_dict(emitter_of(mesh.material)) if glows(mesh.material) else None
        outward = mesh.solid() if id(mesh) in glass else mesh
        result[index] = shape_of(outward, bsdfs[key], emitter, exterior=around.get(mesh.name))
    return tuple(result)


def ids_of(group: Group) -> tuple[int, ...]:
    """Return the ids of the meshes of a group."""
    return tuple(map(id, group))
