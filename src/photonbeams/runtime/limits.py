"""Limits that the system sets for a process: beyond them, libraries crash or hang instead of raising an error."""

from __future__ import annotations

import errno

from .device import memory

# Bytes of addresses that the libraries take, mostly for code and for the stacks of threads; measured: 2.0 GiB.
_LIBRARIES = 9 << 28


#: The same for commands that render nothing: NumPy and OpenImageIO; measured: 0.24 GiB.
LEAST = 3 << 27


def check_address_space(more: int = 0, libraries: int = _LIBRARIES) -> None:
    """Raise OSError if the limit of virtual memory leaves no room for the libraries and `more` bytes."""
    limit, needed = _limit(), libraries + more
    if limit is not None and limit < needed:
        found, wanted = (f"{each / 2**30:.3g} GiB" for each in (limit, needed))
        smaller = ", or a smaller --res" if more and limit >= libraries else ""
        text = f"the limit of virtual memory (ulimit -v) is {found}: expected at least {wanted}{smaller}"
        raise OSError(errno.ENOMEM, text)


def usable_memory() -> int | None:
    """Return how many bytes this process may use at most: the machine's memory, or less by a limit; None: unknown."""
    found = [each for each in (memory(), _limit()) if each is not None]
    return min(found, default=None)


def _limit() -> int | None:
    """Return the limit of virtual memory in bytes, or None if there is none."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if limit == resource.RLIM_INFINITY else limit
