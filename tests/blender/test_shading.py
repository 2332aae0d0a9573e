"""Nodes, skies, glowing meshes and fog in objects of Blender, beside Cycles and analytic values."""

from pathlib import Path

import numpy as np
import pytest

from tests.blender.bpy_python import PYTHON, together

pytestmark = pytest.mark.skipif(
    not PYTHON.exists(), reason=f"{PYTHON} is missing: the set-up makes it with Python 3.11"
)
SCRIPT = Path(__file__).with_name("in_blender_shading.py")


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """What each case told; all run in one Blender."""
    names = "values", "noise", "skies", "glow", "fog", "bumps", "rays", "glowing_fog"
    return {name: case.told for name, case in together(names, tmp_path_factory.mktemp("cases"), SCRIPT).items()}


def test_nodes_have_their_values_and_the_mean_where_they_vary(told):
    (found,) = told["values"]
    values = found["values"]
    assert values["group in a group"] == pytest.approx(0.6 / 4)
    assert values["mix"] == pytest.approx([0.6, 0.3, 0.2])
    assert values["ramp"] == pytest.approx([0.25, 0.125, 0.0], abs=1e-3)
    assert values["hue"] == pytest.approx([0.3, 0.9, 0.3], abs=1e-6)
    assert values["gamma"] == pytest.approx([0.25, 0.0625, 1.0])
    assert values["linear"] == pytest.approx(0.5, abs=3 / np.sqrt(12 * 4096))
    assert len(found["said"]) == 1 and "varies" in found["said"][0]
    # Blender's level is half of the factor on the reflectance at normal incidence, 0.04.
    weak, strong = values["weak"], values["strong"]
    assert weak["specular_weight"] == 0.5 and weak["specular_color"][:3] == [1, 0.5, 0]
    assert ((strong["specular_ior"] - 1) / (strong["specular_ior"] + 1)) ** 2 == pytest.approx(0.08)


def test_noise_is_that_of_cycles(told):
    (found,) = told["noise"]
    assert found["spread"] > 0.2 and found["difference"] < 0.01  # of a pixel's jitter


def test_skies_light_the_ground_as_in_cycles(told):
    """Nishita's sky has other wavelengths and steps here, and Hosek's is Preetham's: within 12 %."""
    found = {each["sky"]: each for each in told["skies"]}
    assert len(found) == 7
    for name, each in found.items():
        exact = name in ("preetham", "ramp")
        np.testing.assert_allclose(each["own"], each["cycles"], rtol=0.005 if exact else 0.12, err_msg=name)
        assert name == "ramp" or abs(each["peaks"][0] - each["peaks"][1]) <= 1
        assert bool(each["said"]) == (name in ("many", "hosek"))
    red, _, blue = found["low sun"]["sun"][0]
    assert red > 5 * blue and not found["preetham"]["sun"]


def test_the_brightest_meshes_that_glow_are_lamps(told):
    (found,) = told["glow"]
    assert found["lamps"] == [f"/Objects/Cube{k}" for k in (1, 2, 3, 4, 5, 6, 7, 9)]
    assert found["said"] == ["10 meshes glow: the 8 brightest are lamps"]
    assert found["unseen"] and "MeshLightAPI" not in found["apis"]


def test_fog_in_objects_is_even_or_a_grid(told):
    (found,) = told["fog"]
    types = found["types"]
    assert types["/Objects/Ball"] == "Mesh" and types["/Objects/Box"] == "Volume" and found["said"] == []
    assert found["ball"] == pytest.approx([0.2, 0.1, 0.4]) and found["box"] == [0.5, 0.25, 1.0]
    content = Path(found["file"]).read_bytes()
    grid = np.frombuffer(content, "<f4", offset=48).reshape(64, 64, 64)
    np.testing.assert_allclose(grid, np.broadcast_to((np.arange(64)[:, None, None] + 0.5) / 64, grid.shape), atol=1e-6)
    np.testing.assert_array_equal(np.frombuffer(content, "<f4", 6, 24), [-1, -1, -1, 1, 1, 1])


def test_bumps_and_normal_maps_have_the_slopes_of_cycles(told):
    """On matt planes in sunlight; both engines soften the ridge of an image, over which the quarters do not reach."""
    cycles, own, last = told["bumps"]
    assert last["said"] == []
    for name, expected in cycles["quarters"].items():
        expected, found = np.array(expected), np.array(own["quarters"][name])
        assert np.ptp(expected) > 0.1 * expected.max(), name
        # Chained bumps are added here; in Cycles the second one is steeper by the length of the first one's normal.
        np.testing.assert_allclose(found, expected, rtol=0.03 if name == "chained" else 0.01, err_msg=name)
    turned = np.array(own["quarters"]["layer"])
    assert np.ptp(turned.mean(axis=1)) > 0.05 > 10 * np.ptp(turned.mean(axis=0))


def test_objects_are_hidden_from_rays_as_in_cycles(told):
    found = {}
    for each in told["rays"]:
        found.setdefault(each["case"], {})[each["engine"]] = np.array(each["blocks"])
    assert found["holdout"]["own"][..., 3].min() < 0.5
    for name, pictures in found.items():
        own, expected = pictures["own"], pictures["Cycles"]
        # Cycles samples the middles of pixels: an edge takes half of up to 7 of a block's 56 pixels too much.
        most = expected.max(axis=(0, 1))
        assert np.all(np.abs(own - expected) < 0.06 * most), name
        np.testing.assert_allclose(own.mean(axis=(0, 1)), expected.mean(axis=(0, 1)), rtol=0.01, err_msg=name)
        assert name == "plain" or np.any(np.abs(own - found["plain"]["own"]) > 0.1 * most), name


def test_fog_glows_as_in_cycles(told):
    """Even fog of the emission ε, the extinction σ and the thickness d has the radiance ε (1 − exp(−σ d)) / σ."""
    found = {(each["place"], each["engine"]): each for each in told["glowing_fog"]}
    expected = {"cube": np.array([0.3, 0.15, 0.075]) * (1 - np.exp(-0.5 * 2)) / 0.5, "world": np.full(3, 0.2 / 0.25)}
    for place, light in expected.items():
        np.testing.assert_allclose(found[place, "own"]["light"], light, rtol=1e-3)
        np.testing.assert_allclose(found[place, "Cycles"]["light"], light, rtol=1e-3)
    assert not any(each["said"] for each in found.values())
