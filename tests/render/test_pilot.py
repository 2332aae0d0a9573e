"""Walks meet the light of emitters in fog where nothing is in its way, beams that through openings and beside glass."""

from photonbeams.render.scene_frame import begin
from photonbeams.render.settings import Settings
from photonbeams.runtime.device import mitsuba
from tests.helpers.mitsuba_scenes import camera, comparison, cube_of, fog, load, rgb

mi = mitsuba()
SKY = {"type": "constant", "radiance": rgb(1.0)}
LAMP = {"type": "point", "position": [0, 3, 0], "intensity": rgb(5.0)}
GLASS = {"type": "sphere", "radius": 0.3, "bsdf": {"type": "dielectric"}}


def walked(scene, **settings):
    """Return the number of emitters that walks meet, and the names of those that emit light paths."""
    light = begin(scene, scene.sensors()[0], Settings(beams=1024, **settings)).light
    known = [each.emitter.name for each in light.simulation.strata(light.world)]
    return sum(len(each.emitters.choice.probabilities) for _, each in light.walks(light.world).media), known


def test_shafts_have_beams_and_a_sky_over_fog_has_walks():
    assert walked(comparison(320, 180))[0] == 0
    scene = load(fog=cube_of(fog(1.0)), sky=SKY, sensor=camera())
    assert walked(scene) == (1, [])


def test_suns_over_fog_have_walks_and_beams_beside_glass_as_lamps_have():
    sun, glass = {"type": "directional", "direction": [0, -1, -0.2]}, GLASS | {"center": [1.5, 0, 0]}
    assert walked(load(fog=cube_of(fog(1.0)), sun=sun, sensor=camera())) == (1, [])
    assert walked(load(fog=cube_of(fog(1.0)), sun=sun, glass=glass, sensor=camera()))[0] == 0
    assert walked(load(fog=cube_of(fog(1.0)), lamp=LAMP, sensor=camera()))[0] == 0


def test_without_fog_all_light_is_met_by_walks():
    floor = {"type": "rectangle", "to_world": mi.ScalarTransform4f().scale(4)}
    assert walked(load(floor=floor, lamp=LAMP, sky=SKY, sensor=camera()), guiding=False) == (2, [])


def test_a_method_that_is_asked_for_is_taken():
    scene = load(fog=cube_of(fog(1.0)), sky=SKY, sensor=camera())
    assert walked(scene, method="beams", guiding=False)[0] == 0
