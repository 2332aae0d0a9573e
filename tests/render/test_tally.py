"""Light that fog scatters again, tallied in froxels: its mean, walls, crops and bits, through the public doors."""

import numpy as np
import pytest

import photonbeams as pb
from photonbeams.render.scene_frame import render
from photonbeams.render.settings import Settings
from photonbeams.render.techniques import FOG_FURTHER, TALLY, WALKS
from photonbeams.runtime.device import mitsuba
from tests.helpers.mitsuba_scenes import T, camera, cloud, cube_of, fog, load, rgb

mi = mitsuba()

GREY = {"type": "twosided", "side": {"type": "diffuse", "reflectance": rgb(0.6)}}


def box_of_fog(extinction=0.8, g=0.0, medium=None, more=None, **film):
    """Return a scene with a floor and a lamp in a box of fog, or of another medium, with `more` in it."""
    medium = mi.load_dict(medium or fog(extinction, (0.9, 0.8, 0.7), phase={"type": "hg", "g": g}))
    place = T().translate([0, -0.9, 0]).rotate([1, 0, 0], -90)
    return load(
        box=cube_of(medium), floor={"type": "rectangle", "to_world": place.scale(0.95), "bsdf": GREY},
        lamp={"type": "sphere", "center": [0.3, 0.2, 0.1], "radius": 0.2, "exterior": medium,
              "bsdf": {"type": "diffuse", "reflectance": rgb(0.0)}, "emitter": {"type": "area", "radiance": rgb(3.0)}},
        sensor=camera((0, 0.3, 4), size=16, fov=34, **film), **(more or {}),
    )  # fmt: skip


def picture(scene, seed=0, passes=2, **given):
    """Return a picture of a scene, and its frame."""
    frame = render(
        scene, scene.sensors()[0], Settings(seed=seed, passes=passes, beams=1024, max_depth=6, guiding=False, **given)
    )
    return np.asarray(frame.layers()["rgba"])[..., :3], frame


def by_tally(frame):
    """Return whether the tally finds light in a frame."""
    return any(row.by(TALLY, FOG_FURTHER) for row in frame.light.rows)


# A mirror and a ball of glass, in the box and before it.
SHARP = {
    "mirror": {"type": "rectangle", "to_world": T().translate([-0.6, 0, -0.3]).rotate([0, 1, 0], 40).scale(0.5),
               "bsdf": {"type": "twosided", "side": {"type": "conductor"}}},
    "ball": {"type": "sphere", "center": [0.1, -0.5, 0.4], "radius": 0.25, "bsdf": {"type": "dielectric"}},
}  # fmt: skip
SCENES = {
    "forward": {"extinction": 0.4, "g": 0.8},
    "dense": {"extinction": 3.0, "g": -0.6},
    "grid": {"medium": cloud(scale=6.0, phase={"type": "hg", "g": 0.5})},
    "grid of colours": {"medium": cloud((1.0, 0.6, 0.3), scale=3.0)},
    "mirrors": {"more": SHARP},
}


@pytest.mark.parametrize("name", SCENES)
def test_the_tally_has_the_mean_of_volpath(name):
    scene = box_of_fog(**SCENES[name])
    seen = [picture(scene, seed, without=frozenset({WALKS})) for seed in range(4)]
    assert by_tally(seen[0][1])
    volpath = mi.load_dict({"type": "volpath", "max_depth": 6, "rr_depth": 64})
    pictures = [[each for each, _ in seen], [mi.render(scene, spp=256, integrator=volpath, seed=k) for k in range(4)]]
    means = np.array([[np.array(each).mean(axis=(0, 1)) for each in own] for own in pictures])
    (found, expected), (own, other) = means.mean(axis=1), means.var(axis=1, ddof=1) / 4
    # Of each colour, whose albedos differ. A blur of a quarter of a free path moves a hundredth at the box's sides.
    assert np.all(abs(found - expected) < 4 * np.sqrt(own + other) + 0.015 * expected)


def test_no_light_comes_through_a_thin_wall():
    medium = mi.load_dict(fog(0.6, 0.9))
    wall = {"type": "cube", "bsdf": GREY, "to_world": T().scale([0.004, 1.0, 1.0])}
    scene = load(
        room={"type": "cube", "bsdf": GREY, "interior": medium}, wall=wall,
        lamp={"type": "point", "position": [0.5, 0.2, -0.2], "intensity": rgb(5.0), "medium": medium},
        sensor=camera((-0.4, 0, 0.9), (-0.4, 0, -1), size=24, fov=80, medium=medium),
    )  # fmt: skip
    seen, frame = picture(scene)
    assert by_tally(frame)
    # Of the fog on the other side, which is as bright as 1; what is left is rounding.
    assert seen.max() < 1e-5


def test_a_crop_has_the_pixels_of_the_whole_picture():
    whole, _ = picture(box_of_fog())
    crop = {"crop_offset_x": 3, "crop_offset_y": 6, "crop_width": 9, "crop_height": 5}
    part, frame = picture(box_of_fog(**crop))
    assert by_tally(frame)
    assert (part == whole[6:11, 3:12]).all()


PANORAMA = """#usda 1.0
def Scope "Fog" (prepend apiSchemas = ["PhotonBeamsMediumAPI"]) {
    color3f photonbeams:scattering = (0.25, 0.25, 0.2)
}
def SphereLight "Lamp" {
    float inputs:radius = 0.3
    float inputs:intensity = 10
    double3 xformOp:translate = (0.9, 0.8, -1.5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Camera "Eye" {
    token photonbeams:projection = "equirectangular"
    float2 photonbeams:fieldOfView = (360, 180)
}
"""


def test_a_panorama_has_the_light_of_soft_beams_all_around(tmp_path):
    path = tmp_path / "panorama.usda"
    path.write_text(PANORAMA)

    def blocks(off, seed):
        found = pb.Shot.open(path).render(
            passes=2, seed=seed, max_depth=4, width=24, height=12, without=frozenset(off), pixel_filter="box"
        )
        return np.asarray(found.layers["beams"])[..., 0].reshape(3, 4, 4, 6).mean(axis=(1, 3))

    found, others = (np.array([blocks(off, seed) for seed in range(4)]) for off in ((), {TALLY}))
    error = np.sqrt((found.var(axis=0, ddof=1) + others.var(axis=0, ddof=1)) / 4)
    # Each block looks through other faces of the cube. Both are biased by their blur, of one or two hundredths.
    assert np.all(abs(found.mean(axis=0) - others.mean(axis=0)) < 4 * error + 0.02 * others.mean(axis=0))
    assert found.var(axis=0).mean() < others.var(axis=0).mean()


MOVING = """#usda 1.0
( startTimeCode = 1
  endTimeCode = 2 )
def Cube "Fog" (prepend apiSchemas = ["PhotonBeamsMediumAPI"]) {
    double size = 2
    color3f photonbeams:scattering = (0.8, 0.8, 0.8)
    double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 2: (0.2, 0, 0) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def SphereLight "Lamp" {
    float inputs:radius = 0.1
    float inputs:intensity = 50
    double3 xformOp:translate = (0.2, 1.6, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Camera "Eye" {
    double shutter:close = 0.5
    double3 xformOp:translate = (0, 0, 5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""


def test_fog_that_moves_has_its_scattered_light_in_every_pass(tmp_path):
    path = tmp_path / "moving.usda"
    path.write_text(MOVING)

    def mean(depth, off, seed):
        off = frozenset({WALKS, *off})
        given = {"width": 16, "height": 12, "pixel_filter": "box", "without": off}
        return (
            pb.Shot.open(path).render(1, passes=1, seed=seed, max_depth=depth, **given).layers["beams"][..., 0].mean()
        )

    straight, tallied, beams = (
        np.array([mean(*each, seed) for seed in range(6)]) for each in ((2, ()), (4, ()), (4, (TALLY,)))
    )
    # Scattered light is a third of all, and each pass has its own world.
    assert (tallied > 1.15 * straight.mean()).all()
    error = np.sqrt((tallied.var(ddof=1) + beams.var(ddof=1)) / len(beams))
    assert abs(tallied.mean() - beams.mean()) < 4 * error + 0.02 * beams.mean()
