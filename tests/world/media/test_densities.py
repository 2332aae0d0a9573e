"""Fog that falls with height, in closed form, and fog with wisps, against the looks' noise."""

import drjit as dr
import numpy as np
import pytest

from photonbeams.looks import LightContext, Noise, ShadingContext
from photonbeams.numerics.hashing import hash32
from photonbeams.runtime.device import Array3f, Bool, Float, UInt32
from photonbeams.scene import FogDensity, FogNoise, Medium, Mesh, Scene, SceneError
from photonbeams.scene.places import moved
from photonbeams.world.media.densities import density_grid
from photonbeams.world.media.interfaces import number
from photonbeams.world.media.media import Media
from photonbeams.world.media.stage_media import media_of


def depths(origin, direction, length, axis, density):
    """Return the optical depth of rays at σt 1: the height's antiderivative, over the rays' rise per unit of length."""

    def integral(height):
        return np.where(height < 0, height, density.falloff * -np.expm1(-np.maximum(height, 0) / density.falloff))

    low = origin[:, axis] - density.ground
    high = low + length * direction[:, axis]
    return (integral(high) - integral(low)) / direction[:, axis]


@pytest.mark.parametrize("up, scale", [("Y", 1.0), ("Z", 0.01), ("Y", 1000.0), ("X", 30.0)])
def test_transmittance_of_fog_that_falls_with_height_is_the_closed_form(up, scale):
    rng = np.random.default_rng(int(scale) + 1)
    axis = "XYZ".index(up)
    middle = rng.normal(size=3) * 50 * scale
    low, high = middle - 5 * scale, middle + 5 * scale
    density = FogDensity(rng.uniform(0.5, 4) * scale, middle[axis] + rng.uniform(-4, 2) * scale, up=up)
    medium = Medium(0.2 / scale, mesh=Mesh.box("/Mist", low, high), density=density)
    (built,) = media_of([medium])
    media, count, rays = Media([built.plugin]), 4096, 32
    origin, end = rng.uniform(low, high, (2, rays, 3))
    length = np.linalg.norm(end - origin, axis=1)
    direction = (end - origin) / length[:, None]

    def packed(values):
        return np.repeat(values, count, axis=0).T.astype(np.float32)

    found = media.transmittance(
        dr.full(UInt32, number(built.plugin), rays * count), Array3f(packed(origin)), Array3f(packed(direction)),
        Float(packed(length)), hash32(dr.arange(UInt32, rays * count)), Bool(True),
    ).numpy()[0].reshape(rays, count)  # fmt: skip
    expected = np.exp(-depths(origin, direction, length, axis, density) * 0.2 / scale)
    error = found.std(axis=1) / np.sqrt(count)
    # Four standard errors, plus the grid's: an optical depth of up to 3.5, times (1 / 32)² / 8.
    np.testing.assert_array_less(np.abs(found.mean(axis=1) - expected), 4 * error + 4e-4)


def wispy(low, high, seconds=0.0, **noise):
    medium = Medium(0.01, mesh=Mesh.box("/Mist", low, high), density=FogDensity(noise=FogNoise(**noise)))
    return density_grid(medium.at("Y", seconds))


def at(grid, points):
    """Return a grid's values at points (N, 3), linear between the centres of its cells."""
    from scipy.ndimage import map_coordinates

    inverse = np.linalg.inv(grid.to_world)
    places = (points @ inverse[:3, :3].T + inverse[:3, 3]) * grid.values.shape[::-1] - 0.5
    return map_coordinates(grid.values, places.T[::-1], order=1, mode="nearest")


def test_wisps_are_the_noise_of_looks_and_drift():
    values = {"amount": 0.8, "scale": 2.0, "octaves": 2, "contrast": 1.5, "drift": (0.3, -0.1, 0.2), "evolution": 0.4}
    grid = wispy((7, -2, 3), (11, 1, 5), 1.7, **values)
    cells = np.array(grid.values.shape[::-1])
    points = np.random.default_rng(0).integers(0, cells, (500, 3))
    centers = (points + 0.5) / cells @ grid.to_world[:3, :3].T + grid.to_world[:3, 3]
    place = Array3f(centers.T.astype(np.float32))
    expected = Noise(**values).evaluate(ShadingContext(place=lambda: place, context=LightContext(time=1.7))).numpy()
    np.testing.assert_allclose(at(grid, centers), expected, atol=2e-4)


def test_the_mean_of_wisps_is_one():
    grid = wispy((0, 0, 0), (40, 40, 40), octaves=2, contrast=1.0)
    # 64,000 cells of noise are independent; a value deviates by half at most.
    assert abs(grid.values.mean() - 1) < 4 * 0.5 / np.sqrt(64_000)


def test_wisps_and_heights_far_from_zero_are_those_of_the_users_coordinates():
    """The reference is evaluated in double precision; single precision is off by a quarter of a wisp there."""
    place = np.array([408201.0, 300.0, 4080928.0])
    density = FogDensity(falloff=2.0, ground=place[1] - 1, noise=FogNoise(), seconds=0.0)
    medium = moved(Medium(0.1, mesh=Mesh.box("/Fog", place - 2, place + 2), density=density), -place)
    grid = density_grid(medium)
    z, y, x = (np.arange(count) + 0.5 for count in grid.values.shape)
    at = np.stack(np.meshgrid(z, y, x, indexing="ij")[::-1], axis=-1) / grid.values.shape[::-1]
    points = (at.reshape(-1, 3) @ grid.to_world[:3, :3].T + grid.to_world[:3, 3] + place).T
    double = dr.float64_array_t(Array3f)
    wisps = Noise().evaluate(ShadingContext(place=lambda: double(points), context=LightContext()))
    expected = np.array(wisps) * np.exp(-np.maximum(points[1] - density.ground, 0) / density.falloff)
    assert np.abs(grid.values.ravel() - expected).max() < 1e-4


def test_wisps_stay_in_place_where_their_box_moves():
    first, later = wispy((0, 0, 0), (4, 4, 4)), wispy((0.777, 0.1, -0.3), (5.3, 4.2, 3.9))
    points = np.random.default_rng(1).uniform(0.8, 3.8, (1000, 3))
    np.testing.assert_allclose(at(first, points), at(later, points), atol=1e-4)


def test_fog_of_all_of_space_ends_at_a_box_around_the_scene():
    density = FogDensity(falloff=0.5, ground=-1)
    scene = Scene(media=Medium(0.1, density=density)).within((np.array([1.0, 2.0, 3.0]), 10.0))
    points = scene.media[0].mesh.points
    np.testing.assert_allclose(points.min(axis=0), [-9, -8, -7])
    # 14 falloffs above the ground there is a millionth of the fog.
    np.testing.assert_allclose(points.max(axis=0), [11, 6, 13])
    assert scene.within(scene.bounds).media[0] is scene.media[0]
    assert Scene(media=Medium(0.1, density=FogDensity())).within(scene.bounds).media[0].mesh is None


def test_wisps_too_small_for_their_space_are_blurred_with_a_warning(caplog):
    grid = wispy((0, 0, 0), (900, 900, 900), octaves=4)
    assert grid.values.size < 1.1 * 2**23
    assert "/Mist" not in caplog.text and "wisps of down to 0.125 units in a space of 900" in caplog.text


@pytest.mark.parametrize(
    "made, message",
    [
        (lambda: FogDensity(falloff=0), "falloff of fog is 0: expected a finite number at least"),
        (lambda: FogDensity(up="z"), "up of fog is 'z': expected one of X, Y, Z"),
        (lambda: FogDensity(noise=0.5), "noise of fog is a float: expected a FogNoise, or None"),
        (lambda: FogNoise(octaves=9), r"octaves of a fog's noise is 9: expected .* at least 1 and at most 8"),
        (lambda: FogNoise(drift=(1, 2)), r"drift of a fog's noise is \(1, 2\): expected three finite numbers"),
        (lambda: Medium(0.1, density=0.5), "density is 0.5: expected a FogDensity, or None"),
    ],
)
def test_bad_numbers_are_named(made, message):
    with pytest.raises(SceneError, match=message):
        made()
