"""`photonbeams doctor`: what this machine can render with, and what is wrong if it cannot render."""

from __future__ import annotations

import os
import platform
import signal
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version

import typer

from .progress import standard_output, table_of

_PACKAGES = ("photonbeams", "mitsuba", "drjit", "usd-core", "OpenEXR", "OpenImageIO", "mitsuba-oidn", "numpy", "scipy")

# Traces one ray against a sphere, 2 away, and ends in the maximum that LLVM 15 cannot compile for AVX-512.
# With a home folder of its own, Dr.Jit compiles the kernel instead of loading it from its cache.
_TRIAL = """
import os, sys, tempfile
from photonbeams.runtime import device
with tempfile.TemporaryDirectory() as home:
    os.environ["HOME"] = home
    import OpenEXR, OpenImageIO, drjit, numpy
    mitsuba = device.mitsuba()
    print(device.backend(), flush=True)
    scene = mitsuba.load_dict({"type": "scene", "ball": {"type": "sphere"}})
    x = drjit.opaque(mitsuba.Float, 0, 64)
    hit = scene.ray_intersect_preliminary(mitsuba.Ray3f(mitsuba.Point3f(x, 0, -3), mitsuba.Vector3f(0, 0, 1)))
    distance = drjit.maximum(hit.t, x).numpy()
if not numpy.allclose(distance, 2, atol=1e-4):
    sys.exit(f"a ray met a sphere at {distance[0]:g} instead of 2")
"""


def doctor() -> None:
    """Show what this machine can render with, and what is wrong if it cannot render.

    A small kernel is compiled and run as a test. The exit code is 1 if the machine cannot render.
    """
    from ..runtime import device

    problem, crashed = trial()
    try:
        if not crashed:  # a library that has just killed a child process must not be loaded into this one
            device.select()
    except device.DeviceError as error:
        problem = str(error)
    console = standard_output()
    console.print(table_of(None, rows()))
    console.print()
    if problem is None:
        console.print(
            "This machine can render: a test kernel compiled, ran, and gave the right answer.", soft_wrap=True
        )
        return
    console.print(f"This machine cannot render: {problem}.", soft_wrap=True)
    raise typer.Exit(1)


def trial() -> tuple[str | None, bool]:
    """Run a kernel in a child process; return what is wrong (or None), and whether a signal ended the child."""
    child = subprocess.run([sys.executable, "-c", _TRIAL], capture_output=True, text=True, check=False)
    if child.returncode == 0:
        return None, False
    if child.returncode > 0:
        reason = (child.stderr.strip().splitlines() or ["no reason given"])[-1]
        return f"the test kernel failed: {reason.removeprefix('photonbeams.runtime.device.DeviceError: ')}", False
    library = os.environ.get("DRJIT_LIBLLVM_PATH", "libLLVM")
    ending = signal.Signals(-child.returncode).name
    if child.stdout.strip() == "cuda":
        return f"the test kernel ended in {ending} on CUDA: set PHOTONBEAMS_DEVICE=cpu, or try another driver", True
    return f"the test kernel ended in {ending} with {library}: set DRJIT_LIBLLVM_PATH to another libLLVM", True


def rows() -> Iterator[tuple[str, str]]:
    """Yield the rows of the table, each a name and a value."""
    from ..runtime import device, libllvm, limits
    from ..usd.common.openusd import plugin_problem

    yield "Python", f"{platform.python_version()} ({sys.executable})"
    yield "Platform", platform.platform()
    yield "Processors", f"{limits.processors()}"
    yield "Memory", f"{_gibibytes(limits.memory())}, {_gibibytes(limits.free_memory())} of it free"
    for package in _PACKAGES:
        try:
            yield package, version(package)
        except PackageNotFoundError:
            yield package, "not installed"
    yield "OpenUSD plug-ins", plugin_problem() or "usable"
    yield "", ""
    yield from device.running().items()
    yield "libLLVM", device.library()
    yield "CUDA", device.cuda_problem() or "usable"
    for candidate in libllvm.candidates():
        known = ".".join(map(str, candidate.version)) or "unknown version"
        yield "Found", f"{candidate.path}, {known}: {candidate.problem or 'accepted'}"


def _gibibytes(size: int | None) -> str:
    return "unknown" if size is None else f"{size / 2**30:.1f} GiB"
