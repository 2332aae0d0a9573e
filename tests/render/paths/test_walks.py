"""Walks from the camera find the same light as beams and photons, and each path counts once."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest

from photonbeams.render.paths.walks import Walks
from photonbeams.render.pilots.pilot import Findings
from photonbeams.render.scene_frame import Extras, begin
from photonbeams.render.settings import Settings
from photonbeams.render.techniques import FURTHER, WALKS
from photonbeams.runtime.device import mitsuba
from photonbeams.scene import BeamSettings, DistanceRamp, Gobo, SceneError
from photonbeams.transport.segments.records import Counts
from tests.helpers.mitsuba_scenes import camera, cube_of, fog, frames, load, rgb
from tests.helpers.references import reference

mi = mitsuba()
SKY = {"type": "constant", "radiance": rgb([1.0, 0.5, 0.25])}
LAMP = {
    "type": "sphere",
    "center": [0, 2.4, 0],
    "radius": 0.3,
    "emitter": {"type": "area", "radiance": rgb([4.0, 6.0, 8.0])},
}
FLOOR = {
    "type": "rectangle",
    "to_world": mi.ScalarTransform4f().translate([0, -1.2, 0]).rotate([1, 0, 0], -90).scale(4),
}


def pictures(scene, seeds, method="paths", extras=None, **settings):
    """Return pictures of independent seeds, (seeds, H, W, 3)."""
    found = frames(scene, Settings(method=method, **settings), seeds, extras)
    return np.array([each.layers()["rgba"][..., :3] for each in found])


def mean_and_error(values):
    """Return the mean picture per channel of independent pictures, and its standard error."""
    means = values.mean(axis=(1, 2))
    return means.mean(axis=0), means.std(axis=0, ddof=1) / np.sqrt(len(means))


def test_a_furnace_of_white_fog_cannot_be_seen():
    # Under a constant sky, fog that absorbs nothing has the sky's radiance everywhere, however often it scatters light.
    scene = load(fog=cube_of(fog(3.0, 1.0)), sky=SKY, sensor=camera(size=16))
    mean, error = mean_and_error(pictures(scene, 8, passes=2, rr_depth=1000))
    assert np.all(np.abs(mean - [1.0, 0.5, 0.25]) < 4 * error + 1e-4)
    assert np.all(error < 0.02 * mean)


@pytest.mark.parametrize("method", ["beams", "paths"])
def test_a_white_surface_with_holes_under_a_sky_cannot_be_seen(method):
    # Transmitted and reflected light both have the sky's radiance, whatever fraction of the surface is cut out.
    mask = {"type": "mask", "opacity": 0.5, "nested": {"type": "diffuse", "reflectance": rgb(1.0)}}
    scene = load(sheet={"type": "rectangle", "bsdf": mask}, sky=SKY, sensor=camera((0, 0, 3), size=4, fov=20))
    mean, error = mean_and_error(pictures(scene, 16, method, passes=8, beams=64, guiding=False, max_depth=2))
    assert np.all(np.abs(mean - [1.0, 0.5, 0.25]) < 4 * error + 1e-4)
    assert np.all(error < 0.02 * mean)


def test_walks_have_the_mean_of_beams_and_emitters_add_up():
    parts = {"fog": cube_of(fog([1.0, 0.5, 0.25], 0.9)), "floor": FLOOR, "lamp": LAMP, "sky": SKY}
    scene = load(sensor=camera(size=16, target=(0, -0.3, 0)), **parts)
    walks, beams = (pictures(scene, 6, method, passes=1, beams=8192, guiding=False) for method in ("paths", "beams"))
    # A lamp that has beam settings keeps its beams, even if only their number is set.
    both = pictures(scene, 6, extras=Extras(beams={"lamp": BeamSettings(beam_count=4096)}), passes=1)
    expected, error = mean_and_error(walks)
    for other in (beams, both):
        mean, own = mean_and_error(other)
        # Wide beams that stick out of their medium lose up to half a per cent: docs/mitsuba.md.
        assert np.all(np.abs(mean - expected) < 4 * np.hypot(error, own) + 0.005 * expected)


def test_walks_count_no_longer_paths_than_allowed():
    scene = load(fog=cube_of(fog(2.0, 0.9)), floor=FLOOR, lamp=LAMP, sensor=camera(size=16))
    mean, error = mean_and_error(pictures(scene, 6, passes=2, max_depth=3))
    expected, own = mean_and_error(reference("walks/short paths", scene, 64, 4, max_depth=3))
    assert np.all(np.abs(mean - expected) < 4 * np.hypot(error, own))


def test_a_method_that_is_none_is_refused():
    with pytest.raises(SceneError, match="method is 'best'"):
        Settings(method="best")


GLASS = {"type": "sphere", "center": [0, -0.4, 0], "radius": 0.6, "bsdf": {"type": "dielectric"}}


def dark(light):
    """Return a light that sends no light paths."""
    result = copy(light)
    nobody = replace(light.simulation.allotment, counts=dict.fromkeys(range(len(light.world.emitters)), Counts.NOTHING))
    result.simulation = replace(light.simulation, allotment=nobody)
    return result


def parts_of(scene, passes, **settings):
    """Return pictures of four seeds: with the light that walks find, with caustics, with both and with neither.

    All of them show the emitters that the camera sees, and direct light.
    """
    found = {"walks": [], "caustics": [], "both": [], "neither": []}
    known = Findings()
    for seed in range(4):
        own = Settings(method="paths", seed=seed, passes=passes, **settings)
        frame = begin(scene, scene.sensors()[0], own, extras=Extras(findings=known))
        known = frame.findings
        light, lights = frame.light, {}
        lights["both"], lights["caustics"] = light, copy(light)
        lights["walks"], lights["neither"] = dark(light), dark(light)
        lights["caustics"].walks = lights["neither"].walks = lambda _: Walks()
        for name, each in lights.items():
            frame.clear()
            frame.light = each
            frame.add_passes(range(passes))
            found[name].append(frame.layers()["rgba"][..., :3])
    return {name: np.array(each) for name, each in found.items()}


def test_caustics_of_lamps_come_from_the_lamp_and_all_other_light_from_walks():
    scene = load(floor=FLOOR, glass=GLASS, lamp=LAMP, sensor=camera(size=16, target=(0, -1, 0)))
    # Up to four edges: with more, walks also meet what caustics light.
    found = parts_of(scene, 1, beams=16384, max_depth=4)
    walks, caustics, both, neither = (mean_and_error(found[name]) for name in ("walks", "caustics", "both", "neither"))
    sum_of_parts = walks[0] + caustics[0] - neither[0]
    assert np.all(caustics[0] > 1.05 * neither[0])
    assert np.all(np.abs(both[0] - sum_of_parts) < 4 * (both[1] + walks[1] + caustics[1] + neither[1]))
    # A path tracer finds the same light.
    both = mean_and_error(parts_of(scene, 1, beams=16384, max_depth=6)["both"])
    expected, error = mean_and_error(reference("walks/caustics", scene, 256, 4, "path", max_depth=6))
    # Photon discs blur, and the parts of them beside the floor count as on the floor: half a per cent.
    assert np.all(np.abs(both[0] - expected) < 4 * np.hypot(both[1], error) + 0.005 * expected)


def test_a_point_lamp_shines_through_glass_where_walks_meet_its_light():
    lamp = {"type": "point", "position": [0, 2.4, 0], "intensity": rgb([4.0, 6.0, 8.0])}
    scene = load(floor=FLOOR, glass=GLASS, lamp=lamp, sensor=camera(size=16, target=(0, -1, 0)))
    walks, beams = (pictures(scene, 4, method, passes=1, beams=16384) for method in ("paths", "beams"))
    (expected, error), (mean, own) = mean_and_error(beams), mean_and_error(walks)
    assert np.all(np.abs(mean - expected) < 4 * np.hypot(error, own))


def test_walks_find_the_light_that_images_and_filters_leave():
    """A square lamp behind a slide, and a point behind a ramp by distance, in a closed room."""
    walls = {"type": "twosided", "side": {"type": "diffuse", "reflectance": rgb([0.7, 0.5, 0.3])}}
    above = mi.ScalarTransform4f().translate([0.2, 0.95, 0.2]).rotate([1, 0, 0], 90).scale(0.25)
    lamp = {"type": "rectangle", "id": "lamp", "to_world": above, "emitter": {"type": "area", "radiance": rgb(10.0)}}
    point = {"type": "point", "id": "point", "position": [-0.6, 0.5, -0.4], "intensity": rgb([0.4, 0.8, 0.2])}
    scene = load(
        walls={"type": "cube", "bsdf": walls}, lamp=lamp, point=point, sensor=camera((0, 0, 0.95), (0, 0, -1), 12, 70),
        optimize=False,
    )  # fmt: skip
    slide = Gobo(np.random.default_rng(0).random((4, 4, 3)).astype(np.float32))
    ramp = DistanceRamp("ramp", [0.3, 1.2], [[1, 0, 0.5], [0.2, 1, 0.5]])
    extras = Extras(beams={"lamp": BeamSettings(gobo=slide), "point": BeamSettings(filters=(ramp,))})
    frame = begin(scene, scene.sensors()[0], Settings(method="paths", max_depth=4), extras=extras)
    assert all(row.by(WALKS, FURTHER) for row in frame.light.rows)
    walks = mean_and_error(pictures(scene, 4, extras=extras, passes=8, max_depth=4))
    photons = mean_and_error(pictures(scene, 4, "beams", extras=extras, passes=1, beams=8192, max_depth=4))
    # Discs of photons lose a little light in corners: a per cent, as for stages.
    assert np.all(np.abs(walks[0] - photons[0]) < 4 * np.hypot(walks[1], photons[1]) + 0.01 * photons[0])
    assert np.all(walks[1] < 0.02 * walks[0])
