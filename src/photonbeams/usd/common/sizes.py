"""Limit a stage to what fits into memory: count what instancers and subdivision make before they make it."""

from __future__ import annotations

from ...runtime.limits import memory

#: The most instances of one instancer: OpenUSD makes a matrix of 128 bytes for each.
MOST_INSTANCES = 10_000_000
#: The overhead of a mesh, as the number of triangles that take as much memory.
MESH = 25
_BYTES = 800  # peak resident memory for each triangle of a render of 11 million, including what rays meet them by
_UNKNOWN = 64 * 2**30  # memory to assume if the system does not tell


def room() -> int:
    """Return how many triangles fit into the machine's memory."""
    return (memory() or _UNKNOWN) // _BYTES


def step_of(total: int, left: int) -> int:
    """Return n, so that every n-th part of `total` makes no more than `left`."""
    return -(-total // max(left, 1)) if total > left else 1


def lowered(level: int, corners: int, left: int) -> int:
    """Return the highest level of subdivision, up to `level`, at which there are no more than `left` triangles.

    Each of the `corners` becomes a quad at the first level, and each quad becomes four at the next.
    """
    return next((each for each in range(level, 0, -1) if 2 * corners * 4 ** (each - 1) <= left), 0)
