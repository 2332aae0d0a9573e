"""Value clips: what OpenUSD hangs on is left out before a stage is composed; what it ignores is told afterwards."""

from __future__ import annotations

import os
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from math import inf, isfinite, isnan
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ...scene import Array
from ..common.openusd import Ar, Sdf, Tf, Usd
from ..common.reading import Reading, file_of, prims_under, quiet
from ..common.warnings import Warnings

_MOST_CLIPS = 1_000_000  # of a template
_MOST_STRIDES = (
    1e12  # from 0 to a template's times: OpenUSD adds strides until the end, and must not lose one to rounding
)
_PROMOTED = 10_000  # OpenUSD counts a template's times in these parts of a time code
_TIMES = ("templateStartTime", "templateEndTime", "templateStride")
_LISTED = ("assetPaths", "active", "primPath")  # what a set needs that lists its files
_NUMBERED = ("templateAssetPath", *_TIMES, "primPath")
# OpenUSD ignores values of other types, except that Python does not tell float from double, nor token from string.
_TYPES = {
    "assetPaths": "asset[]", "manifestAssetPath": "asset", "primPath": "string", "active": "double2[]",
    "times": "double2[]", "templateAssetPath": "string", **dict.fromkeys(_TIMES, "double"),
    "templateActiveOffset": "double", "interpolateMissingClipValues": "bool",
}  # fmt: skip
_PAIRS = ("active", "times")
# What makes a layer the one by which OpenUSD finds the files of a set, its manifest too, and shifts its times.
_ANCHORS = {"assetPaths", "templateAssetPath"}
_Clips: TypeAlias = Mapping[str, Any]  # a set
_INTERPOLATED = re.compile(r"(VtArray<)?(float|double|SdfTimeCode|Gf\w+[dfh])>?")  # values in C++; others are held


class _ClipSet(NamedTuple):
    """A clip set as OpenUSD merges it over layers, and the clip that it uses from each time on."""

    title: str  # the prim and the set, as the beginning of a sentence
    problem: str = ""  # why none of its values are used, as a clause
    starts: Array = np.zeros(0)  # (N,) time codes, in order
    names: Callable[[int], str] = str  # of the file that is used from one of these on
    files: Mapping[str, str] = {}  # the path of each name, "" if there is no such file
    attributes: Sequence[Usd.Attribute] = ()  # at and below the prim, whose values are from clips, if files are missing


def leave_out_clips(
    listed: Iterable[tuple[Sdf.Layer, list[Sdf.Path]]], problem_of: Callable[[str], str], warnings: Warnings
) -> Iterator[str]:
    """Remove clip sets on which OpenUSD would hang or crash from layers, in memory only; yield these layers' names.

    Parameters
    ----------
    listed
        All layers of a stage, each with the paths of its prims, whose metadata clip sets are.
    problem_of
        Returns why a path cannot be read as a layer; "" if it may be one.
    warnings
        Each set that is left out gives one.

    Raises
    ------
    SceneError
        There are some, and warnings are errors.
    """
    specs = [(layer, spec) for layer, prims in listed for spec in map(layer.GetObjectAtPath, prims)]
    specs = [(layer, spec) for layer, spec in specs if spec.HasInfo("clips")]
    parts: dict[str, list[_Clips]] = defaultdict(list)
    anchors: dict[str, dict[Sdf.Layer, None]] = defaultdict(dict)
    for layer, spec in specs:
        for name, clips in spec.GetInfo("clips").items():
            parts[name].append(_typed(clips))
            if not _ANCHORS.isdisjoint(parts[name][-1]):
                anchors[name][layer] = None
    widest = {name: _widest(each) for name, each in parts.items()}
    left_out = []
    for layer, spec in specs:
        sets, problems = spec.GetInfo("clips"), {}
        for name, clips in sets.items():
            typed = _typed(clips)
            files = _files(layer, typed, widest[name], anchors[name])
            if problem := _danger(typed, widest[name], files, problem_of):
                problems[name] = problem
        if problems:
            spec.SetInfo("clips", {name: clips for name, clips in sets.items() if name not in problems})
            yield layer.identifier
        file = layer.realPath or layer.identifier
        left_out += [(f"{spec.path} has the value clips '{name}', {text}", file) for name, text in problems.items()]
    for text, file in left_out:  # after all are removed: other stages of these layers may be open, also after an error
        warnings.lack(text, file, "they are left out")


def _widest(parts: Iterable[_Clips]) -> dict[str, float]:
    """Return the first start, the last end and the least stride of the parts of a set that has a template.

    OpenUSD merges sets of a name over layers, so that one layer's end may meet another one's start. No merged template
    has more clips than these together.
    """
    widest = {}
    for key in _TIMES:
        values = [clips[key] for clips in parts if not isnan(clips.get(key, np.nan))]  # OpenUSD ends at once at NaN
        if values:
            widest[key] = max(values) if key == "templateEndTime" else min(values)
    return widest


def _typed(clips: object) -> _Clips:
    """Return what OpenUSD may use of a clip set: nothing if it is no dictionary, and no values of other types."""
    pairs = clips.items() if isinstance(clips, Mapping) else ()
    return {name: value for name, value in pairs if _type_of(value) == _TYPES.get(name)}


def _type_of(value: object) -> str:
    return str(Sdf.GetValueTypeNameForValue(value) or "dictionary")


def _danger(clips: _Clips, widest: Mapping[str, float], files: Iterable[str], problem_of: Callable[[str], str]) -> str:
    """Return why a clip set of a layer, which may open `files`, must not be composed, as a clause, or ""."""
    for key in _PAIRS:
        if wrong := [number for pair in clips.get(key, ()) for number in pair if not isfinite(number)]:
            return f"whose {key} has {wrong[0]:g}: expected finite numbers"
    own = {key: clips[key] for key in _TIMES if key in clips}
    times = {**widest, **own}
    if own and len(times) == len(_TIMES):
        start, end, stride = (times[key] for key in _TIMES)
        # OpenUSD only ignores an end before the start, and another layer may have another one.
        if not end < start and (problem := _endless(start, end, stride)):
            return problem
    for name in files:
        path = str(Ar.GetResolver().Resolve(name))
        if path and (problem := problem_of(path)):
            return f"one of them {os.path.basename(name)}: expected a file, {problem}"
    return ""


def _endless(start: float, end: float, stride: float) -> str:
    """Return that a template does not have a number of clips that OpenUSD can count, as a clause, or ""."""
    few = stride > 0 and 0 <= (end - start) / stride <= _MOST_CLIPS
    if few and max(abs(start), abs(end)) <= _MOST_STRIDES * stride:
        return ""
    return f"from {start:g} to {end:g} by {stride:g}: expected 1 to {_MOST_CLIPS:,} clips"


def _files(layer: Sdf.Layer, clips: _Clips, widest: Mapping[str, float], anchors: Iterable[Sdf.Layer]) -> Iterator[str]:
    """Yield the names of the files that a clip set may open for some time; these layers name files of the set."""
    manifest = clips.get("manifestAssetPath", Sdf.AssetPath()).path
    named = [(layer, asset.path) for asset in clips.get("assetPaths", ())] + [(each, manifest) for each in anchors]
    for anchor, path in named:
        if path:
            yield str(anchor.ComputeAbsolutePath(path))
    if "#" in os.path.basename(clips.get("templateAssetPath", "")) and len(widest) == len(_TIMES):
        # Not by the resolver, which looks for the template as a file.
        folder, pattern = os.path.split(os.path.join(os.path.dirname(layer.realPath), clips["templateAssetPath"]))
        matching = re.compile(r"(-?\d+)".join(map(re.escape, re.split("#+", pattern)))).fullmatch
        for name in sorted(os.listdir(folder)) if os.path.isdir(folder) else ():
            # The number may lack decimals, or the sign of -0.5.
            if (found := matching(name)) and any(
                widest["templateStartTime"] - 1 <= sign * float(found[1]) <= widest["templateEndTime"] + 1
                for sign in (-1, 1)
            ):
                yield os.path.join(folder, name)


def warn_of_gaps(reading: Reading) -> None:
    """Warn about value clips that OpenUSD goes on without.

    These are sets that it ignores, at all times, and the files for the time that is read, if they are missing. They
    cannot be asked for: OpenUSD warns of a file once for each stage, without a manifest before the first value, and
    says of a value from a file that is missing, too, that it is from clips.
    """
    key = ("clips",)
    if key not in reading.lasting:
        prims = prims_under(reading.stage.GetPseudoRoot())
        with quiet():
            reading.lasting[key] = [each for prim in prims if prim.HasMetadata("clips") for each in _sets(prim)]
    for each in reading.lasting[key]:
        problem, frame = each.problem, None
        if not problem:
            frame = reading.frame
            names = _names_at(each, float(reading.time.GetValue()))
            unread = ((name, _unread(name, each.files.get(name, ""))) for name in names)
            problem = next((f"of which {name} {why}" for name, why in unread if why), "")
        if problem:
            reading.warnings.lack(f"{each.title}, {problem}", file_of(reading.stage), "its values are not used", frame)


def _names_at(clips: _ClipSet, time: float) -> Iterator[str]:
    """Yield the files that OpenUSD needs at a time: of the active clip, then of those up to the samples around it.

    It interpolates between the last sample of a clip and the first of the next one, which is at its start, unless the
    next one is missing. If there is no sample after a time, any clip after it may be the one that would have it, and
    the active clip of a template stands still.
    """
    low = high = time
    for attribute in clips.attributes:
        before, after = attribute.GetBracketingTimeSamples(time) or (time, time)
        if after < time:
            high = inf
        elif _INTERPOLATED.fullmatch(attribute.GetTypeName().cppTypeName):
            low, high = min(low, before), max(high, after)
    first, active, last = (max(int(n), 1) - 1 for n in np.searchsorted(clips.starts, (low, time, high), side="right"))
    yield from map(clips.names, (*range(active, last + 1), *range(active - 1, first - 1, -1)))


def _sets(prim: Usd.Prim) -> Iterator[_ClipSet]:
    """Yield the clip sets of a prim."""
    clips = Usd.ClipsAPI(prim)
    for name, values in clips.GetClips().items():
        if not isinstance(values, Mapping):  # OpenUSD ignores it
            continue
        title = f"{prim.GetPath()} has the value clips '{name}'"
        try:
            assets = clips.ComputeClipAssetPaths(name)
        except Tf.ErrorException:
            if prim.HasMetadata("clipSets"):  # which does not name it
                continue
            assets = []
        layer, offset = _anchor(prim, name)
        if problem := next(_problems(values, layer, assets), ""):
            yield _ClipSet(title, problem)
            continue
        names: Callable[[int], str]
        if "assetPaths" in values:
            starts, indices = np.array(sorted(map(tuple, values["active"]))).T
            names = [assets[int(index)].authoredPath for index in indices].__getitem__
            files = {asset.authoredPath: asset.resolvedPath for asset in assets}
            whole = all(files.values())
        else:
            times = [values[key] for key in _TIMES]
            numbers, starts = _numbers(*times), _numbers(*times, later=values.get("templateActiveOffset", 0.0))
            names = partial(_numbered, values["templateAssetPath"], numbers)
            files = {os.path.basename(asset.resolvedPath): asset.resolvedPath for asset in assets}
            whole = len(files) == len(numbers)
        attributes = [] if whole else [each for below in prims_under(prim) for each in below.GetAttributes()]
        attributes = [
            each for each in attributes if each.GetResolveInfo().GetSource() == Usd.ResolveInfoSourceValueClips
        ]
        yield _ClipSet(title, "", offset.offset + offset.scale * starts, names, files, attributes)


def _problems(clips: _Clips, anchor: Sdf.Layer, assets: Iterable[Sdf.AssetPath]) -> Iterator[str]:
    """Yield why OpenUSD ignores a clip set, merged over layers, or a value of it; as clauses."""
    listed = "assetPaths" in clips
    needed = _LISTED if listed else _NUMBERED
    others = _PAIRS if listed else ("templateActiveOffset",)
    for name in (*needed, *others, "manifestAssetPath", "interpolateMissingClipValues"):
        if name in clips and (kind := _type_of(clips[name])) != _TYPES[name]:
            yield f"whose {name} is of the type {kind}: expected {_TYPES[name]}"
        if name in needed and (name not in clips or not (_TYPES[name] == "double" or len(clips[name]))):
            yield f"without {name}: expected {', '.join(needed)}"
    yield from _unlisted(clips) if listed else _unnumbered(clips)
    yield from _unnamed(clips, anchor, assets)


def _unlisted(clips: _Clips) -> Iterator[str]:
    """Yield what is wrong with a set that lists its files."""
    if not all(asset.path for asset in clips["assetPaths"]):
        yield "one of whose assetPaths is empty: expected the name of a file"
    count = len(clips["assetPaths"])
    for _, index in clips["active"]:
        if not 0 <= index < count:
            yield f"whose active has the index {index:g}: expected one of {count:,} assetPaths, counted from 0"
    for start, count in Counter(start for start, _ in clips["active"]).items():
        if count > 1:
            yield f"whose active has two clips from {start:g} on: expected one"
    for time, count in Counter(time for time, _ in clips.get("times", ())).items():
        if count > 2:
            yield f"whose times has {time:g} more than twice: expected a jump of two"


def _unnumbered(clips: _Clips) -> Iterator[str]:
    """Yield what is wrong with a set that numbers its files."""
    groups = [index for index, part in enumerate(_parts(clips["templateAssetPath"])) if not part.strip("#")]
    if len(groups) not in (1, 2) or groups[-1] - groups[0] != len(groups) - 1:
        form = "NAME.###.usd or NAME.###.##.usd"
        yield f"whose templateAssetPath is '{clips['templateAssetPath']}': expected {form}, of any number of #"
    offset, (start, end, stride) = clips.get("templateActiveOffset"), (clips[name] for name in _TIMES)
    if abs(offset or 0.0) > stride > 0:
        yield f"whose templateActiveOffset is {offset:g}: expected no more than the stride, {stride:g}"
    if offset == 0 and start == end:
        yield "whose templateActiveOffset is 0 for a single clip: expected another one, or none"
    if problem := _endless(start, end, stride):
        yield problem


def _unnamed(clips: _Clips, anchor: Sdf.Layer, assets: Iterable[Sdf.AssetPath]) -> Iterator[str]:
    """Yield why OpenUSD finds no values in a set's manifest or, without one, in any of its files."""
    paths = [asset.resolvedPath for asset in assets]
    if manifest := clips.get("manifestAssetPath"):
        name = manifest.authoredPath
        paths = [str(Ar.GetResolver().Resolve(anchor.ComputeAbsolutePath(name)))]
        if problem := _unread(name, *paths):
            yield f"of which {name} {problem}"
    path, opened = clips["primPath"], False
    for layer in filter(None, map(_opened, paths)):
        if Sdf.Path.IsValidPathString(path) and layer.GetPrimAtPath(path):
            return
        opened = True
    if opened:
        yield f"whose primPath is '{path}': expected a prim in the clips"


def _unread(name: str, path: str) -> str:
    """Return why OpenUSD does not read a file of value clips, as a clause, or ""; if it does, it keeps it open."""
    if Sdf.VariableExpression.IsExpression(name):
        return "is an expression: expected a path, because OpenUSD evaluates none in value clips"
    return "" if _opened(path) else "is not there or cannot be read"


def _opened(path: str) -> Sdf.Layer | None:
    with suppress(Tf.ErrorException):
        return Sdf.Layer.FindOrOpen(path) if path else None
    return None


def _anchor(prim: Usd.Prim, name: str) -> tuple[Sdf.Layer, Sdf.LayerOffset]:
    """Return the layer by which OpenUSD finds a clip set's files, and what turns its starts into times of the stage.

    Both are those of the strongest layer that names the files, also for a manifest and times of other layers; except
    that `active` of a stronger layer of the same layer stack has the times of that one, unless there is a template.
    """
    for node in (arc.GetTargetNode() for arc in Usd.PrimCompositionQuery(prim).GetCompositionArcs()):
        active = None
        for layer, offset in zip(node.layerStack.layers, node.layerStack.layerOffsets, strict=True):
            spec = layer.GetPrimAtPath(node.path)
            clips = _typed(spec.GetInfo("clips").get(name)) if spec and spec.HasInfo("clips") else {}
            to_stage = node.mapToRoot.timeOffset * offset
            if active is None and "active" in clips:
                active = to_stage
            if _ANCHORS & clips.keys():
                return layer, to_stage if active is None or "templateAssetPath" in clips else active
    return prim.GetStage().GetRootLayer(), Sdf.LayerOffset()


def _numbers(start: float, end: float, stride: float, *, later: float = 0.0) -> Array:
    """Return the times that stand in the names of a template's files, or `later` ones, rounded as OpenUSD's are."""
    parts = np.full(int((end - start) / stride) + 2, stride * _PROMOTED)
    parts[0] = start * _PROMOTED
    sums = np.cumsum(parts)
    return np.asarray((sums[sums <= end * _PROMOTED] + later * _PROMOTED) / _PROMOTED)


def _parts(template: str) -> list[str]:
    """Return the parts of a template's name between dots, as OpenUSD joins them again: without empty ones."""
    return [part for part in os.path.basename(Sdf.Layer.SplitIdentifier(template)[0]).split(".") if part]


def _numbered(template: str, numbers: Array, index: int) -> str:
    """Return the name of a template's file, without its folder."""
    parts, number = _parts(template), float(numbers[index])
    whole, *decimals = (index for index, part in enumerate(parts) if not part.strip("#"))
    for at in decimals:
        parts[at] = f"{number:.{len(parts[at])}f}".partition(".")[2]
    parts[whole] = f"{int(number):0{len(parts[whole])}d}"
    return ".".join(parts)
