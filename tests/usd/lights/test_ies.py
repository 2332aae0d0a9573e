"""IES profiles of lights: parsing of LM-63 files, angles as in UsdLux and hdEmbree, and the mean of a profile."""

import os

import numpy as np
import pytest

from photonbeams.numerics.arrays import to_vectors
from photonbeams.runtime.device import Array2f
from photonbeams.usd.lights.ies import parse
from photonbeams.world.emitters.build import lamp_of
from photonbeams.world.emitters.gobos import projected

HEAD = "IESNA:LM-63-2002\n[TEST] none\nTILT=NONE\n"


# `rows` holds candela: a row for each horizontal angle, a column for each vertical one. `kind` is the photometric type.
def file(horizontal, rows, kind=1, vertical=(0, 45, 90), factor=1.0, head=HEAD):
    numbers = [1, -1, factor, len(vertical), len(horizontal), kind, 2, 0, 0, 0, 1, 1, 50, *vertical, *horizontal]
    return head + "\n".join(str(each) for each in [*numbers, *np.ravel(rows)])


def at(profile, theta, phi):
    return float(profile.at(theta, phi))


def test_one_horizontal_angle_is_the_same_all_around():
    profile = parse(file([0], [[4, 2, 0]], factor=2.5))
    assert [at(profile, theta, phi) for theta, phi in ((0, 10), (45, 200), (22.5, 300), (91, 0))] == [10, 5, 7.5, 0]


def test_a_quarter_and_a_half_are_mirrored():
    quarter = parse(file([0, 90], [[4, 2, 0], [4, 1, 0]]))
    assert [at(quarter, 45, phi) for phi in (0, 90, 180, 270, 45, 225)] == [2, 1, 2, 1, 1.5, 1.5]
    half = parse(file([0, 90, 180], [[4, 2, 0], [4, 1, 0], [4, 3, 0]]))
    assert [at(half, 45, phi) for phi in (0, 90, 180, 270, 135, 225)] == [2, 1, 3, 1, 2, 2]
    other = parse(file([90, 180, 270], [[4, 2, 0], [4, 1, 0], [4, 3, 0]]))
    assert [at(other, 45, phi) for phi in (90, 180, 270, 0, 45, 135)] == [2, 1, 3, 1, 1.5, 1.5]
    coarse = parse(file([90, 150, 270], [[4, 2, 0], [4, 1, 0], [4, 5, 0]]))  # neither 0 nor 180 is among the angles
    assert [at(coarse, 45, phi) for phi in (90, 150, 270, 30, 180, 0, 300)] == pytest.approx([2, 1, 5, 1, 2, 2, 4])


def test_a_circle_may_lack_its_last_angle():
    profile = parse(file([0, 120, 240], [[0, 1, 0], [0, 2, 0], [0, 3, 0]]))
    assert [at(profile, 45, phi) for phi in (0, 120, 240, 300)] == [1, 2, 3, 2]


def test_tilt_is_read_past_and_words_may_be_separated_by_commas():
    tilted = file([0], [[4, 2, 0]], head="IESNA91\nTILT=INCLUDE\n1\n3\n0 45 90\n1.0 0.9 0.8\n")
    assert at(parse(tilted.replace("\n0\n", ", 0,\n")), 45, 0) == 2


@pytest.mark.parametrize("end", ["\r", "\r\n", "\n\r"])
def test_lines_end_as_on_any_system(end):
    text = file([0], [[4, 2, 0]], head="IESNA91\n[TEST] none\nTILT=INCLUDE\n1\n3\n0 45 90\n1.0 0.9 0.8\n", factor=2.5)
    assert np.array_equal(parse(text.replace("\n", end)).intensity, parse(text).intensity)


@pytest.mark.parametrize("factor", [1.0, 2.5])
def test_decimal_commas_are_read_and_told_from_commas_between_numbers(factor):
    text = file([0, 90.5], [[4.5, 2, 0], [4, 1.25, 0.5]], vertical=(0, 22.5, 90), factor=factor)
    head, numbers = text.split("TILT=NONE\n")
    right = parse(text)
    for written in (numbers.replace(".", ","), numbers.replace("\n", ","), numbers.replace("\n", " , ")):
        found = parse(f"{head}TILT = none\r\n{written}\r\n\x1a")
        for name in ("vertical", "horizontal", "intensity"):
            assert np.array_equal(getattr(found, name), getattr(right, name))


@pytest.mark.parametrize(
    ("head", "factor"),
    [
        ("IES:LM-63-2019", 1), ("IESNA:LM-63-2002", 1), ("IESNA:LM-63-1995", 1), ("IESNA:LM-63-1991", 1.1),
        ("IESNA91", 1.1), ("any words", 1.1), ("\xef\xbb\xbfIES:LM-63-2019", 1), ("iesna: LM-63-2002", 1),
    ],
)  # fmt: skip
def test_the_twelfth_number_is_a_factor_until_1995_alone(head, factor):
    """In 2019, 1.1 says that a laboratory measured the file; the ballast factor before it always counts."""
    text = file([0], [[4, 2, 0]], head=f"{head}\nTILT=NONE\n").replace("1\n1\n50\n", "0.5\n1.1\n50\n")
    assert at(parse(text), 0, 0) == pytest.approx(4 * 0.5 * factor)


def test_types_a_and_b_have_their_polar_axis_along_the_light():
    ahead = [[0, 1, 0], [0, 8, 0], [0, 1, 0]]  # brightest straight ahead, where both angles are 0
    for kind, phi in ((2, 90), (3, 180)):
        profile = parse(file([-90, 0, 90], ahead, kind, vertical=(-90, 0, 90)))
        assert at(profile, 90, phi) == 8
        assert at(profile, 90, phi + 180) == 0  # there is no light behind


def test_the_mean_is_that_of_the_hemisphere_or_the_sphere():
    for vertical in (np.arange(0, 91, 2.0), np.arange(0, 181, 2.0)):
        profile = parse(file([0], np.full((1, len(vertical)), 7.0), vertical=vertical)).normalized()
        assert at(profile, 30, 0) == pytest.approx(1, rel=1e-4)  # the midpoint rule errs on patches two degrees high
    lobe = parse(file([0], np.cos(np.radians(np.arange(91.0)))[None], vertical=np.arange(91.0))).normalized()
    assert at(lobe, 0, 0) == pytest.approx(2, rel=1e-3)  # the mean of cos θ over a hemisphere is one half


@pytest.mark.parametrize(
    ("scale", "theta", "inside"),
    [
        (0, 50, 50), (0.5, 20, 40), (2.0, 80, 40), (-0.5, 160, 140), (-2.0, 20, 100), (1.0, 70, 70), (-1.0, 70, 70),
        # What a narrower profile leaves over has its last value, if it is scaled from below, and is dark if from above.
        (0.5, 91, 180), (0.5, 170, 180), (0.25, 60, 180), (-0.5, 89, -1), (-0.5, 10, -1),
    ],
)  # fmt: skip
def test_the_angle_scale_is_that_of_hdembree(scale, theta, inside):
    profile = parse(file([0], 1 + np.arange(181.0)[None], vertical=np.arange(181.0)))
    scaled = type(profile)(profile.vertical, profile.horizontal, profile.intensity, scale)
    assert at(scaled, theta, 0) == pytest.approx(1 + inside)


def test_a_scaled_profile_that_ends_early_has_its_last_value_beyond_180_degrees():
    """hdEmbree takes the last value for angles of 180 degrees and more, and none for those between."""
    half = parse(file([0], [[4, 2, 1]]))
    scaled = type(half)(half.vertical, half.horizontal, half.intensity, 0.5)
    assert [at(scaled, theta, 0) for theta in (0, 22.5, 44.9, 50, 89, 91, 180)] == pytest.approx(
        [4, 2, 1, 0, 0, 1, 1], abs=0.01
    )
    assert at(half, 180, 0) == 0


def test_the_table_has_the_profile():
    profile = parse(file([0, 90, 180], [[4, 2, 0], [4, 1, 0], [4, 3, 0]]))
    table = profile.image[..., 0]
    theta, phi = np.append(np.linspace(0, 180, len(table) - 1), 90), np.linspace(0, 360, table.shape[1])
    assert np.allclose(table, profile.at(theta[:, None], phi))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "it has no line TILT="),
        (HEAD + "1 2 3", "it ends after 3 numbers"),
        (file([0], [[4, 2]]), "it ends after 19 numbers"),
        (file([0], [[4, -2, 0]]), "negative"),
        (file([0], [[4, 2, 0]], vertical=(0, 90, 45)), "do not ascend"),
        (file([0], [[4, 2, 0]], kind=7), "its photometric type is 7"),
        (file([10, 80], [[4, 2, 0], [4, 2, 0]]), "its horizontal angles go from 10 to 80"),
        (HEAD + "1 1 1 0 1 1", "it has 0 vertical angles"),
        (HEAD + "one two three", "it has 'one' where a number is expected"),
        (file([0], [[4, 2, 0]]) + " 7 8", "it has 2 more numbers than 3 vertical and 1 horizontal angles need"),
    ],
)  # fmt: skip
def test_what_is_no_profile_is_named(text, message):
    with pytest.raises(ValueError, match=message):
        parse(text)


def test_a_light_reads_its_profile_and_shines_without_one_that_is_not_there(scene, tmp_path, caplog):
    (tmp_path / "good.ies").write_text(file([0], [[4, 2, 0]]))
    (tmp_path / "bad.ies").write_text("nothing")
    body = 'def SphereLight "{0}" {{\n asset inputs:shaping:ies:file = @{1}/{0}.ies@\n{2}\n}}\n'
    more = "float inputs:shaping:ies:angleScale = 0.5\nbool inputs:shaping:ies:normalize = 1"
    text = "".join(body.format(name, tmp_path, more) for name in ("good", "bad", "none"))
    good, bad, none = (light.shaping.profile for light in scene(text).lights)
    assert good.angle_scale == 0.5
    assert (bad, none) == (None, None)
    assert "bad.ies, which is not an IES profile (it has no line TILT=): the light shines without it" in caplog.text
    assert "none.ies, which is not there: the light shines without its IES profile" in caplog.text


def test_the_cone_and_the_profile_are_multiplied(scene, tmp_path):
    """A profile of 4 candela at 0 and 2 from 45 degrees on, under the schema's cone of 90 degrees and two others."""
    (tmp_path / "a.ies").write_text(file([0], [[4, 2, 2]], vertical=(0, 45, 180)))
    found = {}
    for cone in ("", "float inputs:shaping:cone:angle = 30", "float inputs:shaping:cone:angle = 180"):
        body = f"bool treatAsPoint = 1\nfloat inputs:radius = 0\nasset inputs:shaping:ies:file = @{tmp_path}/a.ies@"
        body += f"\n{cone}"
        (lamp,) = scene(f'def SphereLight "L" (prepend apiSchemas = ["ShapingAPI"]) {{\n{body}\n}}').lights
        lit = projected(lamp_of(lamp), lamp, None, {})
        towards = np.array([[0, 0, -1], [np.sin(0.5), 0, -np.cos(0.5)], [1, 0, -1], [1, 0, 0.1]])
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        # Of the points on a sphere around the lamp; without the point's 1/4 for its normalized intensity.
        found[cone] = 4 * lit.illuminate(to_vectors(towards), Array2f(0.5, 0.5)).weight.numpy()[0]
    at_28 = 4 - 2 * np.degrees(0.5) / 45
    for cone, expected in zip(found, ([4, at_28, 2, 0], [4, at_28, 0, 0], [4, at_28, 2, 2]), strict=True):
        assert found[cone] == pytest.approx(expected, abs=2e-3), cone


def test_a_light_shines_without_a_profile_that_cannot_be_read(scene, tmp_path, caplog):
    os.mkfifo(tmp_path / "pipe.ies")
    with open(tmp_path / "huge.ies", "wb") as sparse:
        sparse.truncate(1 << 40)
    (tmp_path / "empty.ies").touch()
    (tmp_path / "infinite.ies").write_text(file([0], [[4, 2, 0]]).replace("4\n", "inf\n"))
    problems = {
        "pipe.ies": "it is a named pipe", "huge.ies": "it has 1,024 GiB: expected up to 16 MiB",
        "empty.ies": "it is empty", "infinite.ies": "it has numbers that are not finite",
    }  # fmt: skip
    for name, problem in problems.items():
        asset = f"asset inputs:shaping:ies:file = @{tmp_path / name}@"
        scene(f'def SphereLight "A" (prepend apiSchemas = ["ShapingAPI"]) {{\n {asset} }}')
        assert f"{name}, which is not an IES profile ({problem}" in caplog.text
