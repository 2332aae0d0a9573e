"""Walks through fog find small lamps: densities integrate to 1, and noise does not depend on the lamp's size."""

import drjit as dr
import numpy as np
import pytest
from scipy.ndimage import maximum_filter

from photonbeams.numerics.sampling import pixel_sample
from photonbeams.render.light import ShotLight
from photonbeams.render.paths.emitters import Chosen
from photonbeams.render.paths.mitsuba_emitters import MitsubaEmitters
from photonbeams.render.paths.toward_lamps import Ball, Equiangular, Toward
from photonbeams.render.settings import Settings
from photonbeams.runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from photonbeams.world.plugin import world_of_plugin
from tests.helpers.mitsuba_scenes import camera, cube_of, fog, frames, load, rgb
from tests.helpers.sweep import sweep

mi = mitsuba()


def ball(center, radius=0.0):
    return Ball(Array3f(*center), Float(radius), Bool(True))


@pytest.mark.parametrize(("place", "radius"), [((0.3, 0.2, 1.0), 0.0), ((0.01, 0, 5.0), 0.02), ((0, 3.0, -2.0), 0.5)])
def test_distances_along_a_segment_have_the_density_that_they_tell(place, radius):
    near = Equiangular(Array3f(0, 0, 0), Array3f(0, 0, 1), Float(2.5), ball(place, radius))
    u = (dr.arange(Float, 100_000) + 0.5) / 100_000
    t = near.sample(u)
    # With equal steps of u, the mean of 1/p is the segment's length: the midpoint rule errs by less than 1e-3.
    assert np.isclose(np.mean(1 / near.density(t).numpy()), 2.5, rtol=1e-3)
    assert np.all((t.numpy() >= 0) & (t.numpy() < 2.5))


def test_directions_toward_a_lamp_have_the_density_that_they_tell():
    toward = Toward(Array3f(1, 2, 3), ball((1.5, 1.0, 2.5)))
    count = 1 << 16
    chosen = toward.sample(pixel_sample(dr.arange(UInt32, count), dr.opaque(UInt32, 1)))
    assert np.allclose(dr.norm(chosen).numpy(), 1, atol=1e-5)
    # The mean of f/p is the integral of f over all directions: 4π/3 for f = z². With 1/p up to 8 times its mean, the
    # error of 65,536 spread points is far below that of as many random ones, 3/256.
    found = dr.square(chosen.z) / toward.density(chosen)
    assert np.isclose(np.mean(found.numpy()), 4 * np.pi / 3, rtol=3 / 256)


def test_spheres_are_around_what_shines():
    scene = load(
        ball={"type": "sphere", "center": [1, 2, 3], "radius": 0.5, "emitter": {"type": "area"}},
        point={"type": "point", "position": [-1, 0, 2]},
        sky={"type": "constant"},
        fog=cube_of(fog(1.0, 0.5)), sensor=camera(size=4),
    )  # fmt: skip
    world, order = world_of_plugin(scene), [each.class_name() for each in scene.emitters()]
    balls = MitsubaEmitters(world, Chosen([0, 1, 2], [1.0, 1.0, 1.0])).balls(dr.arange(UInt32, 3), Bool(True))
    near, radius, center = balls.near.numpy(), balls.radius.numpy(), balls.center.numpy().T
    found = {name: (near[number], radius[number], center[number]) for number, name in enumerate(order)}
    assert not found["ConstantBackgroundEmitter"][0]
    # Around the 32 places of a sphere that are seen there may be a smaller or a larger ball, up to the box's diagonal.
    assert 0.25 < found["AreaLight"][1] < 0.5 * np.sqrt(3) + 1e-3
    assert np.allclose(found["AreaLight"][2], [1, 2, 3], atol=0.25)
    assert found["PointLight"][1] < 1e-5
    assert np.allclose(found["PointLight"][2], [-1, 0, 2], atol=1e-5)


def room(**lamp):
    """Return a closed room full of fog, with a lamp in it."""
    medium = mi.load_dict(fog(0.5, 0.9))
    return load(
        walls={"type": "cube", "bsdf": {"type": "twosided", "side": {"type": "diffuse", "reflectance": 0.6}},
               "interior": medium},
        lamp=lamp | {("exterior" if lamp["type"] == "sphere" else "medium"): medium},
        sensor=camera((0, 0, 0.95), (0, 0, -1), 24, 60, medium=medium),
    )  # fmt: skip


@pytest.mark.parametrize("kind", ["point", "spot"])
def test_a_lamp_without_size_in_fog_leaves_no_bright_dots_on_walls(kind):
    place = {"position": [0.3, 0.5, -0.3]}
    if kind == "spot":
        aim = mi.ScalarTransform4f().look_at(place.pop("position"), [0, -1, 0], [0, 0, 1])
        place = {"to_world": aim, "cutoff_angle": 60.0}
    found = frames(room(type=kind, intensity=1.0, **place), Settings(method="paths", passes=32, max_depth=4), 4)
    walls = np.array([each.layers()["surface"] for each in found]).mean(axis=-1)
    # Direct light alone is smooth. What fog adds is bounded: before, single walks that were scattered beside the lamp
    # made pixels 10 to 100 times as bright as those beside them.
    beside = maximum_filter(np.median(walls, axis=0), 3)
    assert np.all(walls < 2 * beside + walls.mean())


@pytest.mark.parametrize("seed", sweep(range(3), [1]))
def test_light_is_the_same_whatever_powers_emitters_state(monkeypatch, seed):
    """Powers only say which emitters have more samples: those drawn here reach from 0 to a million."""
    lamps = {
        f"lamp{number}": {"type": "point", "position": [x, 0.5, 0.2], "intensity": rgb(each)}
        for number, (x, each) in enumerate(zip((-0.6, 0.0, 0.7), (0.2, 1.0, 0.5), strict=True))
    }
    wall = {"type": "rectangle", "to_world": mi.ScalarTransform4f().translate([0, 0, -0.5]).scale(2)}
    scene = load(**lamps, wall=wall, fog=cube_of(fog(0.5)), sensor=camera(size=64))
    plugin = mi.load_dict({"type": "photon_beams", "method": "paths", "max_depth": 4})

    def mean():
        found = [np.array(mi.render(scene, integrator=plugin, spp=2, seed=each)).mean() for each in range(3)]
        return np.mean(found), np.std(found, ddof=1) / np.sqrt(3)

    right, error = mean()
    rng = np.random.default_rng(seed)
    powers = rng.choice([0.0, 1.0], 3, p=[0.3, 0.7]) * 10 ** rng.uniform(-3, 6, 3)
    monkeypatch.setattr(ShotLight, "_power", dict(enumerate(powers)))
    found, other = mean()
    assert abs(found - right) < 5 * np.hypot(error, other)
    assert np.hypot(error, other) < 0.03 * right
