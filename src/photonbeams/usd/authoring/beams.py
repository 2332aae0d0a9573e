"""Write beams as BasisCurves, for usdview, Blender, Houdini and photonbeams itself."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...beams.curves import directions
from ...runtime.files import PathLike
from ...scene import Array, DrawnBeams, SceneError
from ...scene.places import origin_within
from ..common.openusd import Sdf, Usd, UsdGeom
from ..layers.writing import write_layer
from .prims import copy_prim, write_prims

ROOT = "/Beams"
SUFFIXES = (".usd", ".usda", ".usdc")


def write_beams(
    beams: DrawnBeams | Sequence[DrawnBeams],
    path: PathLike,
    prim_path: str = ROOT,
    like: Usd.Stage | None = None,
    looks: Mapping[str, str] | None = None,
    time: Usd.TimeCode | None = None,
) -> None:
    """Save beams as linear BasisCurves in a .usda, .usdc or .usd file; pieces of a curved beam become one curve.

    Parameters
    ----------
    beams
        One set, which becomes the prim `prim_path`, or several, which become prims below it.
    like
        The stage that they come from: its up axis, units and rate are written, too.
    looks
        Paths of `PhotonBeamsLook` prims on that stage, by the names of sets; they are copied as they are at `time`.

    Raises
    ------
    SceneError
        The file cannot be written: its suffix is another, or its folder does not exist or is not writable.
    OSError
        As for `files.atomic_path`: the file is written whole or not at all.
    """
    layer = Sdf.Layer.CreateAnonymous(".usda")
    stage = Usd.Stage.Open(layer)
    if isinstance(beams, DrawnBeams):
        write_prims(stage, [_described(beams, prim_path)])
    else:
        write_prims(stage, [{"path": prim_path, "type": "Scope"}])
        copies = _copied(stage, like, looks or {}, prim_path, time)
        names = _names([each.name for each in beams], taken={"Looks"})
        for each, name in zip(beams, names, strict=True):
            targets = {"photonbeams:look": [copies[each.name]]} if each.name in copies else {}
            write_prims(stage, [_described(each, f"{prim_path}/{name}") | {"targets": targets}])
    stage.SetDefaultPrim(stage.GetPrimAtPath(Sdf.Path(prim_path).GetPrefixes()[0]))
    if like is not None:
        UsdGeom.SetStageUpAxis(stage, UsdGeom.GetStageUpAxis(like))
        UsdGeom.SetStageMetersPerUnit(stage, UsdGeom.GetStageMetersPerUnit(like))
        stage.SetTimeCodesPerSecond(like.GetTimeCodesPerSecond())
    check_path(Path(path))
    write_layer(layer, path)


def _described(beams: DrawnBeams, path: str) -> dict[str, Any]:
    """Return the description of the curves of a set of beams."""
    fields = _lit({name: np.asarray(value) for name, value in beams.arrays().items()})
    number, first, last = chains(fields)
    counts = last - first + 2
    ends = np.cumsum(counts) - 1  # the last point of each curve
    points, radii = (_along(fields[a], fields[b], counts, ends, last) for a, b in
                     (("start", "end"), ("radius_start", "radius_end")))  # fmt: skip
    power, interpolation = fields["power"][first], "uniform"
    if "power_end" in fields or np.any(fields["power"] != power[number]):
        power = _along(fields["power"], fields.get("power_end", fields["power"]), counts, ends, last)
        interpolation = "vertex"
    brightest = float(power.max(initial=0)) or 1.0
    origin = origin_within(points)
    values: dict[str, Any] = {
        "type": ["token", "linear"],
        "curveVertexCounts": ["int[]", counts],
        "points": ["point3f[]", points - origin],
        "widths": ["float[]", 2 * radii, "vertex"],
        "primvars:displayColor": ["color3f[]", power / brightest, interpolation],
        # On reading, colours along a curve multiply its power.
        "photonbeams:power": ["color3f[]", np.full((1, 3), brightest) if interpolation == "vertex" else power],
    }
    if origin.any():  # in double precision, as points are not
        values["xformOp:translate"] = ["double3", origin.tolist()]
        values["xformOpOrder"] = ["token[]", ["xformOp:translate"]]
    if len(points):
        corners = np.stack([points.min(axis=0) - radii.max(), points.max(axis=0) + radii.max()])
        values["extent"] = ["float3[]", corners - origin]
    if beams.group:
        values["photonbeams:lightGroup"] = ["token", beams.group]
    if "side" in fields:
        fields["side"] = fields["side"] - origin
    if "start_tangent" in fields:
        axis = directions(fields["start"], fields["end"])
        for name, at in (("start_tangent", first), ("end_tangent", last)):
            if np.allclose(fields[name][at], axis[at], atol=1e-5):
                del fields[name]
    for name, (attribute, kind) in _ATTRIBUTES.items():
        if name in fields:
            values[f"photonbeams:{attribute}"] = [kind, fields[name][last if name.startswith("end") else first]]
    return {"path": path, "type": "BasisCurves", "apis": ["PhotonBeamsCurvesAPI"], "values": values}


# The attributes of curves and their types, by fields of beams.
_ATTRIBUTES = {
    **{name: (name, "float[]") for name in ("offset", "total", "entry", "random", "id", "generation")},
    "end_normal": ("endNormals", "normal3f[]"), "start_normal": ("startNormals", "normal3f[]"),
    "side": ("sides", "point3f[]"), "side_normal": ("sideNormals", "normal3f[]"),
    "start_tangent": ("startTangents", "vector3f[]"), "end_tangent": ("endTangents", "vector3f[]"),
}  # fmt: skip


def _lit(fields: dict[str, Array]) -> dict[str, Array]:
    """Return the beams that carry light; pieces without length, beside a guide, carry none."""
    lit = np.any((fields["power"] > 0) | (fields.get("power_end", fields["power"]) > 0), axis=1)
    return {name: value[lit] for name, value in fields.items()}


def chains(fields: Mapping[str, Array]) -> tuple[Array, Array, Array]:
    """Return the curve that each beam belongs to, and the first and the last beam of each curve.

    Consecutive beams belong to one curve if each begins as the one before it ends: at the same place, with the same
    radius, and cut by the same plane.
    """
    count = len(fields["start"])
    joined: Array = np.zeros(max(count - 1, 0), dtype=bool)
    if "start_tangent" in fields and count > 1:
        pairs = (("start", "end"), ("radius_start", "radius_end"), ("start_tangent", "end_tangent"))
        same = [fields[a][1:].reshape(count - 1, -1) == fields[b][:-1].reshape(count - 1, -1) for a, b in pairs]
        joined = np.all(np.concatenate(same, axis=1), axis=1)
        if "offset" in fields:  # the end of a closed curve does not continue at its beginning
            joined &= fields["offset"][1:] > fields["offset"][:-1]
    begins = np.concatenate([[True], ~joined])[:count]
    first = np.flatnonzero(begins)
    return np.cumsum(begins) - 1, first, np.append(first[1:], count)[: len(first)] - 1


def _along(start: Array, end: Array, counts: Array, ends: Array, last: Array) -> Array:
    """Return the values at all points of curves, from the values at the starts and ends of their beams."""
    result = np.empty((int(counts.sum()), *start.shape[1:]))
    inner = np.ones(len(result), dtype=bool)
    inner[ends] = False
    result[inner], result[ends] = start, end[last]
    return result


def _names(paths: Sequence[str], taken: set[str]) -> list[str]:
    """Return a unique prim name for each path."""
    names: list[str] = []
    for path in paths:
        base = re.sub(r"^(?=\d)|\W", "_", path.strip("/"), flags=re.ASCII) or "Beams"
        numbered = (base, *(f"{base}_{number}" for number in range(2, 2 + len(taken))))
        names.append(next(each for each in numbered if each not in taken))
        taken.add(names[-1])
    return names


def _copied(
    stage: Usd.Stage, like: Usd.Stage | None, looks: Mapping[str, str], root: str, time: Usd.TimeCode | None
) -> dict[str, str]:
    """Copy look prims, and return the paths of the copies by the names of sets."""
    if like is None:
        return {}
    paths = list(dict.fromkeys(looks.values()))
    copies = dict(zip(paths, _names(paths, set()), strict=True))
    for path, name in copies.items():
        copy_prim(like.GetPrimAtPath(path), stage, f"{root}/Looks/{name}", time)
    return {name: f"{root}/Looks/{copies[path]}" for name, path in looks.items()}


def check_path(path: Path) -> None:
    """Raise SceneError for a suffix that no stage has, or a folder that does not exist or is not writable."""
    if path.suffix not in SUFFIXES:
        raise SceneError(f"{path}: expected a name that ends in {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}")
    if not os.access(path.parent, os.W_OK):
        raise SceneError(f"{path} cannot be written: expected a folder that is there and may be written to")
