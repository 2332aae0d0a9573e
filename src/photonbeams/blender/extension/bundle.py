"""The renderer that comes with the extension: an archive of Python's packages, which is unpacked once.

Blender's own Python runs it as a process of its own. Nothing is fetched or installed, so nothing that Blender or other
add-ons have is changed. Several Blenders may unpack it at once, and any of them may be killed: each has a folder of its
own, which is renamed when it is whole, and a renderer is whole if it has the files that its list names.
"""

from __future__ import annotations

import json
import lzma
import os
import shutil
import tarfile
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

#: The file of an archive that has the sizes of all others, by their paths.
LIST = "files.json"
_SUFFIX, _PART = ".tar.xz", ".part"
#: Seconds without a sign of life after which a folder that was being unpacked is that of a process that was killed.
_PATIENCE = 120.0
# No file goes elsewhere; Python knows how since 3.11.4.
_SAFE: dict[str, Any] = {"filter": "data"} if hasattr(tarfile, "data_filter") else {}


class NoRendererError(Exception):
    """There is no process that renders; the text says why, and what to do."""


class NotYetError(NoRendererError):
    """There will be one in a while."""


class Bundle:
    """An archive that comes with the extension.

    Parameters
    ----------
    archive
        The archive, whose name changes with its content; it has folders of Python's packages, and their list.
    parent
        The folder in which it is unpacked.
    """

    def __init__(self, archive: Path, parent: Path) -> None:
        self._archive, self._parent = archive, parent
        self._folder = parent / archive.name.removesuffix(_SUFFIX)
        self._doing, self._problem = "Checking the renderer", ""
        self._thread = threading.Thread(target=self._provide, daemon=True)
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
            They are being checked, or unpacked.
        NoRendererError
            They cannot be unpacked.
        """
        if self._thread.is_alive():
            raise NotYetError(self._doing)
        if self._problem:
            raise NoRendererError(self._problem)
        return str(next(self._folder.glob("**/site-packages")))

    def _provide(self) -> None:
        """Unpack the renderer unless it is there, and remove what others have left."""
        try:
            self._parent.mkdir(parents=True, exist_ok=True)
            self._tidy()
            if not _is_whole(self._folder):
                self._unpack()
        except (OSError, EOFError, lzma.LZMAError, tarfile.TarError) as error:
            why = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
            self._problem = (
                f"the renderer cannot be unpacked in {self._parent} ({why}): expected a disk with 800 MB left; then "
                "disable the add-on and enable it again, or choose a Python in its preferences"
            )

    def _tidy(self) -> None:
        """Remove renderers of other versions, and what processes that were killed have left."""
        for other in self._parent.glob("renderer-*"):
            with suppress(OSError):  # another Blender removes it, too
                is_unpacked = other.name.endswith(_PART) and time.time() - other.stat().st_mtime < _PATIENCE
                if other != self._folder and not is_unpacked:
                    shutil.rmtree(other)

    def _unpack(self) -> None:
        own = Path(tempfile.mkdtemp(prefix=f"{self._folder.name}.", suffix=_PART, dir=self._parent))
        try:
            with (
                self._archive.open("rb") as source,
                lzma.open(_Read(source, self._tell, own)) as content,  # type: ignore[call-overload]
                tarfile.open(fileobj=content, mode="r|") as packed,
            ):
                packed.extractall(own / "new", **_SAFE)
            if not _is_whole(own / "new"):
                raise EOFError("files are missing")
            self._put(own)
        finally:
            shutil.rmtree(own, ignore_errors=True)

    def _put(self, own: Path) -> None:
        """Put what was unpacked in its place, unless another Blender has done so."""
        if not _is_whole(self._folder):
            with suppress(FileNotFoundError):
                self._folder.rename(own / "old")
        try:
            (own / "new").rename(self._folder)
        except OSError:
            if not _is_whole(self._folder):
                raise

    def _tell(self, part: float) -> None:
        self._doing = f"Unpacking the renderer, once: {part:.0%}"


def _is_whole(folder: Path) -> bool:
    """Return whether a folder has all files that its list names, of their sizes."""
    try:
        sizes = json.loads((folder / LIST).read_bytes())
        return all((folder / name).stat().st_size == size for name, size in sizes.items())
    except (OSError, ValueError):  # files are missing, the list among them, or it is cut off
        return False


class _Read:
    """A file that tells how far it was read, and that the process that unpacks it lives."""

    def __init__(self, file: IO[bytes], tell: Callable[[float], None], own: Path) -> None:
        self._file, self._tell, self._own = file, tell, own
        self._size = max(os.fstat(file.fileno()).st_size, 1)

    def read(self, size: int) -> bytes:
        """Return the next bytes."""
        os.utime(self._own)
        self._tell(self._file.tell() / self._size)
        return self._file.read(size)
