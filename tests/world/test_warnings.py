"""What users are warned of in their Mitsuba scenes."""

import numpy as np

from photonbeams.render.scene_frame import SceneRenderer
from photonbeams.render.settings import Settings
from photonbeams.runtime.device import mitsuba
from transport.scenes import T, camera, cube_of, fog, load, rgb

mi = mitsuba()
LIGHT = {"type": "point", "position": [0.3, 0.4, 0.2], "intensity": rgb(1.0)}


def warnings(caplog, **parts):
    caplog.clear()
    scene = load(**{"light": LIGHT, **parts})
    SceneRenderer(scene, scene.sensors()[0], Settings(beams=64, guiding=False))
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
    assert not warnings(caplog, **outside, flask=ball(0.9, interior=ink))  # half in it, which is no mistake of words
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


def test_an_integrator_warns_once(caplog):
    scene = load(fog=cube_of(fog()), sensor=camera(size=4))
    integrator = mi.load_dict({"type": "photon_beams", "paths": 64})
    for _ in range(2):
        assert not np.array(mi.render(scene, integrator=integrator, spp=1)).any()
    assert len(caplog.records) == 1
