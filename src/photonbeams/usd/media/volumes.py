"""Read the fields of UsdVol volumes: grids in OpenVDB's .vdb files, or Mitsuba's .vol files."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...runtime.inputs import opened
from ...scene import Array, DensityGrid, SceneError
from ...volumes.dense import MOST_VALUES, Voxels, parts_of, voxels_of
from ...volumes.vdb import VDBGrid, read_grids
from ...volumes.vol import read_vol
from ..common.openusd import Ar, Sdf, Usd, UsdVol
from ..common.reading import Reading, prims_under
from ..common.textures import asset_content, resolved, stamp
from ..common.warnings import Warnings

_FIELD = "field:"
DENSITY = "density"
_VELOCITIES = {"v", "vel", "velocity"}  # as Houdini, EmberGen and Blender name them
_KINDS = (".vdb", ".vol")
_KEPT = 1 << 30  # bytes of grids to keep


class _Grid(NamedTuple):
    """The boxes of a grid, without negative values, and the least value that it had."""

    boxes: list[Voxels]
    least: float


#: The grids read last, the oldest first: a shutter is read at many times, and grids then stay the same objects.
_GRIDS: dict[tuple[object, ...], _Grid] = {}


def fields_of(prim: Usd.Prim) -> list[str]:
    """Return the names of a volume's fields: "density" for the relationship field:density."""
    names = (each.GetName() for each in prim.GetPropertiesInNamespace("field"))
    return [name.removeprefix(_FIELD) for name in names if prim.GetRelationship(name)]


def field_of(reading: Reading, prim: Usd.Prim, name: str) -> Usd.Prim | None:
    """Return the prim of a volume's field, by the name of its relationship or of the grid that it reads; or None."""
    fields = {own: target for own in fields_of(prim) for target in reading.targets(prim, f"{_FIELD}{own}")[:1]}
    named = (target for target in fields.values() if str(reading.value(target, "fieldName", "")) == name)
    return fields[name] if name in fields else next(named, None)


def warn_of_velocities(stage: Usd.Stage, warnings: Warnings) -> None:
    """Warn about the velocities of volumes, by which a shutter that is open would blur them."""
    reading = Reading(stage, warnings=warnings)
    with warnings.together():
        for prim in prims_under(stage.GetPseudoRoot()):
            for name in fields_of(prim) if prim.IsA(UsdVol.Volume) else ():
                if name in _VELOCITIES:
                    text = "is not used: smoke is blurred as its transform and its files move, not by its velocities"
                    reading.warn(prim, text, f"{_FIELD}{name}")


def read_density(
    reading: Reading, prim: Usd.Prim, to_world: Array, name: str = DENSITY, apart: bool = False
) -> list[DensityGrid]:
    """Return the density of a volume: its field of this name, or its only field; parts `apart` as grids of their own.

    Raises
    ------
    SceneError
        The volume has no such field, a file does not exist or cannot be read, or the values are not densities.
    """
    field = field_of(reading, prim, name)
    names = fields_of(prim)
    if field is None and len(names) == 1:
        field = next(iter(reading.targets(prim, f"{_FIELD}{names[0]}")), None)
    if field is None:
        known = f" (the volume has {', '.join(names)})" if names else ""
        raise reading.fail(prim, f"{_FIELD}{name}", f"names no field: expected a prim with a filePath{known}")
    return read_field(reading, prim, field, to_world, apart)


def read_field(
    reading: Reading, prim: Usd.Prim, field: Usd.Prim, to_world: Array, apart: bool = False
) -> list[DensityGrid]:
    """Return a field of a volume, with one or three channels, 0 or more, in world space: one grid, or parts `apart`.

    Raises
    ------
    SceneError
        The same as for `read_density`.
    """
    path, shown = _file(reading, field)
    name, index = str(reading.value(field, "fieldName", "") or ""), reading.value(field, "fieldIndex", 0)
    try:
        boxes, least = _kept(path, name, index, apart)
        if least < 0:  # as simulations have where fog thins out
            reading.warn(field, f"has a grid with values down to {least:g}: those below 0 count as 0", "filePath")
        if boxes[0].step > 1:
            cells = " x ".join(str(each) for each in boxes[0].values.shape[2::-1])
            where = "in all" if len(boxes) == 1 else f"in the first of {len(boxes)} parts"
            text = f"has too many voxels: every {boxes[0].step} along an axis become one, {cells} {where}"
            reading.warn(field, text, "filePath")
        local = np.linalg.inv(reading.to_world(prim)) @ reading.to_world(field)
        return [DensityGrid(each.values, to_world @ local @ each.to_file) for each in boxes]
    except (SceneError, ValueError, OSError, np.linalg.LinAlgError) as error:
        raise reading.missing(field, "filePath", f"names {shown}: expected a grid that can be read ({error})") from None


def _file(reading: Reading, field: Usd.Prim) -> tuple[str, str]:
    """Return the path of a field's file, and its name for messages."""
    asset = reading.value(field, "filePath")
    if not isinstance(asset, Sdf.AssetPath) or not asset.path:
        raise reading.missing(field, "filePath", "names no file: expected a grid, @name.vdb@ or @name.vol@")
    shown = asset.path if len(asset.path) <= 60 else f"…{asset.path[-60:]}"
    if Path(asset.path).suffix.lower() not in _KINDS:
        raise reading.missing(field, "filePath", f"names {shown}: expected a .vdb or .vol file")
    path = resolved(reading, asset)
    if not path:
        raise reading.missing(field, "filePath", f"names {shown}: expected a .vdb or .vol file, but there is none")
    return path, shown


def _kept(path: str, name: str, index: int, apart: bool) -> _Grid:
    """Return a grid of a file, read at most once while it is kept."""
    key = path, stamp(path), name, index, MOST_VALUES, apart
    _GRIDS[key] = grid = _GRIDS.pop(key, None) or _read(path, name, index, apart)
    while len(_GRIDS) > 1 and sum(box.values.nbytes for each in _GRIDS.values() for box in each.boxes) > _KEPT:
        del _GRIDS[next(iter(_GRIDS))]
    return grid


def _read(path: str, name: str, index: int, apart: bool) -> _Grid:
    in_package = Ar.IsPackageRelativePath(path)
    with io.BytesIO(asset_content(path)) if in_package else opened(path) as file:
        if Path(Ar.SplitPackageRelativePathInner(path)[1] or path).suffix.lower() == ".vol":
            boxes = [read_vol(file)]
        else:
            grid = _grid(read_grids(file), name, index)
            boxes = parts_of(grid) if apart else [voxels_of(grid)]
    least = min(float(each.values.min()) for each in boxes)
    if least < 0:
        boxes = [replace(each, values=np.maximum(each.values, 0)) for each in boxes]
    return _Grid(boxes, least)


def _grid(grids: list[VDBGrid], name: str, index: int) -> VDBGrid:
    """Return a grid by its name, and its index among those of this name; without a name, the density."""
    named = [each for each in grids if each.name == (name or DENSITY)]
    if not named and not name:
        named = grids[:1]
    if not named:
        known = ", ".join(dict.fromkeys(each.name for each in grids)) or "none at all"
        raise SceneError(f"it has no grid {name or DENSITY}, but {known}")
    if not 0 <= index < len(named):
        raise SceneError(f"it has no grid {named[0].name} with fieldIndex {index}: expected 0 to {len(named) - 1}")
    return named[index]
