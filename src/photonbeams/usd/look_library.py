"""The looks of a stage, for swatches."""

from __future__ import annotations

from collections.abc import Collection
from contextlib import suppress

from ..scene import Medium, SceneError
from .common.openusd import Usd
from .common.reading import Reading, file_of, frame_number
from .looks.look import LookSpec, read_look
from .stage import default_time, read_scene, time_code


def find_looks(
    stage: Usd.Stage, names: Collection[str], frame: float | None = None
) -> tuple[list[LookSpec], Medium | None, float]:
    """Return the looks on a stage, its fog or None, and the seconds at a frame.

    Parameters
    ----------
    names
        Paths or names of the wanted looks; empty: all.

    Raises
    ------
    SceneError
        A look does not exist or cannot be read.
    """
    time = default_time(stage) if frame is None else time_code(frame)
    reading = Reading(stage, time)
    prims = [prim for prim in stage.Traverse() if prim.GetTypeName() == "PhotonBeamsLook"]
    known = ", ".join(str(prim.GetPath()) for prim in prims) or "none"
    for name in names:
        if not any(name in (str(prim.GetPath()), prim.GetName()) for prim in prims):
            raise SceneError(f"{file_of(stage)} has no look {name}: expected one of its PhotonBeamsLook prims, {known}")
    if not prims:
        raise SceneError(f"{file_of(stage)} has no look: expected a PhotonBeamsLook prim")
    chosen = [prim for prim in prims if not names or {str(prim.GetPath()), prim.GetName()} & set(names)]
    medium = None
    with suppress(SceneError):  # other errors of a stage do not matter to its looks
        medium = read_scene(stage, time).medium
    seconds = frame_number(time) / stage.GetTimeCodesPerSecond()
    return [read_look(reading, prim, prim) for prim in chosen], medium, seconds
