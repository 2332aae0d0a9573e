"""Curve objects that are beams, as BasisCurves with the attributes of `PhotonBeamsCurvesAPI`."""

from __future__ import annotations

from typing import Any

import numpy as np

from .nodes import Told

_APIS = ["PhotonBeamsCurvesAPI"]
_CUBIC = 4  # the order of a NURBS that is a cubic B-spline

#: A spline's kind (type, basis, wrap), its control points (N, 3), and the radii of its own points.
Spline = tuple[tuple[str, str, str], Any, Any]


def curve_prims(thing: Any, path: str, told: Told) -> list[dict[str, Any]]:
    """Return a prim for each kind of spline that a curve object has, without the transform."""
    kinds: dict[tuple[str, str, str], list[tuple[Any, Any]]] = {}
    if any(each.show_render for each in thing.modifiers):
        told(f"{thing.name}: its modifiers are not rendered: its beams are along the curve itself")
    for spline in thing.data.splines:
        kind, points, radii = _read(spline, lambda text: told(f"{thing.name}: {text}"))
        kinds.setdefault(kind, []).append((points, radii))
    if not kinds:
        told(f"{thing.name} has no splines: it makes no beams")
    return [
        _prim(thing.data.photonbeams, path if k == 0 else f"{path}_part{k}", kind, splines)
        for k, (kind, splines) in enumerate(kinds.items())
    ]


def _prim(own: Any, path: str, kind: tuple[str, str, str], splines: list[tuple[Any, Any]]) -> dict[str, Any]:
    """Return the prim of splines of one kind."""
    points = [np.asarray(each, np.float32) for each, _ in splines]
    radii = np.concatenate([each for _, each in splines])
    bezier = kind[1] == "bezier"
    values = {
        "type": ["token", kind[0]], "basis": ["token", kind[1]], "wrap": ["token", kind[2]],
        "curveVertexCounts": ["int[]", np.array([len(each) for each in points], np.int32)],
        "points": ["point3f[]", np.concatenate(points)],
        # A cubic Bézier curve has a value for each of its ends, the others one for each point.
        "widths": ["float[]", (2 * own.radius * radii).astype(np.float32), "varying" if bezier else "vertex"],
        "photonbeams:power": ["color3f[]", np.array([own.power * np.array(own.color[:])], np.float32)],
    }  # fmt: skip
    return {"path": path, "type": "BasisCurves", "apis": list(_APIS), "values": values}


def _read(spline: Any, told: Told) -> Spline:
    """Return a spline as USD has it: Bézier curves and NURBS of order 4 are cubic, the others linear."""
    closed = spline.use_cyclic_u
    wrap = "periodic" if closed else "nonperiodic"
    if spline.type == "BEZIER":
        found = spline.bezier_points
        corners = np.array([[each.handle_left, each.co, each.handle_right] for each in found]).reshape(-1, 3)[1:]
        corners = np.concatenate([corners, np.array([found[0].handle_left])]) if closed else corners[:-1]
        return ("cubic", "bezier", wrap), corners, [each.radius for each in found]
    points = np.array([each.co[:3] for each in spline.points])
    radii = [each.radius for each in spline.points]
    if spline.type == "NURBS" and spline.order_u == _CUBIC and len(points) >= _CUBIC:
        if np.ptp([each.co[3] for each in spline.points]) > 0 or (spline.use_bezier_u and not closed):
            told("weights and Bézier knots of NURBS are not rendered: it is a plain B-spline")
        return ("cubic", "bspline", "pinned" if spline.use_endpoint_u and not closed else wrap), points, radii
    if spline.type == "NURBS":
        told(f"a NURBS of order {spline.order_u} is not rendered, only one of order 4: its points are joined by lines")
    return ("linear", "bezier", wrap), points, radii
