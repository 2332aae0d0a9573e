"""Write files completely or not at all; `inputs` reads them.

A file is written beside its target, under a hidden name of its own. It is closed, synced, and read back: only if its
size and checksum are those of the bytes that were meant, it is renamed. So neither a full disk nor a second writer
leaves half a file. If something goes wrong, an `OSError` names the target. If a process is killed while it writes, the
next writer in the same folder removes the leftover file.

Everything that photonbeams writes goes through `atomic_file`, and libraries encode into it or into memory. Only
OpenUSD's binary layers need a path, from `atomic_path`, and are compared with the layer in memory.
"""

from __future__ import annotations

import errno
import io
import os
import platform
import re
import secrets
import time
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from hashlib import sha256
from pathlib import Path
from shutil import rmtree
from tempfile import TemporaryDirectory, gettempdir
from typing import IO, TYPE_CHECKING, Literal

from ..scene import SceneError

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

PathLike = str | os.PathLike[str]


def _processes() -> str:
    """Return a name for the processes that this one can test for being alive: those of the same machine and boot."""
    parts = [platform.node()]
    for path in ("/proc/sys/kernel/random/boot_id", "/proc/self/ns/pid"):
        with suppress(OSError):
            parts.append(os.readlink(path) if os.path.islink(path) else Path(path).read_text())
    return sha256(repr(parts).encode()).hexdigest()[:10]


_HOST = _processes()
_STALE = 86400.0  # seconds; no process writes one file for so long
_CLEARED: set[str] = set()  # folders from which this process has removed leftovers


def write_bytes(path: PathLike, data: bytes | memoryview) -> None:
    """Write a file whole or not at all; raise OSError as `atomic_path` does."""
    with atomic_file(path) as file:
        file.write(data)


@contextmanager
def atomic_file(path: PathLike) -> Iterator[IO[bytes]]:
    """Yield a binary stream to write to, without `seek`; at the end, `path` has its bytes.

    OSError as for `atomic_path`, or if the file holds other bytes than were written.
    """
    with atomic_path(path) as beside:
        with _Draft(beside) as draft:
            yield draft  # type: ignore[misc]
        sync(beside)
        draft.check()


class _Draft(io.RawIOBase):
    """A stream to a new file, with the size and the checksum of what was written to it."""

    def __init__(self, path: Path) -> None:
        self._path, self._file = path, path.open("wb")
        self._size = self._checksum = 0

    def writable(self) -> bool:
        return True

    def write(self, data: ReadableBuffer) -> int:
        with memoryview(data).cast("B") as view:
            self._file.write(view)
            self._checksum = zlib.crc32(view, self._checksum)
            self._size += len(view)
            return len(view)

    def close(self) -> None:
        try:
            self._file.close()  # writes what is still buffered
        finally:
            super().close()

    def check(self) -> None:
        """Raise OSError if the closed file holds other bytes than were written: some disks lose bytes in silence."""
        size = checksum = 0
        with self._path.open("rb") as file:
            while block := file.read(1 << 20):
                size, checksum = size + len(block), zlib.crc32(block, checksum)
        if (size, checksum) != (self._size, self._checksum):
            text = f"the disk holds {size:,} of {self._size:,} bytes" if size != self._size else "the disk lost bytes"
            raise OSError(errno.EIO, f"cannot be written ({text})", str(self._path))


@contextmanager
def atomic_path(path: PathLike) -> Iterator[Path]:
    """Yield a path beside `path`, with the same suffix, to write to; rename it to `path` at the end, or remove it.

    Whoever writes to it syncs and checks the file, as `atomic_file` does. Where several files belong together, enter
    all their paths first: then none gets its name before all are whole.

    The folder is made if it does not exist, and removed again if nothing is written. If `path` is a symbolic link, the
    file to which it points is written.

    Raises
    ------
    OSError
        If the file cannot be written; its file name is `path`.
    """
    path = Path(path)
    try:
        named = b"\0" not in os.fsencode(path)
    except UnicodeEncodeError:
        named = False
    if not named:
        raise OSError(errno.EINVAL, "a name cannot have a NUL, or half of a character", str(path))
    target = Path(os.path.realpath(path))
    # Short enough for every allowed name, and hidden, so that no pattern for pictures matches it.
    own = f".{path.stem[:40]}.{_HOST}-{os.getpid()}-"
    beside = target.parent / f"{own}{secrets.token_hex(6)}.tmp{path.suffix}"
    missing: list[Path] = []
    try:
        missing += [folder for folder in target.parents if not folder.exists()]
        target.parent.mkdir(parents=True, exist_ok=True)
        _remove_leftovers(str(target.parent))
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if path.exists() and not path.is_file():  # a rename would replace a device or a pipe
            raise OSError(errno.EINVAL, "it is a device or a pipe: expected a file", str(path))
        # Mode 666 with the user's umask; files of `tempfile` have mode 600.
        os.close(os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
        yield beside
        os.replace(beside, target)
    except OSError as error:
        ours = (beside, path, path.parent, target, target.parent)
        if error.filename is not None and Path(os.fsdecode(error.filename)) not in ours:
            raise  # some other file that the writer needed
        if isinstance(error, FileExistsError):  # raised by `mkdir` if a file has the folder's name
            error = NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
        raise OSError(error.errno or errno.EIO, error.strerror or str(error), str(path)) from error
    finally:
        with suppress(OSError):
            beside.unlink()
        for folder in missing:
            with suppress(OSError):  # it is not empty
                folder.rmdir()


def sync(path: Path) -> None:
    """Wait until a file is on the disk: a full network disk reports it only then."""
    file = os.open(path, os.O_RDWR)
    try:
        os.fsync(file)
    finally:
        os.close(file)


def failure_of(path: Path, message: str) -> OSError:
    """Return the system's error because of which a library could not write `path`, or else the library's message."""
    try:
        with path.open("ab") as file:  # this fails as the library did, but Python reports the system's reason
            file.write(bytes(1 << 16))
            file.flush()
            os.fsync(file)
    except OSError as error:
        return error
    return OSError(errno.EIO, f"cannot be written ({message.strip().partition(chr(10))[0] or 'for no reason given'})")


def locked(path: PathLike, mode: Literal["r+b", "xb"] = "r+b") -> IO[bytes] | None:
    """Open or make a file, and lock it until it is closed or this process ends; None if somebody else has locked it.

    Where files cannot be locked, as on some network disks and on Windows, it is only opened.
    """
    file = open(path, mode)  # noqa: SIM115 (the caller closes it)
    try:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        return None
    except (ImportError, OSError):
        pass
    return file


def place_of(path: PathLike) -> object:
    """Return what all names of a file have in common, those by links and by other folders, too."""
    try:
        status = os.stat(path)
    except OSError:
        return os.path.realpath(path)
    return status.st_dev, status.st_ino


def check_kept(targets: Iterable[PathLike], sources: Iterable[PathLike]) -> None:
    """Raise SceneError if one of the files to write is one of those that are read, by its own name or by a link.

    Sources are asked for only if a file would be replaced at all.
    """
    places = {place_of(each): each for each in targets if os.path.exists(each)}
    for source in sources if places else ():
        if (target := places.get(place_of(source))) is not None:
            raise SceneError(f"{target} would replace {source}, which is read: expected another file to write to")


def try_path(path: PathLike) -> None:
    """Raise the error that `atomic_path` would raise, before hours of work; the trial leaves no trace."""
    with suppress(_Undone), atomic_path(path):
        raise _Undone


def temporary_folder(purpose: str) -> TemporaryDirectory[str]:
    """Return a new folder for temporary files, as `tempfile` does; first remove those that killed processes left."""
    _remove_leftovers(gettempdir())
    return TemporaryDirectory(prefix=f"photonbeams-{purpose}.{_HOST}-{os.getpid()}-", ignore_cleanup_errors=True)


def _remove_leftovers(folder: str) -> None:
    """Remove what killed processes left in a folder, once; files of other machines and boots if they are a day old."""
    if folder in _CLEARED or os.name != "posix":
        return
    _CLEARED.add(folder)
    process = r"\.([0-9a-f]{10})-(\d+)-"
    file, temporary = rf"\..*{process}[0-9a-f]{{12}}\.tmp(\.\w+)?", rf"photonbeams-\w+{process}\w+"
    with suppress(OSError):
        for each in os.scandir(folder):
            found = re.fullmatch(file, each.name) or re.fullmatch(temporary, each.name)
            if not found:
                continue
            dead = found[1] == _HOST and not _alive(int(found[2]))
            with suppress(OSError):  # another process may have removed it meanwhile
                if not each.name.startswith("."):
                    if dead:
                        rmtree(each.path)
                elif dead or time.time() - each.stat(follow_symlinks=False).st_mtime > _STALE:
                    os.unlink(each.path)


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # of another user
        return True
    return True


class _Undone(Exception):  # noqa: N818 (not an error: it ends a trial)
    pass
