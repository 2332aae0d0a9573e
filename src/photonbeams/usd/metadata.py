"""Take units, up axis, rates and range from a sublayer if a stage's root layer lacks them.

OpenUSD takes them only from the root layer. A layer with looks and fog over an export would then move the export's keys
of 30 frames a second to other times, and would have no range.
"""

from __future__ import annotations

from collections.abc import Iterator

from .openusd import Sdf, Tf, Usd, UsdGeom
from .reading import file_of
from .warnings import Warnings

_RATES = ("timeCodesPerSecond", "framesPerSecond")
_RANGE = ("startTimeCode", "endTimeCode")
_UNITS = (UsdGeom.Tokens.metersPerUnit, UsdGeom.Tokens.upAxis)


def complete_metadata(stage: Usd.Stage, warnings: Warnings) -> None:
    """Take metadata that a stage's root layer lacks from the strongest sublayer that has it; warn if it matters."""
    root, session = stage.GetRootLayer(), stage.GetSessionLayer()
    timed = any(_says(root, name) for name in (*_RATES, *_RANGE))
    taken: dict[str, list[str]] = {}
    for name in _UNITS if timed else (*_UNITS, *_RATES, *_RANGE):
        source = None if _says(root, name) else next((each for each in _sublayers(root) if _says(each, name)), None)
        if source is None:
            continue
        value = source.pseudoRoot.GetInfo(name)
        if name in _RATES and value != stage.GetMetadata(name) and _has_times(root):
            moved = f"but its sublayer {source.GetDisplayName()} has {value:g}: its keys are moved"
            warnings.give(f"{file_of(stage)}: has no {name}, {moved}; expected {value:g} here, too")
            break
        if value != stage.GetMetadata(name):
            taken.setdefault(source.GetDisplayName(), []).append(name)
        session.pseudoRoot.SetInfo(name, value)
    for display, names in taken.items():
        warnings.give(f"{file_of(stage)}: has no {', '.join(names)}: taken from its sublayer {display}")


def _has_times(layer: Sdf.Layer) -> bool:
    """Return whether a layer has times of its own, which another rate of the stage would move."""
    return bool(layer.ListAllTimeSamples()) or any(each != Sdf.LayerOffset() for each in layer.subLayerOffsets)


def _says(layer: Sdf.Layer, name: str) -> bool:
    return bool(layer.pseudoRoot.HasInfo(name))


def _sublayers(layer: Sdf.Layer) -> Iterator[Sdf.Layer]:
    """Return the layers below a layer, the strongest first."""
    for path in layer.subLayerPaths:
        try:
            found = Sdf.Layer.FindOrOpenRelativeToLayer(layer, path)
        except Tf.ErrorException:  # reported with the composition
            continue
        if found:
            yield found
            yield from _sublayers(found)
