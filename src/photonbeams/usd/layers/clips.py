"""Value clips of a layer, checked before a stage is composed: OpenUSD opens the files that they name."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping

from ..common.openusd import Ar, Sdf
from ..common.warnings import Warnings

_MOST_CLIPS = 1_000_000  # of a template
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
            warnings.give(text, layer.realPath or layer.identifier, "they are left out")
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
