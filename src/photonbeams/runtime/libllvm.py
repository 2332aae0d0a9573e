"""Find a libLLVM that works with Dr.Jit, without importing Dr.Jit.

On Linux with x86-64, pip installs one with photonbeams: that of the package `karellen-llvm-core`, which comes first. Of
the system's, the newest comes first. Dr.Jit refuses LLVM 14 as too old; versions 15 and 16 abort the process on AVX-512
machines ("Cannot select: fmaximum").
"""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from glob import glob
from importlib import metadata
from pathlib import Path

OLDEST = 17
PACKAGE = "karellen-llvm-core"
INSTALL_HINT = (
    f"on Linux (x86-64) `pip install {PACKAGE}`, on other machines with Debian `apt-get install libllvm19`, with conda "
    "`conda install -c conda-forge libllvm19`, on macOS `brew install llvm`; or set DRJIT_LIBLLVM_PATH to your own"
)

# What the package's libLLVM needs, in the order in which they need each other, in a folder beside it.
_RUNTIME = "x86_64-unknown-linux-gnu"
_RUNTIME_LIBRARIES = ("libunwind.so.1", "libc++abi.so.1", "libc++.so.1")

Version = tuple[int, ...]


@dataclass(frozen=True)
class Candidate:
    """A libLLVM that was found."""

    path: str  # without symbolic links
    version: Version = ()  # from the name or from the library itself; empty if neither tells it
    problem: str | None = None  # why it is refused


def packaged_library() -> str | None:
    """Return the path of the libLLVM that pip has installed, without symbolic links, or None."""
    try:
        files = metadata.files(PACKAGE) or ()
    except metadata.PackageNotFoundError:
        return None
    paths = (os.path.realpath(str(file.locate())) for file in files if _version_in_name(file.name) is not None)
    return next(filter(os.path.isfile, paths), None)


def load_runtime(path: str) -> None:
    """Load what the libLLVM at `path` needs, if the loader would not find it; see `_unlinked`."""
    for library in _unlinked(path):
        with suppress(OSError):  # Dr.Jit then says that the library does not load
            ctypes.CDLL(library)


def _unlinked(path: str) -> list[str]:
    """Return the C++ libraries beside a libLLVM of the package to which there are no links.

    The package's links are made when an interpreter starts, except in a folder that is read-only or in PYTHONPATH. A
    library that is loaded already is found by its own name, without a link.
    """
    folder = Path(path).resolve().parent / _RUNTIME
    return [f"{folder / name}.0" for name in _RUNTIME_LIBRARIES
            if (folder / f"{name}.0").exists() and not (folder / name).exists()]  # fmt: skip


def _library_folders() -> list[str]:
    """Return patterns of the library folders of distributions, virtual environments, conda and Homebrew."""
    prefixes = {sys.prefix, os.environ.get("VIRTUAL_ENV"), os.environ.get("CONDA_PREFIX")} - {None}
    return [
        "/usr/lib/*-linux-gnu", "/usr/lib64", "/usr/lib", "/usr/local/lib",
        "/usr/lib/llvm-*/lib", "/usr/lib/llvm*/lib64",
        *(f"{prefix}/lib" for prefix in sorted(map(str, prefixes))),
        "/opt/homebrew/opt/llvm*/lib", "/usr/local/opt/llvm*/lib",
    ]  # fmt: skip


def _library_paths() -> Iterator[str]:
    """Yield every path that may be a libLLVM, in no particular order and with repetitions."""
    for folder in _library_folders():
        yield from glob(f"{folder}/libLLVM*")
    ldconfig = shutil.which("ldconfig", path=f"{os.environ.get('PATH', '')}:/sbin:/usr/sbin")
    if ldconfig and sys.platform == "linux":
        listing = subprocess.run([ldconfig, "-p"], capture_output=True, text=True, check=False).stdout
        yield from re.findall(r"=> (\S*/libLLVM\S*)", listing)


def _version_in_name(path: str) -> Version | None:
    """Return the version in a file name, () if it has none, or None if it is not the name of a libLLVM.

    >>> _version_in_name("libLLVM-17.so.1"), _version_in_name("libLLVM.so.22.1"), _version_in_name("libLLVM.dylib")
    ((17,), (22, 1), ())
    """
    match = re.fullmatch(r"libLLVM(?:-([\d.]+))?\.(?:so|dylib)(?:\.([\d.]+))?", os.path.basename(path))
    if match is None:
        return None
    return tuple(int(part) for part in (match[1] or match[2] or "").split(".") if part)


_PROBE = """
import ctypes, sys
for needed in sys.argv[2:]:
    ctypes.CDLL(needed)
library = ctypes.CDLL(sys.argv[1])
library.LLVMRunPasses, library.LLVMOrcCreateLLJIT
version = [ctypes.c_uint() for _ in range(3)]
library.LLVMGetVersion(*map(ctypes.byref, version))
print(*(number.value for number in version))
"""


def _probe(path: str) -> Candidate:
    """Load a library in a child process and read its version: a truncated library kills its process with SIGBUS."""
    # In Blender or Houdini, sys.executable is the application, which must not be started a second time.
    python = sys.executable if Path(sys.executable or "").name.startswith("python") else shutil.which("python3")
    if python is None:
        return Candidate(path, _version_in_name(path) or ())
    command = [python, "-I", "-S", "-c", _PROBE, path, *_unlinked(path)]
    child = subprocess.run(command, capture_output=True, text=True, check=False)
    if child.returncode == 0:
        return _judged(Candidate(path, tuple(map(int, child.stdout.split()))))
    reason = (child.stderr.strip().splitlines() or [f"damaged, the process ends with status {child.returncode}"])[-1]
    return Candidate(path, _version_in_name(path) or (), f"it does not load: {reason}")


def _judged(candidate: Candidate) -> Candidate:
    """Return the candidate, with a problem if its version is too old."""
    if not candidate.version or candidate.version[0] >= OLDEST:
        return candidate
    problem = "too old for Dr.Jit" if candidate.version[0] < 15 else "aborts on AVX-512 machines"
    return Candidate(candidate.path, candidate.version, f"{problem}; {OLDEST} or newer is needed")


@cache
def candidates() -> tuple[Candidate, ...]:
    """Return all libLLVMs of this machine: the package's, then the system's, newest first.

    Only the first without a problem is known to load.
    """
    found: dict[str, Version] = {}
    packaged = packaged_library()
    for path in (*([packaged] if packaged else []), *_library_paths()):
        real = os.path.realpath(path)
        name_version = _version_in_name(real) or _version_in_name(path)
        if name_version is not None and os.path.isfile(real):
            found[real] = max(name_version, found.get(real, ()))
    named = [_judged(Candidate(path, version)) if version else _probe(path) for path, version in found.items()]
    named.sort(key=lambda candidate: (candidate.path == packaged, candidate.version, candidate.path), reverse=True)
    for index, candidate in enumerate(named):
        if candidate.problem is None:
            named[index] = _probe(candidate.path)
            if named[index].problem is None:
                break
    return tuple(named)


def best() -> str | None:
    """Return the path of the first libLLVM that works, or None."""
    return next((candidate.path for candidate in candidates() if candidate.problem is None), None)
