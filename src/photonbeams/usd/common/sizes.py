"""Limit a stage to what fits into memory: count what instancers and subdivision make before they make it."""

from __future__ import annotations

from ...scene import SceneError
from .openusd import Usd, UsdGeom
from .reading import Reading, file_of

#: The most prims of a stage, counting those in every instance: reading one takes about a millisecond.
MOST_PRIMS = 10_000_000
#: The most instances of one instancer: OpenUSD makes a matrix of 128 bytes for each.
MOST_INSTANCES = 10_000_000
#: The overhead of a mesh, as the number of triangles that take as much memory.
MESH = 25
_BYTES = 800  # peak resident memory for each triangle of a render of 11 million, including what rays meet them by
_UNKNOWN = 64 * 2**30  # memory to assume if the system does not tell


def room() -> int:
    """Return how many triangles fit into the machine's memory."""
    from ...runtime.device import memory  # Dr.Jit takes long to import

    return (memory() or _UNKNOWN) // _BYTES


def check_prims(stage: Usd.Stage) -> None:
    """Raise SceneError for a stage whose instances add up to more prims than can be read."""
    sizes: dict[Usd.Prim, int] = {}

    def size(root: Usd.Prim) -> int:
        if root not in sizes:
            sizes[root] = sum(
                1 + (size(prim.GetPrototype()) if prim.IsInstance() else 0) for prim in Usd.PrimRange(root)
            )
        return sizes[root]

    total = size(stage.GetPseudoRoot()) if stage.GetPrototypes() else 0
    if total > MOST_PRIMS:
        text = f"has {total:,} prims in instances: expected no more than {MOST_PRIMS:,}; a mask can select some of them"
        raise SceneError(f"{file_of(stage)} {text}")


def triangles_about(reading: Reading, prim: Usd.Prim) -> int:
    """Estimate how many triangles a gprim has, reading only the lengths of its arrays."""

    def length(name: str) -> int:
        value = reading.value(prim, name, ())
        return len(value) if hasattr(value, "__len__") else 0

    if prim.IsA(UsdGeom.Mesh):
        return length("faceVertexIndices")
    return 24 * length("points") if prim.IsA(UsdGeom.PointBased) else 4096


def step_of(total: int, left: int) -> int:
    """Return n, so that every n-th part of `total` makes no more than `left`."""
    return -(-total // max(left, 1)) if total > left else 1


def lowered(level: int, corners: int, left: int) -> int:
    """Return the highest level of subdivision, up to `level`, at which there are no more than `left` triangles.

    Each of the `corners` becomes a quad at the first level, and each quad becomes four at the next.
    """
    return next((each for each in range(level, 0, -1) if 2 * corners * 4 ** (each - 1) <= left), 0)
