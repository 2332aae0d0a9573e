"""Build a wheel, and check that it contains the source's files as they are committed, and no others.

Usage: python tools/wheel.py [FILE.whl]; without a file it builds one from the files that git tracks.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]


def tracked() -> list[str]:
    """Return the paths of the files that git tracks."""
    done = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True)
    return [path for path in done.stdout.decode().split("\0") if path and (ROOT / path).is_file()]


def build(folder: Path) -> Path:
    """Build a wheel from a copy of the tracked files, in which no earlier build has left anything."""
    source = folder / "source"
    for path in tracked():
        (source / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / path, source / path)
    environment = {**os.environ, "SETUPTOOLS_SCM_PRETEND_VERSION_FOR_PHOTONBEAMS": "0"}
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", folder, source]
    subprocess.run(command, check=True, env=environment)
    return next(folder.glob("*.whl"))


def differences(wheel: Path) -> list[str]:
    """Return a line for each file that a wheel lacks, has besides, or has with other content."""
    with zipfile.ZipFile(wheel) as archive:
        found = {name: archive.read(name) for name in archive.namelist() if ".dist-info/" not in name}
    expected = {path.removeprefix("src/"): (ROOT / path).read_bytes() for path in tracked() if path.startswith("src/")}
    return [
        *(f"{name} is not in the wheel" for name in sorted(expected.keys() - found.keys())),
        *(f"{name} is in the wheel, but not in src/" for name in sorted(found.keys() - expected.keys())),
        *(f"{name} is another file in the wheel" for name in sorted(expected) if found.get(name, b"") != expected[name]
          and name in found),
    ]  # fmt: skip


def main() -> int:
    """Print the differences; return 1 if there are some."""
    with tempfile.TemporaryDirectory() as name:
        wheel = Path(sys.argv[1]) if len(sys.argv) > 1 else build(Path(name))
        found = differences(wheel)
    print("\n".join(found) if found else f"{wheel.name}: its files are those of src/")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
