"""Units, up axis, rates and range of a stage: taken from a sublayer if the root layer lacks them, and corrected.

OpenUSD takes them only from the root layer. A layer with looks and fog over an export would then move the export's keys
of 30 frames a second to other times, and would have no range. It also accepts what makes no sense, such as a rate of 0.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ...scene import SceneError
from ..common.openusd import Sdf, Usd, UsdGeom
from ..common.reading import file_of
from ..common.warnings import Warnings
from .frames import LARGEST

_RATES = ("timeCodesPerSecond", "framesPerSecond")
_RANGE = ("startTimeCode", "endTimeCode")
_UNITS = (UsdGeom.Tokens.metersPerUnit, UsdGeom.Tokens.upAxis)

# The least and the greatest numbers that make sense, and OpenUSD's fallbacks.
_LIMITS = {
    "framesPerSecond": (1e-3, 1e6, 24.0),
    "timeCodesPerSecond": (1e-3, 1e6, 24.0),
    "metersPerUnit": (1e-15, 1e18, 0.01),  # femtometres, and parsecs
}


def complete_metadata(stage: Usd.Stage, warnings: Warnings) -> None:
    """Take metadata that a stage's root layer lacks from the strongest sublayer that has it; warn if it matters."""
    layers, session = stage.GetLayerStack(includeSessionLayers=False), stage.GetSessionLayer()
    root = layers[0]
    timed = any(_says(root, name) for name in (*_RATES, *_RANGE))
    taken: dict[str, list[str]] = {}
    for name in _UNITS if timed else (*_UNITS, *_RATES, *_RANGE):
        source = next((each for each in layers if _says(each, name)), root)
        if source == root:
            continue
        value, used = source.pseudoRoot.GetInfo(name), stage.GetMetadata(name)
        if name in _RATES and value != used and _has_times(root):
            moved = f"but its sublayer {source.GetDisplayName()} has {value:g}: its keys are moved"
            warnings.give(f"{file_of(stage)}: has no {name}, {moved}; expected {value:g} here, too")
            break
        if value != used:
            taken.setdefault(source.GetDisplayName(), []).append(name)
        session.pseudoRoot.SetInfo(name, value)
    for display, names in taken.items():
        warnings.give(f"{file_of(stage)}: has no {', '.join(names)}: taken from its sublayer {display}")


def correct_metadata(layer: Sdf.Layer, warnings: Warnings | None) -> bool:
    """Replace a layer's metadata that make no sense, in memory only, and return whether there are any.

    A rate of 0 would put keys at infinite times, for which OpenUSD searches for ever.

    Raises
    ------
    SceneError
        There are some, and the layer cannot be changed, or warnings are errors, or there are no `warnings`.
    """
    place = layer.realPath or layer.identifier
    changed = False
    for text, instead, values in _corrections(layer):
        changed = True
        if warnings is None or not layer.permissionToEdit:
            raise SceneError(f"{place}: {text}")
        warnings.give(text, place, instead)
        for name, value in values.items():
            if value is None:
                layer.pseudoRoot.ClearInfo(name)
            else:
                layer.pseudoRoot.SetInfo(name, value)
    return changed


def _corrections(layer: Sdf.Layer) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yield what is wrong with a layer's metadata, what is done instead, and the new values; None: no value."""
    said = {name: layer.pseudoRoot.GetInfo(name) for name in (*_LIMITS, *_UNITS, *_RANGE) if _says(layer, name)}
    for name, (least, most, usual) in _LIMITS.items():
        if not least <= said.get(name, usual) <= most:
            text = f"{name} is {said[name]:g}: expected a number from {least:g} to {most:g}"
            yield text, f"{usual:g} is used", {name: usual}
    usual = UsdGeom.GetFallbackUpAxis()
    if (axis := said.get("upAxis", usual)) not in (UsdGeom.Tokens.y, UsdGeom.Tokens.z):
        yield f"upAxis is '{axis}': expected Y or Z", f"{usual} is used", {"upAxis": usual}
    ends = {name: said[name] for name in _RANGE if name in said}
    impossible = [name for name, end in ends.items() if not abs(end) < LARGEST]
    for name in impossible:
        text = f"{name} is {ends[name]:g}: expected a frame between {-LARGEST:g} and {LARGEST:g}"
        yield text, "there is no range of frames", {name: None}
    if len(ends) == 2 and not impossible:
        last, first = ends.values()
        if first < last:
            text = f"startTimeCode is {last:g}: expected no more than the endTimeCode, which is {first:g}"
            yield text, f"the frames are {first:g} to {last:g}", dict(zip(_RANGE, (first, last), strict=True))


def _has_times(layer: Sdf.Layer) -> bool:
    """Return whether a layer has times of its own, which another rate of the stage would move."""
    return bool(layer.ListAllTimeSamples()) or any(each != Sdf.LayerOffset() for each in layer.subLayerOffsets)


def _says(layer: Sdf.Layer, name: str) -> bool:
    return bool(layer.pseudoRoot.HasInfo(name))
