"""Limits that the system sets for a process: beyond them, libraries crash or hang instead of raising an error."""

from __future__ import annotations

import errno

# Bytes of addresses that the libraries take, mostly for code and for the stacks of threads; measured: 2.0 GiB.
_LIBRARIES = 9 << 28


def check_address_space(more: int = 0) -> None:
    """Raise OSError if the limit of virtual memory leaves no room for the libraries and `more` bytes."""
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
