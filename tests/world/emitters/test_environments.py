"""Environment maps of Mitsuba scenes that are turned: where their light enters the scene."""

import numpy as np
import pytest

from photonbeams.numerics.sampling import pairs, sobol_points
from photonbeams.render.settings import Settings
from photonbeams.runtime.device import mitsuba
from photonbeams.world.media.discovery.surroundings import places_of
from photonbeams.world.plugin import world_of_plugin
from tests.helpers.mitsuba_scenes import camera, cube_of, fog, frames, load
from tests.helpers.sweep import sweep

mi = mitsuba()
T = mi.ScalarTransform4f
COUNT = 1 << 14


def sky(seed):
    """Return an environment map that is dark but for a bright spot, turned at random."""
    rng = np.random.default_rng(seed)
    pixels = np.full((16, 32, 3), 0.2, np.float32)
    pixels[rng.integers(3, 12), rng.integers(32)] = 30
    axis = rng.standard_normal(3)
    turn = T().rotate(list(axis / np.linalg.norm(axis)), rng.uniform(30, 330))
    return {"type": "envmap", "bitmap": mi.Bitmap(pixels), "to_world": turn}


@pytest.mark.parametrize("seed", range(4))
def test_paths_of_a_turned_map_begin_on_a_disc_across_their_direction_before_the_scene(seed):
    rng = np.random.default_rng(100 + seed)
    center, size = rng.uniform(-50, 50, 3), 10 ** rng.uniform(-2, 2)
    scene = load(sky=sky(seed), ball={"type": "sphere", "center": center.tolist(), "radius": size})
    world = world_of_plugin(scene, None)
    rays = world.emitters[0].lamp.emit(*pairs(sobol_points(COUNT, 0, (seed,))), world.bounds)
    origin, direction = rays.origin.numpy().T, rays.direction.numpy().T
    middle, radius = np.ravel(world.bounds.center.numpy()), float(world.bounds.radius.numpy()[0])
    from_center = (origin - middle) / radius
    # Rounding of coordinates up to 50, in radii of the sphere.
    np.testing.assert_allclose((from_center * direction).sum(axis=1), -1, atol=1e-3 + 50 * 1e-6 / radius)
    across = np.linalg.norm(from_center + direction, axis=1)
    assert across.max() < 1.01
    # Uniform on the disc: the mean of the squared radius is 1/2, and its standard deviation 1/sqrt(12).
    assert np.mean(across**2) == pytest.approx(0.5, abs=6 / np.sqrt(12 * COUNT))
    place = places_of(scene)[0]
    half = len(place.origin) // 2  # then the reverses follow
    assert (np.linalg.norm(place.origin[:half] - center, axis=1) > 0.99 * size).all()


@pytest.mark.parametrize("seed", sweep(range(2), [0]))
def test_a_turned_sky_lights_the_fog_of_a_hut_as_walks_say(seed):
    # Five walls of a room, and one side open.
    turns = [([0, 1, 0], 90), ([1, 0, 0], 90), ([1, 0, 0], -90), ([0, 1, 0], 0), ([0, 1, 0], 180)]
    black = {"type": "twosided", "side": {"type": "diffuse", "reflectance": 0.0}}
    walls = {
        f"wall{number}": {"type": "rectangle", "bsdf": black, "to_world": T().rotate(*turn).translate([0, 0, 1])}
        for number, turn in enumerate(turns)
    }
    medium = mi.load_dict(fog(0.2))
    scene = load(
        sky=sky(seed),
        fog=cube_of(medium, 1.2),
        sensor=camera((0.9, 0.2, -0.3), fov=80, size=64, medium=medium),
        **walls,
    )
    found = []
    for method, passes in (("beams", 4), ("paths", 4)):
        seen = frames(scene, Settings(method=method, passes=passes, max_depth=2), 6)
        light = [np.mean(each.layers()["beams"][..., :3]) for each in seen]
        found.append((np.mean(light), np.std(light, ddof=1) / np.sqrt(6)))
    (beams, error), (walks, other) = found
    assert np.hypot(error, other) < 0.04 * walks
    assert beams == pytest.approx(walks, abs=4 * np.hypot(error, other))
