"""The media around emitters and sensors, however a scene names them."""

import numpy as np
import pytest

from photonbeams.render.scene_frame import begin, render
from photonbeams.runtime.device import Array3f, mitsuba
from photonbeams.world.media.discovery.surroundings import Surroundings, place_of_sensor, places_of
from photonbeams.world.media.interfaces import number
from photonbeams.world.media.media import Media
from photonbeams.world.plugin import world_of_plugin
from tests.helpers.mitsuba_pictures import SMALL, agree, pictures
from tests.helpers.mitsuba_scenes import T, by_beams, camera, cube_of, fog, load, rgb
from tests.helpers.references import reference
from tests.helpers.sweep import sweep

mi = mitsuba()
SIZE = 2.0
ROOM = np.sqrt(3) * SIZE  # half the diagonal
WALL = {"type": "twosided", "side": {"type": "diffuse", "reflectance": rgb(0.4)}}
LAMP = {"type": "sphere", "center": [0.5, 1.0, -0.3], "radius": 0.2, "emitter": {"type": "area", "radiance": rgb(20.0)}}
POINT = {"type": "point", "position": [0.5, 1.0, -0.3], "intensity": rgb(2.0)}
SPOT = {"type": "spot", "to_world": T().look_at([0.5, 1.0, -0.3], [0, -1, 0], [0, 0, 1]), "intensity": rgb(5.0)}
INSIDE, OUTSIDE = {"origin": (0.3, 0.2, 1.9), "target": (0, 0, -1), "fov": 70}, {"origin": (0.3, 0.2, 6), "fov": 30}
TURNS = {(0, -1): ([0, 1, 0], 90), (0, 1): ([0, 1, 0], -90), (1, -1): ([1, 0, 0], -90), (1, 1): ([1, 0, 0], 90),
         (2, -1): ([0, 1, 0], 0), (2, 1): ([0, 1, 0], 180)}  # fmt: skip


def room(window=None, **named):
    """Return six walls that face inward; with `window`, the front one is a window with a null BSDF that names media."""
    result = {}
    for (axis, sign), turn in TURNS.items():
        place = T().translate((sign * SIZE * np.eye(3)[axis]).tolist()).rotate(*turn).scale(SIZE)
        wall = {"type": "rectangle", "to_world": place, "bsdf": WALL, **named}
        if window is not None and (axis, sign) == (2, 1):
            wall = {"type": "rectangle", "to_world": place, "bsdf": {"type": "null"}, **window}
        result[f"wall{axis}{sign + 1}"] = wall
    return result


def makes(light=LAMP, **view):
    """Return scenes of the same room full of fog, each with its fog, by the part that names the fog."""

    def made(name):
        medium = mi.load_dict(fog(0.3, 0.8, id="fog"))
        own = {**light, "exterior" if "center" in light else "medium": medium}
        parts = {
            "walls": {**room(exterior=medium), "light": light},
            "lamp": {**room(), "light": own},
            "sensor": {**room(), "light": light},
            "box around": {**room(), "light": light, "around": cube_of(medium, 1.05 * SIZE)},
        }[name]
        return load(**parts, sensor=camera(**view, size=8, medium=medium if name == "sensor" else None)), medium

    return {name: made(name) for name in ("walls", "lamp", "sensor", "box around")}


def surveyed(scene):
    media = Media.of(scene)
    return Surroundings(scene, media, places_of(scene), place_of_sensor(scene.sensors()[0]))


def around(scene):
    """Return the numbers of the media in which light paths and camera paths begin."""
    found, anywhere = surveyed(scene), Array3f(0, 0, 0)
    return int(found.of_emitter(0, anywhere, anywhere)[0]), int(found.of_sensor(anywhere, anywhere)[0])


@pytest.mark.parametrize("light", [LAMP, POINT, SPOT], ids=["area", "point", "spot"])
def test_a_room_is_full_of_its_fog_whoever_names_it(light):
    for name, (scene, medium) in makes(light, **INSIDE).items():
        assert around(scene) == (number(medium),) * 2, name
        size = world_of_plugin(scene, place_of_sensor(scene.sensors()[0])).radius_of(Media.of(scene).all[0])
        assert size == pytest.approx(ROOM * (1.05 if name == "box around" else 1), rel=1e-3), name


def test_a_room_full_of_fog_looks_the_same_whoever_names_it():
    settings = by_beams(passes=2, beams=4096, guiding=False)
    scenes = {name: scene for name, (scene, _) in makes(**INSIDE).items()}
    found = {name: render(each, each.sensors()[0], settings).layers()["rgba"] for name, each in scenes.items()}
    for name in ("lamp", "sensor"):
        # The samples are the same, and sizes differ by rounding.
        np.testing.assert_allclose(found[name], found["walls"], rtol=1e-3, err_msg=name)
    # Radii are 5 % wider.
    assert found["box around"].mean() == pytest.approx(found["walls"].mean(), rel=0.02)


@pytest.mark.parametrize("name", sweep(["lamp", "window"], keep=["window"]))
def test_plain_walls_do_not_hide_fog(name):
    medium = mi.load_dict(fog(0.3, 0.8))
    if name == "lamp":
        parts, view = {**room(), "light": {**LAMP, "exterior": medium}}, INSIDE
    else:  # the front wall faces inward, so the room is its exterior
        parts, view = {**room(window={"exterior": medium}), "light": LAMP}, OUTSIDE
    scene = load(**parts, sensor=camera(**view, size=32))
    declared = load(**parts, sensor=camera(**view, size=32, medium=medium if name == "lamp" else None))
    ours = pictures(scene, max_depth=3, hide_emitters=True, **SMALL)
    theirs = reference(f"surroundings/{name}", declared, 128, len(ours), max_depth=3, hide_emitters=True)
    assert agree(ours, theirs, bias=0.01)


def test_a_window_tells_what_is_on_both_of_its_sides():
    medium = mi.load_dict(fog(0.3, 0.8))
    parts = {**room(window={"exterior": medium}), "light": LAMP}
    assert around(load(**parts, sensor=camera(**OUTSIDE))) == (number(medium), 0)
    assert around(load(**parts, sensor=camera(**INSIDE))) == (number(medium), number(medium))
    found = surveyed(load(**parts, sensor=camera(**OUTSIDE)))
    # The medium is as large as the scene, not as the window.
    assert found.everywhere == 0 and not found.boxes


def two_rooms(lamp, eye, medium, walls):
    """Return two rooms with a door without a surface between them, the left one full of fog.

    `walls` says whether walls name the fog. `lamp` and `eye` are the x of the lamp and the camera, which name the fog
    if they are in it.
    """
    own, within = {"exterior": medium} if walls else {}, {"medium": medium} if eye < 0 else {}
    parts = {"door": {"bsdf": {"type": "null"}, "interior": medium}, "below": {"bsdf": WALL}, "above": {"bsdf": WALL}}
    for (name, part), (y, height) in zip(parts.items(), ((0, 1.0), (-1.5, 0.5), (1.5, 0.5)), strict=True):
        inside = {"interior": medium} if walls and name != "door" else {}
        place = T().translate([0, y, 0]).rotate([0, 1, 0], 90).scale([SIZE, height, 1])
        parts[name] = {"type": "rectangle", "to_world": place, **part, **inside}
    for x, side in ((-SIZE, "left"), (SIZE, "right")):
        for (axis, sign), turn in TURNS.items():
            if (axis, sign) != (0, 1 if side == "left" else -1):
                place = T().translate((sign * SIZE * np.eye(3)[axis] + [x, 0, 0]).tolist()).rotate(*turn).scale(SIZE)
                wall = {"type": "rectangle", "to_world": place, "bsdf": WALL}
                parts[f"{side}{axis}{sign + 1}"] = {**wall, **(own if side == "left" else {})}
    light = {**LAMP, "center": [lamp, 1.0, 0.3], **({"exterior": medium} if lamp < 0 else {})}
    view = camera(origin=(eye, 0.1, 0.2), target=(0, 0, 0), fov=60, size=8, **within)
    return load(**parts, light=light, sensor=view)


@pytest.mark.parametrize(("lamp", "eye"), [(-2.5, -3.5), (-2.5, 3.5), (2.5, -3.5), (2.5, 3.5)])
def test_fog_in_one_of_two_rooms_is_behind_its_door(lamp, eye):
    medium = mi.load_dict(fog(0.3, 0.8))
    for walls in (False, True):
        scene = two_rooms(lamp, eye, medium, walls)
        assert around(scene) == tuple(number(medium) if each < 0 else 0 for each in (lamp, eye))
        found = surveyed(scene)
        assert found.everywhere == 0 and not found.conflicts and not found.boxes


def test_rooms_look_the_same_whether_or_not_their_walls_name_the_fog():
    settings = by_beams(passes=2, beams=2048, guiding=False)
    medium = mi.load_dict(fog(0.3, 0.8))
    scenes = [two_rooms(2.5, -3.5, medium, walls) for walls in (False, True)]
    plain, named = (render(each, each.sensors()[0], settings).layers()["rgba"] for each in scenes)
    np.testing.assert_allclose(plain, named, rtol=1e-3, atol=1e-6)


def test_a_world_is_as_large_as_its_merged_walls():
    """The radius of a world includes merged walls, although Mitsuba gives them no box."""
    scene = load(**room(), light=LAMP, sensor=camera(**INSIDE))
    assert len(scene.shapes()) == 2
    assert world_of_plugin(scene).radius == pytest.approx(ROOM, rel=1e-6)


def test_fog_that_a_lamp_names_in_the_open_fills_the_space():
    medium = mi.load_dict(fog(0.3))
    ground = {"type": "rectangle", "to_world": T().translate([0, -1, 0]).rotate([1, 0, 0], -90).scale(9)}
    scene = load(light={**LAMP, "exterior": medium}, ground=ground, sky={"type": "constant"}, sensor=camera())
    found = surveyed(scene)
    assert found.everywhere == number(medium) and around(scene) == (number(medium),) * 2
    # A medium without a size is as large as the scene.
    assert not found.boxes
    frame = begin(scene, scene.sensors()[0], by_beams(beams=64, guiding=False))
    assert frame.light.world.radius_of(frame.light.world.media.all[0]) == pytest.approx(9 * np.sqrt(2), rel=0.02)


def test_fog_of_a_tank_does_not_fill_the_space():
    medium = mi.load_dict(fog(0.3))
    for named in (None, medium):
        light = {**POINT, "position": [0.2, 0.3, 0.1], **({} if named is None else {"medium": named})}
        found = surveyed(load(tank=cube_of(medium), light=light, sensor=camera()))
        assert found.everywhere == 0
        assert [*found.boxes] == [number(medium)]
        np.testing.assert_allclose(found.boxes[number(medium)], [[-1, -1, -1], [1, 1, 1]], rtol=1e-6)


def test_light_of_a_lamp_begins_in_the_medium_at_its_own_place():
    """Each light path of a lamp that stands half in a tank begins in the medium at its own place."""
    medium = mi.load_dict(fog(0.3))
    lamp = {"type": "sphere", "center": [1.0, 0, 0], "radius": 0.3, "emitter": {"type": "area", "radiance": rgb(1.0)}}
    scene = load(tank=cube_of(medium), light=lamp, sensor=camera())
    origin = Array3f([0.69, 1.31], [0, 0], [0.01, 0.01])
    found = surveyed(scene).of_emitter(0, origin, Array3f([-1, 1], [0, 0], [0, 0]))
    assert found.numpy().tolist() == [number(medium), 0]


@pytest.mark.parametrize("offset", [0, -1e-4, 1e-4])
def test_light_of_a_point_on_a_border_begins_on_the_side_to_which_it_leaves(offset):
    medium = mi.load_dict(fog(0.3))
    found = surveyed(load(tank=cube_of(medium), light={**POINT, "position": [1 + offset, 0.3, 0.1]}, sensor=camera()))
    direction = Array3f([-1, 1], [0.1, 0.1], [0.2, 0.2])
    inward, outward = found.of_emitter(0, Array3f(1 + offset, 0.3, 0.1), direction).numpy().tolist()
    assert inward == (0 if offset > 0 else number(medium))
    # Exactly on the boundary, a ray that leaves may still meet it; then it begins inside.
    assert outward in {-1e-4: [number(medium)], 0: [number(medium), 0], 1e-4: [0]}[offset]


def test_light_through_a_hole_is_in_the_medium_of_the_shape():
    """A lamp's light into a hole begins in the shape's medium, as in `volpath`, whose paths cross no boundary there."""
    medium = mi.load_dict(fog(0.3))
    sides = {f"side{axis}{sign + 1}": {"type": "rectangle", "bsdf": {"type": "null"}, "exterior": medium,
                                       "to_world": T().translate((sign * np.eye(3)[axis]).tolist()).rotate(*turn)}
             for (axis, sign), turn in TURNS.items() if (axis, sign) != (1, 1)}  # fmt: skip
    found = surveyed(load(**sides, light={**POINT, "position": [0, 3, 0]}, sensor=camera()))
    down_and_up = Array3f([0.1, 0.1], [-1, 1], [0.1, 0.1])
    assert found.of_emitter(0, Array3f(0, 3, 0), down_and_up).numpy().tolist() == [number(medium), 0]


def test_light_that_glass_reflects_stays_in_its_medium():
    """Light that a ball of glass reflects stays in its medium, although the ball names only the medium inside."""
    air, ink = mi.load_dict(fog(0.2)), mi.load_dict(fog(2.0))
    scene = load(ball={"type": "sphere", "bsdf": {"type": "dielectric"}, "interior": ink})
    hit = scene.ray_intersect(mi.Ray3f(mi.Point3f(0, 0, 3), mi.Vector3f(0, 0, -1)))
    media = Media([air, ink])
    for direction, entered in (((0, 0.6, 0.8), air), ((0, 0.6, -0.8), ink)):
        found = media.beyond(hit, Array3f(*direction), mi.UInt32(number(air)), mi.Bool(True))
        assert int(found[0]) == number(entered)


# -- contradictions ----------------------------------------------------------------------------------------------------


AIR, INK = ({"type": "ref", "id": name} for name in ("air", "ink"))


def conflicts(**parts):
    media = {"air": fog(0.2), "ink": fog(0.3)}  # by reference: Mitsuba forgets the names of media within a part
    return surveyed(load(**{**media, "light": POINT, "sensor": camera(**INSIDE), **parts})).conflicts


def test_a_place_that_names_another_medium_than_the_walls_is_named():
    tank = {**cube_of(INK, SIZE), "bsdf": WALL}
    (text,) = conflicts(tank=tank, sensor={**camera(**INSIDE), "medium": AIR})
    assert text == ("sensor sensor names medium air, but the shapes around it name medium ink on that side: "
                    "expected one medium")  # fmt: skip
    assert not conflicts(tank=tank, sensor={**camera(**INSIDE), "medium": INK})
    (text,) = conflicts(tank=tank, light={**POINT, "medium": AIR})
    assert text.startswith("emitter light names medium air, but the shapes around it name medium ink")


def test_a_sensor_that_names_the_medium_of_a_tank_it_is_not_in_is_named():
    (text,) = conflicts(tank=cube_of(INK), light={**POINT, "position": [0, 0, 0]}, sensor=camera(medium=INK))
    assert text.startswith("sensor sensor names medium ink, but the shapes around it name none on that side")


def test_media_that_touch_and_nested_ones_do_not_contradict_each_other():
    left, right, inner = (mi.load_dict(fog(0.2)) for _ in range(3))
    cubes = {
        "left": {**cube_of(left), "to_world": T().translate([-1, 0, 0])},
        "right": {**cube_of(right), "to_world": T().translate([1, 0, 0])},
        "inner": {"type": "sphere", "center": [1, 0, 0], "radius": 0.5, "bsdf": {"type": "null"}, "interior": inner,
                  "exterior": right},
    }  # fmt: skip
    assert not conflicts(**cubes, sensor=camera())
