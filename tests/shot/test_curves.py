"""Drawn beams, read and written."""

import numpy as np
import pytest

from photonbeams.scene import DrawnBeams, SceneError
from photonbeams.shot.curves import write_beams
from photonbeams.shot.stage import open_stage, read_scene

API = '(prepend apiSchemas = ["PhotonBeamsCurvesAPI"])'


def curves(body, counts="[2, 2]", kind="linear", points="[(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 3, 0)]"):
    return f"""def BasisCurves "B" {API} {{
        uniform token type = "{kind}"
        int[] curveVertexCounts = {counts}
        point3f[] points = {points}
        {body}
    }}"""


def only(scene):
    (result,) = scene.drawn
    return result


@pytest.mark.parametrize(
    ("widths", "start", "end"),
    [
        ('[0.2] (interpolation = "constant")', [0.1, 0.1], [0.1, 0.1]),
        ('[0.2, 0.4] (interpolation = "uniform")', [0.1, 0.2], [0.1, 0.2]),
        ('[0.2, 0.4, 0.6, 0.8] (interpolation = "vertex")', [0.1, 0.3], [0.2, 0.4]),
        ('[0.2, 0.4, 0.6, 0.8] (interpolation = "varying")', [0.1, 0.3], [0.2, 0.4]),
    ],
)
@pytest.mark.parametrize("name", ["widths", "primvars:widths"])
def test_widths_are_diameters_in_every_interpolation(scene, widths, start, end, name):
    result = only(scene(curves(f"float[] {name} = {widths}")))
    assert np.allclose(result.radius_start, start)
    assert np.allclose(result.radius_end, end)
    assert np.allclose(result.start, [[0, 0, 0], [0, 1, 0]])
    assert np.allclose(result.end, [[1, 0, 0], [0, 3, 0]])
    assert np.allclose(result.power, 1)


def test_longer_curves_are_a_beam_for_each_segment_of_the_curves_power(scene):
    body = """
        float[] widths = [0.1, 0.2, 0.3, 0.4, 0.5]
        color3f[] photonbeams:power = [(1, 0, 0), (0, 2, 0)]"""
    points = "[(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, 0), (0, 3, 0)]"
    result = only(scene(curves(body, "[3, 2]", points=points)))
    assert np.allclose(result.end[:, 0], [1, 2, 0])
    assert np.allclose(result.radius_end * 2, [0.2, 0.3, 0.5])
    assert np.allclose(result.power, [[1, 0, 0], [1, 0, 0], [0, 2, 0]])


def test_a_periodic_curve_is_closed(scene):
    body = 'float[] widths = [0.1]\nuniform token wrap = "periodic"'
    result = only(scene(curves(body, "[3]", points="[(0, 0, 0), (1, 0, 0), (0, 1, 0)]")))
    assert np.allclose(result.end[-1], [0, 0, 0])
    assert len(result.start) == 3


def test_transforms_reach_points_and_widths(scene):
    body = """
        float[] widths = [0.1]
        color3f[] photonbeams:power = [(1, 2, 3)]
        token photonbeams:lightGroup = "drawn"
        float3 xformOp:scale = (2, 2, 2)
        uniform token[] xformOpOrder = ["xformOp:scale"]"""
    result = only(scene(curves(body)))
    assert np.allclose(result.end[0], [2, 0, 0])
    assert np.allclose(result.radius_start, 0.1)
    assert np.allclose(result.power, [1, 2, 3])
    assert result.group == "drawn"


def test_of_cubic_curves_the_control_polygon_is_used_with_a_warning(scene, caplog):
    result = only(scene(curves("float[] widths = [0.1]", "[4]", "cubic")))
    assert len(result.start) == 3
    assert "/B.type is not 'linear': the polygon of control points is used" in caplog.text


def test_segments_without_length_and_empty_curves_are_skipped_with_a_warning(scene, caplog):
    points = "[(0, 0, 0), (0, 0, 0), (0, 1, 0), (0, 3, 0)]"
    assert len(only(scene(curves("float[] widths = [0.1]", points=points))).start) == 1
    assert "/B has 1 segments without length: they are skipped" in caplog.text
    assert scene(curves("", "[]", points="[]")).drawn == ()
    assert "/B has no points: it is skipped" in caplog.text


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (curves("float[] widths = [0.1]", "[2, 3]"), r"/B\.curveVertexCounts sums to 5: expected .* 4"),
        (curves("float[] widths = [0.1]", "[1, 3]"), r"/B\.curveVertexCounts sums to 4: .* at least 2 for each curve"),
        (curves(""), r"/B\.widths is empty: beams expect the diameters of the curves"),
        (curves("float[] widths = [0.1, 0.2, 0.3]"), r"/B\.widths has 3 values .*: expected 1, 2 or 4"),
        (curves("float[] widths = [0.1, -0.2]"), r"/B\.widths holds -0\.2: expected diameters of at least 0"),
        (curves("float[] widths = [nan]"), r"/B\.widths\[0\] is nan: expected finite numbers"),
        (
            curves("float[] widths = [0.1]\ncolor3f[] photonbeams:power = [(1, 1, 1), (1, 1, 1), (1, 1, 1)]"),
            r"/B\.photonbeams:power has 3 values: expected 1 or 2",
        ),
        (
            curves("float[] widths = [0.1]\ncolor3f[] photonbeams:power = [(1, 1, 1), (1, -1, 1)]"),
            r"/B\.photonbeams:power\[1\] is .*: expected no negative power",
        ),
    ],
)
def test_contradictions_are_errors_that_name_prim_and_attribute(scene, text, message):
    with pytest.raises(SceneError, match=rf"stage\.usda: {message}"):
        scene(text)


@pytest.fixture
def beams(rng):
    start, end, power = rng.random((3, 50, 3))
    return DrawnBeams("/Beams", start, end, rng.random(50), rng.random(50), power, "key")


@pytest.mark.parametrize("name", ["beams.usda", "beams.usdc", "beams.usd"])
def test_beams_come_back_as_they_were_written(beams, tmp_path, name):
    write_beams(beams, tmp_path / name)
    result = only(read_scene(open_stage(tmp_path / name)))
    for key in ("start", "end", "radius_start", "radius_end", "power"):
        # Points and widths are single precision in USD.
        assert np.allclose(getattr(result, key), getattr(beams, key), atol=1e-6)
    assert result.group == "key"
    assert [each.name for each in tmp_path.iterdir()] == [name]


def test_beams_that_cannot_be_written_leave_nothing_behind(beams, tmp_path):
    with pytest.raises(SceneError, match=r"cannot be written: expected a folder that is there"):
        write_beams(beams, tmp_path / "gone" / "beams.usda")
    with pytest.raises(SceneError, match=r"expected a name that ends in \.usd"):
        write_beams(beams, tmp_path / "beams.txt")
    assert list(tmp_path.iterdir()) == []
