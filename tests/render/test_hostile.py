"""Scenes that nobody would build, and some that everybody builds, are rendered correctly or refused, without NaNs."""

import os

import numpy as np
import pytest

from photonbeams.render.scene_frame import render
from photonbeams.runtime.device import mitsuba
from photonbeams.scene import SceneError
from tests.helpers.mitsuba_pictures import INSIDE, LAMP, SMALL, agree, pictures
from tests.helpers.mitsuba_scenes import T, by_beams, camera, cloud, cube_of, fog, frames, load, rgb
from tests.helpers.references import reference
from tests.helpers.sweep import sweep
from tests.render.hostile import LOBES, Maker

mi = mitsuba()
FLOOR = {"type": "rectangle", "to_world": T().translate([0, -1.2, 0]).rotate([1, 0, 0], -90).scale(4)}


# -- random ----------------------------------------------------------------------------------------------------------


SEEDS = range(int(os.environ.get("PHOTONBEAMS_RANDOM_SCENES", "6")))


@pytest.mark.parametrize("seed", SEEDS if "PHOTONBEAMS_RANDOM_SCENES" in os.environ else sweep(SEEDS, range(3)))
def test_no_picture_has_numbers_that_are_none(seed, caplog):
    """Pictures of random scenes are finite: PHOTONBEAMS_RANDOM_SCENES sets their number; 500 take half an hour."""
    maker = Maker(seed)
    scene = maker.scene()
    film = scene["sensor"].get("sensor", scene["sensor"])["film"]
    integrator = mi.load_dict(maker.integrator())
    try:
        found = np.array(integrator.render(mi.load_dict(scene), spp=2, seed=seed))
    except SceneError as error:
        said = [str(error)]
    else:
        assert np.isfinite(found).all()
        # Filters with negative lobes overshoot.
        assert film["rfilter"]["type"] in LOBES or found.min() >= 0
        said = []
    for text in [*said, *(each.getMessage() for each in caplog.records)]:
        assert len(text) <= 300 and "\n" not in text


# -- refused ---------------------------------------------------------------------------------------------------------


def refused(match, **parts):
    parts = {"fog": cube_of(fog(0.5)), "light": LAMP, "sensor": camera(size=8), **parts}
    scene = load(**parts)
    with pytest.raises(SceneError, match=match) as caught:
        render(scene, scene.sensors()[0], by_beams(passes=1, beams=64))
    assert "\n" not in str(caught.value)
    with pytest.raises(SceneError) as first:
        mi.load_dict({"type": "photon_beams", "paths": 64, "method": "beams"}).render(scene, spp=1)
    assert str(first.value) == str(caught.value)


def image(value):
    pixels = np.full((4, 8, 3), 0.5, dtype=np.float32)
    pixels[1, 2] = value
    return mi.Bitmap(pixels)


def mesh(x):
    """Return two triangles, one corner of which is at `x`."""
    result = mi.Mesh("sheet", 4, 2)
    parameters = mi.traverse(result)
    parameters["vertex_positions"] = np.ravel([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [x, 1, 0]]).astype(np.float32)
    parameters["faces"] = np.ravel([[0, 1, 2], [0, 2, 3]]).astype(np.uint32)
    parameters.update()
    return result


def grid(value, **more):
    volume = {"type": "gridvolume", "grid": mi.VolumeGrid(np.full((3, 3, 3, 1), value, dtype=np.float32)), "raw": True}
    return cube_of({"type": "heterogeneous", "id": "dust", "sigma_t": volume, "albedo": 0.5, **more})


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_lights_with_numbers_that_are_none_are_refused(value):
    panel = {"type": "rectangle", "emitter": {"type": "area", "id": "panel", "radiance": {
        "type": "bitmap", "bitmap": image(value), "raw": True}}}  # fmt: skip
    refused("emitter panel: radiance.data has numbers that are not finite", light=panel)
    refused("emitter light: data has numbers that are not", light={"type": "envmap", "bitmap": image(value)})
    point = {"type": "point", "intensity": rgb([value, 1, 1])}
    refused("emitter light: intensity.value has numbers that are not finite", light=point)
    refused("emitter light: position", light={"type": "point", "position": [value, 0, 0], "intensity": rgb(1.0)})


def test_media_that_cannot_be_are_refused():
    refused("medium dust: sigma_t.data has numbers below 0, such as -1", fog=grid(-1))
    refused("medium dust: sigma_t.data has numbers that are not finite", fog=grid(np.nan))
    much = {"type": "gridvolume", "grid": mi.VolumeGrid(np.full((2, 2, 2, 1), 1.5, dtype=np.float32)), "raw": True}
    refused("medium dust: albedo.data has numbers above 1, such as 1.5", fog=grid(1, albedo=much))
    plain = {"type": "homogeneous", "id": "dust", "sigma_t": 1.0}
    refused("medium dust: albedo.value.value has numbers above 1, such as 1.5", fog=cube_of({**plain, "albedo": 1.5}))
    refused(r"medium dust: sigma_t is \[-1.0, -1.0, -1.0\]", fog=cube_of({**plain, "albedo": 0.5, "scale": -1.0}))


def test_a_scene_without_an_end_is_refused():
    refused("the scene has a radius of 5e.29 units: expected 1e.09 at most", wall=mesh(1e30))
    for value in (np.inf, np.nan):
        refused("shape wall: a vertex is not finite: expected faces of its own finite vertices", wall=mesh(value))


def test_a_camera_whose_rays_are_none_is_refused():
    nowhere = {**camera(), "to_world": mi.ScalarTransform4f().translate([0, np.nan, 0])}
    refused("sensor sensor: its rays are not finite", sensor=nowhere)


def test_the_near_plane_of_a_camera_does_not_matter():
    """Mitsuba's own rays are NaN there."""
    finite(sensor={**camera(size=8), "near_clip": 1e-30, "far_clip": 1e30})


# -- rendered --------------------------------------------------------------------------------------------------------


def finite(radius=None, guiding=None, **parts):
    scene = load(**{"sensor": camera(size=8), **parts})
    frame = render(scene, scene.sensors()[0], by_beams(passes=2, beams=500, radius=radius, guiding=guiding))
    layers = frame.layers()
    assert all(np.isfinite(layers[name]).all() and layers[name].min() >= 0 for name in ("rgba", "beams", "surface"))
    return frame, layers


def test_an_empty_scene_is_black():
    for parts in ({}, {"fog": cube_of(fog(0.5))},
                  {"fog": cube_of(fog(0.5)), "light": {**INSIDE, "intensity": rgb(0.0)}}):  # fmt: skip
        layers = finite(**parts)[1]
        assert not layers["rgba"].any()  # nor is there alpha: boundaries of media are invisible
        assert np.isinf(layers["depth"]).all()


def test_a_light_in_a_box_is_not_seen():
    box = {"type": "cube", "to_world": T().translate([0.3, 0.4, 0.2]).scale(0.3)}
    black = {"type": "diffuse", "reflectance": rgb(0.5)}
    black = {"type": "twosided", "side": black}
    # Narrow beams: the rim of one that ends at an edge of the box sticks out.
    layers = finite(0.0001, fog=cube_of(fog(0.5)), box={**box, "bsdf": black}, light=INSIDE)[1]
    assert not layers["beams"].any() and layers["rgba"][..., 3].any()


def test_textures_that_are_none_are_black():
    for kind, name in (("diffuse", "reflectance"), ("conductor", "specular_reflectance")):
        holes = {"type": kind, name: {"type": "bitmap", "bitmap": image(np.nan), "raw": True}}
        layers = finite(fog=cube_of(fog(0.5)), light=LAMP, floor={**FLOOR, "bsdf": holes})[1]
        assert layers["beams"].any()


def test_a_scene_is_as_bright_in_any_unit():
    def scaled(unit):
        lamp = {"type": "sphere", "center": [-2.0 * unit, 1.5 * unit, 0], "radius": 0.3 * unit, "emitter": {
            "type": "area", "radiance": rgb(30.0)}}  # fmt: skip
        seen = camera((0, 0.5 * unit, 4 * unit), size=8)
        seen.update(near_clip=1e-2 * unit, far_clip=1e3 * unit)
        parts = {"fog": cube_of(fog(0.5 / unit), unit), "light": lamp, "sensor": seen}
        return finite(guiding=False, **parts)[1]["beams"].mean()

    # Without a pilot, whose paths decide where others go, the samples are the same. But rays leave surfaces with an
    # offset, which has a length.
    assert [scaled(size) for size in (1e-2, 1e4, 1e6)] == pytest.approx([scaled(1.0)] * 3, rel=0.05)


def test_two_surfaces_in_one_place_are_one_or_the_other():
    cube = cube_of(fog(0.5))
    for other in (FLOOR, {"type": "cube", "bsdf": {"type": "dielectric"}}, cube_of(fog(2.0))):
        finite(fog=cube, twin=other, light=LAMP)


def test_fog_that_scatters_nothing_has_no_beams():
    scene = {"fog": cube_of(fog([0.2, 0.5, 1.0], 0.0), 1.1), "floor": FLOOR, "light": {**LAMP, "center": [-1.0, 3, 0]}}
    scene = load(**scene, sensor=camera((0, 1.5, 4), (0, -1, 0), size=32))
    frame = render(scene, scene.sensors()[0], by_beams(passes=16, beams=256, max_depth=2, hide_emitters=True))
    assert frame.statistics.beams == 0 and not frame.layers()["beams"].any()
    ours, theirs = (
        frame.layers()["rgba"][..., :3],
        reference("hostile/black fog", scene, 256, max_depth=2, hide_emitters=True),
    )
    np.testing.assert_allclose(ours.mean(axis=(0, 1)), theirs.mean(axis=(0, 1, 2)), rtol=0.01)


# -- against volpath -------------------------------------------------------------------------------------------------

GLASS = {"type": "dielectric", "int_ior": 1.5}
SKY = {"type": "constant", "radiance": rgb([0.6, 0.8, 1.0])}
ODD = {
    "a light inside": ({"fog": cube_of(fog(0.8)), "light": INSIDE}, 3, 0.01),
    "a mask": (
        {"fog": cube_of(fog(0.8)), "light": {"type": "point", "position": [0, 3, 0], "intensity": rgb(20.0)},
         "mask": {"type": "rectangle", "to_world": T().translate([0, 1.5, 0]).rotate([1, 0, 0], 90).scale(3),
                  "bsdf": {"type": "mask", "opacity": 0.5, "nested": {"type": "diffuse"}}}}, 3, 0.015),
    "coloured glass in the sky": (
        {"slab": {**cube_of(fog([0.1, 0.5, 1.0], 0.5)), "bsdf": GLASS}, "light": SKY}, 8, 0.02),
    "instances": (
        {"group": {"type": "shapegroup", "ball": {"type": "sphere", "bsdf": {"type": "null"}, "interior": fog(0.6)}},
         "a": {"type": "instance", "to_world": T().translate([0.2, 0, 0]), "g": {"type": "ref", "id": "group"}},
         "light": LAMP}, 3, 0.01),
}  # fmt: skip


@pytest.mark.parametrize("name", ODD)
def test_odd_scenes_are_those_of_volpath(name):
    parts, depth, bias = ODD[name]
    scene = load(**parts, sensor=camera(size=32))
    ours = pictures(scene, max_depth=depth, hide_emitters=True, **SMALL)
    theirs = reference(f"hostile/{name}", scene, 128, len(ours), max_depth=depth, hide_emitters=True)
    assert agree(ours, theirs, bias)


@pytest.mark.soak
def test_a_sensor_in_nested_media_need_not_say_so():
    outer, inner = mi.load_dict(fog(0.3)), mi.load_dict(fog([1.0, 0.6, 0.3], 0.8))
    ball = {"type": "sphere", "radius": 0.7, "bsdf": {"type": "null"}, "interior": inner, "exterior": outer}
    parts = {"fog": cube_of(outer, 1.5), "ball": ball, "light": LAMP}
    scene = load(**parts, sensor=camera((0, 0, 0.3), (-0.5, 0.2, -1), fov=70))
    declared = load(**parts, sensor=camera((0, 0, 0.3), (-0.5, 0.2, -1), fov=70, medium=inner))
    ours = pictures(scene, 4, max_depth=3, hide_emitters=True, **{**SMALL, "passes": 3, "beams": 65536})
    theirs = reference("hostile/a sensor in nested media", declared, 1024, 4, max_depth=3, hide_emitters=True)
    # Beams near the camera are bright and few, so the spread of a few pictures underestimates the error.
    np.testing.assert_allclose(ours.mean(axis=(0, 1, 2)), theirs.mean(axis=(0, 1, 2)), rtol=0.03)


def test_a_medium_of_the_sensor_ends_at_its_border():
    """The fog that the sensor names does not reach beyond its boundary, to the lamp outside."""
    medium = mi.load_dict(fog(2.0, 0.8))
    scene = load(fog=cube_of(medium), light=LAMP, floor=FLOOR,
                 sensor=camera((0, 0.5, 0.5), (-0.1, -1.5, -0.3), medium=medium, fov=90))  # fmt: skip
    ours = pictures(scene, 4, hide_emitters=True, **{**SMALL, "passes": 3, "beams": 16384}).mean(axis=(1, 2))
    theirs = reference("hostile/a sensor at a border", scene, 512, 4, hide_emitters=True).mean(axis=(0, 1, 2))
    error = ours.std(axis=0, ddof=1) / np.sqrt(len(ours))
    np.testing.assert_array_less(np.abs(ours.mean(axis=0) - theirs), 4.5 * error + 0.01 * theirs)


def test_a_cornell_box_without_fog_is_that_of_path():
    plain = mi.cornell_box()
    plain["sensor"]["film"].update(width=32, height=32, rfilter={"type": "box"})
    scene = mi.load_dict(plain)
    # Subtract the lamp itself, whose brightness in so few pixels depends on the places that are sampled.
    settings = (by_beams(passes=3, beams=65536, max_depth=depth, surface_samples=16) for depth in (None, 1))
    ours = [render(scene, scene.sensors()[0], own).layers()["surface"].mean(axis=(0, 1)) for own in settings]
    theirs = [
        reference(f"hostile/a cornell box, depth {depth}", scene, 128, plugin="path", max_depth=depth)
        for depth in (-1, 1)
    ]
    ours, theirs = ours[0] - ours[1], (theirs[0] - theirs[1]).mean(axis=(0, 1, 2))
    np.testing.assert_allclose(ours, theirs, rtol=0.03)


def test_caustics_on_surfaces_are_those_of_path():
    ball = {"type": "sphere", "center": [0, 0.2, 0], "radius": 0.6, "bsdf": GLASS}
    lamp = {"type": "sphere", "center": [0, 3.5, 0], "radius": 0.5, "emitter": {"type": "area", "radiance": rgb(10.0)}}
    mirror = {"type": "rectangle", "to_world": T().translate([0, 0, -2]).scale(2), "bsdf": {"type": "conductor"}}
    scene = load(ball=ball, light=lamp, floor=FLOOR, mirror=mirror, sensor=camera((0, 1, 4), (0, -0.5, 0)))
    settings = by_beams(passes=6, beams=8192, hide_emitters=True, max_depth=6)
    each = [found.layers()["surface"].mean() for found in frames(scene, settings, 6)]
    theirs = reference("hostile/caustics", scene, 4096, plugin="path", hide_emitters=True, max_depth=6).mean()
    # Seen in the ball, the lamp is smaller than a pixel, so few camera rays meet it: the seeds give the error.
    assert abs(np.mean(each) - theirs) < 4 * np.std(each, ddof=1) / np.sqrt(len(each))


def test_a_grid_of_nothing_is_nothing():
    nothing = cloud()
    nothing["scale"] = 0.0
    assert not finite(fog=cube_of(nothing), light=LAMP)[1]["beams"].any()


def test_rough_glass_is_lit_by_photons():
    ball = {"type": "sphere", "bsdf": {"type": "roughdielectric", "alpha": 0.4}}
    lamp = {"type": "sphere", "center": [-2.0, 3.5, 0.5], "radius": 1.0, "emitter": {"type": "area", "radiance": 5.0}}
    scene = load(ball=ball, light=lamp, sensor=camera(size=32))
    ours = pictures(scene, passes=3, beams=65536, max_depth=3, hide_emitters=True, radius=0.02)
    theirs = reference("hostile/rough glass", scene, 128, len(ours), max_depth=3, hide_emitters=True)
    # The mean of 24 seeds, which spread by 1.8 % each, agreed with `volpath` to 0.4 %, its standard error.
    assert agree(ours, theirs, bias=0.005)


def test_a_border_that_lies_on_another_surface_is_not_missed_by_single_rays():
    """A plank ends on the wall around the fog; rays that meet only one of the two still meet the fog's boundary."""
    medium = mi.load_dict(fog(0.5))
    plank = {"type": "cube", "to_world": T().translate([-0.5, 0, -1.5]).scale([0.02, 1.5, 0.5])}
    room = {**cube_of(medium, 2.0), "bsdf": {"type": "twosided", "side": {"type": "diffuse"}}}
    sensor = camera((0.6, 0, 1.5), (-0.6, 0, -2), fov=60, size=64, medium=medium)
    scene = load(room=room, plank=plank, light={**INSIDE, "position": [1.2, 1.0, 0.5]}, sensor=sensor)
    beams = render(scene, scene.sensors()[0], by_beams(passes=2, beams=4096, surfaces=False)).layers()["beams"][..., 0]
    # The light is smooth: no pixel is much darker than both of its neighbours.
    around = np.minimum(beams[:, :-2], beams[:, 2:])
    assert (beams[:, 1:-1] > 0.5 * around).all()
