"""The benchmarks against Cycles, as far as they run without Cycles: both renderers get the same scene."""

from functools import partial

import numpy as np
import pytest

from benchmarks import cycles
from benchmarks.cycles_scene import UntranslatedError, cycles_job
from tests.helpers import mitsuba_scenes as scenes

mi = scenes.mi


@pytest.fixture(scope="module")
def told():
    return cycles.job(bounces=0)


@pytest.fixture(scope="module")
def scene():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scenes, "load", partial(scenes.load, optimize=False))  # or Mitsuba would merge the walls
        return scenes.comparison()


def test_the_walls_have_the_same_bounds(told, scene):
    def in_order(bounds):
        return np.array(sorted(np.round(np.float64(bounds), 5).tolist()))

    own = [np.concatenate([each.bbox().min, each.bbox().max]) for each in scene.shapes() if not each.is_emitter()]
    points = [np.array(each["points"]) for each in told["surfaces"]]
    bounds = [np.concatenate([each.min(axis=0), each.max(axis=0)]) for each in points]
    assert in_order(bounds) == pytest.approx(in_order(own), abs=1e-5)
    assert np.ptp(points[0], axis=0) == pytest.approx([4, 3, 4])  # the first is the box, which contains the fog


def test_the_light_has_the_same_place_axis_and_flux(told, scene):
    (shape,), light = [each for each in scene.shapes() if each.is_emitter()], told["light"]
    radiance = np.ravel(mi.traverse(shape)["emitter.radiance.value"])[0]
    assert light["power"] == pytest.approx(1000)
    assert light["power"] == pytest.approx(np.pi * radiance * np.ravel(shape.surface_area())[0], rel=1e-5)
    assert light["center"] == pytest.approx(np.ravel(shape.bbox().center()), abs=1e-6)
    normal = shape.sample_position(0.0, mi.Point2f(0.5, 0.5)).n
    assert light["axis"] == pytest.approx(np.ravel(normal), abs=1e-6)


def test_the_fog_has_the_same_coefficients(told, scene):
    medium = mi.traverse(next(each for each in scene.shapes() if each.is_medium_transition()).interior_medium())
    extinction = np.ravel(medium["scale"])[0] * np.ravel(medium["sigma_t.value.value"])[:3]
    scattering = extinction * np.ravel(medium["albedo.value.value"])[:3]
    (fog,) = told["fogs"]
    assert fog["points"] == told["surfaces"][0]["points"]
    assert fog["fog"]["scattering"] == pytest.approx(scattering, rel=1e-5)
    assert fog["fog"]["absorption"] == pytest.approx(extinction - scattering, rel=1e-4)
    assert fog["fog"]["anisotropy"] == 0


def test_the_camera_has_the_same_place_and_angle(told, scene):
    sensor = mi.traverse(scene.sensors()[0])
    assert np.degrees(told["camera"]["angle"]) == pytest.approx(np.ravel(sensor["x_fov"])[0], rel=1e-5)
    place = np.array(sensor["to_world"].matrix).reshape(4, 4)
    assert np.array(told["camera"]["matrix"])[:3, 3] == pytest.approx(place[:3, 3])
    assert place[:3, 2] == pytest.approx([0, 0, -1])  # Mitsuba's cameras look along their +z, Blender's along −z


def test_the_reference_has_no_error_and_a_brighter_picture_has_its_own():
    reference = cycles.Reference("single", (32, 18))
    picture = reference.radiance
    assert reference.compared(picture) == (0, 1)
    assert reference.compared(1.1 * picture) == pytest.approx((0.1, 1.1))


def test_without_bpy_a_sentence_says_what_is_expected(capsys, tmp_path):
    with pytest.raises(SystemExit):
        cycles.report(None, ["--python", str(tmp_path / "python")])
    assert "is missing: expected a Python that has bpy" in capsys.readouterr().err


# -- other scenes ----------------------------------------------------------------------------------------------------

FOG = {"type": "homogeneous", "sigma_t": 0.5, "albedo": 0.8, "phase": {"type": "hg", "g": 0.3}}


def small_scene(**shapes):
    """Return a room full of fog, with the given shapes in it, and a camera at (0, 0, 4)."""
    camera = {
        "type": "perspective",
        "fov": 50,
        "to_world": mi.ScalarTransform4f().look_at([0, 0, 4], [0, 0, 0], [0, 1, 0]),
    }
    room = {"type": "cube", "to_world": mi.ScalarTransform4f().scale(3), "interior": FOG}
    return mi.load_dict({"type": "scene", "camera": camera, "room": room, **shapes}, optimize=False)


def volume(mesh):
    """Return the volume of a closed mesh, negative if its normals point inward."""
    corners = np.array(mesh["points"])[np.array(mesh["faces"])]
    return np.linalg.det(corners).sum() / 6


def test_a_ball_of_glass_leaves_a_hole_in_the_fog():
    ball = {
        "type": "sphere",
        "radius": 1.5,
        "bsdf": {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0},
        "exterior": FOG,
    }
    job = cycles_job(small_scene(ball=ball))
    (glass,) = [each for each in job["surfaces"] if each["kind"] == "glass"]
    sphere = 4 / 3 * np.pi * 1.5**3
    # Facets of two degrees lose a thousandth of the volume; gaps of 1e-4 over 250 square units of surface lose less.
    assert volume(glass) == pytest.approx(sphere, rel=2e-3)
    (fog,) = job["fogs"]
    assert volume(fog) == pytest.approx(6**3 - sphere, rel=2e-3)
    assert fog["fog"]["scattering"] == pytest.approx([0.4] * 3)
    assert fog["fog"]["absorption"] == pytest.approx([0.1] * 3)
    assert fog["fog"]["anisotropy"] == pytest.approx(0.3)


def test_a_lamp_shines_from_its_front_and_bounds_no_fog():
    lamp = {
        "type": "disk", "to_world": mi.ScalarTransform4f().translate([0, 2, 0]).rotate([1, 0, 0], 90),
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [3.0, 2.0, 1.0]}}, "exterior": FOG,
    }  # fmt: skip
    job = cycles_job(small_scene(lamp=lamp))
    (shining,) = [each for each in job["surfaces"] if "emission" in each]
    assert shining["emission"] == pytest.approx([3, 2, 1])
    a, b, c = np.array(shining["points"])[shining["faces"][0]]
    assert np.cross(b - a, c - a)[1] < 0  # down, as the disk is turned
    assert volume(job["fogs"][0]) == pytest.approx(6**3, rel=1e-3)


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ({"type": "sphere", "bsdf": {"type": "roughplastic"}}, "a surface of RoughPlastic"),
        ({"type": "point", "position": [0, 0, 0]}, "a light of PointLight"),
    ],
)
def test_what_cycles_renders_differently_is_refused(shape, message):
    with pytest.raises(UntranslatedError, match=message):
        cycles_job(small_scene(other=shape))
