"""Value clips: checked before a stage is composed, because OpenUSD opens their files; and again at each frame."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from typing import Any

from ..common.openusd import Ar, Sdf, Tf, Usd
from ..common.reading import Reading, file_of, prims_under
from ..common.warnings import Warnings

_MOST_CLIPS = 1_000_000  # of a template
_HASHES = re.compile(r"#+(\.#+)?")
_TIMES = ("templateStartTime", "templateEndTime", "templateStride")
# OpenUSD ignores values of other types, except that Python does not tell float from double, nor token from string.
_TYPES = {
    "assetPaths": "asset[]", "manifestAssetPath": "asset", "primPath": "string", "active": "double2[]",
    "times": "double2[]", "templateAssetPath": "string", **dict.fromkeys(_TIMES, "double"),
    "templateActiveOffset": "double", "interpolateMissingClipValues": "bool",
}  # fmt: skip


def leave_out_clips(
    layer: Sdf.Layer, prims: Iterable[Sdf.Path], problem_of: Callable[[str], str], warnings: Warnings
) -> bool:
    """Remove clip sets that name unreadable files from a layer, in memory only, and return whether there are any.

    Parameters
    ----------
    layer, prims
        A layer, and the paths of its prims, whose metadata clip sets are.
    problem_of
        Returns why a path cannot be read as a layer; "" if it may be one.
    warnings
        Each set that is left out gives one.

    Raises
    ------
    SceneError
        There are some, and warnings are errors.
    """
    changed = False
    for path in prims:
        spec = layer.GetObjectAtPath(path)
        if not spec.HasInfo("clips"):
            continue
        sets = spec.GetInfo("clips")
        problems = {name: _problem(layer, clips, problem_of) for name, clips in sets.items()}
        for name in filter(problems.get, problems):
            text = f"{path} has the value clips '{name}', {problems[name]}"
            warnings.lack(text, layer.realPath or layer.identifier, "they are left out")
        if any(problems.values()):
            spec.SetInfo("clips", {name: clips for name, clips in sets.items() if not problems[name]})
            changed = True
    return changed


def _problem(layer: Sdf.Layer, clips: object, problem_of: Callable[[str], str]) -> str:
    """Return what is wrong with a clip set of a layer, as a clause, or ""."""
    if not isinstance(clips, Mapping):  # OpenUSD ignores it
        return ""
    if problem := _misfit(clips):
        return problem
    for name in _files(layer, clips):
        path = str(Ar.GetResolver().Resolve(name))
        if path and (problem := problem_of(path)):
            return f"one of them {os.path.basename(name)}: expected a file, {problem}"
    return ""


def _misfit(clips: Mapping[str, Any]) -> str:
    """Return which value of a clip set OpenUSD does not take, as a clause, or ""."""
    for name, kind in _TYPES.items():
        if name in clips and (given := str(Sdf.GetValueTypeNameForValue(clips[name]) or "dictionary")) != kind:
            return f"whose {name} is of the type {given}: expected {kind}"
    template, times = clips.get("templateAssetPath"), _times(clips)
    if template is not None and "#" not in os.path.basename(template):
        return f"whose templateAssetPath is '{template}': expected a run of # in the file's name"
    if times:
        start, end, stride = times
        if not (stride > 0 and 0 <= (end - start) / stride <= _MOST_CLIPS):
            return f"from {start:g} to {end:g} by {stride:g}: expected 1 to {_MOST_CLIPS:,} clips"
    count = len(clips.get("assetPaths", ()))
    for _, index in clips.get("active", ()) if "assetPaths" in clips else ():
        if not 0 <= index < count:  # OpenUSD then ignores all of the set
            return f"whose active has the index {index:g}: expected one of {count:,} assetPaths, counted from 0"
    return ""


def _files(layer: Sdf.Layer, clips: Mapping[str, Any]) -> Iterator[str]:
    """Yield the names of the files that a clip set may open."""
    for name in (*(asset.path for asset in clips.get("assetPaths", ())), _manifest(clips)):
        if name:
            yield str(layer.ComputeAbsolutePath(name))
    if template := clips.get("templateAssetPath"):
        # Not by the resolver, which looks for the template as a file.
        folder, pattern = os.path.split(os.path.join(os.path.dirname(layer.realPath), template))
        matches = re.compile(r"-?\d+".join(map(re.escape, re.split("#+", pattern)))).fullmatch
        names = sorted(os.listdir(folder)) if os.path.isdir(folder) else ()
        yield from (os.path.join(folder, name) for name in names if matches(name))


def warn_of_gaps(reading: Reading) -> None:
    """Warn about missing files of value clips, which OpenUSD goes on without.

    These are the file for the time that is read and, at all times, the manifest, without which no value is used.
    """
    key = ("clips",)
    if key not in reading.lasting:
        prims = prims_under(reading.stage.GetPseudoRoot())
        reading.lasting[key] = [prim for prim in prims if prim.HasMetadata("clips")]
    for prim in reading.lasting[key]:
        for layer, time, clips in _sets(prim, float(reading.time.GetValue())):
            for name, frame in ((_active(clips, time), reading.frame), (_manifest(clips), None)):
                path = name and str(Ar.GetResolver().Resolve(layer.ComputeAbsolutePath(name)))
                if name and not (path and _opens(path)):
                    text = f"{prim.GetPath()} has value clips, of which {name} is not there or cannot be read"
                    reading.warnings.lack(text, file_of(reading.stage), "its values are not used", frame)


def _sets(prim: Usd.Prim, time: float) -> Iterator[tuple[Sdf.Layer, float, Mapping[str, Any]]]:
    """Yield the clip sets of a prim, each with the layer that names its files, and the time in that layer."""
    found = set()
    for spec, offset in prim.GetPrimStackWithLayerOffsets():
        for name, clips in (spec.GetInfo("clips") if spec.HasInfo("clips") else {}).items():
            named = isinstance(clips, Mapping) and ("assetPaths" in clips or "templateAssetPath" in clips)
            if named and name not in found and not _misfit(clips):
                found.add(name)
                yield spec.layer, offset.GetInverse() * time, clips


def _manifest(clips: Mapping[str, Any]) -> str:
    """Return the name of the file that lists what a clip set has values of, "" if it names none."""
    return str(clips["manifestAssetPath"].path) if "manifestAssetPath" in clips else ""


def _times(clips: Mapping[str, Any]) -> list[float]:
    """Return a template's start, end and stride, nothing if it lacks one."""
    times = [clips[name] for name in _TIMES if name in clips]
    return times if len(times) == len(_TIMES) else []


def _active(clips: Mapping[str, Any], time: float) -> str:
    """Return the name of the file that a clip set uses at a time, "" if it names none."""
    paths, active = clips.get("assetPaths"), clips.get("active")
    if paths and active:
        begun = [index for start, index in sorted(map(tuple, active)) if start <= time]
        return str(paths[int(begun[-1] if begun else min(map(tuple, active))[1])].path)
    times = _times(clips)
    if "templateAssetPath" not in clips or not times:
        return ""
    start, end, stride = times
    last = (end - start) // stride
    step = min(max((time - start - clips.get("templateActiveOffset", 0.0)) // stride, 0), last)
    return _HASHES.sub(lambda found: _numbered(found[0], start + step * stride), clips["templateAssetPath"])


def _numbered(hashes: str, number: float) -> str:
    """Return a number as OpenUSD writes it in place of a template's ###.##."""
    whole, _, decimals = hashes.partition(".")
    width = len(whole) + bool(decimals) + len(decimals)
    return f"{number:0{width}.{len(decimals)}f}"


def _opens(path: str) -> bool:
    """Return whether a file is a layer; OpenUSD, which needs it next, keeps it open."""
    with suppress(Tf.ErrorException):
        return bool(Sdf.Layer.FindOrOpen(path))
    return False
