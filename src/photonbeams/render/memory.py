"""How much memory a pass takes, and a check that the machine has it."""

from __future__ import annotations

import drjit as dr

from ..runtime import device
from ..runtime.limits import memory
from ..scene import SceneError
from ..world.cameras.cameras import Window

# Bytes at the peak of a pass on the CPU, measured as resident memory of renders of 2 to 8 million pixels and 1 to 3
# million beams; and of a million pixels with 30 light groups, for each group's layers of a pixel.
PIXEL_BYTES, BEAM_BYTES, GROUP_BYTES = 500, 1450, 250

_MOST_ENTRIES = 1 << 32  # in an array of Dr.Jit


# Pictures with at least this many pixels give memory back between the parts of a pass. Dr.Jit keeps free memory for
# arrays of the same size, which is faster; but for large pictures this takes as much memory again as the picture.
_LARGE = 1 << 20


def release_memory(size: tuple[int, int]) -> None:
    """Return the memory that Dr.Jit keeps for later to the system, if the picture is large."""
    if size[0] * size[1] >= _LARGE:
        dr.flush_malloc_cache()


def check_memory(window: Window, beams: int, groups: int = 0) -> int:
    """Return how many bytes a pass takes; SceneError if there are fewer: the system would kill it without a message.

    `groups` is how many light groups have layers of their own. On CUDA Dr.Jit raises an error itself.
    """
    height, width = window.shape
    expected = "expected fewer, or a part of the picture with --crop"
    if 3 * width * height >= _MOST_ENTRIES:
        most = f"{_MOST_ENTRIES // 3:,}"
        raise SceneError(f"{width} x {height} pixels are more than {most} at a time: {expected}")
    needed = (PIXEL_BYTES + GROUP_BYTES * groups) * width * height + BEAM_BYTES * beams
    present = memory()
    if device.backend() == "llvm" and present is not None and needed > present:
        layers = f" of {groups} light groups" if groups else ""
        raise SceneError(
            f"{width} x {height} pixels{layers} and {beams:,} beams take {needed / 2**30:,.0f} GiB, and this machine "
            f"has {present / 2**30:,.0f}: {expected}"
        )
    return needed
