"""Curve objects that are beams, as BasisCurves with the attributes of `PhotonBeamsCurvesAPI`."""

from __future__ import annotations

from typing import Any

import numpy as np

from .meshes import read
from .prims import Prim, Primvar, Told

_APIS = ["PhotonBeamsCurvesAPI"]
_CUBIC = 4  # the order of a NURBS that is a cubic B-spline

#: A spline's kind (type, basis, wrap), its control points (N, 3), and the radii of its own points.
Spline = tuple[tuple[str, str, str], Any, Any]


def curve_prims(thing: Any, path: str, told: Told) -> list[Prim]:
    """Return a prim for each kind of spline that a curve object has, without the transform."""
    splines = list(thing.data.splines)
    found = [_read(each) for each in splines]
    if any(each.show_render for each in thing.modifiers) or not all(map(_is_plain, splines)):
        lines = _lines(thing, [radii for *_, radii in found])
        if lines:
            found = lines
        else:
            told(
                f"{thing.name}: its modifiers, weights and knots of NURBS are not rendered: set Bevel and Extrude to 0"
            )
    kinds: dict[tuple[str, str, str], list[tuple[Any, Any]]] = {}
    for kind, points, radii in found:
        kinds.setdefault(kind, []).append((points, radii))
    if not kinds:
        told(f"{thing.name} has no splines: it makes no beams")
    return [
        _prim(thing.data.photonbeams, path if k == 0 else f"{path}_part{k}", kind, own)
        for k, (kind, own) in enumerate(kinds.items())
    ]


def _prim(own: Any, path: str, kind: tuple[str, str, str], splines: list[tuple[Any, Any]]) -> Prim:
    """Return the prim of splines of one kind."""
    points = [np.asarray(each, np.float32) for each, _ in splines]
    radii = np.concatenate([each for _, each in splines])
    # A Bézier curve has a value for each of its ends, other curves one for each point.
    interpolation = "varying" if kind[:2] == ("cubic", "bezier") else "vertex"
    values = {
        "type": kind[0], "basis": kind[1] or "bezier", "wrap": kind[2],
        "curveVertexCounts": np.array([len(each) for each in points], np.int32),
        "points": np.concatenate(points),
        "widths": Primvar((2 * own.radius * radii).astype(np.float32), interpolation),
        "photonbeams:power": np.array([own.power * np.array(own.color[:])], np.float32),
    }  # fmt: skip
    return Prim(path, "BasisCurves", values, apis=_APIS)


def _read(spline: Any) -> Spline:
    """Return a spline as USD has it: Bézier curves and NURBS of order 4 are cubic, the others linear."""
    closed = spline.use_cyclic_u
    wrap = "periodic" if closed else "nonperiodic"
    if spline.type == "BEZIER":
        found = spline.bezier_points
        corners = np.array([[each.handle_left, each.co, each.handle_right] for each in found]).reshape(-1, 3)[1:]
        corners = np.concatenate([corners, np.array([found[0].handle_left])]) if closed else corners[:-1]
        return ("cubic", "bezier", wrap), corners, [each.radius for each in found]
    kind = ("cubic", "bspline", wrap) if spline.type == "NURBS" and spline.order_u == _CUBIC else ("linear", "", wrap)
    return kind, np.array([each.co[:3] for each in spline.points]), [each.radius for each in spline.points]


def _is_plain(spline: Any) -> bool:
    """Return whether USD has such a spline: of NURBS, uniform cubic B-splines without weights."""
    if spline.type != "NURBS":
        return True
    weights = [each.co[3] for each in spline.points]
    ends = (spline.use_endpoint_u and not spline.use_cyclic_u) or spline.use_bezier_u
    return spline.order_u == _CUBIC and min(weights) == max(weights) and not ends


def _lines(thing: Any, radii: list[Any]) -> list[Spline]:
    """Return the splines of a curve object as the lines that Blender makes of them; none if it makes faces."""
    mesh = thing.to_mesh()
    found: list[Spline] = []
    if mesh is not None and len(mesh.vertices) and not len(mesh.polygons):
        points, edges = read(mesh.vertices, "co", 3), read(mesh.edges, "vertices", 2, np.int32)
        pairs = {(min(a, b), max(a, b)) for a, b in edges.tolist()}
        firsts = [k for k in range(len(points)) if (k - 1, k) not in pairs]
        for k, (first, end) in enumerate(zip(firsts, [*firsts[1:], len(points)], strict=True)):
            closed = (first, end - 1) in pairs and end - first > 2
            own = radii[k] if len(radii) == len(firsts) else [1.0]
            own = [*own, own[0]] if closed else own
            steps = np.linspace(0, len(own) - 1, end - first, endpoint=not closed)
            kind = ("linear", "", "periodic" if closed else "nonperiodic")
            found.append((kind, points[first:end], np.interp(steps, np.arange(len(own)), own)))
    thing.to_mesh_clear()
    return found
