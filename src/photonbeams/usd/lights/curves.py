"""Read BasisCurves with `PhotonBeamsCurvesAPI` as drawn, curved beams."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ...beams.curves import directions, lengths, segments, tangents
from ...scene import Array, DrawnBeams
from ...scene.vectors import unit
from ..common.openusd import Usd, UsdGeom
from ..common.reading import Reading, has_photonbeams
from ..geometry.polygons import Values
from ..geometry.splines import Spans, expected_points, span_counts, varying_counts
from ..geometry.strands import basis_of, read_points
from .beam_settings import PHYSICAL, bound_look, read_group

# The most time samples at which a curve's curvature is examined. A curve has the same number of pieces at all times, so
# that its motion can be followed from shutter open to shutter close.
_MOST_SHAPES = 9
_NAMED = 3  # how many curves a warning names


def is_drawn(prim: Usd.Prim) -> bool:
    """Return whether a prim is curves that are beams."""
    return bool(prim.IsA(UsdGeom.BasisCurves)) and has_photonbeams(prim, "PhotonBeamsCurvesAPI", "power")


def read_curves(reading: Reading, prim: Usd.Prim, to_world: Array, name: str) -> DrawnBeams | None:
    """Return curves as beams in world space, in as many pieces as their curvature needs; None if none is visible.

    Curves that cannot be rendered are skipped with a warning that names them.

    Raises
    ------
    SceneError
        Counts, widths or powers contradict each other, or are negative.
    """
    shape = read_points(reading, prim)
    if shape is None:
        return None
    sample, points, counts = shape
    source = _CurvesPrim(sample, prim, counts, *basis_of(reading, prim))
    radii = source.widths(sample)
    drawable, wide = source.drawable(), _present(radii, counts)
    spans = Spans.of(counts, drawable & wide, source.kind, source.wrap)
    source.warn_of(np.flatnonzero(drawable & ~wide), "without width", "widths")
    power, colour = source.power(), source.colour()
    span, t = spans.nodes(_pieces(source, spans))
    nodes = _Nodes(
        spans.curve[span] if len(span) else span,
        spans.at(points, span, t) @ to_world[:3, :3].T + to_world[:3, 3],
        # Widths are diameters, and scale with the curves.
        np.maximum(spans.values_at(radii, span, t)[:, 0], 0) * 0.5 * _scale(to_world),
        np.maximum(spans.values_at(power, span, t) * spans.values_at(colour, span, t), 0),
    )
    reading.within_reach(prim, nodes.points)
    reading.within_reach(prim, nodes.radii)
    nodes = nodes.without_repetitions(reading, prim, spans.closed)
    if not len(nodes.curve):
        return None
    group = read_group(reading, prim)
    look = reading.attempt(prim, partial(bound_look, reading, prim), None, PHYSICAL)
    beams = _beams(source, nodes, spans.closed, _graded(power) or _graded(colour), to_world)
    if not len(beams["start"]):
        return None
    return DrawnBeams(name=name, group=group, look=look, **beams)  # type: ignore[arg-type]


_GUIDE_POINTS = 33  # points for each span of a cubic guide


def read_guides(reading: Reading, light: Usd.Prim) -> tuple[Array, ...]:
    """Return points along each curve that guides a light's beams, in world space.

    Raises
    ------
    SceneError
        A target is not a BasisCurves prim, or has no curve with a length.
    """
    name, found = "photonbeams:guides", []
    for prim in reading.targets(light, name):
        kind = prim.GetTypeName() or "prim without a type"
        if not prim.IsA(UsdGeom.BasisCurves):
            raise reading.fail(light, name, f"names {prim.GetPath()}, a {kind}: expected BasisCurves")
        curves = _guides(reading, prim)
        if not curves:
            raise reading.fail(light, name, f"names {prim.GetPath()}, which has no curve: expected one with a length")
        found += curves
    return tuple(found)


def _guides(reading: Reading, prim: Usd.Prim) -> list[Array]:
    points = reading.array(prim, "points", 3)
    counts = reading.integers(prim, "curveVertexCounts")
    if points is None or np.any(counts < 0) or counts.sum() != len(points):
        return []
    source = _CurvesPrim(reading, prim, counts, *basis_of(reading, prim))
    spans = Spans.of(counts, source.drawable(), source.kind, source.wrap)
    span, t = spans.nodes(np.full(len(spans.curve), 1 if source.kind == "linear" else _GUIDE_POINTS))
    to_world = reading.to_world(prim)
    placed = spans.at(points, span, t) @ to_world[:3, :3].T + to_world[:3, 3]
    reading.within_reach(prim, placed)
    curves = [placed[spans.curve[span] == curve] for curve in np.unique(spans.curve)]
    return [curve for curve in curves if np.any(curve != curve[0])]


def _scale(to_world: Array) -> float:
    """Return how much a transform scales lengths, as the mean over the three axes."""
    return float(np.linalg.norm(to_world[:3, :3], axis=0).mean())


def _graded(values: Values) -> bool:
    """Return whether values change along a curve."""
    return values.interpolation in ("varying", "vertex")


def _present(values: Values, counts: Array) -> Array:
    """Return (curves,) whether a curve has a value that is not zero; varying values are assumed to."""
    found = values.values[:, 0] > 0
    if values.interpolation == "vertex":
        sums = np.concatenate([[0], np.cumsum(found)])
        ends = np.cumsum(counts)
        return sums[ends] > sums[ends - counts]
    return found if values.interpolation == "uniform" else np.full(len(counts), bool(found.any()))


@dataclass(frozen=True)
class _CurvesPrim:
    """Curves on a stage: their prim, the number of points of each, their basis (or "linear") and wrap."""

    reading: Reading
    prim: Usd.Prim
    counts: Array
    kind: str
    wrap: str

    def drawable(self) -> Array:
        """Return (curves,) whether each has a number of points that its basis allows; warn about the others."""
        found: Array = span_counts(self.counts, self.kind, self.wrap) > 0
        expected = expected_points(self.kind, self.wrap)
        self.warn_of(np.flatnonzero(~found), f"whose number of points is not {expected}", "curveVertexCounts")
        return found

    def warn_of(self, curves: Array, text: str, name: str) -> None:
        """Warn about curves that are skipped, by their numbers."""
        if len(curves):
            named = ", ".join(str(curve) for curve in curves[:_NAMED].tolist())
            more = f" and {len(curves) - _NAMED:,} more" if len(curves) > _NAMED else ""
            plural = "s" if len(curves) > 1 else ""
            self.reading.warn(self.prim, f"has curve{plural} {named}{more} {text}: skipped", name)

    def widths(self, reading: Reading) -> Values:
        """Return the widths, which are diameters, at the time of a reading."""
        prim = self.prim
        primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar("widths")
        name = "primvars:widths" if primvar and primvar.HasValue() else "widths"
        flat = primvar.ComputeFlattened(reading.time) if name != "widths" else None
        widths = reading.array(prim, name, 1, flat)
        if widths is None:
            raise reading.fail(prim, "widths", "is empty: expected the diameters of the beams")
        if np.any(widths < 0):
            raise reading.fail(prim, name, f"holds {widths.min():g}: expected diameters of 0 or more")
        declared = primvar.GetInterpolation() if name != "widths" else UsdGeom.Curves(prim).GetWidthsInterpolation()
        return self._values(widths, str(declared), name)

    def power(self) -> Values:
        """Return the power: one for all curves, one for each, or values along them."""
        name = "photonbeams:power"
        power = self.reading.array(self.prim, name, 3)
        if power is None:
            return Values(np.ones((1, 3)), "constant")
        if np.any(power < 0):
            index = int(np.argmax(np.any(power < 0, axis=1)))
            text = f"is {tuple(power[index].tolist())}: expected no negative power"
            raise self.reading.fail(self.prim, f"{name}[{index}]", text)
        return self._values(power, "", name)

    def colour(self) -> Values:
        """Return the display colour if it changes along the curves, else white: it is then for viewports only."""
        primvar = UsdGeom.PrimvarsAPI(self.prim).GetPrimvar("displayColor")
        name, colour = "primvars:displayColor", None
        if primvar and primvar.GetInterpolation() in ("varying", "vertex"):
            colour = self.reading.array(self.prim, name, 3, primvar.ComputeFlattened(self.reading.time))
        if colour is None:
            return Values(np.ones((1, 3)), "constant")
        return self._values(np.maximum(colour, 0), str(primvar.GetInterpolation()), name)

    def _values(self, values: Array, declared: str, name: str) -> Values:
        """Return values with the interpolation that fits their number.

        The number decides where it can, because exporters leave the interpolation at its fallback, "vertex".
        """
        varying = varying_counts(self.counts, self.kind, self.wrap).sum()
        sizes = {"constant": 1, "vertex": self.counts.sum(), "varying": varying, "uniform": len(self.counts)}
        fitting = [kind for kind, size in sizes.items() if size == len(values)]
        if not fitting:
            kind = f" of interpolation '{declared}'" if declared else ""
            text = f"has {len(values)} values{kind}: expected 1, {len(self.counts)} or {self.counts.sum()}"
            raise self.reading.fail(self.prim, name, text)
        return Values(values, declared if declared in fitting and fitting[0] != "constant" else fitting[0])

    def each(self, name: str, columns: int) -> Array | None:
        """Return an attribute of each curve, (curves, columns), or None if it is not authored."""
        values = self.reading.array(self.prim, name, columns)
        if values is None:
            return None
        if len(values) not in (1, len(self.counts)):
            text = f"has {len(values)} values: expected 1 or {len(self.counts)}, one for each curve"
            raise self.reading.fail(self.prim, name, text)
        return np.broadcast_to(values, (len(self.counts), columns))


def _pieces(source: _CurvesPrim, spans: Spans) -> Array:
    """Return how many pieces each span needs, the most over all times."""
    if source.kind == "linear" or not len(spans.curve):
        return np.ones(len(spans.curve), dtype=np.int64)
    pieces = np.ones(len(spans.curve), dtype=np.int64)
    for reading in _shapes(source):
        points = reading.array(source.prim, "points", 3)
        if points is not None and len(points) == source.counts.sum():
            radii = 0.5 * spans.values_at(source.widths(reading), *spans.samples()).reshape(len(spans.curve), -1)
            pieces = np.maximum(pieces, spans.pieces(points, radii))
    return pieces


def _shapes(source: _CurvesPrim) -> Iterator[Reading]:
    """Yield readings at the times at which the curves' shape is examined."""
    times = source.prim.GetAttribute("points").GetTimeSamples()
    if len(times) < 2:
        yield source.reading
        return
    for index in np.unique(np.linspace(0, len(times) - 1, _MOST_SHAPES).round().astype(int)):
        yield Reading(source.reading.stage, times[index], source.reading.warnings)


@dataclass(frozen=True)
class _Nodes:
    """The points between pieces, one curve after another."""

    curve: Array
    points: Array
    radii: Array
    power: Array

    def without_repetitions(self, reading: Reading, prim: Usd.Prim, closed: bool) -> _Nodes:
        """Return the nodes without repetitions of the one before, and without curves that are then only a point."""
        same = np.zeros(len(self.curve), dtype=bool)
        same[1:] = (self.curve[1:] == self.curve[:-1]) & np.all(self.points[1:] == self.points[:-1], axis=1)
        if closed and len(same):
            first = np.flatnonzero(np.diff(self.curve, prepend=-1))
            last = np.append(first[1:], len(same)) - 1
            same[last] |= (last > first) & np.all(self.points[last] == self.points[first], axis=1)
        if same.any():
            reading.warn(prim, f"has {np.count_nonzero(same)} segments without length: they are skipped")
        sizes = np.bincount(self.curve[~same], minlength=int(self.curve.max(initial=-1)) + 1)
        kept = ~same & (sizes[self.curve] >= 2)
        return _Nodes(*(each[kept] for each in (self.curve, self.points, self.radii, self.power)))


@dataclass(frozen=True)
class _Pieces:
    """The beams between the nodes of curves: the curve of each, the one that follows it, or -1, and their ends."""

    source: _CurvesPrim
    to_world: Array
    curve: Array
    following: Array
    start: Array
    end: Array

    @property
    def begins(self) -> Array:
        """Whether each begins a curve, (N, 1)."""
        begins = np.ones((len(self.curve), 1), dtype=bool)
        begins[self.following[self.following >= 0]] = False
        return begins

    def each(self, name: str, columns: int) -> Array | None:
        """Return an attribute of each curve, (N, columns), or None if it is not authored."""
        values = self.source.each(f"photonbeams:{name}", columns)
        return None if values is None else values[self.curve]

    def lengths(self, name: str) -> Array | None:
        """Return lengths in world space, (N,)."""
        values = self.each(name, 1)
        return None if values is None else _scale(self.to_world) * values[:, 0]

    def normals(self, name: str) -> Array | None:
        """Return normals in world space, (N, 3)."""
        values = self.each(name, 3)
        return None if values is None else unit(values @ np.linalg.inv(self.to_world[:3, :3]))

    def tangents(self) -> dict[str, Array]:
        """Return the directions of the light at both ends of each; at those of a curve, the authored ones."""
        fields = {}
        smooth = tangents(directions(self.start, self.end), self.following)
        ends = (self.begins, self.following[:, None] < 0)
        for name, at_end, own in zip(("start", "end"), ends, smooth, strict=True):
            authored = self.each(f"{name}Tangents", 3)
            turned = np.zeros((1, 3)) if authored is None else unit(authored @ self.to_world[:3, :3].T)
            fields[f"{name}_tangent"] = np.where(at_end & np.any(turned, axis=1, keepdims=True), turned, own)
        return fields

    def walls(self) -> dict[str, Array]:
        """Return the surfaces at the start of curves and beside them, which cut their beams, if they are authored."""
        start, sides, normals = self.normals("startNormals"), self.each("sides", 3), self.normals("sideNormals")
        fields = {} if start is None else {"start_normal": np.where(self.begins, start, 0)}
        if (sides is None) != (normals is None):
            text = f"is {'not ' if sides is None else ''}authored: expected photonbeams:sides and"
            raise self.source.reading.fail(self.source.prim, "photonbeams:sides", f"{text} photonbeams:sideNormals")
        if sides is not None and normals is not None:
            fields["side"] = sides @ self.to_world[:3, :3].T + self.to_world[:3, 3]
            fields["side_normal"] = normals
        return fields

    def end_normals(self, inner: Array) -> Array | None:
        """Return the normals of the end planes: at a curve's end, that of the surface that stops it."""
        turned = self.normals("endNormals")
        if turned is None:
            return None
        straight = -directions(self.start, self.end)
        surface = np.where(np.any(turned, axis=1, keepdims=True), turned, straight)
        return np.where(self.following[:, None] >= 0, -inner, surface)


def _beams(source: _CurvesPrim, nodes: _Nodes, closed: bool, graded: bool, to_world: Array) -> dict[str, Any]:
    """Return the fields of the beams between nodes."""
    sizes = np.bincount(nodes.curve)
    first, last, following = segments(sizes[sizes > 0], closed)
    curve, start, end = nodes.curve[first], nodes.points[first], nodes.points[last]
    parts = _Pieces(source, to_world, curve, following, start, end)
    radius_start, radius_end = nodes.radii[first], nodes.radii[last]
    fields: dict[str, Any] = {
        "start": start, "end": end, "radius_start": radius_start, "radius_end": radius_end,
        "power": nodes.power[first], "power_end": nodes.power[last] if graded else None,
        # A curve is one beam, so all of its pieces give looks the same values.
        "id": curve.astype(np.float64),
    }  # fmt: skip
    chained = bool(np.any(following >= 0))
    authored = {name: parts.lengths(name) for name in ("offset", "total", "entry")}
    if chained or any(value is not None for value in authored.values()):
        offset, total = lengths(start, end, np.unique(curve, return_inverse=True)[1])
        begin = 0.0 if authored["offset"] is None else authored["offset"]
        fields |= authored | {"offset": begin + offset}
        if authored["total"] is None:
            fields["total"] = begin + total
    if chained:
        fields |= parts.tangents()
    for name in ("random", "id", "generation"):
        values = parts.each(name, 1)
        if values is not None:
            fields[name] = values[:, 0]
    fields["end_normal"] = parts.end_normals(fields.get("end_tangent", directions(start, end)))
    fields |= parts.walls()
    wide = (radius_start > 0) | (radius_end > 0)
    if not wide.all():
        text = f"holds 0 at both ends of {np.count_nonzero(~wide)} segments: they are skipped"
        source.reading.warn(source.prim, text, "widths")
    return {name: value if value is None else value[wide] for name, value in fields.items()}
