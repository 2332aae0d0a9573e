"""Reading and writing of drawn beams."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BSpline, CubicHermiteSpline

import photonbeams as pb
from photonbeams.scene import DrawnBeams, SceneError
from photonbeams.usd.authoring.beams import write_beams
from photonbeams.usd.geometry.splines import BASES, CHORD_ERROR, MOST_TURN, Spans, varying_counts
from photonbeams.usd.stage import open_stage, read_scene

API = '(prepend apiSchemas = ["PhotonBeamsCurvesAPI"])'


@pytest.fixture
def knots(rng):
    return rng.normal(size=(7, 3))


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


def test_velocities_carry_curves_from_the_frames_sample(usd):
    points, velocities = "[(0, 0, 0), (1, 0, 0)]", "[(0, 24, 0), (0, 48, 0)]"
    body = f"""
        vector3f[] velocities.timeSamples = {{ 1: [(9, 9, 9)], 2: {velocities}
        }}
        float[] widths = [0.1]"""
    text = curves(body).replace(
        "int[] curveVertexCounts = [2, 2]", "int[] curveVertexCounts.timeSamples = { 1: [1], 2: [2] }"
    )
    text = re.sub(r"point3f\[\] points = .*", f"point3f[] points.timeSamples = {{ 1: [(0, 0, 0)], 2: {points} }}", text)
    result = only(read_scene(usd(text), 1.5, base=2))
    assert np.allclose(result.start, [[0, -0.5, 0]])
    assert np.allclose(result.end, [[1, -1, 0]])


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


# -- Cubic curves ------------------------------------------------------------------------------------------------------


def de_casteljau(points, t):
    """Return the points at parameters t of the Bézier curve with four control points."""
    for _ in range(3):
        points = (
            points[:-1] + t[:, None, None] * (points[1:] - points[:-1])
            if points.ndim == 2
            else (points[:, :-1] + t[:, None, None] * (points[:, 1:] - points[:, :-1]))
        )
    return points[:, 0]


@pytest.mark.parametrize("wrap", ["nonperiodic", "periodic", "pinned"])
@pytest.mark.parametrize("basis", BASES)
def test_spans_are_the_curves_that_others_compute(basis, wrap, knots):
    points = knots[:6] if basis == "bezier" and wrap == "periodic" else knots
    counts = np.array([len(points)])
    spans = Spans.of(counts, np.array([True]), basis, wrap)
    t = np.linspace(0, 1, 5)
    whole = {"nonperiodic": points, "periodic": np.concatenate([points, points[:3]])}.get(wrap)
    if wrap == "pinned":  # phantom points continue the line through each end and its neighbour
        whole = np.concatenate([[2 * points[0] - points[1]], points, [2 * points[-1] - points[-2]]])
    if basis == "bezier":
        whole = np.concatenate([points, points[:1]]) if wrap == "periodic" else points
    for span in range(len(spans.curve)):
        if basis == "bezier":
            expected = de_casteljau(whole[3 * span : 3 * span + 4], t)
        elif basis == "bspline":
            expected = BSpline(np.arange(-3.0, len(whole) + 1), whole, 3)(span + t)
        else:
            a, b, c, d = whole[span : span + 4]
            expected = CubicHermiteSpline([0, 1], [b, c], [(c - a) / 2, (d - b) / 2])(t)
        assert np.allclose(spans.at(points, np.full(5, span), t), expected)
    assert len(spans.curve) == {"bezier": 2, "bspline": 4, "catmullRom": 4}[basis] + (
        0 if basis == "bezier" else {"nonperiodic": 0, "periodic": 3, "pinned": 2}[wrap]
    )


CIRCLE = 0.5522847498  # handle length of a quarter circle as a Bézier curve, which is exact to 3e-4


def quarter(width=0.2, more=""):
    return f"""def BasisCurves "B" {API} {{
        uniform token type = "cubic"
        uniform token basis = "bezier"
        int[] curveVertexCounts = [4]
        point3f[] points = [(1, 0, 0), (1, {CIRCLE}, 0), ({CIRCLE}, 1, 0), (0, 1, 0)]
        float[] widths = [{width}] (interpolation = "constant")
        {more}
    }}"""


@pytest.mark.parametrize("width", [0.002, 0.02, 0.2])
def test_a_cubic_curve_has_as_many_pieces_as_it_bends(scene, width):
    result = only(scene(quarter(width)))
    middle = 0.5 * (result.start + result.end)
    # The sag is measured from the circle, from which the Bézier curve is up to 3e-4 off. The number of pieces follows
    # from the greatest curvature of the curve.
    sag = 1 - np.linalg.norm(middle, axis=1)
    assert sag.max() <= CHORD_ERROR * width / 2 + 3e-4
    turn = np.degrees(np.arccos(np.sum(result.start_tangent * result.end_tangent, axis=1)))
    assert turn.max() <= 1.3 * MOST_TURN
    assert len(result.start) >= np.pi / 2 / np.sqrt(8 * CHORD_ERROR * width / 2) * 0.9
    assert len(result.start) <= 1.5 * max(np.pi / 2 / np.sqrt(8 * CHORD_ERROR * width / 2), 90 / MOST_TURN) + 1


def test_the_pieces_of_a_curve_are_joined_and_falloffs_run_over_all_of_it(scene):
    result = only(scene(quarter()))
    assert np.array_equal(result.end[:-1], result.start[1:])
    assert np.array_equal(result.end_tangent[:-1], result.start_tangent[1:])
    length = np.linalg.norm(result.end - result.start, axis=1)
    assert np.allclose(result.offset, np.cumsum(length) - length)
    assert np.allclose(result.total, length.sum()) and np.isclose(length.sum(), np.pi / 2, rtol=1e-3)
    assert result.entry is None and result.end_normal is None and result.power_end is None


def test_a_straight_curve_of_two_points_is_a_plain_beam(scene):
    result = only(scene(curves("float[] widths = [0.1]")))
    assert result.arrays().keys() == {"start", "end", "radius_start", "radius_end", "power", "id"}


@pytest.mark.parametrize(("kind", "values"), [("varying", "[0.1, 0.4]"), ("vertex", "[0.1, 0.1, 0.1, 0.4]")])
def test_widths_along_cubic_curves_follow_their_interpolation(scene, kind, values):
    text = quarter().replace(
        'widths = [0.2] (interpolation = "constant")', f'widths = {values} (interpolation = "{kind}")'
    )
    result = only(scene(text))
    pieces = len(result.start)
    t = np.arange(1, pieces + 1) / pieces
    expected = 0.1 + 0.3 * (t if kind == "varying" else t**3)
    assert np.allclose(2 * result.radius_end, expected) and np.array_equal(
        result.radius_end[:-1], result.radius_start[1:]
    )


def test_colours_along_a_curve_multiply_its_power_and_others_are_for_viewports(scene):
    power = "color3f[] photonbeams:power = [(2, 2, 2)]\n"
    along = 'color3f[] primvars:displayColor = [(1, 0, 0), (0, 0, 1)] (interpolation = "varying")'
    result = only(scene(quarter(more=power + along)))
    assert np.allclose(result.power[0], [2, 0, 0]) and np.allclose(result.power_end[-1], [0, 0, 2])
    assert np.allclose(result.power[1:], result.power_end[:-1])
    assert np.allclose(result.power.sum(axis=1), 2)
    whole = along.replace("(1, 0, 0), (0, 0, 1)", "(1, 0, 0)").replace("varying", "constant")
    result = only(scene(quarter(more=power + whole)))
    assert np.allclose(result.power, 2) and result.power_end is None
    result = only(scene(quarter(more="color3f[] photonbeams:power = [(1, 0, 0), (0, 1, 0)]")))
    assert np.allclose(result.power_end[-1], [0, 1, 0])


def test_a_pinned_curve_reaches_its_ends_and_a_periodic_one_closes(scene):
    points = "[(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]"
    for basis in ("bspline", "catmullRom"):
        more = f'uniform token basis = "{basis}"\nfloat[] widths = [0.1]\nuniform token wrap = '
        pinned = only(scene(curves(more + '"pinned"', "[4]", "cubic", points)))
        assert np.allclose(pinned.start[0], 0) and np.allclose(pinned.end[-1], [0, 1, 0])
        closed = only(scene(curves(more + '"periodic"', "[4]", "cubic", points)))
        assert np.array_equal(closed.end[-1], closed.start[0])
        assert np.array_equal(closed.end_tangent[-1], closed.start_tangent[0])


def test_a_curve_has_as_many_pieces_at_all_times(usd):
    moving = quarter().replace(
        "point3f[] points = ",
        "point3f[] points.timeSamples = { 1: [(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0)],\n 5: ",
    ).replace("(0, 1, 0)]\n", "(0, 1, 0)]\n}\n")  # fmt: skip
    stage = usd(moving)
    found = [only(read_scene(stage, time)) for time in (1.0, 2.5, 5.0)]
    assert len({len(each.start) for each in found}) == 1 and len(found[0].start) > 20
    assert np.allclose(found[0].start[:, 1], 0) and np.allclose(np.linalg.norm(found[2].start, axis=1), 1, atol=1e-3)


def test_transforms_reach_curves(scene):
    more = 'double3 xformOp:scale = (2, 2, 2)\nuniform token[] xformOpOrder = ["xformOp:scale"]'
    plain, scaled = only(scene(quarter())), only(scene(quarter(more=more)))
    for name in ("start", "radius_end", "offset", "total"):
        assert np.allclose(getattr(scaled, name), 2 * getattr(plain, name))
    assert np.allclose(scaled.start_tangent, plain.start_tangent)


@pytest.mark.parametrize(
    ("counts", "body", "message"),
    [
        (
            "[1, 3]",
            "float[] widths = [0.1]",
            r"curveVertexCounts has curve 0 whose number of points is not 2 or more",
        ),
        ("[2, 2]", "float[] widths = [0, 0, 0.1, 0.1]", r"/B\.widths has curve 0 without width: skipped"),
        ("[2, 2]", 'float[] widths = [0, 0.1] (interpolation = "uniform")', r"/B\.widths has curve 0 without width"),
    ],
)
def test_a_curve_that_cannot_be_rendered_is_skipped_and_the_others_are_not(scene, caplog, counts, body, message):
    result = only(scene(curves(body, counts)))
    assert np.allclose(result.end[-1], [0, 3, 0]) and not np.any(np.all(result.start == 0, axis=1))
    assert [each for each in caplog.messages if re.search(message, each)]


def test_many_bad_curves_are_named_in_one_sentence(scene, caplog):
    points = str([(k, 0, 0) for k in range(8)])
    assert scene(curves("float[] widths = [0.1]", str([1] * 8), points=points)).drawn == ()
    assert "has curves 0, 1, 2 and 5 more whose number of points is not 2 or more: skipped" in caplog.text


def test_a_piece_without_width_within_a_curve_is_skipped(scene, caplog):
    points = "[(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0)]"
    result = only(scene(curves("float[] widths = [0.1, 0, 0, 0.1]", "[4]", points=points)))
    assert result.start[:, 0].tolist() == [0, 2]
    assert "/B.widths holds 0 at both ends of 1 segments: they are skipped" in caplog.text


def test_counts_of_varying_values_agree_with_usd_where_it_answers():
    counts = np.array([7, 4])
    assert varying_counts(counts, "bezier", "nonperiodic").tolist() == [3, 2]
    assert varying_counts(counts, "bspline", "nonperiodic").tolist() == [5, 2]
    assert varying_counts(counts, "bspline", "periodic").tolist() == [7, 4]
    assert varying_counts(counts, "linear", "nonperiodic").tolist() == [7, 4]


# -- Guides ------------------------------------------------------------------------------------------------------------


def guided(targets, body=""):
    return f"""
    def BasisCurves "Bow" {{
        uniform token type = "cubic"
        uniform token basis = "bezier"
        int[] curveVertexCounts = [4]
        point3f[] points = [(1, 0, 0), (1, {CIRCLE}, 0), ({CIRCLE}, 1, 0), (0, 1, 0)]
        double3 xformOp:scale = (2, 2, 2)
        uniform token[] xformOpOrder = ["xformOp:scale"]
        {body}
    }}
    def BasisCurves "Point" {{
        uniform token type = "linear"
        int[] curveVertexCounts = [2]
        point3f[] points = [(1, 0, 0), (1, 0, 0)]
    }}
    def Scope "Else" {{
    }}
    def SphereLight "Lamp" (prepend apiSchemas = ["PhotonBeamsLightAPI"]) {{
        rel photonbeams:guides = {targets}
    }}"""


def test_a_lights_guides_are_read_as_points_along_them_and_are_nothing_else(scene, caplog):
    content = scene(guided("</Bow>"))
    (points,) = content.lights[0].guides
    assert np.allclose(np.linalg.norm(points, axis=1), 2, atol=2e-3) and len(points) > 30
    assert np.allclose(points[[0, -1]], [[2, 0, 0], [0, 2, 0]])
    assert content.drawn == () and "/Bow" not in caplog.text
    drawn = scene(guided("</Bow>", "float[] widths = [0.1]\ncolor3f[] photonbeams:power = [(1, 1, 1)]"))
    assert len(drawn.drawn) == 1 and len(drawn.lights[0].guides) == 1


@pytest.mark.parametrize(
    ("targets", "message"),
    [
        ("</Else>", r"/Lamp\.photonbeams:guides names /Else, a Scope"),
        ("</Point>", r"/Lamp\.photonbeams:guides names /Point, which has no curve"),
        ("</Gone>", r"/Lamp\.photonbeams:guides names /Gone"),
    ],
)
def test_guides_that_lead_nothing_are_errors(scene, targets, message):
    with pytest.raises(SceneError, match=message):
        scene(guided(targets))


# -- Bad input ---------------------------------------------------------------------------------------------------------


def test_segments_without_length_and_empty_curves_are_skipped_with_a_warning(scene, caplog):
    points = "[(0, 0, 0), (0, 0, 0), (0, 1, 0), (0, 3, 0)]"
    assert len(only(scene(curves("float[] widths = [0.1]", points=points))).start) == 1
    assert "/B has 1 segments without length: they are skipped" in caplog.text
    assert scene(curves("", "[]", points="[]")).drawn == ()
    assert "/B has no points: it is skipped" in caplog.text


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (curves("float[] widths = [0.1]", "[2, 3]"), r"/B\.curveVertexCounts sums to 5"),
        (curves("float[] widths = [0.1]", "[-1, 5]"), r"/B\.curveVertexCounts sums to 4: .* and no negative counts"),
        (curves(""), r"/B\.widths is empty"),
        (curves("float[] widths = [0.1, 0.2, 0.3]"), r"/B\.widths has 3 values .*"),
        (curves("float[] widths = [0.1, -0.2]"), r"/B\.widths holds -0\.2"),
        (curves("float[] widths = [nan]"), r"/B\.widths\[0\] is nan"),
        (
            curves("float[] widths = [0.1]\ncolor3f[] photonbeams:power = [(1, 1, 1), (1, 1, 1), (1, 1, 1)]"),
            r"/B\.photonbeams:power has 3 values",
        ),
        (
            curves("float[] widths = [0.1]\ncolor3f[] photonbeams:power = [(1, 1, 1), (1, -1, 1)]"),
            r"/B\.photonbeams:power\[1\] is .*",
        ),
    ],
)
def test_contradictions_are_errors_that_name_prim_and_attribute(scene, text, message):
    with pytest.raises(SceneError, match=rf"stage\.usda: {message}"):
        scene(text)


# -- Curve numbers -----------------------------------------------------------------------------------------------------


def two_bends(look=""):
    points = f"[(1, 0, 0), (1, {CIRCLE}, 0), ({CIRCLE}, 1, 0), (0, 1, 0), (2, 0, 0), (2, 1, 0), (1, 2, 0), (0, 2, 0)]"
    return f"""{look}
    def BasisCurves "B" {API} {{
        uniform token type = "cubic"
        uniform token basis = "bezier"
        int[] curveVertexCounts = [4, 4]
        point3f[] points = {points}
        float[] widths = [0.2] (interpolation = "constant")
    }}"""


def test_all_pieces_of_a_curve_have_the_curves_number(scene):
    result = only(scene(two_bends()))
    pieces = np.bincount(result.id.astype(int))
    assert len(pieces) == 2 and min(pieces) > 10
    assert np.array_equal(result.id, np.repeat([0, 1], pieces))
    points = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 1], [0, 1, 0], [0, 2, 0], [1, 2, 0]])
    assert pb.curved(points, 0.1, (1, 1, 1), [3, 3]).arrays()["id"].tolist() == [0, 0, 1, 1]


def test_a_look_that_asks_for_random_numbers_shows_no_joints(scene):
    beams = pb.Beams(**only(scene(two_bends())).arrays())
    turn = np.linspace(0.2, 1.3, 200)  # along the first curve, with far more rays than pieces
    origin = np.stack([np.cos(turn), np.sin(turn), np.full(200, 2.0)], axis=1)
    fog = pb.Medium((0.1, 0.1, 0.1))
    plain, random = (
        pb.estimate(beams, origin, (0, 0, -1), look=pb.Look(along=along), medium=fog).numpy()[:, 0]
        for along in (pb.looks.Constant(1), pb.looks.Expression("random"))
    )
    assert plain.min() > 0
    # The random number is the same over the whole curve, to the rounding of single precision: it does not change at
    # joints.
    assert np.ptp(random / plain) < 1e-5
    assert 0 < (random / plain)[0] < 1


# -- Writing -----------------------------------------------------------------------------------------------------------


@pytest.fixture
def beams(rng):
    start, end, power = rng.random((3, 50, 3))
    return DrawnBeams("/Beams", start, end, rng.random(50), rng.random(50), power, "key", id=np.arange(50.0))


def assert_same(result, beams):
    """Assert that beams are the same, to the rounding of single precision."""
    assert result.arrays().keys() == beams.arrays().keys()
    for name, value in beams.arrays().items():
        assert np.allclose(getattr(result, name), value, atol=1e-6), name


@pytest.mark.parametrize("name", ["beams.usda", "beams.usdc", "beams.usd"])
def test_beams_come_back_as_they_were_written(beams, tmp_path, name):
    write_beams(beams, tmp_path / name)
    result = only(read_scene(open_stage(tmp_path / name)))
    assert_same(result, beams)
    assert result.group == "key"
    assert [each.name for each in tmp_path.iterdir()] == [name]


def test_what_light_tracing_knows_of_beams_comes_back(beams, tmp_path, rng):
    normal, first, beside = rng.normal(size=(3, 50, 3))
    first, beside = (each / np.linalg.norm(each, axis=1, keepdims=True) for each in (first, beside))
    traced = replace(
        beams, offset=rng.random(50), total=3 + rng.random(50), entry=rng.random(50),
        end_normal=normal / np.linalg.norm(normal, axis=1, keepdims=True),
        start_normal=first, side=rng.normal(size=(50, 3)), side_normal=beside,
    )  # fmt: skip
    write_beams(traced, tmp_path / "beams.usda")
    assert_same(only(read_scene(open_stage(tmp_path / "beams.usda"))), traced)


@pytest.mark.parametrize(
    "colour", ["", 'color3f[] primvars:displayColor = [(1, 0, 0), (0, 0, 1)] (interpolation = "varying")']
)
@pytest.mark.parametrize("wrap", ["nonperiodic", "periodic"])
def test_joined_beams_stay_one_curve(scene, tmp_path, colour, wrap):
    body = f'float[] widths = [0.1]\nuniform token wrap = "{wrap}"\n' + 'uniform token basis = "bspline"\n'
    colour = (
        colour.replace("(0, 0, 1)", "(0, 0, 1), " * (3 if wrap == "periodic" else 1) + "(0, 1, 0)") if colour else ""
    )
    points = "[(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 1), (0, 0, 1)]"
    drawn = only(scene(curves(body + colour, "[5]", "cubic", points)))
    write_beams([drawn], tmp_path / "beams.usda")
    stage = open_stage(tmp_path / "beams.usda")
    assert list(stage.GetPrimAtPath("/Beams/B").GetAttribute("curveVertexCounts").Get()) == [len(drawn.start) + 1]
    result = only(read_scene(stage))
    if wrap == "periodic":  # the curve in the file is open: its ends meet, each perpendicular to its piece
        ends = {"start_tangent": drawn.start_tangent.copy(), "end_tangent": drawn.end_tangent.copy()}
        ends["start_tangent"][0], ends["end_tangent"][-1] = result.start_tangent[0], result.end_tangent[-1]
        drawn = replace(drawn, **ends)
    # Directions come from points in single precision, on pieces that are a few hundredths long.
    for name, value in drawn.arrays().items():
        assert np.allclose(getattr(result, name), value, atol=2e-5), name


def test_several_sets_have_prims_of_their_own(beams, tmp_path):
    sets = [replace(beams, name=name) for name in ("/World/Lamp", "/World/Lamp", "/World/2nd lamp")]
    write_beams(sets, tmp_path / "beams.usda")
    stage = open_stage(tmp_path / "beams.usda")
    names = [prim.GetName() for prim in stage.GetPrimAtPath("/Beams").GetChildren()]
    assert names == ["World_Lamp", "World_Lamp_2", "World_2nd_lamp"]
    assert stage.GetDefaultPrim().GetPath() == "/Beams"


def test_beams_that_cannot_be_written_leave_nothing_behind(beams, tmp_path):
    with pytest.raises(SceneError, match=r"cannot be written: expected a folder that is there"):
        write_beams(beams, tmp_path / "gone" / "beams.usda")
    with pytest.raises(SceneError, match=r"expected a name that ends in \.usd"):
        write_beams(beams, tmp_path / "beams.txt")
    assert list(tmp_path.iterdir()) == []
