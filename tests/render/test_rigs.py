"""Rigs of many lamps: the same light, whether lamps are taken one by one, by lists, or in one set of beams."""

import numpy as np
import pytest

import photonbeams as pb
from photonbeams import scene
from photonbeams.world.emitters import lamp_boxes
from tests.helpers.comparison import box, camera, quad

LAMPS = 24
SIZE = {"width": 48, "height": 27, "passes": 1, "beams": 64, "max_depth": 2, "gather_error": 0.0}
PAPER = scene.Material(diffuse=(0.5, 0.5, 0.5), roughness=1.0)


def rig(groups=False, only=None):
    """Return spots under the ceiling of a foggy room, in groups of their own, or only one of them."""
    rng, lights = np.random.default_rng(6), []
    for number in range(LAMPS):
        axis = np.array([0, -1, 0]) + rng.normal(0, 0.4, 3)
        x, z, angle = rng.uniform(-1.5, 1.5), rng.uniform(-1.5, 1), rng.uniform(4, 25)
        spot = scene.SphereLight(
            f"/Rig/Spot{number}", tuple(rng.uniform(50, 500, 3)), center=(x, 2.8, z), axis=axis / np.linalg.norm(axis),
            radius=0.02, shaping=scene.Shaping(angle, 0.2), group=f"spot{number}" if groups else "",
        )  # fmt: skip
        lights.append(spot)
    floor = quad("/Floor", [[-2, 0, -2], [-2, 0, 2], [2, 0, 2], [2, 0, -2]], PAPER)
    wall = quad("/Wall", [[-2, 0, -2], [2, 0, -2], [2, 3, -2], [-2, 3, -2]], PAPER)
    blocks = [box(f"/Block{each}", (each - 1.2, 0, -0.5), (each - 0.8, 0.6, 0), PAPER) for each in range(3)]
    return scene.Scene(
        meshes=(floor, wall, *blocks), lights=tuple(lights if only is None else [lights[only]]),
        media=(scene.Medium(scattering=(0.05, 0.05, 0.05)),),
    )  # fmt: skip


def rendered(content):
    return pb.Shot(content, camera()).render(**SIZE).layers


def test_pictures_have_the_same_bits_with_all_lamps_in_each_list(monkeypatch):
    by_lists = rendered(rig())
    monkeypatch.setattr(lamp_boxes, "_FEW", LAMPS)  # no box is divided
    whole = rendered(rig())
    assert by_lists.keys() == whole.keys()
    assert by_lists["surface"][..., :3].max() > 0
    for name in whole:
        np.testing.assert_array_equal(by_lists[name], whole[name])


@pytest.mark.parametrize("layer", ["surface", "beams"])
def test_a_rig_is_the_sum_of_its_lamps(layer):
    """Lamps of one group are gathered in one set, lamps of groups of their own one by one: only rounding differs."""
    together, apart = rendered(rig()), rendered(rig(groups=True))
    scale = together[layer].max()
    np.testing.assert_allclose(apart[layer], together[layer], rtol=1e-4, atol=1e-5 * scale)
    if layer == "beams":
        for number in (0, LAMPS // 2):
            single = rendered(rig(only=number))
            own = apart[f"beams_spot{number}"]
            np.testing.assert_allclose(own[..., :3], single["beams"][..., :3], rtol=1e-4, atol=1e-5 * scale)
