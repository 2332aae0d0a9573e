"""Warnings about stages: they are given once, grouped and short, and what they name is left out."""

import re

import pytest

from photonbeams import Shot
from photonbeams.scene import SceneError
from photonbeams.scene.checks import LONGEST, printable
from photonbeams.usd.common.openusd import Tf, sentences_of
from photonbeams.usd.common.reading import Reading
from photonbeams.usd.common.warnings import Warnings
from photonbeams.usd.stage import open_stage, read_camera, read_scene


def test_many_warnings_of_a_kind_are_one_with_their_number(caplog):
    warnings = Warnings()
    with warnings.together():
        for number in range(91):
            warnings.give(f"/Hair{number} has {number + 1} curves without width: they are skipped", "a.usda")
        warnings.give("/Lamp.inputs:radius is 0", "a.usda")
        warnings.give("/Ball.radius is 0", "a.usda")
        assert not caplog.messages
    assert caplog.messages == [
        "a.usda: /Hair0 has 1 curves without width: they are skipped "
        "(and 90 more like this: /Hair1, /Hair2, /Hair3, …)",
        "a.usda: /Lamp.inputs:radius is 0",
        "a.usda: /Ball.radius is 0",
    ]
    warnings.give("/Hair7 has 8 curves without width: they are skipped", "a.usda")
    assert len(caplog.messages) == 3


def test_warnings_of_a_kind_about_one_prim_differ_by_their_numbers(caplog):
    warnings = Warnings()
    with warnings.together():
        for numbers in ("1002, 1003", "1002, 1011", "1003, 1012"):
            warnings.give(f"/T.file names tiles without {numbers}: black is used", "a.usda")
    text = "a.usda: /T.file names tiles without 1002, 1003: black is used (and 2 more like this: 1011, 1012)"
    assert caplog.messages == [text]


def test_what_is_used_instead_can_be_left_out_of_a_warning():
    warnings = Warnings(muted=True)
    warnings.give("/Look.expression: 'a; b' is wrong", "a.usda", "none is used")
    warnings.give("/Look.tint: is black; so are its beams", "a.usda")
    assert warnings.causes == {
        "a.usda: /Look.expression: 'a; b' is wrong; none is used": "a.usda: /Look.expression: 'a; b' is wrong"
    }
    assert len(warnings.given) == 2


def test_a_message_has_at_most_three_hundred_characters(caplog):
    warnings = Warnings()
    with warnings.together():
        for number in range(9):
            warnings.give(f"/{'A' * 200}{number} is skipped", "stage.usda")
        warnings.give("/B " + 400 * "b", "stage.usda")
    assert [len(each) <= LONGEST for each in caplog.messages] == [True, True]
    assert caplog.messages[0].endswith(" is skipped (and 8 more like this)")
    assert len(str(SceneError(200 * "a "))) == LONGEST


def test_what_fails_in_a_way_that_nobody_thought_of_is_left_out(usd, caplog):
    stage = usd('def Cube "C" {}')
    reading = Reading(stage)
    assert reading.attempt(stage.GetPrimAtPath("/C"), lambda: [][1], 7, "it is skipped") == 7
    assert caplog.messages[-1].endswith("stage.usda: /C cannot be read; it is skipped")


@pytest.mark.parametrize(
    ("prim", "warning"),
    [
        ("references = @ok.usda@</Nope>", "/A has a reference to @ok.usda@</Nope>, which has no such prim;"),
        ("references = @plain.usda@", "/A has a reference to @plain.usda@, which names no default prim;"),
        ("payload = @broken.usda@", "/A has a payload to @broken.usda@, which cannot be read (line 3: "),
        ("references = </A/B>", "/A refers to itself, directly or through others;"),
        ("references = @picture.jpg@", "/A has a reference to @picture.jpg@, but OpenUSD reads no *.jpg files"),
    ],
)
def test_what_cannot_be_composed_is_left_out_in_a_sentence_of_our_own(tmp_path, caplog, capfd, prim, warning):
    (tmp_path / "ok.usda").write_text('#usda 1.0\n(\ndefaultPrim = "R"\n)\ndef "R"\n{\n}\n')
    (tmp_path / "plain.usda").write_text('#usda 1.0\ndef "R"\n{\n}\n')
    (tmp_path / "broken.usda").write_text('#usda 1.0\ndef "R"\n{ what\n')
    (tmp_path / "picture.jpg").write_text("no picture")
    path = tmp_path / "stage.usda"
    path.write_text(f'#usda 1.0\ndef Xform "A" ({prim}\n)\n{{\n    def "B"\n    {{\n    }}\n}}\ndef Cube "C"\n{{\n}}\n')
    assert len(read_scene(open_stage(path)).meshes) == 1
    assert any(f"{path}: {warning}" in each for each in caplog.messages)
    assert capfd.readouterr().err == ""
    with pytest.raises(SceneError, match="stage"):
        open_stage(path, warnings=Warnings(strict=True))


BODY = """def Camera "Camera" {
}
def Mesh "Broken" {
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0)]
}
def Cube "Cube" {
    %s material:binding = %s
}
def SphereLight "Lamp" {
    %s photonbeams:portal = %s
    %s photonbeams:look = %s
    %s photonbeams:guides = %s
    asset photonbeams:gobo = @gone.exr@
}
def SphereLight "Dark" {
    float inputs:intensity = nan
}"""
ATTRIBUTES = ("token", '"a"') * 4
MISSING = ("rel", "</Gone>") * 4


@pytest.mark.parametrize("values", [ATTRIBUTES, MISSING])
def test_a_light_is_left_with_what_of_it_can_be_used(usd, caplog, values):
    stage = usd(BODY % values)
    content = read_scene(stage)
    assert [mesh.name for mesh in content.meshes] == ["/Cube"]
    (light,) = content.lights
    assert (light.name, light.portal, light.look, light.guides, light.gobo) == ("/Lamp", None, None, (), None)
    for end in ("has no portal", "physical look", "has no guides", "has no gobo", "grey is used", "it is skipped"):
        assert sum(end in each for each in caplog.messages) == (2 if end == "it is skipped" else 1)
    path = stage.GetRootLayer().realPath
    with pytest.raises(SceneError, match="/Broken"):
        Shot.open(path, strict=True).read()
    assert len(Shot.open(path).read()[0].lights) == 1


@pytest.mark.parametrize("kind", ["DomeLight", "RectLight"])
def test_a_light_without_its_texture_has_one_colour(usd, caplog, kind):
    (light,) = read_scene(usd(f'def {kind} "L" {{\nasset inputs:texture:file = @gone.exr@\n}}')).lights
    assert light.radiance == (1, 1, 1) and light.gobo is None and getattr(light, "image", None) is None
    assert caplog.messages[0].endswith("there is none; the light has one colour")


def test_a_relationship_that_is_declared_as_an_attribute_is_left_out(usd, caplog):
    stage = usd(
        """def Mesh "Cube" {
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
        token material:binding = "/Gone"
    }
    def SphereLight "Lamp" {
        token photonbeams:look = "/Gone"
        token photonbeams:portal = "/Gone"
        token photonbeams:guides = "/Gone"
    }
    def PointInstancer "Copies" {
        token prototypes = "/Cube"
        int[] protoIndices = [0]
        point3f[] positions = [(0, 0, 0)]
    }
    def Camera "Eye" {}
    def RenderSettings "Settings" { token camera = "/Gone" }
    """,
        'renderSettingsPrimPath = "/Settings"',
    )
    found = read_scene(stage)
    assert [mesh.name for mesh in found.meshes] == ["/Cube"]
    assert [light.name for light in found.lights] == ["/Lamp"]
    assert read_camera(stage).name == "/Eye"
    for name in ("material:binding", "photonbeams:look", "photonbeams:portal", "photonbeams:guides", "prototypes"):
        assert f".{name} is an attribute" in caplog.text


@pytest.mark.parametrize("depth", [1, 4, 12])
def test_the_reason_and_what_is_done_stand_beside_paths_of_any_length(tmp_path, caplog, depth):
    folder = tmp_path.joinpath(*[f"{'x' * 17}{number}" for number in range(depth)])
    folder.mkdir(parents=True)
    (folder / "sky.exr").write_bytes(b"\x76\x2f\x31\x01" + b"x" * 500)
    (folder / "a.usda").write_text('#usda 1.0\ndef DomeLight "Sky" {\n    asset inputs:texture:file = @sky.exr@\n}\n')
    read_scene(open_stage(folder / "a.usda"))
    (message,) = caplog.messages
    assert len(message) <= LONGEST - len("Warning: ")
    assert re.search(r"a\.usda: /Sky\.inputs:texture:file names \S+sky\.exr: expected an image that can be", message)
    assert "EXR_ERR_FILE_BAD_HEADER" in message
    assert message.endswith("; the light has one colour")


def test_openusd_prints_nothing_and_its_errors_are_told_without_places_in_its_source(tmp_path, capfd):
    (tmp_path / "a.usda").write_text('#usda 1.0\ndef Camera "C" (\n    color3f = 1\n) {\n}\ndef Sphere "S" {\n}\n')
    shot = Shot(open_stage(tmp_path / "a.usda"))
    shot.subject.digest(shot.viewpoint, None)
    assert "stage.cpp" not in capfd.readouterr().err
    error = Tf.ErrorException("\n\tError in 'pxr::Set' at line 3 in file /build/pxr/a.cpp : 'It is wrong'")
    assert sentences_of(error) == ["It is wrong"]


def test_control_characters_of_names_reach_no_terminal():
    """A terminal would take them as commands: to clear itself, to change its title, to turn text around."""
    assert printable("a\x1b[31mb\x9b2J\x07\x7f\u202ec\rd\u00e9") == r"a\x1b[31mb\x9b2J\x07\x7f\u202ec\rdé"
    assert str(SceneError("a\x1b]0;b\x07.usda: expected a stage")) == r"a\x1b]0;b\x07.usda: expected a stage"
