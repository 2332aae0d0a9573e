"""The benchmark beside Cycles, as far as it goes without Cycles: both renderers are told of the same scene."""

from functools import partial

import numpy as np
import pytest
from benchmarks import cycles
from tests.transport import scenes

mi = scenes.mi


@pytest.fixture(scope="module")
def told():
    return cycles.job((160, 90), samples=4, bounces=0, file="picture.exr")


@pytest.fixture(scope="module")
def scene():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scenes, "load", partial(scenes.load, optimize=False))  # or the walls would be one
        return scenes.comparison()


def test_the_walls_have_the_same_bounds(told, scene):
    def in_order(bounds):
        return np.array(sorted(np.round(np.float64(bounds), 5).tolist()))

    own = [np.concatenate([each.bbox().min, each.bbox().max]) for each in scene.shapes() if not each.is_emitter()]
    points = [np.array(points) for points, _ in told["meshes"]]
    bounds = [np.concatenate([each.min(axis=0), each.max(axis=0)]) for each in points]
    assert in_order(bounds) == pytest.approx(in_order(own), abs=1e-5)
    assert np.ptp(points[0], axis=0) == pytest.approx([4, 3, 4])  # the first is the box, which has the fog


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
    assert told["fog"]["scattering"] == pytest.approx(scattering, rel=1e-5)
    assert told["fog"]["absorption"] == pytest.approx(extinction - scattering, rel=1e-4)
    assert told["fog"]["anisotropy"] == 0


def test_the_camera_has_the_same_place_and_angle(told, scene):
    sensor = mi.traverse(scene.sensors()[0])
    assert np.degrees(told["camera"]["angle"]) == pytest.approx(np.ravel(sensor["x_fov"])[0], rel=1e-5)
    place = np.array(sensor["to_world"].matrix).reshape(4, 4)
    assert told["camera"]["eye"] == pytest.approx(place[:3, 3])
    assert place[:3, 2] == pytest.approx([0, 0, -1])  # Mitsuba's cameras look along their +z, Blender's along −z


def test_the_reference_has_no_error_and_a_brighter_picture_has_its_own():
    reference = cycles.Reference("single", (32, 18))
    picture = reference.radiance
    assert reference.compared(picture) == (0, 1)
    assert reference.compared(1.1 * picture) == pytest.approx((0.1, 1.1))


def test_without_bpy_a_sentence_says_what_is_expected(capsys, tmp_path):
    with pytest.raises(SystemExit):
        cycles.report(None, ["--python", str(tmp_path / "python")])
    assert "is missing: expected --install, or a Python that has bpy" in capsys.readouterr().err
