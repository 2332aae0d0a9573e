"""The prims of a stage with their transforms: those of instances, and of point instancers at each of their points."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from ...scene import Array
from ..common.openusd import Gf, Sdf, Usd, UsdGeom
from ..common.reading import PROTOTYPE_PRIMS, Reading, is_relationship, target_paths, visible
from ..common.selection import rendered_purposes
from ..common.sizes import MESH, MOST_INSTANCES, room, step_of
from .meshes import is_surface, triangle_count
from .primvars import Instance
from .velocities import PointSample

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


def _expanded(reading: Reading, item: Item) -> list[Item]:
    """Return a prim or, for a point instancer, the prims of its prototypes at each of its points.

    SceneError if these are without end.
    """
    if not item.prim.IsA(UsdGeom.PointInstancer):
        return [item]
    copies = reading.attempt(item.prim, partial(_copies, reading, item.prim, ()), None, "it is skipped")
    if copies is None:
        return []
    if copies.count > MOST_INSTANCES:
        text = f"makes more than {MOST_INSTANCES:,} copies with those of instancers that it repeats: expected fewer"
        raise reading.fail(item.prim, "protoIndices", f"{text}; a mask can select other prims")
    return reading.attempt(item.prim, lambda: list(_instances(reading, item, copies)), [], "it is skipped")


@dataclass(frozen=True)
class _Prototype:
    """The prims of a prototype, those that are instancers with what they make, and how many triangles these are."""

    parts: list[tuple[Item, _Copies | None]]
    triangles: int

    @property
    def has_own(self) -> bool:
        """Whether it has prims that are no instancers, which count as one copy."""
        return any(inner is None for _, inner in self.parts)

    @cached_property
    def count(self) -> int:
        """How many copies it is."""
        return self.has_own + sum(inner.count for _, inner in self.parts if inner is not None)


@dataclass(frozen=True)
class _Copies:
    """What an instancer makes: the numbers of the instances that are rendered, with a prototype for each.

    All instances have a matrix.
    """

    shown: list[int]
    prototypes: list[_Prototype]
    matrices: Sequence[Gf.Matrix4d]

    @cached_property
    def count(self) -> int:
        """How many copies it makes in all."""
        return sum(each.count for each in self.prototypes)

    @cached_property
    def triangles(self) -> int:
        """How many triangles these have."""
        return sum(each.triangles for each in self.prototypes)


def _instances(reading: Reading, item: Item, copies: _Copies) -> Iterator[Item]:
    """Yield the prims that an instancer makes: all, or an even selection of those that fit into memory."""
    step = step_of(copies.triangles, room() - reading.expected)
    reading.expected += copies.triangles // step
    if step > 1:
        text = f"has {copies.count:,} instances: one in {step} is rendered, to limit memory"
        reading.warn(item.prim, text, "protoIndices")
    yield from _selected(reading, item, copies, 0, step)


def _selected(reading: Reading, item: Item, copies: _Copies, number: int, step: int) -> Iterator[Item]:
    """Yield the prims of those copies whose numbers, which begin at `number`, are multiples of `step`."""
    for index, prototype in zip(copies.shown, copies.prototypes, strict=True):
        first, number = number, number + prototype.count
        if -first % step >= prototype.count:
            continue
        local = item.to_world @ reading.matrix(item.prim, copies.matrices[index])
        instances = (Instance(item.prim, index), *item.instances)
        inside = first + prototype.has_own
        for part, inner in prototype.parts:
            copy = Item(part.prim, local @ part.to_world, f"{item.name}[{index}]{part.name}", instances)
            if inner is not None:
                yield from _selected(reading, copy, inner, number=inside, step=step)
                inside += inner.count
            elif first % step == 0:
                reading.cache["copied", copy.name] = part.prim.GetPath()
                yield copy


def _copies(reading: Reading, prim: Usd.Prim, within: tuple[Sdf.Path, ...]) -> _Copies:
    """Return what an instancer makes; `within` are the paths of instancers that repeat it."""
    key = ("copies", prim.GetPath())
    if key not in reading.cache:
        reading.cache[key] = _read_copies(reading, prim, within)
    copies: _Copies = reading.cache[key]
    return copies


def _read_copies(reading: Reading, prim: Usd.Prim, within: tuple[Sdf.Path, ...]) -> _Copies:
    if prim.GetPath() in within:
        raise reading.fail(prim, "prototypes", "contains the instancer itself: expected prims that do not")
    if not is_relationship(prim, "prototypes"):
        raise reading.fail(prim, "prototypes", "is an attribute: expected a relationship, rel")
    sample = PointSample.of(reading, prim, "positions")
    indices = sample.reading.integers(prim, "protoIndices")
    if len(indices) > MOST_INSTANCES:
        text = f"has {len(indices):,} values: expected no more than {MOST_INSTANCES:,}"
        raise reading.fail(prim, "protoIndices", text)
    roots = [reading.stage.GetPrimAtPath(path) for path in target_paths(prim, "prototypes")]
    matrices = _matrices(reading, sample, indices, roots)
    prototypes = [_prototype(reading, root, (*within, prim.GetPath())) for root in roots]
    there = np.isin(indices, [number for number, each in enumerate(prototypes) if each is not None])
    if not there.all():
        lost = indices[~there]
        text = f"names prototype {lost[0]}, which is not there: {len(lost)} of {len(indices)} instances are skipped"
        reading.lack(prim, text, "protoIndices")
    mask = UsdGeom.PointInstancer(prim).ComputeMaskAtTime(sample.reading.time)
    if mask:
        there[: len(mask)] &= np.asarray(mask)[: len(there)]
    shown = np.flatnonzero(there[: len(matrices)])
    chosen = [each for number in indices[shown].tolist() if (each := prototypes[number]) is not None]
    return _Copies(shown.tolist(), chosen, matrices)


def _prototype(reading: Reading, root: Usd.Prim, within: tuple[Sdf.Path, ...]) -> _Prototype | None:
    """Return what a prototype consists of; None for one that is not there."""
    if not root or not root.IsActive():
        return None
    parts: list[tuple[Item, _Copies | None]] = []
    triangles = 0
    for each in _prototype_items(reading, root):
        if not each.prim.IsA(UsdGeom.PointInstancer):
            parts.append((each, None))
            triangles += MESH + triangle_count(reading, each.prim) if is_surface(each.prim) else 0
        elif inner := reading.attempt(each.prim, partial(_copies, reading, each.prim, within), None, "it is skipped"):
            parts.append((each, inner))
            triangles += inner.triangles
    return _Prototype(parts, triangles)


def _matrices(
    reading: Reading, sample: PointSample, indices: Array, prototypes: list[Usd.Prim]
) -> Sequence[Gf.Matrix4d]:
    """Return one matrix per instance, hidden ones too, with the prototypes' own transforms."""
    prim, count = sample.prim, len(indices)
    for name in ("positions", "orientations", "scales", "ids"):
        values = sample.reading.value(prim, name, ())
        if not hasattr(values, "__len__"):
            raise reading.fail(prim, name, f"is {values}: expected a list of values")
        needed = name == "positions"
        if len(values) != count and (needed or len(values)):
            instead = f"{min(len(values), count)} are rendered" if needed else "none of them is used"
            text = f"has {len(values)} values: expected {count}, as many as protoIndices; {instead}"
            reading.warn(prim, text, name)
    # At the earliest time, which is infinitely long ago, velocities would move instances infinitely far.
    base = sample.reading.time
    result: Sequence[Gf.Matrix4d] = UsdGeom.PointInstancer(prim).ComputeInstanceTransformsAtTime(
        base if reading.time.IsEarliestTime() else reading.time, base,
        UsdGeom.PointInstancer.IncludeProtoXform, UsdGeom.PointInstancer.IgnoreMask,
    )  # fmt: skip
    return result if len(result) == count else _complete_matrices(sample, indices, prototypes)


def _complete_matrices(sample: PointSample, indices: Array, prototypes: list[Usd.Prim]) -> list[Gf.Matrix4d]:
    """Return the matrices of the instances that have all values; OpenUSD computes none if one lacks a value.

    Velocities are left out.
    """
    scales, orientations = (sample.reading.value(sample.prim, name, ()) for name in ("scales", "orientations"))
    positions, result = sample.points, []
    for index, (number, position) in enumerate(zip(indices, () if positions is None else positions, strict=False)):
        matrix = Gf.Matrix4d(1)
        if 0 <= number < len(prototypes) and prototypes[number]:
            matrix, _ = sample.reading.xforms.GetLocalTransformation(prototypes[number])
        if len(scales) == len(indices):
            matrix = matrix * Gf.Matrix4d().SetScale(Gf.Vec3d(scales[index]))
        if len(orientations) == len(indices):
            matrix = matrix * Gf.Matrix4d().SetRotate(Gf.Quatd(orientations[index]))
        result.append(matrix * Gf.Matrix4d().SetTranslate(Gf.Vec3d(*map(float, position))))
    return result


def _prototype_items(reading: Reading, root: Usd.Prim) -> Iterator[Item]:
    """Return the prims of a prototype, with transforms relative to its root."""
    walk = iter(Usd.PrimRange(root, Usd.TraverseInstanceProxies(PROTOTYPE_PRIMS)))
    for prim in walk:
        if prim.IsA(UsdGeom.Imageable) and not shown_in_prototype(reading, prim, root):
            continue  # what is below may have another purpose
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


def shown_in_prototype(reading: Reading, prim: Usd.Prim, root: Usd.Prim) -> bool:
    """Return whether a prim of a prototype with this root is rendered with it.

    Nothing hides it, from the root on, and its purpose is rendered: its own, or that of the nearest prim above it that
    has one. What is above the prototype does not hide its instances.
    """
    purpose = ""
    while not prim.IsPseudoRoot():
        if reading.value(prim, "visibility", "inherited") == "invisible":
            return False
        own = prim.GetAttribute("purpose")
        purpose = purpose or (own.Get() if own and own.HasAuthoredValue() else "")
        if prim == root:
            break
        prim = prim.GetParent()
    return (purpose or "default") in rendered_purposes(reading.stage)
