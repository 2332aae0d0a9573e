"""The media of a stage in Mitsuba, with their boundaries, and where these touch surfaces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from ... import scene
from ...numerics.arrays import to_vectors
from ...runtime.device import Float, mitsuba
from ..bounds import Box
from ..shadow_rays import gap_at
from ..surfaces.shapes import scene_of, shape_of
from .interfaces import number
from .media import Media
from .stage_media import around_glass, is_convex, media_of

if TYPE_CHECKING:
    from ...runtime.mitsuba_types import MiMedium, MiScene

mi = mitsuba()

# How many points of each boundary are tested for a surface in the same place.
_POINTS = 4096


def same(these: Sequence[object], those: Sequence[object]) -> bool:
    """Return whether two sequences have identical elements."""
    return len(these) == len(those) and all(a is b for a, b in zip(these, those, strict=True))


def touching(media: Sequence[scene.Medium], surfaces: MiScene, size: Float) -> bool:
    """Return whether boundaries of media coincide with surfaces, tested at random points of each boundary."""
    rng = np.random.default_rng(0)
    found = []
    for boundary in (each.boundary for each in media):
        if boundary is None or not len(boundary.faces):
            continue
        corners = boundary.corners
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(across, axis=1)
        if area.sum() > 0:
            face = rng.choice(len(area), _POINTS, p=area / area.sum())
            weights = rng.dirichlet([1, 1, 1], _POINTS)
            found.append((np.einsum("ij,ijk->ik", weights, corners[face]), across[face] / area[face, None]))
    if not found:
        return False
    place, normal = (to_vectors(np.concatenate(each)) for each in zip(*found, strict=True))
    gap = gap_at(place, size)
    ray = mi.Ray3f(mi.Point3f(place - gap * normal), mi.Vector3f(normal))
    ray.maxt = 2 * gap
    return bool(dr.any(surfaces.ray_test(ray)))


@dataclass(frozen=True)
class BoundedMedia:
    """The media of a world, and what bounds them: see `World`; `outside` are the media around bodies of glass."""

    media: Media
    boundaries: tuple[Any, ...]
    around: Any
    boxes: dict[int, Box]
    reentrant: frozenset[int]
    outside: Mapping[str, Any]

    @classmethod
    def of(
        cls, given: Sequence[scene.Medium], host: MiScene, glass: Sequence[scene.Mesh], known: Mapping[int, MiMedium]
    ) -> BoundedMedia:  # fmt: skip
        """Return media as Mitsuba's; `known` has Mitsuba media by the ids of media for which they were built."""
        solids = [each.solid() for each in glass]
        warned = set[str]()
        built = media_of(given, warned, solids, known)
        outside = around_glass(built, solids, warned)
        unfelt = [each.plugin for each in built if not each.medium.surfaces]
        filling = next((each.plugin for each in built if each.shape is None), None)
        boundaries = tuple(each.shape for each in built if each.shape is not None)
        bounded = {number(each.plugin): each.shape.bbox() for each in built if each.shape is not None}
        boxes = {own: (np.ravel(each.min), np.ravel(each.max)) for own, each in bounded.items()}
        bodies = [
            shape_of(each.outward(), mi.load_dict({"type": "null"}), exterior=outside[each.name])
            for each in solids
            if each.name in outside
        ]
        around = scene_of([*boundaries, *bodies], host) if boundaries or bodies else host
        emission = {number(each.plugin): each.emission for each in built if each.emission is not None}
        several = around if len(boundaries) > 1 else None
        media = Media(
            [each.plugin for each in built], several, filling=filling, clear=True, unfelt=unfelt, emission=emission
        )
        outer = {each.shape.exterior_medium() for each in built if each.shape is not None} | set(outside.values())
        reentrant = frozenset(
            number(each.plugin) for each in built if each.plugin in outer or not is_convex(each.medium.boundary)
        )
        return cls(media, boundaries, around, boxes, reentrant, outside)
