"""Write beams as BasisCurves, for usdview, Blender, Houdini and photonbeams itself."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ...beams.curves import directions
from ...runtime.files import PathLike
from ...scene import Array, DrawnBeams, SceneError
from ...scene.places import origin_within
from ..common.openusd import Gf, Sdf, Usd, UsdGeom, Vt
from ..layers.writing import write_layer

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
        _define(stage, beams, prim_path)
    else:
        UsdGeom.Scope.Define(stage, prim_path)
        copies = _copied(stage, like, looks or {}, prim_path, time)
        names = _names([each.name for each in beams], taken={"Looks"})
        for each, name in zip(beams, names, strict=True):
            prim = _define(stage, each, f"{prim_path}/{name}")
            if each.name in copies:
                prim.CreateRelationship("photonbeams:look", False).SetTargets([copies[each.name]])
    stage.SetDefaultPrim(stage.GetPrimAtPath(Sdf.Path(prim_path).GetPrefixes()[0]))
    if like is not None:
        UsdGeom.SetStageUpAxis(stage, UsdGeom.GetStageUpAxis(like))
        UsdGeom.SetStageMetersPerUnit(stage, UsdGeom.GetStageMetersPerUnit(like))
        stage.SetTimeCodesPerSecond(like.GetTimeCodesPerSecond())
    check_path(Path(path))
    write_layer(layer, path)


def _define(stage: Usd.Stage, beams: DrawnBeams, path: str) -> Usd.Prim:
    """Define the curves of a set of beams."""
    curves = UsdGeom.BasisCurves.Define(stage, path)
    fields = _lit({name: np.asarray(value) for name, value in beams.arrays().items()})
    number, first, last = chains(fields)
    counts = last - first + 2
    ends = np.cumsum(counts) - 1  # the last point of each curve
    points, widths = (_along(fields[a], fields[b], counts, ends, last) for a, b in
                      (("start", "end"), ("radius_start", "radius_end")))  # fmt: skip
    curves.CreateTypeAttr("linear")
    curves.CreateCurveVertexCountsAttr(Vt.IntArray.FromNumpy(counts.astype(np.int32)))
    origin = origin_within(points)
    if origin.any():  # in double precision, as points are not
        curves.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(*origin.tolist()))
    curves.CreatePointsAttr(_vectors(points - origin))
    curves.CreateWidthsAttr(_numbers(2 * widths))
    curves.SetWidthsInterpolation("vertex")
    if len(points):
        extent = UsdGeom.Curves.ComputeExtent(curves.GetPointsAttr().Get(), curves.GetWidthsAttr().Get())
        curves.CreateExtentAttr(extent)
    power, interpolation = fields["power"][first], "uniform"
    if "power_end" in fields or np.any(fields["power"] != power[number]):
        power = _along(fields["power"], fields.get("power_end", fields["power"]), counts, ends, last)
        interpolation = "vertex"
    brightest = float(power.max(initial=0)) or 1.0
    curves.CreateDisplayColorPrimvar(interpolation).Set(_vectors(power / brightest))
    if interpolation == "vertex":  # on reading, colours along a curve multiply its power
        power = np.full((1, 3), brightest)
    prim = curves.GetPrim()
    prim.AddAppliedSchema("PhotonBeamsCurvesAPI")
    _set(prim, "power", "color3f[]", _vectors(power))
    if "side" in fields:
        fields["side"] = fields["side"] - origin
    for name in ("offset", "total", "entry", "random", "id", "generation"):
        if name in fields:
            _set(prim, name, "float[]", _numbers(fields[name][first]))
    for field, (name, kind) in _VECTORS.items():
        if field in fields:
            _set(prim, name, kind, _vectors(fields[field][last if field == "end_normal" else first]))
    if "start_tangent" in fields:
        axis = directions(fields["start"], fields["end"])
        for name, tangent, at in (("startTangents", "start_tangent", first), ("endTangents", "end_tangent", last)):
            if not np.allclose(fields[tangent][at], axis[at], atol=1e-5):
                _set(prim, name, "vector3f[]", _vectors(fields[tangent][at]))
    if beams.group:
        _set(prim, "lightGroup", "token", beams.group)
    return prim


# The attributes and their types, by the fields of beams.
_VECTORS = {
    "end_normal": ("endNormals", "normal3f[]"), "start_normal": ("startNormals", "normal3f[]"),
    "side": ("sides", "point3f[]"), "side_normal": ("sideNormals", "normal3f[]"),
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


def _set(prim: Usd.Prim, name: str, kind: str, value: object) -> None:
    prim.CreateAttribute(f"photonbeams:{name}", Sdf.ValueTypeNames.Find(kind), False).Set(value)


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
        prim = stage.DefinePrim(f"{root}/Looks/{name}", "PhotonBeamsLook")
        for attribute in like.GetPrimAtPath(path).GetAuthoredAttributes():
            value = attribute.Get(Usd.TimeCode.EarliestTime() if time is None or time.IsDefault() else time)
            if isinstance(value, Sdf.AssetPath):
                value = Sdf.AssetPath(value.resolvedPath or value.path)
            if value is not None:
                kind, varying = attribute.GetTypeName(), attribute.GetVariability()
                prim.CreateAttribute(attribute.GetName(), kind, attribute.IsCustom(), varying).Set(value)
    return {name: f"{root}/Looks/{copies[path]}" for name, path in looks.items()}


def _vectors(values: Array) -> Vt.Vec3fArray:
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(values, dtype=np.float32).reshape(-1, 3))


def _numbers(values: Array) -> Vt.FloatArray:
    return Vt.FloatArray.FromNumpy(np.ascontiguousarray(values, dtype=np.float32))


def check_path(path: Path) -> None:
    """Raise SceneError for a suffix that no stage has, or a folder that does not exist or is not writable."""
    if path.suffix not in SUFFIXES:
        raise SceneError(f"{path}: expected a name that ends in {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}")
    if not os.access(path.parent, os.W_OK):
        raise SceneError(f"{path} cannot be written: expected a folder that is there and may be written to")
