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
    times = [each for each in map(clips.get, _TIMES) if isinstance(each, float)]
    if len(times) == 3 and times[2] > 0 and not (times[1] - times[0]) / times[2] <= _MOST_CLIPS:
        return f"from {times[0]:g} to {times[1]:g} by {times[2]:g}: expected up to {_MOST_CLIPS:,} clips"
    for name in _files(layer, clips):
        path = str(Ar.GetResolver().Resolve(name))
        if path and (problem := problem_of(path)):
            return f"one of them {os.path.basename(name)}: expected a file, {problem}"
    return ""


def _files(layer: Sdf.Layer, clips: Mapping[str, object]) -> Iterator[str]:
    """Yield the names of the files that a clip set may open."""
    listed = clips.get("assetPaths")
    for asset in (*(listed if isinstance(listed, Iterable) else ()), clips.get("manifestAssetPath")):
        if isinstance(asset, Sdf.AssetPath) and asset.path:
            yield str(layer.ComputeAbsolutePath(asset.path))
    template = clips.get("templateAssetPath")
    if isinstance(template, str) and template:
        # Not by the resolver, which looks for the template as a file.
        folder, pattern = os.path.split(os.path.join(os.path.dirname(layer.realPath), template))
        matches = re.compile(r"-?\d+".join(map(re.escape, re.split("#+", pattern)))).fullmatch
        names = sorted(os.listdir(folder)) if os.path.isdir(folder) else ()
        yield from (os.path.join(folder, name) for name in names if matches(name))


def warn_of_gaps(reading: Reading) -> None:
    """Warn about value clips of which the file for the time that is read is missing; OpenUSD goes on without it."""
    key = ("clips",)
    if key not in reading.lasting:
        prims = prims_under(reading.stage.GetPseudoRoot())
        reading.lasting[key] = [prim for prim in prims if prim.HasMetadata("clips")]
    for prim in reading.lasting[key]:
        for layer, time, clips in _sets(prim, float(reading.time.GetValue())):
            name = _active(clips, time)
            path = name and str(Ar.GetResolver().Resolve(layer.ComputeAbsolutePath(name)))
            if name and not (path and _opens(path)):
                text = f"{prim.GetPath()} has value clips, of which {name} is not there or cannot be read"
                reading.warnings.lack(text, file_of(reading.stage), "its values are not used", reading.frame)


def _sets(prim: Usd.Prim, time: float) -> Iterator[tuple[Sdf.Layer, float, Mapping[str, Any]]]:
    """Yield the clip sets of a prim, each with the layer that names its files, and the time in that layer."""
    found = set()
    for spec, offset in prim.GetPrimStackWithLayerOffsets():
        for name, clips in (spec.GetInfo("clips") if spec.HasInfo("clips") else {}).items():
            named = isinstance(clips, Mapping) and ("assetPaths" in clips or "templateAssetPath" in clips)
            if named and name not in found:
                found.add(name)
                yield spec.layer, offset.GetInverse() * time, clips


def _active(clips: Mapping[str, Any], time: float) -> str:
    """Return the name of the file that a clip set uses at a time, "" if it names none."""
    paths, active = clips.get("assetPaths"), clips.get("active")
    if paths and active:
        begun = [index for start, index in sorted(map(tuple, active)) if start <= time]
        index = int(begun[-1] if begun else min(map(tuple, active))[1])
        return str(paths[index].path) if 0 <= index < len(paths) else ""
    template, times = (
        clips.get("templateAssetPath"),
        [each for each in map(clips.get, _TIMES) if isinstance(each, float)],
    )
    if not (isinstance(template, str) and len(times) == len(_TIMES) and times[2] > 0):
        return ""
    start, end, stride = times
    last = (end - start) // stride
    step = min(max((time - start - clips.get("templateActiveOffset", 0.0)) // stride, 0), last)
    return _HASHES.sub(lambda found: _numbered(found[0], start + step * stride), template)


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
