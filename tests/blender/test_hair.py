"""Hair in Blender's scenes: curves and particles are where Blender has them, and as thick."""

from pathlib import Path

import numpy as np
import pytest

from photonbeams.usd.authoring.prims import new_stage, write_prims
from photonbeams.usd.stage import read_scene
from tests.blender.bpy_python import PYTHON, blender, passes_of

pytestmark = pytest.mark.skipif(
    not PYTHON.exists(), reason=f"{PYTHON} is missing: the set-up makes it with Python 3.11"
)
SCRIPT = Path(__file__).with_name("hair.py")
_ARRAYS = {"point3f[]": np.float32, "normal3f[]": np.float32, "texCoord2f[]": np.float32, "float[]": np.float32,
           "int[]": np.int32}  # fmt: skip


@pytest.fixture(scope="module")
def prims(tmp_path_factory):
    (found,) = blender("reading", tmp_path_factory.mktemp("hair"), SCRIPT)
    for each in found["prims"]:
        each["values"] = {
            name: [kind, np.array(value, _ARRAYS[kind]) if kind in _ARRAYS else value, *rest]
            for name, (kind, value, *rest) in each["values"].items()
        }
    return found["prims"]


@pytest.fixture(scope="module")
def meshes(prims):
    """The tubes that the renderer makes of Blender's curves, by name."""
    stage = new_stage("Z", 1.0)
    write_prims(stage, prims)
    return {each.name.rpartition("/")[2]: each for each in read_scene(stage).meshes}


def test_curves_are_tubes_of_their_radius(meshes):
    low, high = meshes["Straight"].points.min(axis=0), meshes["Straight"].points.max(axis=0)
    np.testing.assert_allclose(low, [-0.05, -0.05, 0], atol=1e-3)
    np.testing.assert_allclose(high, [1.05, 0.05, 1], atol=1e-3)
    # A Catmull-Rom curve passes through its points; without a radius it is 1 cm.
    assert meshes["Bent"].points[:, 2].max() == pytest.approx(1.01, abs=0.005)
    assert "None" not in meshes


def test_hair_of_particles_grows_from_its_object(prims, meshes):
    (hair,) = (each for each in prims if each["path"] == "/Objects/Lawn_Blades")
    assert "Lawn" not in meshes  # it is hidden, and its hair is not
    counts, points = hair["values"]["curveVertexCounts"][1], hair["values"]["points"][1]
    assert list(counts) == [5] * 15  # of 4 parts: 5 parents, and 2 children of each
    along = points.reshape(15, 5, 3)
    np.testing.assert_allclose(along[:, -1] - along[:, 0], np.tile([0, 0, 0.5], (15, 1)), atol=1e-5)
    assert np.abs(along[:, 0, :2]).max() <= 0.5 + 1e-4
    np.testing.assert_allclose(hair["values"]["widths"][1][:5], [0.02, 0.0175, 0.015, 0.0125, 0], rtol=1e-6)
    assert hair["targets"]["material:binding"] == ["/Materials/Grass"]
    # In the world the square stands on its edge: its normal, along which hair grows, is −Y.
    assert meshes["Lawn_Blades"].points[:, 1].min() == pytest.approx(1.5, abs=0.02)


def test_points_of_geometry_nodes_are_spheres(meshes):
    low, high = meshes["Dots"].points.min(axis=0), meshes["Dots"].points.max(axis=0)
    np.testing.assert_allclose([low, high], [[3.9, -1.1, 0.9], [6.1, 1.1, 1.1]], atol=1e-5)


def test_hair_is_seen(tmp_path):
    blender("frame", tmp_path, SCRIPT)
    without, found = (passes_of(tmp_path / f"{name}.exr")["Depth"][..., 0] for name in ("without", "with"))
    nearer = found < without - 0.1
    assert 5 < nearer.sum() < 0.5 * nearer.size
    assert np.all(found[~nearer] <= without[~nearer] + 0.1)
