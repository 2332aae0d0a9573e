"""`photonbeams swatch`: a picture of a look."""

from pathlib import Path

import numpy as np
import pytest

import photonbeams as pb
from photonbeams.cli import main
from photonbeams.images.files import read_parts
from photonbeams.images.swatches import FOG, Specimen, cross_section, curves, from_the_side

LIBRARY = Path(__file__).resolve().parents[2] / "examples" / "looks" / "looks.usda"
STAGE = """#usda 1.0
def PhotonBeamsLook "One" {
    color3f photonbeams:along:tint = (1, 0.5, 0)
}
def PhotonBeamsLook "Two" {
    string photonbeams:along:expression = "wave(5 * s - time)"
}
"""


def run(capsys, *arguments):
    with pytest.raises(SystemExit) as ended:
        main(["swatch", *map(str, arguments)])
    captured = capsys.readouterr()
    return ended.value.code, captured.out.strip(), captured.err.strip()


@pytest.fixture
def stage(tmp_path):
    path = tmp_path / "looks.usda"
    path.write_text(STAGE)
    return path


def pixels(path):
    return read_parts(path)[0].pixels


def test_each_look_is_drawn_in_a_row_of_its_own(capsys, stage, tmp_path):
    both, one = tmp_path / "both.png", tmp_path / "one.png"
    assert run(capsys, stage, "-o", both) == (0, f"Wrote {both}", "")
    assert run(capsys, stage, "--look", "One", "-o", one) == (0, f"Wrote {one}", "")
    assert pixels(both).shape[0] == pytest.approx(2 * pixels(one).shape[0], abs=1)
    # /One comes first, and its row does not depend on the rows below.
    rows = pixels(one).shape[0] // 2
    assert np.abs(pixels(both)[:rows] - pixels(one)[:rows]).max() < 0.02


def test_values_layers_and_frames_change_the_picture(capsys, stage, tmp_path):
    layer = tmp_path / "over.usda"
    layer.write_text('#usda 1.0\nover "One" {\ncolor3f photonbeams:along:tint = (0, 0, 1)\n}\n')
    pictures = []
    for number, flags in enumerate(
        (
            ("--look", "One"),
            ("--look", "One", "--set", "/One.photonbeams:along:tint=(0,0,1)"),
            ("--look", "/One", "--session-layer", layer),
            ("--look", "Two"),
            ("--look", "Two", "-f", "12"),  # half a second: half a wave
            ("--look", "Two", "-f", "24"),
        )
    ):
        path = tmp_path / f"{number}.png"
        assert run(capsys, stage, "-o", path, *flags)[0] == 0
        pictures.append(pixels(path))
    assert np.abs(pictures[0] - pictures[1]).max() > 0.2
    assert np.array_equal(pictures[1], pictures[2])
    assert np.abs(pictures[3] - pictures[4]).max() > 0.2
    assert np.abs(pictures[3] - pictures[5]).max() < 0.05


def test_the_library_is_drawn(capsys, tmp_path):
    assert run(capsys, LIBRARY, "-o", tmp_path / "a.png")[0] == 0
    assert pixels(tmp_path / "a.png").shape[1] == 1200


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (("STAGE", "-o", "a.exr"), 2, "a.exr is not the name of a picture: expected FILE.png"),
        (
            ("STAGE", "-o", "a.png", "--look", "Three"),
            1,
            "has no look Three: expected one of its PhotonBeamsLook prims, /O",
        ),
        (
            ("STAGE", "-o", "a.png", "--radius", "0", "0"),
            2,
            "--radius is 0 0: expected radii of at least 0 that are not both 0",
        ),
        (
            ("STAGE", "-o", "a.png", "--set", '/Two.photonbeams:along:expression="1 - q"'),
            1,
            "along:expression is wrong: ",
        ),
        (("STAGE", "-o", "a.png", "-f", "nan"), 1, "Error: frame is nan: expected a finite number"),
        (("STAGE", "-o", "a.png", "-f", "1e308"), 1, "Error: a context's frame is 1e+308: expected a finite number"),
        (("STAGE", "-o", "a.png", "--radius", "1e30", "1e-30"), 1, "Error: the length of a look's beams is inf: "),
        (("nothing.usda", "-o", "a.png"), 1, "nothing.usda: expected a USD stage, but there is no such file"),
    ],
)
def test_what_cannot_be_drawn_is_told(capsys, stage, tmp_path, monkeypatch, arguments, code, message):
    monkeypatch.chdir(tmp_path)
    found, _, error = run(capsys, *(stage if each == "STAGE" else each for each in arguments))
    assert found == code and message in error and "Traceback" not in error
    assert list(tmp_path.iterdir()) == [stage]


def test_a_stage_without_looks_says_so(capsys, tmp_path):
    (tmp_path / "a.usda").write_text("#usda 1.0\n")
    code, _, error = run(capsys, tmp_path / "a.usda", "-o", tmp_path / "a.png")
    assert code == 1 and "has no look: expected a PhotonBeamsLook prim" in error


def test_pictures_and_curves_show_the_look():
    look = pb.Look(
        along=pb.looks.ColorRamp([0, 1], [[1, 0, 0], [0, 0, 1]]), across=pb.looks.Hollow(0.6), eye=1.0, angle=1.0
    )
    specimen = Specimen()
    side = from_the_side(look, specimen, 120, 40)
    left, right = side[15:25, 15], side[15:25, -15]
    assert np.all(left[:, 0] > 2 * left[:, 2]) and np.all(right[:, 2] > 2 * right[:, 0])
    assert not side[:, 0].any()  # left of the light
    section = cross_section(look, specimen, 60)
    assert not section[28:32, 28:32].any() and section[28:32, 5:14].max() > 0.1
    along, across, eye, angle = (values for _, _, values, _ in curves(specimen.bind(look), specimen))
    np.testing.assert_allclose(along[[0, 2]], [np.linspace(1, 0, 513), np.linspace(0, 1, 513)], atol=1e-5)
    assert not across[:, :300].any() and across[:, 400].min() > 0.5
    assert np.all(eye == 1) and np.all(angle == 1)
    assert FOG.extinction[2] > FOG.extinction[0]


def test_an_empty_value_clears_an_expression(capsys, stage, tmp_path):
    pictures = []
    for number, value in enumerate(("", "1")):
        path = tmp_path / f"{number}.png"
        flags = ("--look", "Two", "--set", f"/Two.photonbeams:along:expression={value}")
        assert run(capsys, stage, "-o", path, *flags)[0] == 0
        pictures.append(pixels(path))
    assert np.array_equal(*pictures)
