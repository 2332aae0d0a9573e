"""Build the extension for Blender: out/photonbeams-VERSION-PLATFORM.zip. `make blender` calls it.

    python tools/extension.py [FOLDER] [--bare]

The zip has the engine, and the renderer with its packages for this platform and this version of Python, which must be
that of Blender. A --bare one, photonbeams-VERSION.zip, has the engine alone: it starts a Python that has photonbeams,
which the add-on's preferences choose.
"""

import hashlib
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "src" / "photonbeams" / "blender" / "extension"
# What no renderer needs: half of the files.
UNUSED = re.compile(r"/(bin|include|tests|share|__pycache__|pip|pip-[^/]*|libOpenImageIO/.*\.cmake)(/|$)|\.pyi$")


def build(folder: Path, bare: bool) -> Path:
    """Write the zip into a folder, and return its path."""
    manifest = (SOURCE / "blender_manifest.toml").read_text(encoding="utf-8")
    version = re.search(r'^version = "(.+)"$', manifest, re.MULTILINE)[1]
    platform = sysconfig.get_platform().replace("x86_64", "x64").replace("amd64", "x64").replace("win-", "windows-")
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / (f"photonbeams-{version}.zip" if bare else f"photonbeams-{version}-{platform}.zip")
    files = [path for path in sorted(SOURCE.rglob("*")) if path.suffix in (".py", ".json", ".png")]
    with tempfile.TemporaryDirectory() as scratch, zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        if not bare:
            manifest = manifest.replace("\n[permissions]", f'platforms = ["{platform}"]\n\n[permissions]')
            packed = packed_renderer(Path(scratch))
            archive.write(packed, packed.name, zipfile.ZIP_STORED)
        archive.writestr("blender_manifest.toml", manifest)
        for path in [*files, ROOT / "LICENSE"]:
            archive.write(path, path.name if path.parent == ROOT else path.relative_to(SOURCE))
    return target


def packed_renderer(scratch: Path) -> Path:
    """Return the path of an archive of photonbeams and the packages that it needs, with the hash of its content."""
    tree, packed = scratch / "renderer", scratch / "renderer.tar.xz"
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--ignore-installed",
         "--no-compile", "--no-warn-script-location", "--prefix", tree, f"{ROOT}[usd,vdb,materialx]"], check=True,
    )  # fmt: skip
    several = [shutil.which("xz"), "--threads=0", "-7", "--stdout"]  # on all processors, where there is one
    with packed.open("wb") as sink:
        if several[0] is None:
            pack(tree, sink, "w:xz")
        else:
            with subprocess.Popen(several, stdin=subprocess.PIPE, stdout=sink) as compressing:
                pack(tree, compressing.stdin, "w|")
                compressing.stdin.close()
    digest = hashlib.sha256(packed.read_bytes()).hexdigest()[:12]
    return packed.rename(scratch / f"renderer-{digest}.tar.xz")


def pack(tree: Path, sink, mode: str) -> None:
    """Write the files of a folder that a renderer needs into an archive."""
    with tarfile.open(fileobj=sink, mode=mode) as archive:
        archive.add(tree, ".", filter=lambda each: None if UNUSED.search(each.name) else each)


if __name__ == "__main__":
    options = [each for each in sys.argv[1:] if each != "--bare"]
    print(build(Path(options[0]) if options else ROOT / "out", "--bare" in sys.argv[1:]))
