"""The extension as a package: what it imports, its manifest, and the zip."""

import ast
import json
import lzma
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import photonbeams.blender
from photonbeams.studio.encoding import thumbnail_of
from photonbeams.usd.authoring.presets import PRESETS, preset_of
from tests.blender.bpy_python import PYTHON
from tools import extension

ROOT = Path(__file__).resolve().parents[2]
SOURCE = Path(photonbeams.blender.__file__).parent / "extension"
#: What Blender's Python has; the export alone uses pxr, Blender's own OpenUSD, which other builds may lack.
THERE = {*sys.stdlib_module_names, "numpy", "bpy", "bmesh", "bl_ui", "mathutils", "gpu", "gpu_extras"}


@pytest.mark.parametrize("path", sorted(SOURCE.rglob("*.py")), ids=lambda path: path.name)
def test_a_module_imports_what_blender_has_and_its_own_package(path):
    depth = len(path.relative_to(SOURCE).parts)
    there = THERE | {"pxr"} if path.name == "export.py" else THERE
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            assert {each.name.partition(".")[0] for each in node.names} <= there
        if isinstance(node, ast.ImportFrom):
            assert node.level <= depth and (node.level or node.module.partition(".")[0] in there), ast.unparse(node)


def test_the_manifest_has_the_version_of_the_package():
    manifest = tomllib.loads((SOURCE / "blender_manifest.toml").read_text())
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert manifest["version"] == project["tool"]["setuptools_scm"]["fallback_version"]


def test_each_preset_has_a_thumbnail():
    """If it has none, run `python tools/thumbnails.py`."""
    found = {each.stem: np.asarray(Image.open(each)) for each in (SOURCE / "thumbnails").glob("*.png")}
    assert found.keys() == {each.name for each in PRESETS}
    drawn = np.asarray(Image.open(BytesIO(thumbnail_of(preset_of("look-ember")))))
    assert np.abs(found["look-ember"].astype(int) - drawn).mean() < 1
    assert all(each.shape == drawn.shape and each.max() > 40 for each in found.values())


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    folder = tmp_path_factory.mktemp("zip")
    command = [sys.executable, ROOT / "tools" / "extension.py", folder, "--bare"]
    ran = subprocess.run(command, capture_output=True, check=True)
    return Path(ran.stdout.decode().strip())


def test_the_zip_has_all_modules(archive):
    with zipfile.ZipFile(archive) as found:
        names = set(found.namelist())
    assert names == {"LICENSE", "blender_manifest.toml"} | {
        str(path.relative_to(SOURCE)) for path in SOURCE.rglob("*") if path.suffix in (".py", ".json", ".png")
    }


def test_a_zip_that_is_not_finished_leaves_the_one_before(tmp_path):
    target = tmp_path / "out" / "photonbeams.zip"
    with extension.whole(target) as aside:
        assert aside.parent == target.parent and not aside.exists() and not target.exists()
        aside.write_bytes(b"whole")
    with pytest.raises(KeyboardInterrupt), extension.whole(target) as aside:
        aside.write_bytes(b"ha")
        raise KeyboardInterrupt
    assert target.read_bytes() == b"whole" and [*target.parent.iterdir()] == [target]


def test_only_what_has_changed_is_compressed_again(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(extension, "PIECE", 1000)
    packages = tmp_path / "tree" / "lib" / "site-packages"
    for name in ("numpy/a.py", "photonbeams/a.py", "scipy/a.py", "scipy/tests/a.py"):
        (packages / name).parent.mkdir(parents=True)
        (packages / name).write_bytes(name.encode() * 200)

    def packed():
        extension.pack(tmp_path / "tree", tmp_path / "packed", tmp_path / "kept")
        return (tmp_path / "packed").read_bytes(), {path.name for path in (tmp_path / "kept").iterdir()}

    first, kept = packed()
    assert packed() == (first, kept) and len(kept) == 4  # three files and the list
    (packages / "photonbeams" / "a.py").write_bytes(b"other" * 200)
    second, now = packed()
    assert second != first and len(now) == 4 and len(now & kept) == 2
    assert capsys.readouterr().err.endswith("packing the renderer: 75%\npacking the renderer: 100%\n")
    with lzma.open(BytesIO(second)) as content, tarfile.open(fileobj=content, mode="r|") as archive:
        found = {each.name: archive.extractfile(each).read() for each in archive}
    names = [f"lib/site-packages/{name}/a.py" for name in ("numpy", "scipy", "photonbeams")]
    assert list(found) == [*names, "files.json"] and found[names[-1]] == b"other" * 200
    assert json.loads(found["files.json"]) == {name: len(found[name]) for name in names}


@pytest.mark.skipif(not PYTHON.exists(), reason=f"{PYTHON} is missing: the set-up makes it with Python 3.11")
def test_blender_accepts_the_zip(archive):
    (tool,) = PYTHON.parents[1].glob("lib/*/site-packages/bpy/*/scripts/addons_core/bl_pkg/cli/blender_ext.py")
    ran = subprocess.run([PYTHON, tool, "validate", archive], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stdout + ran.stderr
