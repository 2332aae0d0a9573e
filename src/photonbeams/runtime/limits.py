"""Limits that the system sets to a process: libraries crash or hang beyond them, instead of saying so."""

from __future__ import annotations

import errno

# Addresses that the libraries take, most of them for code and for the stacks of threads; measured: 2.0 GiB.
_LIBRARIES = 9 << 28


def check_address_space(more: int = 0) -> None:
    """Raise OSError where the limit of virtual memory leaves no room for the libraries and `more` bytes."""
    try:
        import resource
    except ImportError:  # Windows
        return
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    needed = _LIBRARIES + more
    if limit != resource.RLIM_INFINITY and limit < needed:
        found, wanted = (f"{each / 2**30:.3g} GiB" for each in (limit, needed))
        smaller = ", or a smaller --res" if more and limit >= _LIBRARIES else ""
        text = f"the limit of virtual memory (ulimit -v) is {found}: expected at least {wanted}{smaller}"
        raise OSError(errno.ENOMEM, text)
