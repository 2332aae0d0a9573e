"""Read a stage at one time: each prim by the reader of its kind."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from ..scene import Array, DrawnBeams, Light, Medium, Mesh, Scene, SceneError
from . import schemas as schemas
from .curves import guide_paths, is_drawn, read_curves, read_guides
from .lights import is_light, portal_paths, read_light
from .links import linked
from .medium import is_medium, read_medium
from .meshes import is_gprim, read_meshes
from .reading import Reading, visible
from .velocities import carried

PROTOTYPE_PRIMS = Usd.PrimIsActive & Usd.PrimIsLoaded  # prototypes may be `over` or `class`


@dataclass
class _Contents:
    meshes: list[Mesh] = field(default_factory=list)
    lights: list[tuple[Usd.Prim, Light]] = field(default_factory=list)
    drawn: list[DrawnBeams] = field(default_factory=list)
    media: list[tuple[Usd.Prim, Medium]] = field(default_factory=list)


@dataclass(frozen=True)
class _Item:
    """A prim at a place: the same prim comes several times where an instancer repeats it."""

    prim: Usd.Prim
    to_world: Array
    name: str


def read_scene(stage: Usd.Stage, time: Any = None, warned: set[str] | None = None, base: Any = None) -> Scene:
    """Return meshes, lights, drawn beams and fog of a stage at a time.

    What cannot be rendered is skipped with a warning to the logger "photonbeams".

    Parameters
    ----------
    time
        A time code, or a number; None is the default time.
    warned
        Warnings that were given already and are not given again; new ones are added.
    base
        The frame whose samples velocities carry on, while its shutter is open; None: `time`.

    Raises
    ------
    SceneError
        What cannot be read, with file, prim and attribute.
    """
    reading = Reading(stage, time, set() if warned is None else warned, base=base)
    contents = _Contents()
    # Points near the largest float and sums of them are the file's fault; the values are checked where it matters.
    with np.errstate(over="ignore", invalid="ignore"):
        items = list(_items(reading, stage.GetPseudoRoot()))
        lights = [item.prim for item in items if is_light(item.prim)]
        portals = {path for prim in lights for path in portal_paths(reading, prim)}
        guides = {path for prim in lights for path in guide_paths(reading, prim)}
        for item in items:
            path = item.prim.GetPath()
            if path not in portals and (path not in guides or is_drawn(item.prim)):
                _collect(reading, item, contents)
    _check_media(reading, contents.media)
    media = [prim for prim, _ in contents.media]
    return Scene(
        tuple(contents.meshes),
        tuple(linked(reading, light, prim, contents.meshes, media) for prim, light in contents.lights),
        tuple(contents.drawn),
        tuple(medium for _, medium in contents.media),
    )


def _check_media(reading: Reading, media: list[tuple[Usd.Prim, Medium]]) -> None:
    """Raise SceneError where two media fill the whole space."""
    filling = [prim for prim, medium in media if not medium.bounded]
    for prim in filling[1:]:
        first = filling[0].GetPath()
        raise SceneError(
            f"{reading.place(prim)} is a medium of the whole space, as {first} is: expected one such medium, the "
            "others on closed gprims"
        )


def _collect(reading: Reading, item: _Item, contents: _Contents) -> None:
    prim = item.prim
    if is_medium(prim):
        medium = read_medium(reading, prim, item.to_world, item.name)
        contents.media.append((prim, medium))
        if medium.bounded:
            return
    if is_light(prim):
        light = read_light(reading, prim, item.to_world, item.name)
        contents.lights.extend([(prim, replace(light, guides=read_guides(reading, prim)))] if light else [])
    if is_gprim(prim):
        _warn_of_skinning(reading, prim)
        contents.meshes.extend(read_meshes(reading, prim, item.to_world, item.name))
    elif prim.IsA(UsdGeom.BasisCurves) and is_drawn(prim):
        drawn = read_curves(reading, prim, item.to_world, item.name)
        contents.drawn.extend([drawn] if drawn else [])
    elif prim.IsA(UsdGeom.Gprim):
        hint = " without PhotonBeamsCurvesAPI" if prim.IsA(UsdGeom.BasisCurves) else ""
        reading.warn(prim, f"is a {prim.GetTypeName()}{hint}, which is not rendered: it is skipped")


def _warn_of_skinning(reading: Reading, prim: Usd.Prim) -> None:
    if "SkelBindingAPI" in prim.GetAppliedSchemas() and prim.HasRelationship("skel:skeleton"):
        reading.warn(prim, "is deformed by a skeleton, which is not rendered: its points are used as they are")


def _items(reading: Reading, root: Usd.Prim) -> Iterator[_Item]:
    """Return all visible prims below a prim, with instances and point instances expanded."""
    scope = Usd.PrimRange(root, Usd.TraverseInstanceProxies())
    for prim in (walk := iter(scope)):
        if prim.IsPseudoRoot():
            continue
        if not visible(prim, reading.time):
            if UsdGeom.Imageable(prim).ComputeVisibility(reading.time) == "invisible":
                walk.PruneChildren()
            continue
        if prim.IsA(UsdGeom.PointInstancer):
            walk.PruneChildren()  # prototypes are drawn where the instancer puts them, not where they stand
            yield from _instances(reading, prim, reading.to_world(prim), str(prim.GetPath()))
        else:
            yield _Item(prim, reading.to_world(prim), str(prim.GetPath()))


def _instances(reading: Reading, prim: Usd.Prim, to_world: Array, name: str) -> Iterator[_Item]:
    """Return the prims of a point instancer's prototypes, at each of its points."""
    instancer = UsdGeom.PointInstancer(prim)
    prototypes = reading.targets(prim, "prototypes")
    moved = carried(reading, prim, "positions")
    sample = moved.reading if moved is not None else reading
    indices = np.asarray(sample.value(prim, "protoIndices", ()), dtype=np.int64)
    if len(indices) and not (indices.min() >= 0 and indices.max() < len(prototypes)):
        bad = indices[(indices < 0) | (indices >= len(prototypes))][0]
        raise reading.fail(prim, "protoIndices", f"name prototype {bad}: expected 0 to {len(prototypes) - 1}")
    transforms = _instance_transforms(reading, sample, instancer, len(indices))
    mask = instancer.ComputeMaskAtTime(sample.time)
    shown = np.flatnonzero(np.asarray(mask)) if mask else range(len(indices))
    parts = [list(_prototype_items(reading, root)) for root in prototypes]
    for index in shown:
        local = to_world @ reading.matrix(prim, transforms[int(index)])
        for part in parts[indices[index]]:
            label = f"{name}[{index}]{part.name}"
            if part.prim.IsA(UsdGeom.PointInstancer):
                yield from _instances(reading, part.prim, local @ part.to_world, label)
            else:
                yield _Item(part.prim, local @ part.to_world, label)


def _instance_transforms(reading: Reading, sample: Reading, instancer: UsdGeom.PointInstancer, count: int) -> Any:
    """Return one matrix per instance, hidden ones too, with the prototypes' own transforms."""
    prim = instancer.GetPrim()
    positions = sample.array(prim, "positions", 3)
    if (0 if positions is None else len(positions)) != count:
        text = f"has {0 if positions is None else len(positions)} values: expected {count}, as protoIndices"
        raise reading.fail(prim, "positions", text)
    if not count:
        return []
    # Velocities would carry instances to the earliest of all times, which is infinitely long ago.
    time = sample.time if reading.time.IsEarliestTime() else reading.time
    result = instancer.ComputeInstanceTransformsAtTime(
        time,
        sample.time,
        UsdGeom.PointInstancer.IncludeProtoXform,
        UsdGeom.PointInstancer.IgnoreMask,
    )
    if len(result) != count:
        raise SceneError(f"{reading.place(prim)} has orientations, scales or ids of another length than protoIndices")
    return result


def _prototype_items(reading: Reading, root: Usd.Prim) -> Iterator[_Item]:
    """Return the prims of a prototype, with transforms relative to its root."""
    walk = iter(Usd.PrimRange(root, Usd.TraverseInstanceProxies(PROTOTYPE_PRIMS)))
    for prim in walk:
        if prim.IsA(UsdGeom.Imageable) and not shown_in_prototype(reading, prim):
            walk.PruneChildren()
            continue
        matrix, _ = reading.xforms.ComputeRelativeTransform(prim, root)
        relative = str(prim.GetPath().MakeRelativePath(root.GetPath()))
        yield _Item(prim, reading.matrix(prim, matrix), "" if relative == "." else f"/{relative}")
        if prim.IsA(UsdGeom.PointInstancer):
            walk.PruneChildren()


def shown_in_prototype(reading: Reading, prim: Usd.Prim) -> bool:
    """Return whether a prim of a prototype is to be rendered with it, as far as the prim itself says."""
    # What hides the prototype where it stands, above its root, does not hide its instances.
    return reading.value(prim, "visibility", "inherited") != "invisible" and reading.value(
        prim, "purpose", "default"
    ) in ("default", "render")
