"""Build the extension for Blender: out/photonbeams-VERSION-PLATFORM.zip. `make blender` calls it.

    python tools/extension.py [FOLDER] [--bare]

The zip has the engine, and the renderer with its packages for this platform and this version of Python, which must be
that of Blender. A --bare one, photonbeams-VERSION.zip, has the engine alone: it starts a Python that has photonbeams,
which the add-on's preferences choose.
"""

import hashlib
import lzma
import re
import subprocess
import sys
import sysconfig
import tarfile
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "src" / "photonbeams" / "blender" / "extension"
# Blender's versions that have a version of Python.
BLENDERS = {
    (3, 11): 'blender_version_min = "5.0.0"\nblender_version_max = "5.1.0"',
    (3, 13): 'blender_version_min = "5.1.0"',
}
# What no renderer needs: half of the files.
UNUSED = re.compile(
    r"/(bin|include|tests|share|__pycache__|pip|pip-[^/]*)(/|$)|\.pyi$|/mitsuba/\w+_(mono|spectral)(_polarized)?\.cpython"
)


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
            own = f'platforms = ["{platform}"]\n{BLENDERS[sys.version_info[:2]]}\n'
            manifest = re.sub("blender_version_min.*\n", own, manifest)
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
         "--no-compile", "--no-warn-script-location", "--prefix", tree, f"{ROOT}[usd,vdb]"], check=True,
    )  # fmt: skip
    print("packing the renderer, which takes some minutes", file=sys.stderr)
    # The filter for machine code saves a tenth.
    best = {"id": lzma.FILTER_LZMA2, "preset": 9 | lzma.PRESET_EXTREME, "dict_size": 1 << 26}
    with (
        lzma.open(packed, "wb", filters=[{"id": lzma.FILTER_X86}, best]) as sink,
        tarfile.open(fileobj=sink, mode="w") as archive,
    ):
        archive.add(tree, ".", filter=lambda each: None if UNUSED.search(each.name) else each)
    digest = hashlib.sha256(packed.read_bytes()).hexdigest()[:12]
    return packed.rename(scratch / f"renderer-{digest}.tar.xz")


if __name__ == "__main__":
    options = [each for each in sys.argv[1:] if each != "--bare"]
    print(build(Path(options[0]) if options else ROOT / "out", "--bare" in sys.argv[1:]))
