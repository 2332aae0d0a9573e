"""Beams that someone drew: BasisCurves with `PhotonBeamsCurvesAPI`, read and written."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from ..scene import Array, DrawnBeams, SceneError
from .lights import check_group
from .looks import read_look
from .reading import Reading, has_photonbeams


def is_drawn(prim: Usd.Prim) -> bool:
    """Return whether curves are beams."""
    return has_photonbeams(prim, "PhotonBeamsCurvesAPI", "power")


def read_curves(reading: Reading, prim: Usd.Prim, to_world: Array, name: str) -> DrawnBeams | None:
    """Return each segment of linear curves as a beam, in world space; None where there are no points.

    Raises
    ------
    SceneError
        Counts, widths or powers that contradict each other, or are negative.
    """
    points = reading.array(prim, "points", 3)
    counts = np.asarray(reading.value(prim, "curveVertexCounts", ()), dtype=np.int64)
    if points is None or not len(counts):
        reading.warn(prim, "has no points: it is skipped")
        return None
    if counts.sum() != len(points) or np.any(counts < 2):
        text = f"sums to {counts.sum()}: expected the number of points, {len(points)}, and at least 2 for each curve"
        raise reading.fail(prim, "curveVertexCounts", text)
    if reading.value(prim, "type", "cubic") != "linear":
        reading.warn(prim, "is not 'linear': the polygon of control points is used", "type")
    first, last, curve = _segments(counts, periodic=reading.value(prim, "wrap") == "periodic")
    start, end = (points[index] @ to_world[:3, :3].T + to_world[:3, 3] for index in (first, last))
    reading.within_reach(prim, start)
    reading.within_reach(prim, end)
    kept = np.any(start != end, axis=1)
    if not kept.all():
        reading.warn(prim, f"has {np.count_nonzero(~kept)} segments without length: they are skipped")
    # Widths are diameters, and scale with the curves.
    radii = _widths(reading, prim, counts) * (0.5 * np.linalg.norm(to_world[:3, :3], axis=0).mean())
    reading.within_reach(prim, radii)
    if np.any(kept & (radii[first] == 0) & (radii[last] == 0)):
        raise reading.fail(prim, "widths", "is 0 at both ends of a segment: expected the diameters of beams")
    group = str(reading.value(prim, "photonbeams:lightGroup", ""))
    check_group(reading, prim, group)
    looks = reading.targets(prim, "photonbeams:look")
    look = read_look(reading, prim, looks[0]) if looks else None
    return DrawnBeams(
        name=name,
        start=start[kept],
        end=end[kept],
        radius_start=radii[first][kept],
        radius_end=radii[last][kept],
        power=_power(reading, prim, len(counts))[curve][kept],
        group=group,
        look=look,  # type: ignore[arg-type]
    )


def _segments(counts: Array, periodic: bool) -> tuple[Array, Array, Array]:
    """Return the first point, the last point and the curve of each segment."""
    starts = np.cumsum(counts) - counts
    curve = np.repeat(np.arange(len(counts)), counts)
    first = np.arange(counts.sum())
    last = first + 1
    closing = np.isin(first, starts + counts - 1)
    last[closing] = starts
    if not periodic:
        first, last, curve = first[~closing], last[~closing], curve[~closing]
    return first, last, curve


def _widths(reading: Reading, prim: Usd.Prim, counts: Array) -> Array:
    """Return the width at each point, whatever the interpolation."""
    curves = UsdGeom.BasisCurves(prim)
    primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar("widths")
    name = "primvars:widths" if primvar and primvar.HasValue() else "widths"
    flat = primvar.ComputeFlattened(reading.time) if name != "widths" else None
    widths = reading.array(prim, name, 1, flat)
    if widths is None:
        raise reading.fail(prim, "widths", "is empty: beams expect the diameters of the curves")
    if np.any(widths < 0):
        raise reading.fail(prim, name, f"holds {widths.min():g}: expected diameters of at least 0")
    kind = str(primvar.GetInterpolation() if name != "widths" else curves.GetWidthsInterpolation())
    total = int(counts.sum())
    # The count decides where it can: exporters leave the interpolation at its fallback, "vertex".
    if len(widths) == total:
        return widths[:, 0]
    if len(widths) == 1:
        return np.full(total, widths[0, 0])
    if len(widths) == len(counts):
        return np.repeat(widths[:, 0], counts)
    text = f"has {len(widths)} values of interpolation '{kind}': expected 1, {len(counts)} or {total}"
    raise reading.fail(prim, name, text)


def _power(reading: Reading, prim: Usd.Prim, curves: int) -> Array:
    name = "photonbeams:power"
    power = reading.array(prim, name, 3)
    if power is None:
        return np.ones((curves, 3))
    if len(power) not in (1, curves):
        raise reading.fail(prim, name, f"has {len(power)} values: expected 1 or {curves}, one for each curve")
    if np.any(power < 0):
        index = int(np.argmax(np.any(power < 0, axis=1)))
        raise reading.fail(prim, f"{name}[{index}]", f"is {tuple(power[index].tolist())}: expected no negative power")
    return np.broadcast_to(power, (curves, 3))


def write_beams(beams: DrawnBeams, path: str | os.PathLike[str], prim_path: str = "/Beams") -> None:
    """Save beams as linear BasisCurves of two points each, in a .usda, .usdc or .usd file.

    The file is complete or not there: it is written beside its place and then renamed.

    Raises
    ------
    SceneError
        A file that cannot be written.
    """
    layer = Sdf.Layer.CreateAnonymous(".usda")
    stage = Usd.Stage.Open(layer)
    curves = UsdGeom.BasisCurves.Define(stage, prim_path)
    stage.SetDefaultPrim(stage.GetPrimAtPath(Sdf.Path(prim_path).GetPrefixes()[0]))
    points = np.stack([beams.start, beams.end], axis=1).reshape(-1, 3)
    widths = 2 * np.stack([beams.radius_start, beams.radius_end], axis=1).reshape(-1)
    curves.CreateTypeAttr("linear")
    curves.CreateCurveVertexCountsAttr(Vt.IntArray(len(beams.start), 2))
    curves.CreatePointsAttr(_vectors(points))
    curves.CreateWidthsAttr(Vt.FloatArray.FromNumpy(np.ascontiguousarray(widths, dtype=np.float32)))
    curves.SetWidthsInterpolation("vertex")
    if len(points):
        curves.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(curves.GetPointsAttr().Get()))
    prim = curves.GetPrim()
    prim.AddAppliedSchema("PhotonBeamsCurvesAPI")
    prim.CreateAttribute("photonbeams:power", Sdf.ValueTypeNames.Color3fArray, False).Set(_vectors(beams.power))
    if beams.group:
        prim.CreateAttribute("photonbeams:lightGroup", Sdf.ValueTypeNames.Token, False).Set(beams.group)
    _export(layer, Path(path))


def _vectors(values: Array) -> Vt.Vec3fArray:
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(values, dtype=np.float32).reshape(-1, 3))


def _export(layer: Sdf.Layer, path: Path) -> None:
    if path.suffix not in (".usd", ".usda", ".usdc"):
        raise SceneError(f"{path}: expected a name that ends in .usd, .usda or .usdc")
    beside = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        if not os.access(path.parent, os.W_OK):
            raise SceneError(f"{path} cannot be written: expected a folder that is there and may be written to")
        try:
            layer.Export(str(beside))
        except Exception as error:
            raise SceneError(f"{path} cannot be written: {str(error).strip().splitlines()[-1]}") from None
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)
