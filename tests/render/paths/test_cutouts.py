"""Cut-out surfaces and the light that bounces to them: an opacity dims what is seen of them once."""

import numpy as np

import photonbeams as pb
from photonbeams import scene

WHITE = (0.8,) * 3


def card(name, height, half, opacity=1.0):
    corners = np.array([[-half, height, half], [half, height, half], [half, height, -half], [-half, height, -half]])
    material = scene.Material(diffuse=WHITE, ior=1.0, opacity=opacity)
    return scene.Mesh(name, corners, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32), material=material)


def test_photons_and_walks_find_the_same_light_on_a_leaf_above_a_floor():
    """A sheet of opacity 0.4 from below: by photons and by walks.

    The floor is lit through the sheet; all of the sheet's light comes from the floor.
    """
    sun = scene.DistantLight("/Sun", (3.0,) * 3, axis=np.array([0.0, -1.0, 0.0]), angle=0.0)
    meshes = card("/Floor", 0.0, 1.0), card("/Leaf", 0.5, 1.0, opacity=0.4)
    camera = scene.Camera.look_at((0, 0.2, 0), (0, 0.5, 0), up=(0, 0, 1), fov=60)
    shot, mean, error = pb.Shot(scene.Scene(lights=(sun,), meshes=meshes), camera), {}, {}
    for method in ("beams", "auto"):
        given = {"passes": 2, "width": 32, "max_depth": 3, "method": method, "beams": 1 << 15}
        pictures = [shot.render(seed=seed, **given).layers["surface"].mean() for seed in range(4)]
        mean[method], error[method] = np.mean(pictures), np.std(pictures, ddof=1) / 2
    assert abs(mean["beams"] - mean["auto"]) < 4 * np.hypot(*error.values()) + 0.01 * mean["auto"], (mean, error)
    assert max(error.values()) < 0.06 * mean["auto"]
