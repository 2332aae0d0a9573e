"""The renderer that comes with the extension: an archive of Python's packages, which is unpacked once.

Blender's own Python runs it as a process of its own. Nothing is fetched or installed, so nothing that Blender or other
add-ons have is changed.
"""

from __future__ import annotations

import os
import shutil
import tarfile
import threading
from pathlib import Path
from typing import IO

_SUFFIX = ".tar.xz"


class NoRendererError(Exception):
    """There is no process that renders; the text says why, and what to do."""


class NotYetError(NoRendererError):
    """There will be one in a while."""


class Bundle:
    """An archive that comes with the extension.

    Parameters
    ----------
    archive
        The archive, whose name changes with its content; it has folders of Python's packages.
    parent
        The folder in which it is unpacked.
    """

    def __init__(self, archive: Path, parent: Path) -> None:
        self._archive, self._parent = archive, parent
        self._folder = parent / archive.name.removesuffix(_SUFFIX)
        self._done, self._problem = 0.0, ""
        self._thread = threading.Thread(target=self._unpack, daemon=True)
        if not self._folder.exists():
            self._thread.start()

    @classmethod
    def within(cls, folder: Path, parent: Path) -> Bundle | None:
        """Return the bundle of a folder, None if it has none."""
        found = next(folder.glob(f"renderer-*{_SUFFIX}"), None)
        return None if found is None else cls(found, parent)

    def packages(self) -> str:
        """Return the folder of the packages.

        Raises
        ------
        NotYetError
            They are being unpacked.
        NoRendererError
            They cannot be unpacked.
        """
        if self._folder.exists():
            return str(next(self._folder.glob("**/site-packages")))
        if self._problem:
            raise NoRendererError(self._problem)
        raise NotYetError(f"Unpacking the renderer, once: {self._done:.0%}")

    def _unpack(self) -> None:
        part = self._parent / f"{self._folder.name}.part"
        try:
            shutil.rmtree(part, ignore_errors=True)  # of a process that was killed
            part.mkdir(parents=True)
            with self._archive.open("rb") as source, tarfile.open(fileobj=_Read(source, self), mode="r|xz") as packed:  # type: ignore[call-overload]
                packed.extractall(part, filter="data")
            for other in self._parent.glob("renderer-*"):  # before it is there: who sees it sees it alone
                if other != part:
                    shutil.rmtree(other, ignore_errors=True)
            part.rename(self._folder)
        except (OSError, EOFError, tarfile.TarError) as error:
            shutil.rmtree(part, ignore_errors=True)
            why = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
            self._problem = (
                f"the renderer cannot be unpacked in {self._parent} ({why}): expected a disk with 800 MB left; then "
                "disable the add-on and enable it again, or choose a Python in its preferences"
            )

    def read(self, place: int) -> None:
        """Note how much of the archive was read."""
        self._done = place / max(os.path.getsize(self._archive), 1)


class _Read:
    """A file that tells a bundle how far it was read."""

    def __init__(self, file: IO[bytes], bundle: Bundle) -> None:
        self._file, self._bundle = file, bundle

    def read(self, size: int) -> bytes:
        """Return the next bytes."""
        self._bundle.read(self._file.tell())
        return self._file.read(size)
