"""Walks meet the light of emitters for which they have less noise at equal cost than beams, and miss no light."""

import numpy as np
import pytest

from photonbeams.render.pilots.choice import noise, prefers_walks
from photonbeams.render.scene_frame import begin
from photonbeams.render.settings import Settings
from photonbeams.runtime.device import mitsuba
from tests.helpers.mitsuba_scenes import camera, comparison, cube_of, fog, load, rgb

mi = mitsuba()
RAYS = (24, 40)
SKY = {"type": "constant", "radiance": rgb(1.0)}
LAMP = {"type": "point", "position": [0, 3, 0], "intensity": rgb(5.0)}


def passes(count, mean, spread, seed=0):
    """Return the radiance of rays in passes, (P, H, W), with a mean and a standard deviation relative to it."""
    return mean * (1 + spread * np.random.default_rng(seed).standard_normal((count, *RAYS)))


@pytest.mark.parametrize(("spread", "cost", "walks"), [(0.1, 1.0, True), (0.4, 1.0, False), (0.4, 0.1, True)])
def test_what_has_less_noise_at_equal_cost_is_preferred(spread, cost, walks):
    assert prefers_walks(passes(4, 1.0, 0.2), passes(8, 1.0, spread, 1), cost) is walks


def test_walks_that_miss_light_are_not_preferred():
    # The standard error of both means is below 0.4 %: if a tenth is lacking, walks miss light.
    assert not prefers_walks(passes(4, 1.0, 0.2), passes(8, 0.9, 0.01, 1), 1.0)


def test_noise_is_the_variance_in_units_of_the_mean_and_dark_parts_count_little():
    mean = np.ones(RAYS)
    # 7,680 samples of a normal distribution give its variance to 1.6 %.
    assert noise(passes(8, 1.0, 0.3), mean) == pytest.approx(0.09, rel=0.07)
    dark = np.where(np.arange(40) < 8, 0.01, 1.0) * np.ones(RAYS)  # the blocks at the left
    found = passes(8, 1.0, 0.3)
    found = np.where(dark < 1, 0.01 * (1 + 3 * (found - 1)), found)
    assert noise(found, dark) == pytest.approx(0.09, rel=0.1)


def test_nothing_is_noise_where_nothing_shines():
    assert noise(np.zeros((4, *RAYS)), np.zeros(RAYS)) == 0


def walked(scene, **settings):
    """Return the number of emitters that walks meet, and the names of those that emit light paths."""
    light = begin(scene, scene.sensors()[0], Settings(beams=1024, **settings)).light
    known = [each.emitter.name for each in light.simulation.strata(light.world)]
    return sum(len(each.emitters) for _, each in light.walks(light.world).media), known


def test_shafts_have_beams_and_a_sky_over_fog_has_walks():
    assert walked(comparison(320, 180))[0] == 0
    scene = load(fog=cube_of(fog(1.0)), sky=SKY, sensor=camera())
    assert walked(scene) == (1, [])


def test_without_fog_all_light_is_met_by_walks():
    floor = {"type": "rectangle", "to_world": mi.ScalarTransform4f().scale(4)}
    assert walked(load(floor=floor, lamp=LAMP, sky=SKY, sensor=camera()), guiding=False) == (2, [])


def test_a_method_that_is_asked_for_is_taken():
    scene = load(fog=cube_of(fog(1.0)), sky=SKY, sensor=camera())
    assert walked(scene, method="beams", guiding=False)[0] == 0
