"""Warnings about Mitsuba scenes."""

import numpy as np

from photonbeams.render.scene_frame import begin
from photonbeams.runtime.device import mitsuba
from tests.helpers.mitsuba_scenes import T, by_beams, camera, cube_of, fog, load, rgb

mi = mitsuba()
LIGHT = {"type": "point", "position": [0.3, 0.4, 0.2], "intensity": rgb(1.0)}


def warnings(caplog, **parts):
    caplog.clear()
    scene = load(**{"light": LIGHT, **parts})
    begin(scene, scene.sensors()[0], by_beams(beams=64, guiding=False))
    return [each.getMessage() for each in caplog.records if each.name == "photonbeams"]


def ball(x=0.0, **media):
    return {"type": "sphere", "center": [x, 0, 0], "radius": 0.5, "bsdf": {"type": "dielectric"}, **media}


def test_a_shape_in_fog_that_does_not_say_so_is_named(caplog):
    air, ink = mi.load_dict(fog(0.2)), mi.load_dict(fog(2.0))
    room, filled = {"room": cube_of(air, 2), "sensor": camera()}, {"sensor": camera(medium=air)}
    for around in (room, filled, {**room, "sensor": camera((0, 0, 1.5), medium=air)}):
        (text,) = warnings(caplog, **around, flask=ball(interior=ink))
        assert "shape flask: stands in a medium, but names no exterior" in text
        assert not warnings(caplog, **around, flask=ball(interior=ink, exterior=air))
        assert not warnings(caplog, **around, flask=ball())


def test_shapes_beside_fog_and_around_it_are_right(caplog):
    air, ink = mi.load_dict(fog(0.2)), mi.load_dict(fog(2.0))
    outside = {"tank": cube_of(air), "sensor": camera()}
    assert not warnings(caplog, **outside)
    assert not warnings(caplog, **outside, flask=ball(3.0, interior=ink))
    assert not warnings(caplog, **outside, glass={**ball(), "radius": 3.0})
    walls = {
        f"wall{number}": {"type": "rectangle", "to_world": T().rotate([0, 1, 0], 90 * number).translate([0, 0, 1]),
                          "interior": air}
        for number in range(4)
    }  # fmt: skip
    assert not warnings(caplog, **walls, sensor=camera())


def test_a_scene_without_light_is_named(caplog):
    scene = {"tank": cube_of(fog()), "sensor": camera()}
    assert warnings(caplog, **scene, light={"type": "sphere"}) == [
        "the scene has no emitter and will be black: expected one"
    ]


def test_a_scene_whose_lights_are_black_is_named(caplog):
    scene = {"tank": cube_of(fog()), "sensor": camera(), "light": {**LIGHT, "intensity": rgb(0.0)}}
    sky = {"type": "envmap", "bitmap": mi.Bitmap(np.ones((2, 4, 3), dtype=np.float32)), "scale": 0.0}
    for parts in (scene, {**scene, "sky": sky}):
        (text,) = warnings(caplog, **parts)
        assert text.startswith("all emitters of the scene are black, and so will be the picture (light")
    assert not warnings(caplog, **scene, sky={**sky, "scale": 1.0})


def test_a_shape_whose_normals_point_inward_is_named(caplog):
    """A mirrored cube, which is a mesh, is turned inside out."""
    tank = {**cube_of({"type": "ref", "id": "ink"}), "to_world": T().scale([-1, 1, 1])}
    (text,) = warnings(caplog, ink=fog(2.0), tank=tank, sensor=camera())
    assert text.startswith("shape tank: stands in a medium") and text.endswith("normals that point outward")
    assert len(text) <= 300


def test_an_integrator_warns_once(caplog):
    scene = load(fog=cube_of(fog()), sensor=camera(size=4))
    integrator = mi.load_dict({"type": "photon_beams", "paths": 64, "method": "beams"})
    for _ in range(2):
        assert not np.array(mi.render(scene, integrator=integrator, spp=1)).any()
    assert len(caplog.records) == 1
