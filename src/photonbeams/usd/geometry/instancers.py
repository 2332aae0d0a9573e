"""The prims of a stage with their transforms: those of instances, and of point instancers at each of their points."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ...scene import Array
from ..common.openusd import Gf, Sdf, Usd, UsdGeom
from ..common.reading import PROTOTYPE_PRIMS, Reading, is_relationship, target_paths, visible
from ..common.selection import rendered_purposes
from ..common.sizes import MESH, MOST_INSTANCES, room, step_of, triangles_about
from .meshes import is_surface
from .primvars import Instance
from .velocities import carried

_WITH_ALL_BELOW = "it is skipped with all below it"


@dataclass(frozen=True)
class Item:
    """A prim with its transform; a prim that an instancer repeats has one item for each copy."""

    prim: Usd.Prim
    to_world: Array
    name: str
    instances: tuple[Instance, ...] = ()  # innermost instancer first


def items(reading: Reading) -> Iterator[Item]:
    """Return all visible prims of a stage, with instances and point instances expanded."""
    scope = Usd.PrimRange(reading.stage.GetPseudoRoot(), Usd.TraverseInstanceProxies())
    for prim in (walk := iter(scope)):
        if prim.IsPseudoRoot():
            continue
        if not visible(prim, reading.time):
            if UsdGeom.Imageable(prim).ComputeVisibility(reading.time) == "invisible":
                walk.PruneChildren()
            continue
        to_world = reading.attempt(prim, partial(reading.to_world, prim), None, _WITH_ALL_BELOW)
        if to_world is None or prim.IsA(UsdGeom.PointInstancer):
            walk.PruneChildren()  # prototypes are rendered where the instancer places them, not at their own place
        if to_world is not None:
            yield from _expanded(reading, Item(prim, to_world, str(prim.GetPath())))


def _expanded(reading: Reading, item: Item, within: tuple[Sdf.Path, ...] = ()) -> list[Item]:
    """Return a prim or, for a point instancer, the prims of its prototypes at each of its points.

    `within` are the paths of instancers that repeat this one.
    """
    if not item.prim.IsA(UsdGeom.PointInstancer):
        return [item]
    return reading.attempt(item.prim, lambda: list(_instances(reading, item, within)), [], "it is skipped")


def _instances(reading: Reading, item: Item, within: tuple[Sdf.Path, ...]) -> Iterator[Item]:
    prim = item.prim
    if prim.GetPath() in within:
        raise reading.fail(prim, "prototypes", "contains the instancer itself: expected prims that do not")
    if not is_relationship(prim, "prototypes"):
        raise reading.fail(prim, "prototypes", "is an attribute: expected a relationship, rel")
    within = (*within, prim.GetPath())
    instancer = UsdGeom.PointInstancer(prim)
    moved = carried(reading, prim, "positions")
    sample = moved.reading if moved is not None else reading
    indices = sample.integers(prim, "protoIndices")
    if len(indices) > MOST_INSTANCES:
        text = f"has {len(indices):,} values: expected no more than {MOST_INSTANCES:,}"
        raise reading.fail(prim, "protoIndices", text)
    positions = sample.array(prim, "positions", 3) if moved is None else moved.points
    prototypes, parts = _prototypes(reading, prim)
    transforms = _instance_transforms(reading, sample, instancer, indices, positions, prototypes)
    mask = np.asarray(instancer.ComputeMaskAtTime(sample.time) or np.ones(len(indices), dtype=bool))
    lost = [index for index in indices if not 0 <= index < len(parts) or parts[index] is None]
    if lost:
        text = f"names prototype {lost[0]}, which is not there: {len(lost)} of {len(indices)} instances are skipped"
        reading.warn(prim, text, "protoIndices")
    step = _step(reading, prim, indices, parts, within)
    for index, (number, matrix) in enumerate(zip(indices, transforms, strict=False)):
        if index % step or not (index >= len(mask) or mask[index]) or not 0 <= number < len(parts):
            continue
        local = item.to_world @ reading.matrix(prim, matrix)
        for part in parts[number] or ():
            instances = (Instance(prim, index), *item.instances)
            copy = Item(part.prim, local @ part.to_world, f"{item.name}[{index}]{part.name}", instances)
            yield from _expanded(reading, copy, within)


def _step(
    reading: Reading, prim: Usd.Prim, indices: Array, parts: list[list[Item] | None], within: tuple[Sdf.Path, ...]
) -> int:
    """Return n if every n-th instance is rendered: 1 if all fit into memory."""
    total = _triangles_of(reading, indices, parts, within)
    if len(within) > 1:  # an instancer that another one repeats was counted there
        return step_of(total, room())
    step = step_of(total, room() - reading.expected)
    reading.expected += total // step
    if step > 1:
        reading.warn(
            prim, f"has {len(indices):,} instances: one in {step} is rendered, to limit memory", "protoIndices"
        )
    return step


def _triangles_of(
    reading: Reading, indices: Array, parts: list[list[Item] | None], within: tuple[Sdf.Path, ...]
) -> int:
    """Estimate how many triangles an instancer's copies of its prototypes have."""
    numbers = np.bincount(indices[(indices >= 0) & (indices < len(parts))], minlength=len(parts))
    sizes = [sum(_triangles_in(reading, each.prim, within) for each in part or ()) for part in parts]
    return sum(int(number) * size for number, size in zip(numbers, sizes, strict=True))


def _triangles_in(reading: Reading, prim: Usd.Prim, within: tuple[Sdf.Path, ...]) -> int:
    """Estimate how many triangles a prim of a prototype has; an instancer counts all of its copies."""
    key = ("about", prim.GetPath())
    if key not in reading.cache:
        size = 0
        if is_surface(prim):
            size = MESH + triangles_about(reading, prim)
        elif prim.IsA(UsdGeom.PointInstancer) and prim.GetPath() not in within:
            _, parts = _prototypes(reading, prim)
            indices = reading.attempt(prim, partial(reading.integers, prim, "protoIndices"), np.zeros(0, int), "")
            size = _triangles_of(reading, indices, parts, (*within, prim.GetPath()))
        reading.cache[key] = size
    return int(reading.cache[key])


def _instance_transforms(
    reading: Reading,
    sample: Reading,
    instancer: UsdGeom.PointInstancer,
    indices: Array,
    positions: Array | None,
    prototypes: list[Usd.Prim],
) -> Sequence[Gf.Matrix4d]:
    """Return one matrix per instance, hidden ones too, with the prototypes' own transforms."""
    prim, count = instancer.GetPrim(), len(indices)
    there = 0 if positions is None else len(positions)
    if there != count:
        text = f"has {there} values: expected {count}, as many as protoIndices; {min(there, count)} are rendered"
        reading.warn(prim, text, "positions")
    for name in ("orientations", "scales", "ids"):
        values = sample.value(prim, name, ())
        if not hasattr(values, "__len__"):
            raise reading.fail(prim, name, f"is {values}: expected a list of values")
        if len(values) not in (0, count):
            text = f"has {len(values)} values: expected {count}, as many as protoIndices; none of them is used"
            reading.warn(prim, text, name)
    # At the earliest time, which is infinitely long ago, velocities would move instances infinitely far.
    time = sample.time if reading.time.IsEarliestTime() else reading.time
    result: Sequence[Gf.Matrix4d] = instancer.ComputeInstanceTransformsAtTime(
        time,
        sample.time,
        UsdGeom.PointInstancer.IncludeProtoXform,
        UsdGeom.PointInstancer.IgnoreMask,
    )
    return result if len(result) == count else _placed(sample, prim, indices, positions, prototypes)


def _placed(
    sample: Reading, prim: Usd.Prim, indices: Array, positions: Array | None, prototypes: list[Usd.Prim]
) -> list[Gf.Matrix4d]:
    """Return the matrices of the instances that have all values; OpenUSD computes none if one lacks a value.

    Angular velocities are left out.
    """
    given = {name: sample.value(prim, name, ()) for name in ("orientations", "scales")}
    result = []
    for index, (number, position) in enumerate(zip(indices, () if positions is None else positions, strict=False)):
        matrix = Gf.Matrix4d(1)
        if 0 <= number < len(prototypes) and prototypes[number]:
            matrix, _ = sample.xforms.GetLocalTransformation(prototypes[number])
        if len(given["scales"]) == len(indices):
            matrix = matrix * Gf.Matrix4d().SetScale(Gf.Vec3d(given["scales"][index]))
        if len(given["orientations"]) == len(indices):
            matrix = matrix * Gf.Matrix4d().SetRotate(Gf.Quatd(given["orientations"][index]))
        result.append(matrix * Gf.Matrix4d().SetTranslate(Gf.Vec3d(*map(float, position))))
    return result


def _prototypes(reading: Reading, instancer: Usd.Prim) -> tuple[list[Usd.Prim], list[list[Item] | None]]:
    """Return the prototypes of an instancer, and what each consists of; None for one that is not there."""
    roots = [reading.stage.GetPrimAtPath(path) for path in target_paths(instancer, "prototypes")]
    return roots, [list(_prototype_items(reading, root)) if root and root.IsActive() else None for root in roots]


def _prototype_items(reading: Reading, root: Usd.Prim) -> Iterator[Item]:
    """Return the prims of a prototype, with transforms relative to its root."""
    walk = iter(Usd.PrimRange(root, Usd.TraverseInstanceProxies(PROTOTYPE_PRIMS)))
    for prim in walk:
        if prim.IsA(UsdGeom.Imageable) and not shown_in_prototype(reading, prim):
            walk.PruneChildren()
            continue
        to_root = reading.attempt(prim, partial(_relative, reading, prim, root), None, _WITH_ALL_BELOW)
        relative = str(prim.GetPath().MakeRelativePath(root.GetPath()))
        if to_root is not None:
            yield Item(prim, to_root, "" if relative == "." else f"/{relative}")
        if to_root is None or prim.IsA(UsdGeom.PointInstancer):
            walk.PruneChildren()


def _relative(reading: Reading, prim: Usd.Prim, root: Usd.Prim) -> Array:
    """Return the transform of a prim of a prototype to the prototype's root."""
    matrix, _ = reading.xforms.ComputeRelativeTransform(prim, root)
    return reading.matrix(prim, matrix)


def shown_in_prototype(reading: Reading, prim: Usd.Prim) -> bool:
    """Return whether a prim of a prototype is rendered with it, judged by the prim itself."""
    # An invisible ancestor of the prototype does not hide its instances.
    purpose = reading.value(prim, "purpose", "default")
    return reading.value(prim, "visibility", "inherited") != "invisible" and purpose in rendered_purposes(reading.stage)
