"""Filters of lights in pictures: a blocker is as dark as a mesh in its place, in fog and on surfaces."""

import dataclasses

import numpy as np
import pytest

import photonbeams as pb
from photonbeams import scene
from tests.helpers.comparison import box, quad
from tests.helpers.sweep import sweep

GREY = scene.Material(diffuse=(0.5, 0.5, 0.5))
FLOOR = quad("/Floor", [[-6, 0, -6], [-6, 0, 6], [6, 0, 6], [6, 0, -6]], GREY)
FOG = pb.Medium((0.1, 0.1, 0.1), name="/Fog", mesh=box("/Fog", [-5, -1, -5], [5, 5, 5]))
LAMP = scene.SphereLight(
    "/Lamp", (800.0,) * 3, center=np.array([0, 3.5, 0]), radius=0.05, axis=np.array([0, -1.0, 0]),
    shaping=scene.Shaping(cone_angle=50),
)  # fmt: skip
CAMERA = scene.Camera.look_at([0, 1.5, 9], [0, 1.5, 0], fov=50, aspect=1.5)
SMALL = {"width": 48, "passes": 4, "beams": 2048}
PLACE = np.array([[1.0, 0, 0, 0.5], [0, 1, 0, 2.6], [0, 0, 1, 0], [0, 0, 0, 1]])
LOW, HIGH = np.array([0.25, 2.5, -0.25]), np.array([0.75, 2.7, 0.25])
FLAG = scene.Blocker("/Flag", 0.5 * (HIGH - LOW), frame=PLACE)


def picture(*lights, meshes=(FLOOR,), **more):
    shot = pb.Shot(scene.Scene(meshes=list(meshes), lights=list(lights), media=[FOG]), CAMERA)
    return shot.render(**SMALL | more).layers


def filtered(*filters, **more):
    return picture(dataclasses.replace(LAMP, filters=filters), **more)


@pytest.fixture(scope="module")
def whole():
    return picture(LAMP)


def test_a_blocker_is_as_dark_as_a_mesh_in_its_place():
    whole, blocked = picture(LAMP, passes=8), filtered(FLAG, passes=8)
    stopped = picture(LAMP, meshes=(FLOOR, box("/Flag", LOW, HIGH)), passes=8)
    away = np.ones((32, 48), bool)
    away[5:11, 22:32] = False  # the mesh is seen there, and behind it less fog
    for name, most in (("beams", 0.1), ("surface", 0.02)):
        shadow = (whole[name] - stopped[name])[away]
        difference = np.abs(blocked[name] - stopped[name])[away]
        assert np.max(shadow / np.maximum(whole[name][away], 1e-6)) > 0.4
        # Beams end at a mesh as wide as it lets them be, but at a blocker as wide as they are.
        assert difference.max() < most * shadow.max()
        assert difference.mean() < 0.05 * shadow.mean()


@pytest.mark.parametrize("bounces", [0, 1])
def test_surfaces_and_beams_have_the_same_fraction_of_filtered_light(whole, bounces):
    """A quarter of all light, and of what it becomes when it is scattered once more."""
    whole = whole if bounces == 0 else picture(LAMP, max_depth=3)
    quarter = filtered(scene.DistanceRamp("/Quarter", [0.0], [[0.25, 0.5, 1.0]]), max_depth=2 + bounces)
    for name in ("beams", "surface"):
        ratio = quarter[name].reshape(-1, 3).sum(axis=0) / whole[name].reshape(-1, 3).sum(axis=0)
        assert np.allclose(ratio, [0.25, 0.5, 1], rtol=1e-3 if bounces == 0 else 0.02)


def on(*names, color=(0.25, 0.5, 1.0)):
    """Return a ramp that acts on what has these names alone."""
    return scene.DistanceRamp("/Tint", [0.0], [color], left_out=frozenset({"/Floor", "/Roof", "/Fog"} - {*names}))


def test_a_filter_acts_on_what_its_link_includes(whole):
    for names, changed in ((("/Floor",), "surface"), (("/Fog",), "beams"), ((), "")):
        found = filtered(on(*names))
        for name in ("beams", "surface"):
            factor = np.array([0.25, 0.5, 1.0]) if name == changed else 1.0
            np.testing.assert_allclose(found[name], whole[name] * factor, rtol=2e-5, atol=1e-6)


@pytest.mark.parametrize("method", sweep(["auto", "beams"], ["auto"]))
def test_filters_that_act_on_parts_of_a_room_add_up(method):
    """Light is linear: filters on each of the places where light is scattered first add up to a filter on all."""
    roof = quad("/Roof", [[-3, 4.5, -3], [3, 4.5, -3], [3, 4.5, 3], [-3, 4.5, 3]], GREY)
    black = (0.0, 0.0, 0.0)
    lamp = dataclasses.replace(LAMP, shaping=None, seen=False)
    more = {"meshes": (FLOOR, roof), "max_depth": 4, "method": method, "guiding": False, "passes": 3}

    def total(*filters, unlit=()):
        media = frozenset(unlit) & {"/Fog"}
        light = dataclasses.replace(lamp, filters=filters, unlit=frozenset(unlit) - media, unlit_media=media)
        layers = picture(light, **more)
        return np.array([layers[name].mean() for name in ("beams", "surface")])

    full = total()
    places = "/Floor", "/Roof", "/Fog"
    parts = [total(on(*(each for each in places if each != own), color=black)) for own in places]
    linked = [total(unlit=[each for each in places if each != own]) for own in places]
    np.testing.assert_allclose(sum(parts), full, rtol=0.01)
    # Links of the light itself leave the same light, by the same paths: also beyond the fog's boundary, on the floor.
    np.testing.assert_allclose(linked, parts, rtol=1e-3, atol=1e-6)


def look(**along):
    ramp = pb.looks.ColorRamp([0, 1], [[1, 0.6, 0.2], [0.25, 0.5, 1]], **along)
    return pb.Look(along=ramp * pb.looks.Attenuation(), surfaces="tint")


def test_a_look_tints_what_its_beams_hit(whole):
    """The pool of light has the colour of the end of the beams, and the beams are those without the tint."""
    found, plain = (picture(dataclasses.replace(LAMP, look=each)) for each in (look(), pb.Look(along=look().along)))
    np.testing.assert_allclose(found["surface"], whole["surface"] * [0.25, 0.5, 1], rtol=2e-5, atol=1e-6)
    np.testing.assert_array_equal(found["beams"], plain["beams"])


@pytest.mark.parametrize("method", sweep(["auto", "beams"], ["beams"]))
def test_a_tint_by_distance_is_a_ramp_on_surfaces(method):
    """Two lamps with equal looks, whose light bounces; a ramp of the same colours acts on the same surfaces."""
    ramp = scene.DistanceRamp("/Ramp", [2.0, 4.5], [[1, 0.6, 0.2], [0.25, 0.5, 1]], left_out=frozenset({"/Fog"}))
    lamps = LAMP, dataclasses.replace(LAMP, name="/Other", center=np.array([2.5, 3, 0]))
    more = {"max_depth": 4, "method": method, "meshes": (FLOOR, box("/Block", [1, 0, 1], [2, 1, 2]))}
    tinted = picture(
        *(dataclasses.replace(each, look=look(begin=2, end=4.5, space="distance")) for each in lamps), **more
    )
    ramped = picture(*(dataclasses.replace(each, filters=(ramp,)) for each in lamps), **more)
    mean = ramped["surface"].mean(axis=(0, 1))
    np.testing.assert_allclose(tinted["surface"].mean(axis=(0, 1)), mean, rtol=0.01)
    # One pixel differs from the other by noise of what bounces.
    assert np.abs(tinted["surface"] - ramped["surface"]).mean() < 0.02 * mean.mean()


def test_a_look_that_needs_more_than_surfaces_have_does_not_tint(whole, caplog):
    found = picture(dataclasses.replace(LAMP, look=pb.Look(along="s * random * t", surfaces="tint")))
    text = "/Lamp tints no surfaces: along its beams, its look depends on random, to_camera, which they lack"
    assert text in caplog.text
    np.testing.assert_allclose(found["surface"], whole["surface"], rtol=2e-5, atol=1e-6)


def test_a_tint_changes_with_time_and_place(whole):
    """The floor is at the height 0, and the lamp turned so that it is in its plane x = 3.5."""
    turned = np.array([[0, 1, 0, 0], [-1, 0, 0, 3.5], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    changing = pb.Look(along="0.1 * frame * (1 + P.y) * Pl.x", surfaces="tint")
    found = picture(dataclasses.replace(LAMP, look=changing, frame=turned), frame=2)
    np.testing.assert_allclose(found["surface"], whole["surface"] * 0.7, rtol=1e-4, atol=1e-6)
