"""Numbers of samples of surfaces and of pixels at edges of beams; what integrators keep between renders."""

import numpy as np
import pytest

from photonbeams.render import lights
from photonbeams.render.costs import surface_samples
from photonbeams.render.lights import Findings
from photonbeams.render.scene_frame import Extras, begin, render
from photonbeams.render.settings import Settings
from photonbeams.runtime.device import mitsuba
from photonbeams.scene import SceneError
from photonbeams.world.parameters import Parameters
from tests.helpers.mitsuba_scenes import by_beams, camera, comparison, cube_of, fog, load, rgb

mi = mitsuba()
LAMP = {"type": "sphere", "center": [0, 3, 0], "radius": 0.5, "emitter": {"type": "area", "radiance": rgb(20.0)}}


def room(albedo, **film):
    """Return a room of fog with a large lamp in it, whose walls have this albedo."""
    turned = mi.ScalarTransform4f().translate([0, 0.9, 0]).rotate([1, 0, 0], 90).scale(0.5)
    walls = {
        **cube_of(fog(0.05)),
        "bsdf": {"type": "twosided", "side": {"type": "diffuse", "reflectance": rgb(albedo)}},
    }
    return load(
        lamp={"type": "rectangle", "to_world": turned, "emitter": {"type": "area", "radiance": rgb(5.0)}}, walls=walls,
        sensor=camera((0, 0, 0.9), fov=80, **{"width": 640, "height": 360, **film}),
    )  # fmt: skip


def test_passes_without_light_paths_look_once_and_others_as_often_as_their_beams_pay_for():
    assert surface_samples(0, 1000) == 1
    counts = [surface_samples(16384, pixels) for pixels in (16, 10_000, 100_000, 1_000_000, 100_000_000)]
    assert counts == sorted(counts, reverse=True) and counts[0] == 16 and counts[-1] >= 1
    assert all(each & (each - 1) == 0 for each in counts)
    assert surface_samples(1, 100_000_000) == 1


@pytest.mark.parametrize("value", [0, 3, 2048, 1.5])
def test_a_number_of_samples_is_a_power_of_two(value):
    with pytest.raises(SceneError, match="surface_samples"):
        Settings(surface_samples=value)


def test_more_samples_at_edges_leave_the_mean_and_take_the_noise_of_edges_away():
    """More samples remove the noise of edges, where fog behind the hole is forty times as bright as before the wall."""
    scene = comparison(48, 27)
    found = {}
    for each in (1, 8):
        once = {"passes": 1, "beams": 8192, "max_depth": 2, "surface_samples": each, "guiding": False}
        pictures = [render(scene, scene.sensors()[0], by_beams(seed=seed, **once)) for seed in range(12)]
        found[each] = np.array([picture.layers()["beams"].mean(axis=2) for picture in pictures])
    totals = {each: own.mean(axis=(1, 2)) for each, own in found.items()}
    error = np.hypot(*(each.std(ddof=1) / np.sqrt(len(each)) for each in totals.values()))
    assert abs(totals[1].mean() - totals[8].mean()) < 4 * error
    variance = {each: own.var(axis=0, ddof=1) for each, own in found.items()}
    edge = variance[1] > np.quantile(variance[1], 0.99)
    # Edges have five samples instead of one; beams themselves have noise, too.
    assert variance[8][edge].mean() < variance[1][edge].mean() / 3


def test_samples_of_surfaces_are_means_over_the_pixel():
    """Four passes of one sample and one pass of four give the same picture of a lamp before black."""
    scene = load(lamp=LAMP, sensor=camera(target=(0, 2, 0), size=12), dust=cube_of(fog(0.01)))
    one, four = (
        render(scene, scene.sensors()[0], by_beams(passes=passes, beams=64, max_depth=2, surface_samples=each)).layers()
        for passes, each in ((4, 1), (1, 4))
    )
    # Both use the same points of one sequence of samples.
    np.testing.assert_array_equal(one["rgba"][..., 3], four["rgba"][..., 3])
    np.testing.assert_allclose(one["surface"], four["surface"], rtol=1e-6)
    assert len(np.unique(four["rgba"][..., 3])) > 2


def plan(scene, **given):
    """Return the numbers of samples that pilots plan, by the numbers of pixels, if beams carry the light in fog."""
    extras = Extras(findings=Findings(walked=[]))
    return begin(scene, scene.sensors()[0], Settings(max_depth=4, **given), extras=extras).light.findings.samples


@pytest.mark.parametrize(("albedo", "expected"), [(0.0, 2), (0.8, 4)])
def test_black_walls_have_few_samples_and_grainy_ones_many(albedo, expected):
    """The light that walls send one another is grain of their samples; the light of fog is that of beams."""
    plans = [plan(room(albedo), seed=seed) for seed in range(2)]
    assert plans[1] == plans[0] == {640 * 360: expected}


def test_a_crop_has_the_plan_of_the_whole_picture():
    found = [plan(room(0.8, **crop)) for crop in ({}, {"crop_width": 16, "crop_height": 8, "crop_offset_x": 99})]
    assert found[0] == found[1] and list(found[0]) == [640 * 360]


def test_a_small_picture_asks_no_pilot():
    assert plan(room(0.8, width=64, height=36)) == plan(room(0.8), surface_samples=4) == {}


def test_parameters_are_equal_until_one_is_set():
    scene = load(lamp=LAMP, sensor=camera(size=4))
    state = Parameters(scene, scene.sensors()[0])
    assert state == Parameters(scene, scene.sensors()[0])
    parameters = mi.traverse(scene)
    name = next(each for each in parameters.properties if "radiance" in each)
    parameters[name] = 2 * parameters[name]
    parameters.update()
    assert state != Parameters(scene, scene.sensors()[0])


def test_an_integrator_asks_its_pilot_once_while_nothing_changes(monkeypatch):
    asked, preferred = [], lights.preferred
    monkeypatch.setattr(lights, "preferred", lambda *given: asked.append(1) or preferred(*given))
    forward = {"type": "hg", "g": 0.5}  # rendering makes this number a variable
    scene = load(lamp=LAMP, fog=cube_of(fog(0.5, phase=forward)), sensor=camera(size=4))
    integrator = mi.load_dict({"type": "photon_beams", "paths": 256, "max_depth": 3})
    pictures = [np.array(mi.render(scene, integrator=integrator, spp=1, seed=seed)) for seed in (0, 1, 0)]
    assert len(asked) == 1
    # What the integrator keeps does not change its pictures.
    np.testing.assert_array_equal(pictures[0], pictures[2])
    fresh = mi.load_dict({"type": "photon_beams", "paths": 256, "max_depth": 3})
    np.testing.assert_array_equal(np.array(mi.render(scene, integrator=fresh, spp=1, seed=1)), pictures[1])
    parameters = mi.traverse(scene)
    name = next(each for each in parameters.properties if "radiance" in each)
    parameters[name] = 2 * parameters[name]
    parameters.update()
    mi.render(scene, integrator=integrator, spp=1)
    assert len(asked) == 3
