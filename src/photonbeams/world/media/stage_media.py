"""Media of a scene as Mitsuba media, with the closed shapes that bound them, nested or side by side."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ... import scene
from ...runtime.device import mitsuba
from ...scene import Array
from ..surfaces.shapes import shape_of
from .densities import density_grid

if TYPE_CHECKING:
    from ...runtime.mitsuba_types import MiMedium

mi = mitsuba()

_LOG = logging.getLogger("photonbeams")

#: What fills a part of space: a medium, or a body of glass.
Part = scene.Medium | scene.Mesh

# How many points of a boundary are tested for the media around it, and their depth below its faces, as a fraction of
# the faces' size.
_POINTS, _INSIDE = 64, 1e-4
# A boundary overlaps another medium if more than this fraction of its points lie inside, and more than this outside.
_OVERLAP = 0.02
# Mitsuba's name of the values of a heterogeneous medium's density.
_DATA = "sigma_t.data"
# The fraction of its convex hull that a convex mesh fills at least: faces of round ones may be bent by rounding.
_CONVEX = 0.999


@dataclass(frozen=True)
class BuiltMedium:
    """A medium of a scene as a Mitsuba medium.

    Attributes
    ----------
    medium
        The scene's medium.
    plugin, shape
        Mitsuba's medium, and the shape that bounds it; None if it fills the space.
    emission
        The radiance that it emits per scene unit, as Mitsuba's volume or one colour, or None.
    """

    medium: scene.Medium
    plugin: Any
    shape: Any = None
    emission: Any = None


def media_of(
    media: Sequence[scene.Medium], warned: set[str] | None = None, glass: Sequence[scene.Mesh] = (),
    known: Mapping[int, MiMedium] | None = None,
) -> list[BuiltMedium]:  # fmt: skip
    """Return the media of a scene as Mitsuba media, in the same order.

    A bounded medium has a shape with a null BSDF. The shape's interior is the medium, and its exterior the smallest
    medium around it: another bounded one, or the one that fills the space. Bodies of glass are empty: a medium in one
    has no other around it.

    Parameters
    ----------
    media
        The media; at most one may fill the space.
    warned
        Texts of the warnings so far, to which new ones are added.
    glass
        Closed bodies of glass, with outward faces.
    known
        Mitsuba media that were built before, by the ids of the scene's media.

    Raises
    ------
    SceneError
        Two media fill the space.
    """
    filling = [each for each in media if not each.bounded]
    if len(filling) > 1:
        first, second = (each.name or "the one without a name" for each in filling[:2])
        raise scene.SceneError(
            f"medium {second} has no boundary, and is in medium {first}, which fills the space: expected a closed mesh "
            "or a grid that bounds it"
        )
    grids = {id(each): density_grid(each) for each in media}
    shared: dict[Any, Any] = {}
    plugins = {id(each): (known or {}).get(id(each)) or _plugin(each, grids[id(each)], shared) for each in media}
    boundaries = {id(each): boundary for each in media if (boundary := each.boundary) is not None}
    bounded = [(each, _Solid(boundaries[id(each)])) for each in media if each.bounded]
    solids: list[tuple[Part, _Solid]] = [*bounded, *((each, _Solid(each)) for each in glass)]
    result, seen, within = [], set() if warned is None else warned, dict[str, list[str]]()
    for each in media:
        if not each.bounded:
            result.append(BuiltMedium(each, plugins[id(each)], emission=each.emission))
            continue
        texts = set[str]()
        outer = _around(each, solids, texts) or next(iter(filling), None)
        if each.grid is not None and isinstance(outer, scene.Medium):
            within.setdefault(outer.name, []).append(each.name)
        _warn(texts, seen)
        exterior = plugins.get(id(outer))  # none of glass
        shape = shape_of(
            boundaries[id(each)], mi.load_dict({"type": "null"}), interior=plugins[id(each)], exterior=exterior
        )
        emitted, grid = each.emission, grids[id(each)]
        if emitted is not None and grid is not None and not isinstance(emitted, scene.DensityGrid):
            emitted = scene.DensityGrid(grid.values[..., None] * np.array(emitted, dtype=np.float32), grid.to_world)
        if isinstance(emitted, scene.DensityGrid):
            emitted = mi.load_dict(_volume(emitted.values, emitted.to_world))
        result.append(BuiltMedium(each, plugins[id(each)], shape, emitted))
    _warn({_replaced(*each) for each in within.items()}, seen)
    return result


def _replaced(outer: str, inner: list[str]) -> str:
    """Return a text about smoke in other fog or smoke: only one of them is rendered where its box is."""
    others = f" and {len(inner) - 1} more" if inner[1:] else ""
    return f"smoke {inner[0]}{others} lies in {outer or 'fog'}, and replaces it in its whole box: they do not add up"


def around_glass(
    built: Sequence[BuiltMedium], glass: Sequence[scene.Mesh], warned: set[str] | None = None
) -> dict[str, MiMedium]:
    """Return Mitsuba's media around closed bodies of glass, by the names of these.

    Bodies in empty space have none, and neither have those that are partly in a bounded medium: it goes on in them.
    """
    filling = next((each.plugin for each in built if each.shape is None), None)
    plugins = {id(each.medium): each.plugin for each in built}
    media: list[tuple[Part, _Solid]] = [
        (each.medium, _Solid(boundary)) for each in built if (boundary := each.medium.boundary) is not None
    ]
    solids = [*media, *((each, _Solid(each)) for each in glass)]
    result = {}
    for each in glass:
        texts = set[str]()
        outer = _around(each, solids, texts)
        found = filling if outer is None else None if texts else plugins.get(id(outer))
        _warn(texts, set() if warned is None else warned)
        if found is not None:
            result[each.name] = found
    return result


def is_convex(boundary: scene.Mesh | None) -> bool:
    """Return whether a closed mesh is convex, as all of space is: whether it fills its convex hull."""
    if boundary is None or len(boundary.points) < 5:
        return True
    from scipy.spatial import ConvexHull, QhullError  # takes long to import

    try:
        return boundary.volume > _CONVEX * float(ConvexHull(boundary.points).volume)
    except QhullError:  # it is flat
        return True


def _plugin(medium: scene.Medium, varying: scene.DensityGrid | None, shared: dict[Any, Any]) -> MiMedium:
    """Return a medium as a Mitsuba medium; `varying` is its density where that is not given on a grid.

    Media whose grids have the same values and the same extinction share them: `shared` has those of earlier media.

    Everything that may change between frames is data. A `scale` would be a literal in kernels, which would be compiled
    again for each value.
    """
    extinction = np.array(medium.extinction)
    albedo = np.divide(medium.scattering, extinction, out=np.zeros(3), where=extinction > 0)
    albedo = np.minimum(albedo, 1).reshape(1, 1, 1, 3)
    colors = medium.scattering_color
    properties = {
        "albedo": _volume(albedo) if colors is None else _colored(albedo, colors),
        "phase": {"type": "hg", "g": medium.anisotropy} if medium.anisotropy else {"type": "isotropic"},
        **({"id": medium.name} if medium.name else {}),
    }
    grid = medium.grid or varying
    if grid is None:
        return mi.load_dict({"type": "homogeneous", "sigma_t": _volume(extinction.reshape(1, 1, 1, 3)), **properties})
    values = grid.values if grid.values.ndim == 4 else grid.values[..., None]
    grey = values.shape[3] == 1 and np.ptp(extinction) == 0
    key = id(grid.values), *extinction
    own = np.zeros((1, 1, 1, 1)) if key in shared else values * (extinction[:1] if grey else extinction)
    result = mi.load_dict({"type": "heterogeneous", "sigma_t": _volume(own, grid.to_world), **properties})
    parameters = mi.traverse(result)
    if key in shared:
        parameters[_DATA] = shared[key]
        parameters.update()
    shared[key] = parameters[_DATA]
    return result


def _colored(albedo: Array, colors: scene.DensityGrid) -> dict[str, Any]:
    """Describe an albedo times the colours of a grid."""
    factors = colors.values if colors.values.ndim == 4 else colors.values[..., None]
    return _volume(np.minimum(albedo * factors, 1), colors.to_world)


def _volume(values: Array, to_world: Array | None = None) -> dict[str, Any]:
    """Describe values on a grid over the unit cube, transformed by `to_world`, as a Mitsuba volume."""
    place = {} if to_world is None else {"to_world": mi.ScalarTransform4f(to_world)}
    grid = mi.VolumeGrid(np.ascontiguousarray(values, dtype=np.float32))
    return {"type": "gridvolume", "grid": grid, "raw": True, **place}


class _Solid:
    """A closed mesh with outward faces: its volume, points just inside, and a test of which points it contains."""

    def __init__(self, mesh: scene.Mesh) -> None:
        self._mesh, self.volume = mesh, mesh.volume
        corners = mesh.corners
        a, b, c = np.moveaxis(corners, 1, 0)
        normals = np.cross(b - a, c - a)
        area = np.linalg.norm(normals, axis=1)
        some = np.flatnonzero(area > 1e-12 * area.max(initial=0))
        some = some[np.unique(np.linspace(0, len(some) - 1, _POINTS).astype(int))] if len(some) else some
        # In proportion to the faces' size: points must not pass through thin media.
        depth = _INSIDE * np.sqrt(area[some])[:, None]
        self.points = corners[some].mean(axis=1) - depth * normals[some] / area[some][:, None]

    def contains(self, points: Array) -> Array:
        """Return which points are inside, by the solid angle that the faces subtend."""
        return np.array([self._mesh.winding(each) > 0.5 for each in points], dtype=bool)


def _warn(texts: set[str], warned: set[str]) -> None:
    """Give each warning once, and add it to those that were given."""
    for text in sorted(texts - warned):
        _LOG.warning("%s", text)
    warned |= texts


def _around(part: Part, solids: list[tuple[Part, _Solid]], texts: set[str]) -> Part | None:
    """Return the smallest bounded part around a bounded one; add a text about each that overlaps it."""
    index, own = next((index, solid) for index, (each, solid) in enumerate(solids) if each is part)
    around: list[tuple[float, int, Part]] = []
    for number, (other, solid) in enumerate(solids):
        if number == index or not len(own.points) or solid.volume < own.volume:
            continue
        inside = float(solid.contains(own.points).mean())
        if inside > 0.5 and (solid.volume, index) > (own.volume, number):
            around.append((solid.volume, -number, other))
        if _OVERLAP < inside < 1 - _OVERLAP:
            first, second = (other, part) if number < index else (part, other)
            text = f"media {first.name} and {second.name} overlap: expected one inside the other, or side by side"
            if isinstance(second, scene.Mesh):
                text = f"glass {second.name} is partly in {first.name}: expected all of it inside, or outside"
            texts.add(text)
    return min(around, key=lambda each: each[:2])[2] if around else None
