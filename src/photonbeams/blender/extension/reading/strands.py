"""Hair and clouds of points: curves objects and particle systems as BasisCurves, points as Points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from .prims import Primvar, Told, Values

_RADIUS = 0.01  # Blender's where none is given
_POLY = 1  # the number of this type of curve


@dataclass(frozen=True)
class Strands:
    """Curves or points that an object has.

    Attributes
    ----------
    kind, name
        The type of their prim, and its name.
    number
        What tells them from others of the same object.
    slot
        The slot of their material.
    read
        Returns their attributes in the space of the object; None if there are none.
    """

    kind: str
    name: str
    number: int
    slot: int
    read: Callable[[], Values | None]


def strands_of(thing: Any, final: bool, told: Told) -> list[Strands]:
    """Return the hair and points of an object; those of a `final` picture may be finer than in a viewport."""
    if thing.type == "CURVES":
        return [Strands("BasisCurves", thing.name, thing.data.session_uid, 0, lambda: _curves(thing, told))]
    if thing.type == "POINTCLOUD":
        return [Strands("Points", thing.name, thing.data.session_uid, 0, lambda: _points(thing))]
    found = []
    for number, each in enumerate(thing.modifiers if len(thing.particle_systems) else (), start=1):
        if each.type == "PARTICLE_SYSTEM" and (each.show_render if final else each.show_viewport):
            settings = each.particle_system.settings
            if settings.type == "HAIR" and settings.render_type == "PATH":
                read = partial(_hair, thing, each.particle_system, final)
                name = f"{thing.name}_{each.particle_system.name}"
                found.append(Strands("BasisCurves", name, -number, settings.material - 1, read))
    return found


def _curves(thing: Any, told: Told) -> Values | None:
    curves = thing.data
    if not len(curves.curves):
        return None
    ends: Any = np.empty(len(curves.curves) + 1, np.int32)
    curves.curve_offset_data.foreach_get("value", ends)
    kinds = _attribute(curves, "curve_type", "value", np.zeros(len(curves.curves), np.int32))
    linear = bool(np.all(kinds == _POLY))
    if not linear and kinds.any():
        told(f"{thing.name} has curves of several kinds: they are rendered as Catmull-Rom curves")
    points = _attribute(curves, "position", "vector", np.zeros((ends[-1], 3), np.float32))
    return _prim_values(points, np.diff(ends), 2 * _radii(curves, ends[-1]), linear)


def _points(thing: Any) -> Values | None:
    count = len(thing.data.points)
    if not count:
        return None
    points = _attribute(thing.data, "position", "vector", np.zeros((count, 3), np.float32))
    return {"points": points, "widths": Primvar(2 * _radii(thing.data, count), "vertex")}


def _hair(thing: Any, system: Any, final: bool) -> Values | None:
    settings, parents, children = system.settings, len(system.particles), len(system.child_particles)
    first = parents if children and not settings.use_parent_particles else 0
    count, along = parents + children - first, (1 << (settings.render_step if final else settings.display_step)) + 1
    if not count:
        return None
    found = [system.co_hair(thing, particle_no=first + k, step=step) for k in range(count) for step in range(along)]
    to_object = np.linalg.inv(np.array(thing.matrix_world))
    points = np.array(found) @ to_object[:3, :3].T + to_object[:3, 3]
    root, tip, shape = settings.root_radius, settings.tip_radius, settings.shape
    thin = np.linspace(1, 0, along) ** (1 + shape if shape < 0 else 1 / max(1 - shape, 1e-3))
    widths = settings.radius_scale * (tip + (root - tip) * thin)  # as in Cycles, the radii are diameters
    widths[-1] = 0 if settings.use_close_tip else widths[-1]
    widths = np.tile(widths, count).astype(np.float32)
    return _prim_values(points.astype(np.float32), np.full(count, along), widths, False)


def _prim_values(points: Any, counts: Any, widths: Any, linear: bool) -> Values:
    return {
        "points": points, "curveVertexCounts": counts.astype(np.int32),
        "widths": Primvar(widths, "vertex"), "type": "linear" if linear else "cubic",
        "basis": "catmullRom", "wrap": "nonperiodic" if linear else "pinned",
    }  # fmt: skip


def _radii(data: Any, count: int) -> Any:
    return _attribute(data, "radius", "value", np.full(count, _RADIUS, np.float32))


def _attribute(data: Any, name: str, member: str, otherwise: Any) -> Any:
    """Return the values of an attribute, or others of the same shape and type if there is none."""
    found = data.attributes.get(name)
    if found is None:
        return otherwise
    values = np.empty(otherwise.size, otherwise.dtype)
    found.data.foreach_get(member, values)
    return values.reshape(otherwise.shape)
