"""Equirectangular and fisheye cameras beside their formulas in float64."""

import drjit as dr
import numpy as np
import pytest

from photonbeams.runtime.device import Float, UInt32
from photonbeams.scene import Camera, SceneError
from photonbeams.scene.cameras import EQUIRECTANGULAR, FISHEYES
from photonbeams.transport.guiding.importance import Views
from photonbeams.world.cameras import panoramas
from photonbeams.world.cameras.cameras import View, Window

# Another inverse than the code's: the angle from the axis that is seen at a distance from the middle of the film.
ANGLES = {
    "fisheyeEquidistant": lambda r: r,
    "fisheyeEquisolid": lambda r: 2 * np.arcsin(r / 2),
    "fisheyeStereographic": lambda r: 2 * np.arctan(r / 2),
    "fisheyeOrthographic": np.arcsin,
}
WIDTH, HEIGHT = 48, 32


def turned(rng):
    """Return a random rigid transform."""
    matrix, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    result = np.eye(4)
    result[:3, :3] = matrix * np.sign(np.linalg.det(matrix))
    result[:3, 3] = rng.normal(size=3)
    return result


def directions(camera, right, up):
    """Return the directions, (N, 3), in which places on the film look."""
    if camera.projection == EQUIRECTANGULAR:
        local = np.stack([np.sin(right) * np.cos(up), np.sin(up), -np.cos(right) * np.cos(up)], axis=-1)
    else:
        r, around = np.hypot(right, up), np.arctan2(up, right)
        theta = ANGLES[camera.projection](r)
        local = np.stack([np.sin(theta) * np.cos(around), np.sin(theta) * np.sin(around), -np.cos(theta)], axis=-1)
    return local @ camera.to_world[:3, :3].T


def pixels(window):
    x, y = np.meshgrid(np.arange(window.width) + 0.5, np.arange(window.height) + 0.5)
    return x.ravel(), y.ravel()


@pytest.mark.parametrize(
    ("projection", "field"),
    [(EQUIRECTANGULAR, (360, 180)), (EQUIRECTANGULAR, (180, 90)), *((each, (170, 170)) for each in FISHEYES),
     ("fisheyeEquidistant", (300, 200)), ("fisheyeStereographic", (250, 250))],
)  # fmt: skip
def test_rays_have_the_directions_of_the_formula_and_places_are_found_again(rng, projection, field):
    camera, window = Camera.panorama("c", turned(rng), projection, field), Window.full(WIDTH, HEIGHT)
    view = View(camera, window)
    rays = view.rays((0.5, 0.5))
    x, y = pixels(window)
    scale = view.pixels_per_tangent
    right, up = (x - WIDTH / 2) / scale[0], (HEIGHT / 2 - y) / scale[1]
    if projection == EQUIRECTANGULAR:
        seen = (np.abs(right) <= np.pi) & (np.abs(up) <= np.pi / 2)
    else:
        seen = np.hypot(right, up) <= FISHEYES[projection](np.radians(max(field)) / 2)
    np.testing.assert_array_equal(rays.seen.numpy(), seen)
    assert 0.3 < seen.mean() <= 1
    found, expected = rays.direction.numpy().T[seen], directions(camera, right[seen], up[seen])
    # Rounding of places in single precision: 1e-7 of a picture, which is at most a few radians wide.
    np.testing.assert_allclose(found, expected, atol=5e-6)
    np.testing.assert_array_equal(rays.facing.numpy(), 1)  # depths are distances
    places = np.concatenate([camera.to_world[:3, 3] + 7 * expected, np.ones((len(expected), 1))], axis=1)
    np.testing.assert_allclose(view.in_picture(places), np.stack([x, HEIGHT - y], 1)[seen] / [WIDTH, HEIGHT], atol=1e-6)


def test_the_middle_and_the_edges_of_a_panorama():
    view = View(Camera.panorama("c", np.eye(4)), Window.full(360, 180))
    known = {(0.5, 0.5): (0, 0, -1), (0.75, 0.5): (1, 0, 0), (0.5, 0.0): (0, 1, 0), (0.0, 0.5): (0, 0, 1)}
    for at, expected in known.items():
        np.testing.assert_allclose(view.ray(at).direction.numpy().ravel(), expected, atol=1e-6)


def test_the_middle_of_a_fisheye_has_no_gap():
    for projection in FISHEYES:
        found = panoramas.toward(projection, Float(0), Float(0))
        np.testing.assert_array_equal(np.ravel(found.numpy()), [0, 0, 1])


@pytest.mark.parametrize(
    ("projection", "field", "count"),
    [(EQUIRECTANGULAR, (360, 180), 6), ("fisheyeEquidistant", (180, 180), 5), ("fisheyeEquidistant", (60, 60), 1),
     ("fisheyeEquidistant", (360, 360), 6)],
)  # fmt: skip
def test_faces_of_a_cube_show_all_that_a_panorama_sees(rng, projection, field, count):
    camera, window = Camera.panorama("c", turned(rng), projection, field), Window.full(WIDTH, HEIGHT)
    view = View(camera, window)
    rays = view.rays((0.5, 0.5))
    assert len(view.projections) == count
    views, shown = Views(view.projections), np.zeros(WIDTH * HEIGHT, bool)
    for number in range(count):
        face = views(dr.opaque(UInt32, number, WIDTH * HEIGHT))
        low, high = face.clipped(view.projection.origin, rays.direction, Float(1))
        shown |= (high > low).numpy()
    assert shown[rays.seen.numpy()].all()


@pytest.mark.parametrize(
    ("projection", "field", "text"),
    [("equirectangular", (400, 180), "360 and 180"), ("equirectangular", (0, 180), "above 0"),
     ("fisheyeOrthographic", (200, 200), "up to 180"), ("fisheyeEquidistant", (np.nan, 3), "two angles"),
     ("mirrorball", (), "expected one of equirectangular")],
)  # fmt: skip
def test_a_field_that_a_projection_cannot_show_is_told(projection, field, text):
    with pytest.raises(SceneError, match=text) as error:
        Camera.panorama("c", np.eye(4), projection, field)
    assert len(str(error.value)) <= 300


def test_a_projection_that_does_not_exist_is_told():
    with pytest.raises(SceneError, match="projection is 'cylinder': expected one of perspective"):
        Camera("c", np.eye(4), projection="cylinder")
