"""Spheres that shine in Mitsuba scenes: light paths that are chosen by direction first."""

import numpy as np
import pytest

from photonbeams.numerics.sampling import pairs, sobol_points
from photonbeams.runtime.device import mitsuba
from photonbeams.world.emitters.mitsuba_emitter import MitsubaEmitter, MitsubaSphere
from photonbeams.world.plugin import world_of_plugin
from tests.helpers.mitsuba_scenes import load, rgb
from tests.helpers.tracing import emission_of

mi = mitsuba()
COUNT = 1 << 14
LIGHT = [3.0, 2.0, 1.0]


def lamp_of(center, radius, radiance, **more):
    shining = {"emitter": {"type": "area", "radiance": radiance}}
    lamp = {"type": "sphere", "center": center, "radius": radius, **shining, **more}
    scene = load(lamp=lamp, wall={"type": "sphere", "center": center, "radius": 100 * radius})
    return world_of_plugin(scene, None)


def paths_of(world):
    (paths,) = emission_of(world, COUNT).emit(0)
    return paths


@pytest.mark.parametrize(("center", "radius"), [((0, 0, 0), 1.0), ((300, -20, 4), 0.5), ((1, 2, 3), 1e-3)])
def test_paths_leave_all_of_the_sphere_and_carry_its_power(center, radius):
    world = lamp_of(center, radius, rgb(LIGHT))
    assert isinstance(world.emitters[0].lamp, MitsubaSphere)
    paths = paths_of(world)
    # The power is 4 π² r² L, and each path has an equal part. Rounding may lose a path that grazes the sphere.
    expected = 4 * np.pi**2 * radius**2 * np.array(LIGHT)
    np.testing.assert_allclose(paths.flux.numpy().astype(float).sum(axis=1), expected, rtol=1e-3)
    normal = (paths.origin.numpy().T - center) / radius
    rounding = 2e-4 * (1 + np.abs(center).max()) / radius  # by which Mitsuba keeps rays off surfaces
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1, atol=rounding)
    cosine = (normal / np.linalg.norm(normal, axis=1, keepdims=True) * paths.direction.numpy().T).sum(axis=1)
    # Uniform over the silhouette: cos² is uniform, so the mean of cos is 2/3, but for where rays are kept off.
    assert cosine.min() > 0
    assert np.mean(cosine) == pytest.approx(2 / 3, abs=0.01 + rounding)
    np.testing.assert_allclose(paths.direction.numpy().mean(axis=1), 0, atol=0.01)


def test_the_power_of_a_textured_sphere_is_that_of_its_texture():
    stripes = np.zeros((8, 16, 3), dtype=np.float32)
    stripes[:, 3:7], stripes[:2] = [4, 1, 0], [0, 2, 1]
    texture = {"type": "bitmap", "bitmap": mi.Bitmap(stripes), "raw": True}
    world = lamp_of((2, 1, 0), 0.7, texture)
    own, bounds = world.emitters[0].lamp, world.bounds
    usual = MitsubaEmitter(own.emitter, world.plugin)
    sample = pairs(sobol_points(1 << 16, 0, (1,)))
    both = [each.emit(*sample, bounds).flux.numpy().mean(axis=1) for each in (own, usual)]
    np.testing.assert_allclose(*both, rtol=0.01)


def test_a_sphere_that_shines_inward_is_sampled_by_mitsuba():
    world = lamp_of((0, 0, 0), 1.0, rgb(LIGHT), flip_normals=True)
    assert type(world.emitters[0].lamp) is MitsubaEmitter
