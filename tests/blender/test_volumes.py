"""Volumes of grids in Blender's scenes: OpenVDB objects and smoke, beside Blender's own export and analytic values."""

from pathlib import Path

import numpy as np
import pytest

import photonbeams as pb
from examples.vdb import write_vdb
from photonbeams.usd.authoring.prims import new_stage, write_prims
from photonbeams.usd.stage import read_scene
from photonbeams.volumes.vol import read_vol
from tests.blender.bpy_python import PYTHON, blender, passes_of

pytestmark = pytest.mark.skipif(
    not PYTHON.exists(), reason=f"{PYTHON} is missing: the set-up makes it with Python 3.11"
)
SCRIPT = Path(__file__).with_name("volumes.py")
WIDTH, HEIGHT = 48, 27
RADIANCE = 5.670374e-14 / np.pi


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a blob of smoke, 2 x 1.5 x 1 m, as a file, and as a film of two."""
    found = tmp_path_factory.mktemp("volumes")
    z, y, x = np.indices((10, 15, 20)) / np.array([10, 15, 20]).reshape(3, 1, 1, 1)
    density = np.maximum(1 - 4 * ((x - 0.4) ** 2 + (y - 0.5) ** 2 + (z - 0.5) ** 2), 0)
    place = np.diag([2, 1.5, 1, 1.0])
    place[:3, 3] = -1, -0.75, -0.5
    write_vdb(found / "smoke.vdb", {"density": density, "tint": density / 2}, place, half=False)
    for number in (1, 2):
        write_vdb(found / f"smoke_{number:04d}.vdb", {"density": density * number}, place, half=False)
    return found


def blocks(picture):
    """Return the means of blocks of 3 × 8 pixels."""
    return picture[:24].reshape(8, 3, 6, 8, -1).mean(axis=(1, 3))


def test_smoke_is_that_of_the_exported_stage(folder):
    blender("frame", folder, SCRIPT)
    color = np.array([0.8, 0.6, 0.4])
    # Blender keeps the opacity of an object as it is scaled, by 1.5; and its export has no materials of volumes.
    per_metre = {"scattering": 3 * color / 1.5, "absorption": 3 * (1 - color) / 1.5}
    overrides = [f"/root/Smoke/Smoke.photonbeams:{name}={tuple(value.tolist())}" for name, value in per_metre.items()]
    overrides.append("/root/Smoke/Smoke.photonbeams:anisotropy=0.3")
    shot = pb.Shot.open(folder / "frame.usdc", overrides=overrides)
    given = {"width": WIDTH, "height": HEIGHT, "beams": 1024, "max_depth": 2, "passes": 2}
    theirs = [shot.render(seed=seed, **given).layers for seed in range(1, 4)]
    ours = passes_of(folder / "frame.exr")
    clear = np.array([blocks(each["transmittance"]) for each in theirs])
    allowed = 4 * clear.std(axis=0, ddof=1) + 0.01
    assert ours["Transmittance"].min() < 0.5
    assert np.all(np.abs(blocks(ours["Transmittance"]) - clear.mean(axis=0)) < allowed)
    for name, layer in (("Surface", "surface"), ("Beams", "beams")):
        means = np.array([each[layer].mean() for each in theirs])
        error = means.std(ddof=1) * (1 + 1 / len(means)) ** 0.5
        assert ours[name].mean() == pytest.approx(means.mean(), abs=float(4 * error + 0.01 * means.mean())), name


@pytest.fixture(scope="module")
def found(folder):
    (found,) = blender("reading", folder, SCRIPT)
    return found


@pytest.fixture(scope="module")
def media(found):
    """The media that the renderer makes of Blender's volumes, by name."""
    stage = new_stage("Z", 1.0)
    write_prims(stage, found["prims"])
    return {each.name.rpartition("/")[2]: each for each in read_scene(stage).media}


def test_volumes_have_the_coefficients_of_their_shaders(media):
    for name, scattering, absorption in (
        ("Scaled", (0.5, 0.25, 1.0), (0.5, 0.75, 0.0)),  # scaled by 2, a density of 2 is 1
        ("Tinted", (0.5,) * 3, (0.25,) * 3),  # half of what is not scattered is let through
        ("Thin", (0.5,) * 3, (0.0,) * 3),
        ("Bare", (0.5,) * 3, (0.5,) * 3),
        ("Filled", (0.5,) * 3, (0.5,) * 3),
    ):
        np.testing.assert_allclose(media[name].scattering, scattering, rtol=1e-5, atol=1e-6, err_msg=name)
        np.testing.assert_allclose(media[name].absorption, absorption, rtol=1e-5, atol=1e-6, err_msg=name)
    assert media["Scaled"].grid.values.max() == pytest.approx(1, rel=0.02)
    assert media["Tinted"].scattering_color.values.max() == pytest.approx(0.5, rel=0.02)
    assert media["Filled"].grid.values.max() == pytest.approx(2, rel=0.01)


def test_a_sequence_has_the_file_of_the_frame(media):
    assert media["Film"].grid.values.max() == pytest.approx(2, rel=0.02)


def test_hot_gas_has_the_radiance_of_a_black_body(media):
    emission = media["Hot"].emission.values
    hottest = 1000 * media["Hot"].grid.values.max() / 2
    luminance = emission.reshape(-1, 3).max(axis=0) @ [0.2126, 0.7152, 0.0722]
    assert luminance == pytest.approx(0.5 * RADIANCE * hottest**4, rel=0.02)


def test_what_is_not_rendered_is_a_sentence(found, media):
    said = " | ".join(found["said"])
    assert "Missing is not rendered: missing.vdb not found" in said
    assert "Empty is not rendered: it has no OpenVDB file" in said
    assert "Other is not rendered: it has no grid mist" in said
    assert not {"Missing", "Empty", "Other"} & media.keys()


def test_smoke_fills_the_box_of_its_domain(folder, found):
    assert found["flame"]
    with (folder / "density.vol").open("rb") as file:
        density = read_vol(file)
    with (folder / "color.vol").open("rb") as file:
        color = read_vol(file)
    # Twice the resolution by noise; x runs fastest.
    assert np.array_equal(density.values, np.arange(192).reshape(8, 6, 4))
    assert np.array_equal(color.values[0, 0, 1], [4, 5, 6]) and color.values.shape == (4, 3, 2, 3)
    np.testing.assert_allclose(density.to_file @ [1, 1, 1, 1], [1, 2, 3, 1])
