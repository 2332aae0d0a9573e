"""What runs on the workers of a farm: open the scene once, render some passes of a frame, return their sums."""

from __future__ import annotations

import gc
import platform
import threading
from collections.abc import Callable, Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any, Protocol

from ..scene import Array

_KEPT: dict[str, Any] = {}  # the last scene, by the key of the run
_ONE = threading.Lock()  # a part uses all threads of its worker

#: Whose versions must be the same for pictures to be.
PACKAGES = ("photonbeams", "mitsuba", "drjit", "usd-core", "numpy")


class Opened(Protocol):
    """An open scene: returns the state of the sums of some passes of a frame."""

    def __call__(self, frame: int, numbers: range, planned: int | None) -> dict[str, Array]:
        """Render passes `numbers` of a frame; `planned` is that of `FrameSums`."""


class WorkerError(Exception):
    """What a worker cannot do, in one sentence."""


class MachineError(WorkerError):
    """What a worker's machine lacks: others may have it."""


@cache
def versions() -> dict[str, str]:
    """Return the versions of this machine that pictures depend on."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "missing"
    return found


def threads_here() -> int | None:
    """Return how many threads Dask gives this worker; None outside of one."""
    from distributed import get_worker

    try:
        return int(get_worker().state.nthreads)
    except (ValueError, AttributeError):
        return None


def render_part(
    open_scene: Callable[[Any], Opened], request: Any, key: str, expected: Mapping[str, str], frame: int,
    numbers: range, planned: int | None,
) -> dict[str, Array]:  # fmt: skip
    """Return the state of some passes' sums.

    The scene of a run, which `key` names, stays open with its textures and kernels.

    Raises
    ------
    MachineError
        Other versions than expected, or a file or a library that is missing here.
    WorkerError
        What cannot be opened or rendered.
    """
    with _ONE:
        own = versions()
        other = [name for name in own if own[name] != expected.get(name)]
        if other:
            found, wanted = (", ".join(f"{name} {each.get(name)}" for name in other) for each in (own, expected))
            raise MachineError(f"has {found}: expected {wanted}")
        try:
            if key not in _KEPT:
                _KEPT.clear()
                gc.collect()  # or layers of the last scene stay in OpenUSD's registry, and are not read anew
                _KEPT[key] = open_scene(request)
            return _KEPT[key](frame, numbers, planned)
        except OSError as error:
            reason = error.strerror or str(error)
            raise MachineError(f"{error.filename}: {reason}" if error.filename is not None else reason) from None
        except ImportError as error:
            raise MachineError(f"lacks what it needs: {error}") from None
        except MemoryError:
            raise WorkerError("has not enough memory for so many beams and pixels") from None
        except (ValueError, RuntimeError) as error:  # also SceneError and DeviceError
            text = " ".join(str(error).split())[:300]
            if "out of memory" in text:
                text = "has not enough memory for so many beams and pixels"
            raise (WorkerError if isinstance(error, ValueError) else MachineError)(text) from None
