"""Open files that users and scenes name: whatever a path leads to, opening it neither waits nor takes all memory.

A path may lead to a pipe or a device, which have no end, and opening one may block forever. So every reader asks
`why_unreadable` before it hands a path to another library, or reads by `opened` and `content` itself. What a reader
would allocate is compared with `check_size` before it is allocated, because a small file may claim to be huge.
"""

from __future__ import annotations

import os
import stat
import warnings
import zlib
from collections.abc import Iterator
from contextlib import suppress
from errno import EACCES
from io import BytesIO
from typing import BinaryIO
from zipfile import ZIP_DEFLATED, ZIP_STORED, BadZipFile, ZipFile

import numpy as np

from ..scene import Array, SceneError
from .files import PathLike
from .limits import memory

#: Bytes of files of text that is read as a whole, such as scenes in XML.
MOST_TEXT = 1 << 28

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)
_UNITS = ((1 << 30, "GiB"), (1 << 20, "MiB"), (1 << 10, "KiB"), (1, "bytes"))
# How a file begins that stands for another one in a repository, and its most bytes.
_POINTER = b"version https://git-lfs.github.com/spec/"
_MOST_POINTER = 1024
# Archives of arrays may be compressed, and regular numbers by much; what is small may be so by any factor.
_SMALL, _MOST_COMPRESSED = 1 << 28, 64


def why_unreadable(path: PathLike, most: int | None = None) -> str:
    """Return why a path cannot be read as a file, such as "it is a named pipe"; "" if it can be.

    An empty file cannot be read either, nor one of more than `most` bytes. Call this before another library opens a
    file that a user or a scene names.
    """
    try:
        status = os.stat(path)
    except (OSError, ValueError) as error:
        return _cause(error)
    if problem := _wrong(status, most) or ("" if os.access(path, os.R_OK) else os.strerror(EACCES)):
        return problem
    if status.st_size > _MOST_POINTER:
        return ""
    with suppress(OSError), open(path, "rb") as file:
        if file.read(len(_POINTER)) == _POINTER:
            return "it is a pointer of Git LFS: expected the file itself, which `git lfs pull` brings"
    return ""


def problem_of(path: PathLike, most: int | None = None) -> str:
    """Return what `why_unreadable` does; raise the system's own error if there is no file, or it may not be read."""
    problem = why_unreadable(path, most)
    if problem and not (is_special(path) or os.path.isdir(path)):
        with suppress(ValueError):  # a name that no file has
            open(path, "rb").close()
    return problem


def is_special(path: PathLike) -> str:
    """Return what a path leads to, such as "it is a named pipe"; "" for files, folders, and if there is nothing."""
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):
        return ""
    return "" if stat.S_ISREG(mode) or stat.S_ISDIR(mode) else _kind(mode)


def opened(path: PathLike, most: int | None = None) -> BinaryIO:
    """Return a file, opened for reading; raise SceneError, a clause about the file, as `why_unreadable`."""
    if problem := why_unreadable(path, most):
        raise SceneError(problem)
    try:
        # Without waiting, in case that another process has replaced the file by a pipe meanwhile.
        number = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
        file = os.fdopen(number, "rb")
    except (OSError, ValueError) as error:
        raise SceneError(_cause(error)) from None
    if problem := _wrong(os.fstat(number), most):
        file.close()
        raise SceneError(problem)
    return file


def content(path: PathLike, most: int = MOST_TEXT) -> bytes:
    """Return the bytes of a file; raise SceneError as `opened` does."""
    with opened(path, most) as file:
        try:
            data = file.read(most + 1)
        except OSError as error:
            raise SceneError(_cause(error)) from None
    check_size(len(data), most, "its content")
    return data


def check_size(size: float, most: float, what: str) -> None:
    """Raise SceneError, a clause about a file, if `what` takes more than `most` bytes, or more than the memory here."""
    if size > most:
        raise SceneError(f"{what} takes {_bytes(size)}: expected up to {_bytes(most)}")
    here = memory()
    if here is not None and size > here:
        raise SceneError(f"{what} takes {_bytes(size)}: expected up to {_bytes(here)}, the memory here")


def arrays(path: PathLike) -> dict[str, Array]:
    """Return the arrays in a NumPy archive (.npz) by name: numbers, truth values and text, read-only.

    Every checksum is verified, and sizes are checked before memory is allocated.

    Raises
    ------
    SceneError
        As `opened`; a file that is no such archive, or a damaged one; the message is a clause about the file.
    """
    with opened(path) as file:
        try:
            with ZipFile(file) as archive:
                size = sum(each.file_size for each in archive.infolist())
                check_size(size, max(_SMALL, _MOST_COMPRESSED * os.fstat(file.fileno()).st_size), "what it holds")
                return dict(_arrays(archive))
        except SceneError:
            raise
        except (BadZipFile, NotImplementedError, RuntimeError, OSError, EOFError, ValueError, zlib.error) as error:
            raise SceneError(f"it is damaged, or no archive of arrays ({' '.join(str(error).split())[:80]})") from None


def _arrays(archive: ZipFile) -> Iterator[tuple[str, Array]]:
    names = archive.namelist()
    for name in names:
        if not name.endswith(".npy") or names.count(name) > 1:
            raise SceneError(f"it has the member {name[:60]!r}: expected arrays (.npy), each once")
        member = archive.getinfo(name)
        if member.compress_type not in (ZIP_STORED, ZIP_DEFLATED) or member.flag_bits & 1:
            raise SceneError(f"its member {name[:60]!r} is encrypted, or compressed in an unknown way")
        yield name.removesuffix(".npy"), _array(archive.read(name), name)


def _array(data: bytes, name: str) -> Array:
    """Return the array in the bytes of a .npy file."""
    stream = BytesIO(data)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Python's parser reads the header, and warns of odd literals
            values: Array = np.lib.format.read_array(stream)  # without pickles
    except (ValueError, KeyError, SyntaxError, TypeError, OverflowError, RecursionError, MemoryError):
        raise SceneError(f"its member {name[:60]!r} cannot be read") from None
    if values.dtype.kind not in "biufU":
        raise SceneError(f"its member {name[:60]!r} holds {str(values.dtype)[:40]}: expected numbers or text")
    if stream.read(1):
        raise SceneError(f"its member {name[:60]!r} is not as long as it says")
    values.flags.writeable = False
    return values


def _cause(error: OSError | ValueError) -> str:
    if isinstance(error, FileNotFoundError):
        return "there is no such file"
    return getattr(error, "strerror", None) or str(error)


def _kind(mode: int) -> str:
    return next((f"it is {name}" for test, name in _KINDS if test(mode)), "it is no file")


def _wrong(status: os.stat_result, most: int | None) -> str:
    """Return what makes a file with this status unreadable, or ""."""
    if not stat.S_ISREG(status.st_mode):
        return _kind(status.st_mode)
    if not status.st_size:  # also files of the kernel, which may have no end
        return "it is empty"
    if most is not None and status.st_size > most:
        return f"it has {_bytes(status.st_size)}: expected up to {_bytes(most)}"
    return ""


def _bytes(size: float) -> str:
    unit, name = next(each for each in _UNITS if size >= each[0] or each[0] == 1)
    return f"{size / unit:,.4g} {name}"
