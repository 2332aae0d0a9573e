"""How much memory and how many processors this process may use: of the machine, of its container, by its shell.

A container's limits are those of its control groups (cgroups, of version 1 or 2); a scheduler may bind a process to
some processors; and `ulimit` limits addresses and data. The system ends a process that uses more memory.
"""

from __future__ import annotations

import errno
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

# Bytes of addresses that the libraries take, mostly for code and for the stacks of threads; measured: 2.0 GiB.
_LIBRARIES = 9 << 28
#: The same for commands that render nothing: NumPy and OpenImageIO; measured: 0.24 GiB.
LEAST = 3 << 27

_GROUPS = Path("/proc/self/cgroup")  # lines "number:controllers:folder"; of version 2, without controllers
_ROOT = Path("/sys/fs/cgroup")


def processors() -> int:
    """Return the number of processors that this process may use; a part of one counts as one."""
    bound = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    times = [text.split() for text in _texts("", "cpu.max")]  # microseconds of a period, and the period
    periods = _texts("cpu", "cpu.cfs_period_us")
    quotas = _texts("cpu", "cpu.cfs_quota_us")
    times += [[*quota.split(), *period.split()] for quota, period in zip(quotas, periods, strict=False)]
    shares = [-(-int(each[0]) // int(each[1])) for each in times if len(each) == 2 and each[0].isdecimal()]
    return max(min([bound, *shares]), 1)


def memory() -> int | None:
    """Return how many bytes this process may use: the machine's memory, or less by a limit; None: unknown."""
    groups = [*_texts("", "memory.max"), *_texts("memory", "memory.limit_in_bytes")]  # "max": there is no limit
    found = [_pages("SC_PHYS_PAGES"), *_limits(), *(int(each) for each in groups if each.strip().isdecimal())]
    return min((each for each in found if each is not None), default=None)


def free_memory() -> int | None:
    """Return how many bytes of the machine's memory are free; None if the system does not tell."""
    return _pages("SC_AVPHYS_PAGES")


def check_address_space(more: int = 0, libraries: int = _LIBRARIES) -> None:
    """Raise OSError if the limit of virtual memory leaves no room for the libraries and `more` bytes."""
    limit, needed = next(_limits(), None), libraries + more
    if limit is not None and limit < needed:
        found, wanted = (f"{each / 2**30:.3g} GiB" for each in (limit, needed))
        smaller = ", or a smaller --res" if more and limit >= libraries else ""
        text = f"the limit of virtual memory (ulimit -v) is {found}: expected at least {wanted}{smaller}"
        raise OSError(errno.ENOMEM, text)


def check_working_folder() -> None:
    """Raise OSError if the working folder was deleted: Mitsuba asks for it while it is imported, and crashes."""
    try:
        os.getcwd()
    except OSError as error:
        raise OSError(error.errno, "the working folder is not there: expected one that exists") from None


@contextmanager
def bounded(more: int) -> Iterator[None]:
    """Let this process take at most so many bytes more within the context; libraries then raise errors of their own.

    Linux alone has such a bound. Threads may enter it at the same time: the last bound holds until all have left it.
    """
    with _DataLimit.lock:
        _DataLimit.entered += 1
        if _DataLimit.entered == 1:
            _DataLimit.before = resource.getrlimit(resource.RLIMIT_DATA) if resource else None
        used = _data()
        if used is not None and _DataLimit.before is not None:
            _set_data_limit(min(used + more, _DataLimit.before[0]) if _DataLimit.before[0] >= 0 else used + more)
    try:
        yield
    finally:
        with _DataLimit.lock:
            _DataLimit.entered -= 1
            if not _DataLimit.entered and _DataLimit.before is not None:
                _set_data_limit(_DataLimit.before[0])


class _DataLimit:
    """How often the context is entered, and the limits before."""

    lock = threading.Lock()
    entered = 0
    before: tuple[int, int] | None = None


def _set_data_limit(limit: int) -> None:
    assert _DataLimit.before is not None
    with suppress(ValueError, OSError):  # of systems that let no process set it
        resource.setrlimit(resource.RLIMIT_DATA, (limit, _DataLimit.before[1]))


def _data() -> int | None:
    """Return how many bytes of data this process has; None if the system does not tell."""
    pages = _read(Path("/proc/self/statm")).split()
    return int(pages[5]) * os.sysconf("SC_PAGE_SIZE") if len(pages) > 5 else None


def _limits() -> Iterator[int | None]:
    """Yield the limits of addresses and of data in bytes, None where there is none."""
    for kind in (resource.RLIMIT_AS, resource.RLIMIT_DATA) if resource else ():
        limit, _ = resource.getrlimit(kind)
        yield None if limit == resource.RLIM_INFINITY else limit


def _pages(name: str) -> int | None:
    try:
        return os.sysconf(name) * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return None


def _texts(controller: str, name: str) -> Iterator[str]:
    """Yield what the files of this name hold in the control groups of this process, and in those around them.

    Without a controller they are of version 2. In a container the group's folder may be one of the machine, which is
    not there; then only the outermost is, which is the container's own.
    """
    for line in _read(_GROUPS).splitlines():
        _, controllers, folder = (*line.split(":", 2), "", "")[:3]
        if controller not in controllers.split(","):
            continue
        inner = _ROOT / controller / folder.strip().lstrip("/")
        for group in (inner, *inner.parents):
            if group.is_relative_to(_ROOT) and (text := _read(group / name)):
                yield text


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
