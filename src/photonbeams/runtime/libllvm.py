"""Find a libLLVM that works with Dr.Jit, without importing Dr.Jit.

Dr.Jit refuses LLVM 14 as too old; versions 15 and 16 abort the process on AVX-512 machines ("Cannot select: fmaximum").
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from glob import glob
from pathlib import Path

OLDEST = 17
INSTALL_HINT = (
    "on Debian and Ubuntu `apt-get install libllvm19`, with conda `conda install -c conda-forge libllvm19`, "
    "on macOS `brew install llvm`; or set DRJIT_LIBLLVM_PATH to a libLLVM of your own"
)

Version = tuple[int, ...]


@dataclass(frozen=True)
class Candidate:
    """A libLLVM that was found.

    Attributes
    ----------
    path
        Path of the library, without symbolic links.
    version
        Version from the name or from the library itself; empty if neither tells it.
    problem
        Why the library is refused, or None.
    """

    path: str
    version: Version = ()
    problem: str | None = None


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
    child = subprocess.run([python, "-I", "-S", "-c", _PROBE, path], capture_output=True, text=True, check=False)
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
    """Return all libLLVMs of this machine, newest first; only the first without a problem is known to load."""
    found: dict[str, Version] = {}
    for path in _library_paths():
        real = os.path.realpath(path)
        name_version = _version_in_name(real) or _version_in_name(path)
        if name_version is not None and os.path.isfile(real):
            found[real] = max(name_version, found.get(real, ()))
    named = [_judged(Candidate(path, version)) if version else _probe(path) for path, version in found.items()]
    named.sort(key=lambda candidate: (candidate.version, candidate.path), reverse=True)
    for index, candidate in enumerate(named):
        if candidate.problem is None:
            named[index] = _probe(candidate.path)
            if named[index].problem is None:
                break
    return tuple(named)


def newest() -> str | None:
    """Return the path of the newest working libLLVM, or None."""
    return next((candidate.path for candidate in candidates() if candidate.problem is None), None)
