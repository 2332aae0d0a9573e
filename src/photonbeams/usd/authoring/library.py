"""A library of looks: a folder with a .usda file for each, so that looks of one shot can be used in others.

A file has one `PhotonBeamsLook`, its default prim, and can be referenced by stages as well.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from ...runtime.files import write_bytes
from ...scene import SceneError
from ..common.definitions import LOOK, PREFIX, definitions, plain
from ..common.openusd import Sdf, Usd
from ..common.reading import file_of
from .presets import Preset, preset_of
from .prims import copy_prim

# The most looks that are listed.
_MOST = 200


@dataclass(frozen=True)
class KeptLook(Preset):
    """A look of a library."""

    @property
    def name(self) -> str:
        """The look's name for programs, such as "kept-Ember"."""
        return f"kept-{self.label}"


class LookLibrary:
    """The looks in a folder, which need not exist.

    Parameters
    ----------
    folder
        The folder; it is made when the first look is kept.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def looks(self) -> list[KeptLook]:
        """Return the looks, by name; files that cannot be read or have no look are left out."""
        return list(self._found())

    def _found(self) -> Iterator[KeptLook]:
        for file in sorted(self.folder.glob("*.usda"))[:_MOST]:
            with suppress(Exception):  # of any kind: whatever lies in the folder, the studio goes on
                stage = Usd.Stage.Open(str(file))
                prim = stage.GetDefaultPrim()
                if prim.GetTypeName() == LOOK:
                    yield KeptLook("look", file.stem, _values(prim))

    def preset(self, name: str) -> Preset:
        """Return the look of the library, or else the preset, of a name; SceneError if there is neither."""
        return next((each for each in self.looks() if each.name == name), None) or preset_of(name)

    def keep(self, stage: Usd.Stage, path: str) -> KeptLook:
        """Write a look of a stage to a new file, whose name has a number if there is one of the prim's name.

        Raises
        ------
        SceneError
            The prim is no look, or the file cannot be written.
        """
        prim = stage.GetPrimAtPath(path) if Sdf.Path.IsValidPathString(path) else None
        if not prim or prim.GetTypeName() != LOOK:
            raise SceneError(f"{file_of(stage)} has no look {path} to keep")
        numbers = ("", *map(str, range(2, 10_000)))
        file = next(each for each in (self.folder / f"{prim.GetName()}{k}.usda" for k in numbers) if not each.exists())
        stage = Usd.Stage.CreateInMemory()
        copy_prim(prim, stage, f"/{prim.GetName()}")
        stage.SetDefaultPrim(stage.GetPrimAtPath(f"/{prim.GetName()}"))
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            write_bytes(file, stage.Flatten().ExportToString().encode())
        except OSError as error:
            raise SceneError(f"{file} cannot be written: {error.strerror or error}") from error
        return KeptLook("look", file.stem, _values(prim))


def _values(prim: Usd.Prim) -> dict[str, object]:
    """Return the values that a look has, by names without prefix; files by their whole paths."""
    found = {}
    for name in definitions(LOOK):
        attribute = prim.GetAttribute(name)
        if attribute and attribute.HasAuthoredValue():
            value = attribute.Get(Usd.TimeCode.EarliestTime())
            own = value.resolvedPath or value.path if isinstance(value, Sdf.AssetPath) else plain(value)
            found[name.removeprefix(PREFIX)] = own
    return found
