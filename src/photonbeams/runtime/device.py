"""The processor that runs the kernels: a working libLLVM, or CUDA, chosen before Dr.Jit is first imported.

Dr.Jit loads libLLVM while it is imported, and takes the library that it finds. It refuses version 14, and versions 15
and 16 abort the process on AVX-512 machines ("Cannot select: fmaximum"). So `prepare`, which `import photonbeams`
calls, looks for a working library and sets DRJIT_LIBLLVM_PATH to it. A value that the user has set is kept.

The array types `Float`, `UInt32`, `Int32`, `Int64`, `Bool`, `Array2f`, `Array3f` and `Array4f` of the chosen backend
are attributes of this module. The first use of one of them starts the backend; call `select` earlier to choose it.
"""

from __future__ import annotations

import ctypes
import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from glob import glob
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import libllvm
from .limits import check_working_folder, processors

if TYPE_CHECKING:
    from drjit.auto.ad import Array2f, Array3f, Array4f, Bool, Float, Int32, Int64, UInt32, UInt64

__all__ = [
    "Array2f", "Array3f", "Array4f", "Bool", "DeviceError", "Float", "Int32", "Int64", "UInt32", "UInt64", "backend",
    "check_recording", "kept_variant", "mitsuba", "mitsuba_variant", "prepare", "scene_variants", "select",
    "set_threads", "uncollected",
]  # fmt: skip

_ARRAY_TYPES = ("Array2f", "Array3f", "Array4f", "Bool", "Float", "Int32", "Int64", "UInt32", "UInt64")


class DeviceError(RuntimeError):
    """The machine cannot run the kernels as requested; the message is one sentence for the user."""


@dataclass
class _State:
    """The device of this process; Dr.Jit can be started only once."""

    backend: str | None = None
    library: str | None = None  # the value that prepare() has given to DRJIT_LIBLLVM_PATH
    types: dict[str, Any] = field(default_factory=dict)


_state = _State()


def prepare() -> None:
    """Set DRJIT_LIBLLVM_PATH to a working libLLVM, unless it is set or Dr.Jit is imported already."""
    if "drjit" in sys.modules:
        return
    path = os.environ.get("DRJIT_LIBLLVM_PATH")
    if not path and (path := libllvm.best()):
        os.environ["DRJIT_LIBLLVM_PATH"] = _state.library = path
    if path:
        libllvm.load_runtime(path)


@cache
def cuda_problem() -> str | None:
    """Return why CUDA cannot be used, or None. Ray tracing of meshes needs OptiX, which some drivers lack."""
    windows = sys.platform == "win32"
    try:
        driver = ctypes.CDLL(os.environ.get("DRJIT_LIBCUDA_PATH") or ("nvcuda.dll" if windows else "libcuda.so.1"))
        count = ctypes.c_int()
        if driver.cuInit(0) != 0 or driver.cuDeviceGetCount(ctypes.byref(count)) != 0 or count.value == 0:
            return "the NVIDIA driver reports no usable GPU"
    except (OSError, AttributeError):
        return "no NVIDIA driver was found"
    if windows or glob("/usr/lib/wsl/lib/libnvoptix*"):
        return None
    try:
        ctypes.CDLL(os.environ.get("DRJIT_LIBOPTIX_PATH") or "libnvoptix.so.1")
    except OSError:
        return "the NVIDIA driver lacks OptiX (libnvoptix.so.1)"
    return None


def _wanted(name: str | None) -> str | None:
    """Return "llvm" or "cuda" for the name of a device, or None for "auto"."""
    if name in (None, "auto"):
        name = os.environ.get("PHOTONBEAMS_DEVICE") or "auto"
    backends = {"auto": None, "cpu": "llvm", "cuda": "cuda"}
    if name not in backends:
        raise DeviceError(f"device is {name!r}: expected auto, cpu or cuda")
    return backends[name]


def _automatic() -> str:
    """Return the backend on which Mitsuba already runs in this process; else CUDA if it is usable, else LLVM."""
    mitsuba_module = sys.modules.get("mitsuba")
    variant = str(mitsuba_module.variant()) if mitsuba_module else ""
    if variant.startswith(("llvm_", "cuda_")):
        return variant[:4]
    return "llvm" if cuda_problem() else "cuda"


def select(name: str | None = None) -> None:
    """Choose the device and start it.

    Parameters
    ----------
    name
        "cpu" (LLVM), "cuda", or "auto": the device in the environment variable PHOTONBEAMS_DEVICE, else CUDA if there
        is a usable NVIDIA driver, else LLVM. Once a device is started, "auto" stands for that device.

    Raises
    ------
    DeviceError
        If the device does not exist, or another device has been started in this process.
    """
    wanted = _wanted(name)
    if _state.backend is None:
        _start(wanted or _automatic())
    elif name not in (None, "auto") and wanted != _state.backend:
        raise DeviceError(
            f"device is {name}, but the {_state.backend} backend was already started in this process; "
            "select the device before anything else is used"
        )


def _start(name: str) -> None:
    """Import Dr.Jit with the backend `name` and keep its array types."""
    check_working_folder()
    prepare()
    if name == "cuda" and (problem := cuda_problem()):
        raise DeviceError(f"device is cuda, but {problem}")
    if name == "llvm" and "drjit" not in sys.modules and not os.environ.get("DRJIT_LIBLLVM_PATH"):
        raise DeviceError(_no_library())
    drjit = _import_drjit()
    if name == "llvm":
        check_library()
        drjit.set_thread_count(min(drjit.thread_count(), processors()))
    if not drjit.has_backend(getattr(drjit.JitBackend, name.upper())):
        raise DeviceError(_no_backend(name))
    module = import_module(f"drjit.{name}.ad")
    _state.types = {array: getattr(module, array) for array in _ARRAY_TYPES}
    _state.backend = name


def check_library() -> None:
    """Raise DeviceError if Dr.Jit has taken a libLLVM by itself whose kernels end the process on some machines.

    Nothing can give it another one: it has loaded the library while it was imported, and is not started a second time.
    """
    if not os.environ.get("DRJIT_LIBLLVM_PATH") and _import_drjit().detail.llvm_version()[0] < libllvm.OLDEST:
        raise DeviceError(
            "Dr.Jit was imported before photonbeams and took no LLVM that works on all machines: expected a new "
            "process that imports photonbeams before Mitsuba, or DRJIT_LIBLLVM_PATH"
        )


def _import_drjit() -> Any:
    """Return the module `drjit`; its wheel links libatomic, which small Debian systems lack."""
    try:
        return import_module("drjit")
    except (ImportError, NameError) as error:  # a NameError, raised while it handles the ImportError
        cause = error.__context__ or error
        raise DeviceError(
            f"Dr.Jit does not load ({cause}); if libatomic.so.1 is missing, install the package libatomic1"
        ) from error


def _no_library() -> str:
    """Return the message for a machine without a working libLLVM."""
    found = "; ".join(f"{candidate.path}: {candidate.problem}" for candidate in libllvm.candidates())
    return f"no working libLLVM was found{f' ({found})' if found else ''}: {libllvm.INSTALL_HINT}"


def _no_backend(name: str) -> str:
    """Return the message for a backend that Dr.Jit could not start."""
    if name == "cuda":
        return "device is cuda, but Dr.Jit could not start CUDA: the NVIDIA driver may be too old for it"
    path = os.environ.get("DRJIT_LIBLLVM_PATH")
    if path and path != _state.library:
        return f"DRJIT_LIBLLVM_PATH names {path}, which Dr.Jit could not start; unset it to use one that works"
    return f"Dr.Jit could not start LLVM from {path or 'what it found'}: {libllvm.INSTALL_HINT}"


def __getattr__(name: str) -> Any:
    """Return an array type of the backend, which is started for the first of them."""
    if name not in _ARRAY_TYPES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if _state.backend is None:
        select()
    return _state.types[name]


def backend() -> str:
    """Return "llvm" or "cuda"; start the default device if none is started."""
    if _state.backend is None:
        select()
    assert _state.backend is not None
    return _state.backend


def mitsuba_variant() -> str:
    """Return the Mitsuba variant whose arrays are this module's: "llvm_ad_rgb" or "cuda_ad_rgb"."""
    return f"{backend()}_ad_rgb"


def scene_variants() -> tuple[str, str]:
    """Return the variants of Mitsuba whose scenes can be rendered: `mitsuba_variant` and its monochrome twin."""
    variant = mitsuba_variant()
    return variant, variant.replace("rgb", "mono")


def mitsuba(variant: str | None = None) -> Any:
    """Return the module `mitsuba` with a variant set; None: one of `scene_variants`, the first unless one is set."""
    usual = scene_variants()
    import mitsuba as module

    if module.variant() not in ([variant] if variant else usual):
        module.set_variant(variant or usual[0])
    return module


@contextmanager
def kept_variant() -> Iterator[None]:
    """Give Mitsuba back the variant that it has, at the end of the context or of a function, also after an error."""
    module = sys.modules.get("mitsuba")
    variant = module and module.variant()
    try:
        yield
    finally:
        if module and variant:
            module.set_variant(variant)


def set_threads(count: int) -> None:
    """Run kernels on the CPU with `count` threads; 0 means one for each processor."""
    if count < 0:
        raise DeviceError(f"threads is {count}: expected 0 (all processors) or more")
    backend()
    import drjit

    drjit.set_thread_count(count or processors())


def check_recording() -> None:
    """Raise DeviceError within a function that `drjit.freeze` records: a render in it would end the process."""
    import drjit

    if drjit.flag(drjit.JitFlag.FreezingScope):
        raise DeviceError("a render is within drjit.freeze, which cannot record it: expected a render outside of it")


@contextmanager
def uncollected() -> Iterator[None]:
    """Collect no garbage within the context, in which kernels are recorded.

    Dr.Jit calls a method of a single object directly, and of several by a table. If the surfaces of an earlier picture
    vanish while a kernel is recorded, it has the same function both ways, twice, and libLLVM ends the process.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


@contextmanager
def helping_thread() -> Iterator[None]:
    """Have a second thread within the context, in which Mitsuba reads or writes files.

    Mitsuba leaves parts of OpenEXR files to other threads, and waits forever if there are none.
    """
    import drjit

    backend()
    count = drjit.thread_count()
    try:
        if count < 2:
            drjit.set_thread_count(2)
        yield
    finally:
        if count < 2:
            drjit.set_thread_count(count)


def library() -> str:
    """Return which libLLVM Dr.Jit has and why, or "none"."""
    path = os.environ.get("DRJIT_LIBLLVM_PATH")
    if not path:
        return "none"
    packaged = path == libllvm.packaged_library()
    chosen = f"of the package {libllvm.PACKAGE}" if packaged else "the system's newest that works"
    return f"{path} ({chosen if path == _state.library else 'named by DRJIT_LIBLLVM_PATH'})"


def running() -> dict[str, str]:
    """Return what runs the kernels, in words by name."""
    if _state.backend is None:
        return {"Backend": "none"}
    import drjit

    found = {"Backend": _state.backend}
    if _state.backend == "llvm":
        found["LLVM"] = ".".join(map(str, drjit.detail.llvm_version()))
        found["Vector width"] = f"{_vector_width(drjit) or 'unknown'}"
        found["Threads"] = f"{drjit.thread_count()}"
    return found


def _vector_width(drjit: Any) -> int | None:
    """Return how many floats a vector register holds; Dr.Jit has only a C++ function for it, with a mangled name."""
    try:
        core = ctypes.CDLL(str(next(Path(drjit.__file__).parent.glob("libdrjit-core.*"))))
        return int(core._Z21jit_llvm_vector_widthv())
    except (OSError, AttributeError, StopIteration):
        return None
