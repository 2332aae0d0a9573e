"""The picture's window: how the camera's aperture fits it, the shape of its pixels, and overscan."""

import numpy as np
import pytest

from photonbeams.render.films.film import Film
from photonbeams.runtime.device import Array2f
from photonbeams.scene import Camera
from photonbeams.scene.cameras import CONFORM_POLICIES
from photonbeams.world.cameras.cameras import View, Window


def cases(rng, count=40):
    """Yield cameras and pictures of many proportions: (camera, width, height, a pixel's width over its height)."""
    for _ in range(count):
        wide, high, focal = rng.uniform(0.2, 5, 3)
        offsets = rng.uniform(-1, 1, 2)
        projection = str(rng.choice(["perspective", "orthographic"]))
        camera = Camera("/c", np.eye(4), focal, wide, high, *offsets, projection=projection)
        yield camera, *(int(each) for each in rng.integers(1, 200, 2)), float(rng.choice([1.0, 0.5, 2.0, 1.37]))


@pytest.mark.parametrize("policy", CONFORM_POLICIES)
def test_the_aperture_conforms_as_openusd_defines_it(rng, policy):
    for camera, width, height, ratio in cases(rng):
        own, (wide, high) = (camera.horizontal_aperture, camera.vertical_aperture), (
            Window(width, height, (0, 0, 1, 1), ratio, policy).aperture(camera)
        )  # fmt: skip
        if policy == "adjustPixelAspectRatio":
            assert (wide, high) == own
            continue
        assert wide / high == pytest.approx(ratio * width / height)
        expected = {
            "adjustApertureWidth": (None, own[1]), "adjustApertureHeight": (own[0], None),
            "expandAperture": (max(own[0], wide), max(own[1], high)),
            "cropAperture": (min(own[0], wide), min(own[1], high)),
        }[policy]  # fmt: skip
        assert wide == pytest.approx(wide if expected[0] is None else expected[0])
        assert high == pytest.approx(high if expected[1] is None else expected[1])
        assert wide == pytest.approx(own[0]) or high == pytest.approx(own[1])


@pytest.mark.parametrize("policy", CONFORM_POLICIES)
def test_rays_matrices_and_the_header_agree_on_the_frustum(rng, policy):
    for camera, width, height, ratio in cases(rng, 6):
        view = View(camera, Window(width, height, (-3, -2, width + 1, height + 2), ratio, policy))
        (wide, high), header = view.window.aperture(camera), view.header()
        assert header["pixelAspectRatio"] == pytest.approx(wide / high * height / width)
        if policy != "adjustPixelAspectRatio":
            assert header["pixelAspectRatio"] == ratio
        rays = view.rays(Array2f(0.25, 0.75))
        origin, direction = np.broadcast_arrays(*(each.numpy().T for each in (rays.origin, rays.direction)))
        column, row = (np.tile(np.arange(-3, width + 1), height + 4), np.repeat(np.arange(-2, height + 2), width + 4))
        place = np.stack([(column + 0.25) / width, 1 - (row + 0.75) / height], axis=1)
        points = np.concatenate([origin + 7 * direction, np.ones((len(origin), 1))], axis=1) @ header["worldToNDC"]
        assert np.allclose(points[:, :2] / points[:, 3:], place, atol=2e-5)
        slope = (place - 0.5) * (wide, high) + (camera.horizontal_offset, camera.vertical_offset)
        if not camera.orthographic:
            assert np.allclose(direction[:, :2] / -direction[:, 2:], slope / camera.focal_length, rtol=1e-4, atol=1e-5)
            left, up = header["screenWindowCenter"]
            assert (-left, up) == pytest.approx(
                np.array([camera.horizontal_offset, camera.vertical_offset]) / camera.focal_length
            )
            assert header["screenWindowWidth"] == pytest.approx(wide / camera.focal_length)


@pytest.mark.parametrize(("width", "height", "crop"), [(64, 36, (-32, -18, 96, 54)), (53, 47, (-5, -40, 60, 48))])
def test_pixels_of_overscan_have_numbers_of_their_own(width, height, crop):
    """Those of the picture are its own, and those of each pixel are the same in all windows."""
    x0, y0, x1, y1 = crop
    order = Film((y1 - y0, x1 - x0), (x0, y0), size=(width, height)).order.numpy().reshape(y1 - y0, x1 - x0)
    assert len(np.unique(order)) == order.size
    whole = Film((height, width)).order.numpy().reshape(height, width)
    assert np.array_equal(order[-y0 : height - y0, -x0 : width - x0], whole)
    part = Film((9, 7), (x0 + 2, y0 + 3), size=(width, height)).order.numpy().reshape(9, 7)
    assert np.array_equal(part, order[3:12, 2:9])


@pytest.mark.parametrize("margin", [0, 2])
def test_a_window_grows_to_the_edge_of_the_picture_and_beyond_it_in_overscan(margin):
    assert Window(64, 36, (0, 4, 64, 20)).grown(margin).crop == (0, 0, 64, 20 + margin)
    assert Window(64, 36, (-32, -18, 96, 54)).grown(margin).crop == (
        -32 if margin == 0 else -48, -32, 96 + margin, 54 + margin,
    )  # fmt: skip
