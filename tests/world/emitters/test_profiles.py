"""IES profiles in kernels: their directions by hdEmbree's convention, and samples that follow them."""

import drjit as dr
import numpy as np
import pytest

from photonbeams import scene
from photonbeams.numerics.arrays import to_vectors
from photonbeams.numerics.sampling import sobol_block
from photonbeams.runtime.device import Array3f, UInt32
from photonbeams.world.emitters.build import lamp_of
from photonbeams.world.emitters.gobos import pack_projected, projected
from photonbeams.world.emitters.profiles import ProfileTable

AROUND = [0, 90, 180, 270, 360]
VALUES = np.array([[2, 5, 1, 0.5], [2, 3, 0, 0.2], [2, 1, 0, 0.1], [2, 4, 0, 0.6], [2, 5, 1, 0.5]])
#: A light that looks along +X, with +Z up.
FRAME = np.eye(4)
FRAME[:3, :3] = [[0, 0, -1], [-1, 0, 0], [0, 1, 0]]


@pytest.mark.parametrize("scale", [0.0, 0.5, -0.5, 2.0, -2.0])
def test_the_angles_are_those_of_the_direction_to_the_light_in_its_own_space(rng, scale):
    """As in hdEmbree, θ = acos(w_z) and φ = atan2(w_y, w_x), where w points from the lit point to the light."""
    profile = scene.Profile([0, 30, 60, 180], AROUND, VALUES, scale)
    directions = rng.normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    w = -directions @ FRAME[:3, :3]
    theta, phi = np.degrees(np.arccos(w[:, 2])), np.degrees(np.arctan2(w[:, 1], w[:, 0]))
    table = ProfileTable.of(profile, FRAME)
    found = table.factor(to_vectors(directions), to_vectors(profile.colors.reshape(-1, 3))).numpy()
    # A profile that is scaled down has sharp edges: rounding puts a few directions on their other side.
    assert np.mean(np.abs(found[0] - profile.at(theta, phi)) < 1e-3) > (0.99 if 0 < abs(scale) < 1 else 0.999)


def test_directions_are_sampled_with_the_density_that_they_are_told_to_have():
    profile = scene.Profile([0, 30, 60, 180], AROUND, VALUES + 1)
    light = scene.SphereLight(
        "/light", (1.0, 1.0, 1.0), frame=FRAME, axis=-FRAME[:3, 2], shaping=scene.Shaping(180, profile=profile)
    )
    sampler = projected(lamp_of(light), light, None, {}).bare.directions
    direction, density = sampler.sample(sobol_block(1 << 14, 0, (3,))[0])
    # ∫ dω over the sphere is 4π, and ∫ of the square of each component of the direction is a third of that.
    weight = 1 / density.numpy().astype(np.float64)
    assert np.mean(weight) == pytest.approx(4 * np.pi, rel=1e-4)
    assert np.allclose(np.mean(weight * direction.numpy() ** 2, axis=1), 4 * np.pi / 3, rtol=1e-3)
    assert dr.allclose(dr.norm(direction), 1, atol=1e-5)


def test_lights_that_share_a_profile_share_its_table():
    shared, own = scene.Profile([0, 180], [0], [[1, 1]]), scene.Profile([0, 180], [0], [[3, 3]])
    lights = [
        scene.SphereLight(f"/{number}", (1.0, 1.0, 1.0), shaping=scene.Shaping(180, profile=profile))
        for number, profile in enumerate((shared, own, shared))
    ]
    packed, pixels = pack_projected([projected(lamp_of(light), light, None, {}) for light in lights])
    assert len(pixels["profile"].x) == 2 * (2 * 722 + 1)
    for number, expected in enumerate((1, 3, 1)):
        light = dr.gather(type(packed), packed, UInt32(number)).with_pixels(pixels)
        assert np.allclose(light.tint(Array3f(0), Array3f(0, 0, -1)).numpy(), expected)
