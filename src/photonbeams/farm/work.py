"""What runs on the workers of a farm: open the scene once, render some passes of a frame, return their sums."""

from __future__ import annotations

import platform
import threading
import time
from collections.abc import Callable, Mapping
from importlib.metadata import PackageNotFoundError, version
from typing import Any, Protocol

from ..scene import Array

_KEPT: dict[str, Any] = {}  # the last scene, by the request's key
_ONE = threading.Lock()  # a part uses all threads of its worker

#: Whose versions must be the same for pictures to be.
PACKAGES = ("photonbeams", "mitsuba", "drjit", "usd-core", "numpy")


class Opened(Protocol):
    """An open scene: returns the state of the sums of some passes of a frame."""

    def __call__(self, frame: int, numbers: range, planned: int | None) -> dict[str, Array]:
        """Render passes `numbers` of a frame; `planned` is that of `FrameSums`."""


class WorkerError(Exception):
    """What a worker cannot do; its text is a sentence for the user."""


def versions() -> dict[str, str]:
    """Return the versions of this machine that pictures depend on."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "missing"
    return found


def render_part(
    open_scene: Callable[[Any], Opened], request: Any, key: str, expected: Mapping[str, str], frame: int,
    numbers: range, planned: int | None,
) -> tuple[dict[str, Array], float]:  # fmt: skip
    """Return the state of some passes' sums, and the seconds that they took.

    The scene of the last request stays open, with its textures and kernels.

    Raises
    ------
    WorkerError
        What this machine cannot open or render, in one sentence.
    """
    with _ONE:
        begin = time.perf_counter()
        own = versions()
        other = [f"{name} {own[name]}" for name in own if own[name] != expected.get(name)]
        if other:
            here = ", ".join(f"{name} {expected.get(name)}" for name in own if own[name] != expected.get(name))
            raise WorkerError(f"has {', '.join(other)}: expected {here}")
        try:
            if key not in _KEPT:
                _KEPT.clear()
                _KEPT[key] = open_scene(request)
            return _KEPT[key](frame, numbers, planned), time.perf_counter() - begin
        except OSError as error:
            reason = error.strerror or str(error)
            raise WorkerError(f"{error.filename}: {reason}" if error.filename is not None else reason) from None
        except (ValueError, RuntimeError, MemoryError) as error:  # also SceneError and DeviceError
            raise WorkerError(" ".join(str(error).split())[:300]) from None
