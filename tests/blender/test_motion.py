"""Motion blur of Blender's scenes: what moves while the shutter is open, beside Blender's own export of the frames."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import photonbeams as pb
from tests.blender.bpy_python import PYTHON, passes_of, together

pytestmark = pytest.mark.skipif(
    not PYTHON.exists(), reason=f"{PYTHON} is missing: the set-up makes it with Python 3.11"
)
SCRIPT = Path(__file__).with_name("moving.py")
WIDTH, HEIGHT = 48, 27


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    return together(("frame", "still", "eyes", "samples"), tmp_path_factory.mktemp("cases"), SCRIPT)


def blocks(picture):
    """Return the means of blocks of 3 × 8 pixels."""
    return picture[:24].reshape(8, 3, 6, 8, -1).mean(axis=(1, 3))


def test_what_moves_is_blurred_as_in_the_exported_animation(cases):
    (found,), folder = cases["frame"]
    assert found["frame"] == 2  # reading other times leaves Blender where it was
    overrides = [f"/root/Camera/Camera.shutter:{name}={value}" for name, value in (("open", -0.5), ("close", 0.5))]
    shot = pb.Shot.open(folder / "frame.usdc", medium=pb.Medium(scattering=0.08), overrides=overrides)
    given = {"width": WIDTH, "height": HEIGHT, "beams": 1024, "max_depth": 2, "passes": 4}
    ours = passes_of(folder / "frame.exr")
    theirs = [shot.render(2, seed=seed, **given).layers for seed in range(1, 4)]
    without = shot.render(2, blur=False, **given).layers
    for name, layer in (("Surface", "surface"), ("Beams", "beams")):
        seeds = np.array([blocks(each[layer]) for each in theirs])
        mean = seeds.mean(axis=0)
        allowed = 4 * (seeds.std(axis=0, ddof=1) + 0.02 * mean) + 1e-5
        assert np.all(np.abs(blocks(ours[name]) - mean) < allowed), name
        assert np.any(np.abs(blocks(without[layer]) - mean) > allowed), name  # the motion is not lost in noise


def test_what_does_not_move_has_the_bits_of_a_picture_without_a_shutter(cases):
    folder = cases["still"].folder
    first, second = (passes_of(folder / f"{name}.exr") for name in ("without", "with"))
    assert all(np.array_equal(each, second[name]) for name, each in first.items())


def test_two_eyes_have_the_same_motion_and_a_border_shows_a_part_of_it(cases):
    folder = cases["eyes"].folder
    for side in "LR":
        whole, part = (passes_of(folder / f"{name}_{side}.exr")["Combined"] for name in ("whole", "part"))
        np.testing.assert_allclose(part, whole[:18, 12:36], rtol=0.02, atol=1e-4)


def test_transforms_shapes_and_lights_have_time_samples(cases):
    (found,) = cases["samples"].told
    samples, said = found["samples"], " | ".join(found["said"])
    assert found["times"] == [1.5, 2.0]
    assert samples.keys() == {
        "/Objects/Cube", "/Objects/Copied", "/Objects/Mist", "/Objects/Lawn_Blades", "/Lights/Fill"
    }  # fmt: skip
    turned = [np.array(matrix) for _, matrix in samples["/Objects/Cube"]["matrix"]]
    halfway = [np.linalg.norm(((a + b) / 2)[0, :3]) for a, b in pairwise(turned)]
    assert min(halfway) > 0.998  # it keeps its size between the samples
    np.testing.assert_allclose(turned[-1][0, :2], [np.cos(np.radians(150)), np.sin(np.radians(150))], atol=1e-6)
    for name in ("Copied", "Mist", "Lawn_Blades"):
        moved = {time: matrix[3][0] for time, matrix in samples[f"/Objects/{name}"]["matrix"]}
        assert moved == {1.0: 0.0, 1.5: pytest.approx(1.0), 2.0: pytest.approx(2.0)}, name
    sizes = [value for _, value in samples["/Lights/Fill"]["inputs:radius"]]
    assert sizes == pytest.approx([0.1, 0.2, 0.3])
    assert "Growing has other faces" in said and "the curve of the shutter" in said
