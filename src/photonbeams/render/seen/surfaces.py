"""Which meshes and materials camera rays meet, although a shape of Mitsuba's may be several meshes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from ... import scene
from ...runtime.device import Array3f, Bool, UInt32, mitsuba
from ...world.world import World
from ..films.mattes import MATERIAL, OBJECT
from ..paths.branches import CameraPaths
from ..paths.camera_paths import CameraVertex

mi = mitsuba()


class SeenPoints:
    """Where the first surfaces straight ahead are: `place`, `shape` and `triangle`, and whether they are `solid`."""

    def __init__(self, count: int) -> None:
        self.shape: Any
        self.triangle: Any
        self.solid: Any
        self.place = dr.full(Array3f, dr.inf, count)
        self.shape, self.triangle, self.solid = (dr.zeros(kind, count) for kind in (UInt32, UInt32, Bool))

    def add(self, step: CameraPaths, vertex: CameraVertex) -> None:
        """Add one step of camera paths."""
        if vertex.point is None:
            return
        first = step.alive & step.primary & vertex.solid
        dr.scatter(self.place, vertex.point.place, step.pixel, first)
        dr.scatter(self.shape, vertex.point.shape, step.pixel, first)
        dr.scatter(self.triangle, vertex.point.triangle, step.pixel, first)
        dr.scatter(self.solid, Bool(True), step.pixel, first)
        dr.eval(self.place, self.shape, self.triangle, self.solid)


@dataclass(frozen=True, eq=False)
class Surfaces:
    """The surfaces of a world: `names` and `materials` of objects, and their meshes, if they are known.

    `starts` are the objects' first triangles in their shapes, and `shapes` the objects, from the first up to the last,
    of each shape by its number.
    """

    names: Sequence[str]
    materials: Sequence[str]
    meshes: Sequence[scene.Mesh]
    starts: np.ndarray
    shapes: dict[int, tuple[int, int]]

    @classmethod
    def of(cls, world: World) -> Surfaces:
        """Return the surfaces of a world."""
        names, materials, meshes, starts = list[str](), list[str](), list[scene.Mesh](), list[int]()
        shapes = dict[int, tuple[int, int]]()
        for shape, group in _groups(world):
            first, start = len(names), 0
            for each in group:
                names.append(each.name)
                starts.append(start)
                materials.append(_material(each))
                if isinstance(each, scene.Mesh):
                    meshes.append(each)
                    start += len(each.faces)
            number = int(UInt32(dr.reinterpret_array(UInt32, mi.ShapePtr(shape)))[0])
            shapes[number] = first, len(names)
        return cls(names, materials, meshes, np.array(starts, np.int64), shapes)

    def numbers(self, points: SeenPoints) -> np.ndarray:
        """Return the numbers of the objects at points, -1 where there is none."""
        shape, triangle = points.shape.numpy(), points.triangle.numpy().astype(np.int64)
        result = np.full(len(shape), -1, np.int32)
        for number in np.unique(shape):
            if int(number) not in self.shapes:
                continue
            first, last = self.shapes[int(number)]
            here = shape == number
            places = np.searchsorted(self.starts[first:last], triangle[here], side="right")
            result[here] = first - 1 + places
        return result

    def moved(self, points: SeenPoints, place: np.ndarray, later: Sequence[scene.Mesh]) -> np.ndarray:
        """Return where points at these places, (N, 3), are when the meshes are as they are `later`.

        Meshes that are not there, or have other faces, stay where they are.
        """
        result, numbers, triangle = place.copy(), self.numbers(points), points.triangle.numpy().astype(np.int64)
        by_name = {mesh.name: mesh for mesh in later}
        for number in np.unique(numbers[numbers >= 0]):
            if number >= len(self.meshes):
                continue
            mesh = self.meshes[number]
            other = by_name.get(mesh.name)
            if other is None or other is mesh or not np.array_equal(other.faces, mesh.faces):
                continue
            here = np.flatnonzero(numbers == number)
            faces = np.asarray(mesh.faces)[triangle[here] - self.starts[number]]
            before, after = (np.asarray(each.points, np.float64)[faces] for each in (mesh, other))
            weights = _barycentric(place[here], before)
            # The place is a float32's: the point that these weights give in `before` is nearest to it.
            result[here] += ((after - before) * weights[..., None]).sum(axis=1)
        return result


def _barycentric(place: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return the weights of the corners, (N, 3, 3), of triangles at places, (N, 3), in their planes."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = place - corners[:, 0]
    aa, ab, bb, pa, pb = ((x * y).sum(axis=1) for x, y in ((a, a), (a, b), (b, b), (p, a), (p, b)))
    scale = np.maximum(aa * bb - ab * ab, 1e-300)
    u, v = (bb * pa - ab * pb) / scale, (aa * pb - ab * pa) / scale
    return np.stack([1 - u - v, u, v], axis=1)


@dataclass(frozen=True)
class _Whole:
    """A shape of a Mitsuba scene, with its id and that of its BSDF."""

    name: str
    material: str


def _groups(world: World) -> list[tuple[Any, Sequence[Any]]]:
    """Return the shapes of a world, and the meshes in each."""
    if world.parts is not None and hasattr(world.parts, "groups"):
        return [*zip(world.parts.shapes, world.parts.groups, strict=True)]
    return [*zip(world.plugin.shapes(), ([each] for each in wholes(world.plugin)), strict=True)]


def _material(each: Any) -> str:
    """Return the name of a mesh's material."""
    return each.material if isinstance(each, _Whole) else each.material.name


def names_of(objects: Iterable[Any]) -> dict[str, list[str]]:
    """Return the names of meshes and of their materials, by the cryptomattes that have them."""
    objects = [*objects]
    found = {OBJECT: [each.name for each in objects], MATERIAL: [_material(each) for each in objects]}
    return {layer: sorted({name for name in names if name}) for layer, names in found.items()}


def wholes(plugin: Any) -> list[_Whole]:
    """Return the shapes of a Mitsuba scene."""
    return [_Whole(each.id(), each.bsdf().id()) for each in plugin.shapes()]
