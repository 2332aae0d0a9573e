"""Write files completely or not at all, and check whether files can be read.

A file is written beside its target, under a hidden name of its own, and renamed once it is complete and on the disk. So
neither a full disk nor a second writer leaves half a file. If something goes wrong, an `OSError` names the target. If a
process is killed while it writes, the next writer in the same folder removes the leftover file.
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
    """Return a name for the processes that this one can test for being alive: those of the same machine and boot."""
    parts = [platform.node()]
    for path in ("/proc/sys/kernel/random/boot_id", "/proc/self/ns/pid"):
        with suppress(OSError):
            parts.append(os.readlink(path) if os.path.islink(path) else Path(path).read_text())
    return sha256(repr(parts).encode()).hexdigest()[:10]


_HOST = _processes()
_STALE = 86400.0  # seconds; no process writes one file for so long
_CLEARED: set[str] = set()  # folders from which this process has removed leftovers


_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)


def why_unreadable(path: PathLike) -> str:
    """Return why a path cannot be read as a file, such as "it is a named pipe"; "" if it can be.

    Pipes and devices may have no end, and opening one may block forever: call this before a user's file is opened.
    """
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError) as error:
        return getattr(error, "strerror", None) or str(error)
    return next((f"it is {name}" for test, name in _KINDS if test(mode)), "")


@contextmanager
def atomic_path(path: PathLike) -> Iterator[Path]:
    """Yield a path beside `path`, with the same suffix, to write to; rename it to `path` at the end, or remove it.

    The folder is made if it does not exist. If `path` is a symbolic link, the file to which it points is written.

    Raises
    ------
    OSError
        If the file cannot be written; its file name is `path`.
    """
    path = Path(path)
    target = Path(os.path.realpath(path))
    # Short enough for every allowed name, and hidden, so that no pattern for pictures matches it.
    own = f".{path.stem[:40]}.{_HOST}-{os.getpid()}-"
    beside = target.parent / f"{own}{secrets.token_hex(6)}.tmp{path.suffix}"
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        _remove_leftovers(str(target.parent))
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if path.exists() and not path.is_file():  # a rename would replace a device or a pipe
            raise OSError(errno.EINVAL, "it is a device or a pipe: expected a file", str(path))
        # Mode 666 with the user's umask; files of `tempfile` have mode 600.
        os.close(os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
        yield beside
        _flush(beside)
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


def try_path(path: PathLike) -> None:
    """Raise the error that `atomic_path` would raise, before hours of work; the trial leaves no trace.

    Raises
    ------
    OSError
        If the folder cannot be made or written to, or a folder has the file's name.
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
    """Remove files of killed processes from a folder, once; those of other machines and boots if they are a day old."""
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


class _Undone(Exception):  # noqa: N818 (not an error: it ends a trial)
    pass


def _flush(path: Path) -> None:
    """Wait until a file is on the disk: a full network disk reports it only then."""
    file = os.open(path, os.O_RDWR)
    try:
        os.fsync(file)
    finally:
        os.close(file)
