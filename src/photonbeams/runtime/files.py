"""Files that are written whole or not at all, and those that can be read.

A file grows beside its target under a hidden name of its own and is renamed once it is whole and on the disk, so that
neither a full disk nor a second writer leaves half of one. What goes wrong on the way is an `OSError` that names the
target. What a process leaves that was killed while it wrote, the next writer in the same folder removes.
"""

from __future__ import annotations

import errno
import os
import platform
import re
import secrets
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from hashlib import sha256
from pathlib import Path

PathLike = str | os.PathLike[str]


def _processes() -> str:
    """Return a name of the set of processes that this one can tell alive from dead."""
    parts = [platform.node()]
    for path in ("/proc/sys/kernel/random/boot_id", "/proc/self/ns/pid"):
        with suppress(OSError):
            parts.append(os.readlink(path) if os.path.islink(path) else Path(path).read_text())
    return sha256(repr(parts).encode()).hexdigest()[:10]


_HOST = _processes()
_STALE = 86400.0  # seconds: nobody writes one file for so long
_CLEARED: set[str] = set()  # folders from which this process has removed leftovers


_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)


def why_unreadable(path: PathLike) -> str:
    """Return what keeps a path from being read as a file, "a named pipe", say; "" where nothing does.

    Pipes and devices may have no end, and to open one may block for ever: ask before a file of a user's is opened.
    """
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError) as error:
        return getattr(error, "strerror", None) or str(error)
    return next((f"it is {name}" for test, name in _KINDS if test(mode)), "")


@contextmanager
def atomic_path(path: PathLike) -> Iterator[Path]:
    """Give a path beside `path`, with its suffix, to write to; rename it to `path` at the end, remove it on failure.

    Makes the folder if there is none. Where `path` is a symbolic link, the file that it names is written.

    Raises
    ------
    OSError
        What kept the file from being written, with `path` as its file name.
    """
    path = Path(path)
    target = Path(os.path.realpath(path))
    # Short enough for any name that is allowed itself, and never the name of a picture that someone globs for.
    own = f".{path.stem[:40]}.{_HOST}-{os.getpid()}-"
    beside = target.parent / f"{own}{secrets.token_hex(6)}.tmp{path.suffix}"
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        _remove_leftovers(str(target.parent))
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if path.exists() and not path.is_file():  # a rename would take a device or a pipe away
            raise OSError(errno.EINVAL, "it is a device or a pipe: expected a file", str(path))
        # Mode 666 under the user's umask, which a temporary file would not have.
        os.close(os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
        yield beside
        _flush(beside)
        os.replace(beside, target)
    except OSError as error:
        ours = (beside, path, path.parent, target, target.parent)
        if error.filename is not None and Path(os.fsdecode(error.filename)) not in ours:
            raise  # some other file, that the writer needed
        if isinstance(error, FileExistsError):  # what `mkdir` says where a file has the folder's name
            error = NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
        raise OSError(error.errno or errno.EIO, error.strerror or str(error), str(path)) from error
    finally:
        with suppress(OSError):
            beside.unlink()


def try_path(path: PathLike) -> None:
    """Raise what `atomic_path` would raise, before hours of work; the trial leaves no trace.

    Raises
    ------
    OSError
        The folder cannot be made or written to, or a folder bears the file's name.
    """
    missing = [folder for folder in Path(path).parents if not folder.exists()]
    try:
        with suppress(_Undone), atomic_path(path):
            raise _Undone
    finally:
        for folder in missing:
            with suppress(OSError):
                folder.rmdir()


def _remove_leftovers(folder: str) -> None:
    """Remove what killed processes left in a folder, once; of other machines and boots, what is a day old."""
    if folder in _CLEARED or os.name != "posix":
        return
    _CLEARED.add(folder)
    name = re.compile(r"\..*\.([0-9a-f]{10})-(\d+)-[0-9a-f]{12}\.tmp(\.\w+)?")
    with suppress(OSError):
        for each in os.scandir(folder):
            found = name.fullmatch(each.name)
            if not found:
                continue
            with suppress(OSError):  # another process may have removed it meanwhile
                dead = found[1] == _HOST and not _alive(int(found[2]))
                if dead or time.time() - each.stat(follow_symlinks=False).st_mtime > _STALE:
                    os.unlink(each.path)


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # of another user
        return True
    return True


class _Undone(Exception):  # noqa: N818 (no error: it takes back a trial)
    pass


def _flush(path: Path) -> None:
    """Wait until a file is on the disk: a full network disk tells only then."""
    file = os.open(path, os.O_RDWR)
    try:
        os.fsync(file)
    finally:
        os.close(file)
