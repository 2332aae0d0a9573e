"""The layer `albedo` shows the colour of materials, also in mirrors and through boundaries of media, antialiased."""

import numpy as np
import pytest

from photonbeams import Shot
from photonbeams.images.files import read_layers
from photonbeams.runtime.device import mitsuba

mi = mitsuba()
T = mi.ScalarTransform4f
COLOR = (0.2, 0.5, 0.7)


def card(x, y, bsdf, half=0.5):
    """Return a square card that faces the camera from four units away."""
    return {"type": "rectangle", "to_world": T().translate([x, y, -4]).scale(half), "bsdf": bsdf}


def rgb(color):
    return {"type": "rgb", "value": list(color)}


@pytest.fixture(scope="module")
def frame():
    """Return a frame of four cards: diffuse, mirror, rough metal, and diffuse behind the boundary of a fog."""
    diffuse = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": rgb(COLOR)}}
    fog = {"type": "homogeneous", "sigma_t": 0.1, "albedo": 0.5}
    scene = mi.load_dict({
        "type": "scene",
        # At the distance of the cards, four units are 32 pixels.
        "sensor": {
            "type": "perspective", "fov": float(np.degrees(2 * np.arctan(0.5 * 4 / 4))),
            "to_world": T().look_at([0, 0, 0], [0, 0, -1], [0, 1, 0]),
            "film": {"type": "hdrfilm", "width": 32, "height": 32, "rfilter": {"type": "box"}},
        },
        "a": card(-1, 1, diffuse, 0.4375), "b": card(1, 1, {"type": "conductor"}),
        "c": card(-1, -1, {"type": "twosided", "bsdf": {"type": "roughconductor", "alpha": 0.3}}),
        "d": card(1, -1, diffuse, 0.25),
        "cube": {
            "type": "cube", "to_world": T().translate([1, -1, -4]).scale(0.4), "bsdf": {"type": "null"},
            "interior": fog,
        },
        "wall": {
            "type": "rectangle", "to_world": T().translate([0, 0, 6]).rotate([0, 1, 0], 180).scale(40),
            "bsdf": {"type": "diffuse", "reflectance": rgb((0.9, 0.1, 0.3))},
        },
        "lamp": {"type": "point", "position": [0, 0, 1], "intensity": 10.0},
    })  # fmt: skip
    return Shot(scene).render(passes=4, beams=64, albedo=True, surface_samples=16)


def test_albedos_are_those_of_the_first_surface_that_is_no_mirror(frame):
    albedo = frame.layers["albedo"]

    def shown(x, y):
        column, row = round(16 + 8 * x), round(16 - 8 * y)
        return albedo[row - 1 : row + 1, column - 1 : column + 1].reshape(-1, 3)

    assert np.allclose(shown(-1, 1), COLOR, atol=1e-5)
    assert np.allclose(shown(1, 1), (0.9, 0.1, 0.3), atol=1e-5)  # the wall behind the camera, in the mirror
    assert np.allclose(shown(-1, -1), 1)
    assert np.allclose(shown(1, -1), COLOR, atol=1e-5)
    assert not shown(0, 0).any()


def test_albedos_are_antialiased(frame):
    albedo = frame.layers["albedo"][..., 1] / COLOR[1]
    # Edges of the first card are in the middle of pixels. A straight edge misplaces at most one of the eight rows of 64
    # stratified samples.
    column = albedo[6:10, 4]
    assert np.allclose(column, 0.5, atol=1 / 8)


def test_a_layer_of_albedos_is_there_if_it_is_asked_for(frame, tmp_path):
    frame.write(tmp_path / "frame.exr")
    found = read_layers(tmp_path / "frame.exr")["albedo"]
    assert np.allclose(found, frame.layers["albedo"], rtol=1e-3)  # half precision
