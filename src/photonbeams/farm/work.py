"""The code that runs on the workers of a farm: open the scene once, render passes of a frame, return their sums."""

from __future__ import annotations

import gc
import platform
import threading
from collections.abc import Callable, Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any, TypeVar

from ..scene import Array

T = TypeVar("T")  # what a scene is opened by

_KEPT: dict[str, Any] = {}  # the last scene, by the key of the run
_ONE = threading.Lock()  # a part uses all threads of its worker

#: Packages whose versions must be the same on all machines, or pictures differ.
PACKAGES = ("photonbeams", "mitsuba", "drjit", "usd-core", "numpy")


#: An open scene: a function of a frame, a range of passes and a planned number that returns the state of their sums.
Opened = Callable[[int, range, "int | None"], dict[str, Array]]


class WorkerError(Exception):
    """A worker cannot do its work; the message says why, in one sentence."""


class MachineError(WorkerError):
    """A worker's machine lacks something that others may have."""


@cache
def versions() -> dict[str, str]:
    """Return the versions on this machine on which pictures depend."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "missing"
    return found


def threads_here() -> int | None:
    """Return the number of threads that Dask gives this worker, or None outside a worker."""
    from distributed import get_worker

    try:
        return int(get_worker().state.nthreads)
    except (ValueError, AttributeError):
        return None


def render_part(
    open_scene: Callable[[T], Opened], request: T, key: str, expected: Mapping[str, str], frame: int,
    numbers: range, planned: int | None,
) -> dict[str, Array]:  # fmt: skip
    """Render some passes of a frame, and return the state of their sums.

    The scene stays open under `key`, with its textures and kernels, for further parts of the same run. MachineError if
    this machine lacks something or has other versions than expected; WorkerError if the frame cannot be rendered.
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
                gc.collect()  # otherwise layers of the last scene stay in OpenUSD's registry and are not read again
                _KEPT[key] = open_scene(request)
            return _KEPT[key](frame, numbers, planned)
        except OSError as error:
            reason = error.strerror or str(error)
            raise MachineError(f"{error.filename}: {reason}" if error.filename is not None else reason) from None
        except ImportError as error:
            raise MachineError(f"lacks what it needs: {error}") from None
        except MemoryError:
            raise WorkerError("does not have enough memory for this many beams and pixels") from None
        except (ValueError, RuntimeError) as error:  # also SceneError and DeviceError
            text = " ".join(str(error).split())[:300]
            if "out of memory" in text:
                text = "does not have enough memory for this many beams and pixels"
            raise (WorkerError if isinstance(error, ValueError) else MachineError)(text) from None
