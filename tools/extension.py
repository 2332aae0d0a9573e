"""Build the extension for Blender: out/photonbeams-VERSION-PLATFORM.zip. `make blender` calls it.

    python tools/extension.py [FOLDER] [--bare]

The zip has the engine, and the renderer with its packages for this platform and this version of Python, which must be
that of Blender. A --bare one, photonbeams-VERSION.zip, has the engine alone: it starts a Python that has photonbeams,
which the add-on's preferences choose.

The renderer is compressed in pieces, which are kept in build/renderer: what has not changed is not compressed again.
"""

import hashlib
import json
import lzma
import os
import re
import signal
import subprocess
import sys
import sysconfig
import tarfile
import tempfile
import zipfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

from photonbeams.blender.extension.bundle import LIST

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

OWN = "/photonbeams"  # in the names of our files, and of what pip says about them
PIECE = 1 << 25  # bytes before compression
# The filter for machine code saves a tenth. The dictionary is that of the preset, 8 MB: the largest effort with 64 MB
# takes 1.7 times the time and saves 4 %.
FILTERS = [{"id": lzma.FILTER_X86}, {"id": lzma.FILTER_LZMA2, "preset": 6}]


def build(folder: Path, bare: bool) -> Path:
    """Write the zip into a folder, and return its path."""
    manifest = (SOURCE / "blender_manifest.toml").read_text(encoding="utf-8")
    version = re.search(r'^version = "(.+)"$', manifest, re.MULTILINE)[1]
    platform = sysconfig.get_platform().replace("x86_64", "x64").replace("amd64", "x64").replace("win-", "windows-")
    target = folder / (f"photonbeams-{version}.zip" if bare else f"photonbeams-{version}-{platform}.zip")
    files = [path for path in sorted(SOURCE.rglob("*")) if path.suffix in (".py", ".json", ".png")]
    with tempfile.TemporaryDirectory() as scratch:
        if not bare:
            own = f'platforms = ["{platform}"]\n{BLENDERS[sys.version_info[:2]]}\n'
            manifest = re.sub("blender_version_min.*\n", own, manifest)
            packed = packed_renderer(Path(scratch))
        with whole(target) as sink, zipfile.ZipFile(sink, "w", zipfile.ZIP_DEFLATED) as archive:
            if not bare:
                archive.write(packed, packed.name, zipfile.ZIP_STORED)
            archive.writestr("blender_manifest.toml", manifest)
            for path in [*files, ROOT / "LICENSE"]:
                archive.write(path, path.name if path.parent == ROOT else path.relative_to(SOURCE))
    return target


@contextmanager
def whole(target: Path) -> Iterator[Path]:
    """Give a file to be written beside `target`, of which it takes the place once it is whole."""
    target.parent.mkdir(parents=True, exist_ok=True)
    aside = target.with_name(f"{target.name}.{os.getpid()}.tmp")
    try:
        yield aside
        aside.replace(target)
    finally:
        aside.unlink(missing_ok=True)


def packed_renderer(scratch: Path) -> Path:
    """Return the path of an archive of photonbeams and the packages that it needs, with the hash of its content."""
    tree, packed = scratch / "renderer", scratch / "renderer.tar.xz"
    tell("installing the renderer and its packages")
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--ignore-installed",
         "--no-compile", "--no-warn-script-location", "--prefix", tree, f"{ROOT}[usd,vdb]"], check=True,
    )  # fmt: skip
    pack(tree, packed, ROOT / "build" / "renderer")
    digest = hashlib.sha256(packed.read_bytes()).hexdigest()[:12]
    return packed.rename(scratch / f"renderer-{digest}.tar.xz")


def pack(tree: Path, target: Path, kept: Path) -> None:
    """Write an archive of the files of a folder and their list; pieces of it are kept in another folder."""
    files = {path.relative_to(tree).as_posix(): path for path in tree.rglob("*") if path.is_file()}
    # photonbeams comes last: when it alone has changed, the pieces before it are as they were.
    names = sorted((name for name in files if not UNUSED.search(f"/{name}")), key=lambda each: (OWN in each, each))
    sizes = {name: files[name].stat().st_size for name in names}
    pieces = [[files[name] for name in piece] for piece in parted(sizes)]
    end = member(LIST, json.dumps(sizes).encode(), 0o644) + bytes(2 * tarfile.BLOCKSIZE)
    kept.mkdir(parents=True, exist_ok=True)

    def packed(piece: list[Path]) -> Path:
        entries = (member(path.relative_to(tree).as_posix(), path.read_bytes(), path.stat().st_mode) for path in piece)
        return compressed(b"".join(entries) if piece else end, kept)

    used = []
    with ThreadPoolExecutor(os.cpu_count()) as pool, target.open("wb") as sink:
        for path in pool.map(packed, [*pieces, []]):
            sink.write(path.read_bytes())
            used.append(path)
            tell(f"packing the renderer: {len(used) / (len(pieces) + 1):.0%}")
    for other in set(kept.iterdir()) - set(used):
        other.unlink(missing_ok=True)


def parted(sizes: dict[str, int]) -> list[list[str]]:
    """Return names in pieces of about `PIECE` bytes, whose order stays."""
    found, size = list[list[str]](), PIECE
    for name in sizes:
        if size >= PIECE:
            found.append([])
            size = 0
        found[-1].append(name)
        size += sizes[name]
    return found


def member(name: str, content: bytes, mode: int) -> bytes:
    """Return a file as a part of an archive, without times and owners: the same files make the same archive."""
    entry = tarfile.TarInfo(name)
    entry.size, entry.mode = len(content), mode & 0o777
    return entry.tobuf() + content + bytes(-len(content) % tarfile.BLOCKSIZE)


def compressed(content: bytes, kept: Path) -> Path:
    """Return the file of a compressed piece, which is made if it is not there."""
    path = kept / f"{hashlib.sha256(repr(FILTERS).encode() + content).hexdigest()}.xz"
    if not path.exists():
        with whole(path) as aside:
            aside.write_bytes(lzma.compress(content, filters=FILTERS))
    return path


def tell(text: str) -> None:
    """Print what is done, which takes a while."""
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # what was begun is removed
    options = [each for each in sys.argv[1:] if each != "--bare"]
    print(build(Path(options[0]) if options else ROOT / "out", "--bare" in sys.argv[1:]))
