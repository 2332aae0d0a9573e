"""The extension as a package: what it imports, its manifest, and the zip."""

import ast
import subprocess
import sys
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

ROOT = Path(__file__).resolve().parents[2]
SOURCE = Path(photonbeams.blender.__file__).parent / "extension"
#: What Blender's Python has; the export alone uses pxr, Blender's own OpenUSD, which other builds may lack.
THERE = {*sys.stdlib_module_names, "numpy", "bpy", "bl_ui", "mathutils", "gpu", "gpu_extras"}


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


@pytest.mark.skipif(not PYTHON.exists(), reason=f"{PYTHON} is missing: the set-up makes it with Python 3.11")
def test_blender_accepts_the_zip(archive):
    (tool,) = PYTHON.parents[1].glob("lib/*/site-packages/bpy/*/scripts/addons_core/bl_pkg/cli/blender_ext.py")
    ran = subprocess.run([PYTHON, tool, "validate", archive], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stdout + ran.stderr
