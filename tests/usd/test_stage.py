"""Opening of stages, and the messages about those that cannot be opened."""

import os
import re

import OpenImageIO
import pytest
from pxr import Usd

from photonbeams.scene import SceneError
from photonbeams.usd.common.warnings import Warnings
from photonbeams.usd.stage import default_time, extent_varies, open_stage, read_scene, sample_times

LAMP = """#usda 1.0
def SphereLight "Lamp" {
    float inputs:intensity = 3
    color3f inputs:color = (1, 1, 1)
}
def Scope "Dust" {
}
"""


def written(folder, text, name="stage.usda"):
    path = folder / name
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("hello", "is not a valid usda layer"),
        ("", "it is empty"),
        ('#usda 1.0\ndef Xform "A" {', r"cannot be read: line 2: Expected }"),
        (
            '#usda 1.0\ndef Xform "A" {\n    int photonbeams:count = 10000000000\n}',
            r"line 3: .*</A\.photonbeams:count>",
        ),
    ],
)
def test_a_broken_stage_is_one_sentence_with_its_line(tmp_path, capfd, text, message):
    path = written(tmp_path, text)
    with pytest.raises(SceneError, match=message) as error:
        open_stage(path)
    assert str(error.value).startswith(str(path))
    assert "\n" not in str(error.value)
    assert "pxrInternal" not in str(error.value)
    assert capfd.readouterr().err == ""


def test_a_missing_stage_is_named(tmp_path):
    with pytest.raises(SceneError, match=r"missing\.usda"):
        open_stage(tmp_path / "missing.usda")


def test_a_folder_or_another_file_is_no_stage(tmp_path):
    with pytest.raises(SceneError, match="is not a USD stage"):
        open_stage(tmp_path)
    with pytest.raises(SceneError, match=r"readme\.txt is not a USD stage"):
        open_stage(written(tmp_path, "text", "readme.txt"))


@pytest.mark.parametrize("name", ["stage.usdc", "stage.usdz", "stage.usd"])
def test_a_broken_binary_stage_is_one_sentence(tmp_path, name):
    with pytest.raises(SceneError, match=rf"{re.escape(name)} cannot be read: ") as error:
        open_stage(written(tmp_path, "PXR-USDC but cut off", name))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "text",
    [
        "#usda 1.0\n(\n    subLayers = [@./gone.usda@]\n)\n",
        '#usda 1.0\ndef Xform "A" (\n    references = @./gone.usda@\n) {\n}\n',
        '#usda 1.0\ndef Xform "A" (\n    payload = @./gone.usda@\n) {\n}\n',
    ],
)
def test_a_layer_that_is_not_there_is_a_warning_or_an_error_that_names_it(tmp_path, capfd, caplog, text):
    path = written(tmp_path, text)
    open_stage(path)
    (warning,) = caplog.messages
    assert re.search(r"gone\.usda@, which is not there; it is left out$", warning)
    with pytest.raises(SceneError, match=re.escape(warning)):
        open_stage(path, warnings=Warnings(strict=True))
    assert capfd.readouterr().err == ""


def test_a_file_in_a_format_of_another_build_is_warned_of(tmp_path, caplog):
    (tmp_path / "gold.abc").write_text("Alembic, which is another plug-in's")
    path = written(tmp_path, LAMP + 'def Scope "Looks" (\n    references = @./gold.abc@\n) {\n}\n')
    assert len(read_scene(open_stage(path)).lights) == 1
    assert "OpenUSD reads no *.abc files here" in caplog.text


def test_values_can_be_set_over_the_stage(tmp_path):
    path = written(tmp_path, LAMP)
    stage = open_stage(
        path,
        overrides=[
            "/Lamp.inputs:intensity=5",
            "/Lamp.inputs:color=0.5",
            "/Lamp.photonbeams:lightGroup=key",
            "/Dust.photonbeams:scattering=(0.1, 0.2, 0.3)",
            "/Dust.photonbeams:absorption=0.1,0.2,0.3",
        ],
    )
    result = read_scene(stage)
    assert result.lights[0].radiance == (2.5, 2.5, 2.5)
    assert result.lights[0].group == "key"
    assert result.medium.scattering == pytest.approx((0.1, 0.2, 0.3))
    assert result.medium.absorption == pytest.approx((0.1, 0.2, 0.3))
    assert path.read_text() == LAMP


def test_what_an_artist_sets_per_light_can_be_set_over_the_stage(tmp_path):
    look = 'def PhotonBeamsLook "Soft" {\n    uniform token photonbeams:across:profile = "biweight"\n}\n'
    path = written(tmp_path, LAMP + look)
    OpenImageIO.ImageBuf(OpenImageIO.ImageSpec(2, 1, 3, "float")).write(str(tmp_path / "black.exr"))
    values = {
        "photonbeams:intensity": 3, "photonbeams:lightGroup": "key", "photonbeams:look": "/Soft",
        "photonbeams:gobo": "black.exr", "photonbeams:gobo:angle": 30, "photonbeams:gobo:wrap": "repeat",
        "photonbeams:count": 7, "collection:shadowLink:excludes": "</Dust>, </Soft>",
    }  # fmt: skip
    stage = open_stage(path, overrides=[f"/Lamp.{name}={value}" for name, value in values.items()])
    (light,) = read_scene(stage).lights
    assert (light.beam_scale, light.group, light.beam_count, light.emits_beams) == (3, "key", 7, True)
    assert light.look.name == "/Soft"
    assert (light.gobo.image.shape, light.gobo.angle, light.gobo.repeat) == ((1, 2, 3), 30, True)
    targets = stage.GetPrimAtPath("/Lamp").GetRelationship("collection:shadowLink:excludes").GetTargets()
    assert [str(target) for target in targets] == ["/Dust", "/Soft"]
    off = open_stage(path, overrides=["/Lamp.photonbeams:look=/Soft", "/Lamp.photonbeams:look=",
                                      "/Lamp.photonbeams:enabled=0"])  # fmt: skip
    assert (read_scene(off).lights[0].look, read_scene(off).lights[0].emits_beams) == (None, False)
    fog = "/Dust.photonbeams:scattering=0.1"
    dark = open_stage(path, overrides=[fog, "/Lamp.collection:lightLink:excludes=/Dust"])
    assert not read_scene(dark).lights[0].emits_beams


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("/Lamp.inputs:intensity", r"expected /prim\.attribute=value"),
        ("Lamp=3", r"expected /prim\.attribute=value"),
        ("/Lamp.inputs:intensity=bright", "expected a value of type float"),
        ("/Lamp.inputs:brightness=3", "/Lamp has no attribute inputs:brightness"),
        ("/Dust.photonbeams:intensity=2", "/Dust has no attribute photonbeams:intensity"),
        ("/Torch.inputs:intensity=3", "has no prim /Torch"),
        ("/Lamp.photonbeams:look=Soft", "expected the paths of prims"),
        ("/Lamp.photonbeams:portal=/Dust,no path", "expected the paths of prims"),
    ],
)
def test_a_value_that_cannot_be_set_is_an_error(tmp_path, capfd, text, message):
    with pytest.raises(SceneError, match=f"cannot set '{re.escape(text)}'.*{message}"):
        open_stage(written(tmp_path, LAMP), overrides=[text])
    assert capfd.readouterr().err == ""


INSTANCES = """#usda 1.0
class Xform "Rig"
{
    def SphereLight "Lamp"
    {
    }
}
def Xform "A" (
    instanceable = true
    %s
)
{
}
"""


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("inherits = </Rig>", "/Rig/Lamp, which all its instances repeat"),
        ("references = @rig.usda@</Rig>", "a prim outside of instances"),
    ],
)
@pytest.mark.parametrize("value", ["inputs:intensity=3", "photonbeams:look=/Soft"])
def test_a_value_inside_an_instance_is_refused_with_what_can_be_set(tmp_path, capfd, value, source, expected):
    text = f"/A/Lamp.{value}"
    (tmp_path / "rig.usda").write_text('#usda 1.0\ndef Xform "Rig"\n{\n    def SphereLight "Lamp"\n    {\n    }\n}\n')
    path = written(tmp_path, INSTANCES % source)
    with pytest.raises(SceneError) as error:
        open_stage(path, overrides=[text])
    assert str(error.value) == f"cannot set '{text}': /A/Lamp is inside the instance /A: expected {expected}"
    assert capfd.readouterr().err == ""


def test_session_layers_are_stronger_than_the_stage_and_the_first_the_strongest(tmp_path):
    layers = [
        written(tmp_path, f'#usda 1.0\nover "Lamp" {{\n    float inputs:intensity = {value}\n}}\n', f"over{value}.usda")
        for value in (7, 8)
    ]
    stage = open_stage(written(tmp_path, LAMP), session_layers=[*layers, layers[0]])  # one twice, too
    assert read_scene(stage).lights[0].radiance == (7, 7, 7)
    with pytest.raises(SceneError, match=r"gone\.usda"):
        open_stage(written(tmp_path, LAMP), session_layers=[tmp_path / "gone.usda"])


def test_payloads_are_loaded(tmp_path):
    written(tmp_path, LAMP, "lamp.usda")
    text = '#usda 1.0\ndef "A" (\n    payload = @./lamp.usda@</Lamp>\n) {\n}\n'
    assert [light.name for light in read_scene(open_stage(written(tmp_path, text))).lights] == ["/A"]


def test_the_default_time_is_the_start_of_the_stage_if_it_has_one(usd):
    assert default_time(usd("", "startTimeCode = 101\nendTimeCode = 130")) == Usd.TimeCode(101)
    assert default_time(usd("")).IsDefault()


def test_an_empty_stage_is_an_empty_scene(scene):
    result = scene("")
    assert (result.meshes, result.lights, result.drawn, result.medium) == ((), (), (), None)


def test_a_transform_that_is_not_finite_is_an_error(scene):
    text = """def Cube "C" {
        double3 xformOp:translate = (nan, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }"""
    with pytest.raises(SceneError, match=r"stage\.usda: /C has a transform that is not finite"):
        scene(text)


@pytest.mark.parametrize(
    ("varying", "expected"),
    [
        ("", False),
        ('over "Camera" {\n    double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 2: (1, 0, 0) }\n}', False),
        ('over "Lamp" {\n    float inputs:intensity.timeSamples = { 1: 1, 2: 2 }\n}', False),
        ('over "Lamp" {\n    float photonbeams:intensity.timeSamples = { 1: 1, 2: 2 }\n}', False),
        ('over "Lamp" {\n    float inputs:radius.timeSamples = { 1: 1, 2: 2 }\n}', True),
        ('over "Group" {\n    double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 2: (1, 0, 0) }\n}', True),
        ('over "Grid" {\n    asset filePath.timeSamples = { 1: @1.vdb@, 2: @2.vdb@ }\n}', True),
        ('over "Group" {\n    over "Ball" {\n    double radius.timeSamples = { 1: 1, 2: 2 }\n    }\n}', True),
    ],
)
def test_an_extent_varies_with_what_has_one(tmp_path, varying, expected):
    path = tmp_path / "a.usda"
    path.write_text(
        '#usda 1.0\ndef Camera "Camera" {\n}\ndef SphereLight "Lamp" {\n}\ndef OpenVDBAsset "Grid" {\n}\n'
        'def Xform "Group" {\n    def Sphere "Ball" {\n    }\n}\n'
    )
    layer = tmp_path / "b.usda"
    layer.write_text(f"#usda 1.0\n{varying}\n")
    assert extent_varies(open_stage(path, [layer])) == expected


SPLINE = """#usda 1.0
def Xform "Rig" {
    double xformOp:translateX.spline = {
        bezier,
        %s
        1: 0; post curve (2.0, 5.0),
        11: 10; pre (2.0, 5.0),
    }
    uniform token[] xformOpOrder = ["xformOp:translateX"]
    def Sphere "Ball" {
    }
}
"""
RANGE = "#usda 1.0\n(\n    startTimeCode = %g\n    endTimeCode = %g\n    subLayers = [@spline.usda@%s]\n)\n"


@pytest.mark.parametrize(
    ("extrapolation", "top", "times"),
    [
        ("", "#usda 1.0\n(\n    subLayers = [@spline.usda@]\n)\n", [1, 3.5, 6, 8.5, 11]),
        ("post: linear,", RANGE % (1, 31, ""), [1, 3.5, 6, 8.5, 11, 16, 21, 26, 31]),
        ("", RANGE % (5, 27, " (offset = 5; scale = 2)"), [5, 5.5, 6, 6.5, 7, 12, 17, 22, 27]),
        ("post: loop repeat,", RANGE % (1, 21, ""), [1, 3.5, 6, 8.5, 11, 13.5, 16, 18.5, 21]),
        ("post: loop repeat,", RANGE % (1, 19, ""), [1, 3.5, 6, 8.5, 11, 13, 15, 17, 19]),
    ],
)
def test_splines_are_looked_at_at_their_knots_and_between_and_to_the_stages_ends(tmp_path, extrapolation, top, times):
    written(tmp_path, SPLINE % extrapolation, "spline.usda")
    stage = open_stage(written(tmp_path, top))
    assert sample_times(stage, 33) == times
    assert sample_times(stage, 3) == [times[0], times[len(times) // 2], times[-1]]
    assert extent_varies(stage)


def test_a_layer_that_was_written_again_is_read_again(tmp_path):
    path = tmp_path / "a.usda"
    for radius in (1, 2):
        path.write_text(f'#usda 1.0\ndef SphereLight "Lamp" {{\n    float inputs:radius = {radius}\n}}\n')
        stamp = 1_000_000_000 * radius
        os.utime(path, (stamp, stamp))
        assert open_stage(path).GetPrimAtPath("/Lamp").GetAttribute("inputs:radius").Get() == radius


@pytest.mark.parametrize("value", ["2.5", "many", ""])
def test_a_whole_number_is_not_rounded(tmp_path, value):
    path = tmp_path / "a.usda"
    path.write_text('#usda 1.0\ndef SphereLight "Lamp" {\n}\n')
    with pytest.raises(SceneError, match=f"cannot set '/Lamp.photonbeams:count={value}'"):
        open_stage(path, overrides=[f"/Lamp.photonbeams:count={value}"])


def test_bytes_that_are_no_text_are_a_sentence(tmp_path, capfd):
    path = tmp_path / "stage.usda"
    path.write_bytes(b'#usda 1.0\n(\n doc = "\xff"\n x\n)\n')
    with pytest.raises(SceneError, match=r"line 3: there is more than expected; expected UTF-8"):
        open_stage(path)
    assert capfd.readouterr().err == ""


def test_a_time_sample_at_nan_is_no_motion(tmp_path):
    path = written(tmp_path, '#usda 1.0\ndef Sphere "A"\n{\n    double radius.timeSamples = { nan: 2 }\n}\n')
    stage = open_stage(path)
    assert sample_times(stage, 8) == [] and len(read_scene(stage, default_time(stage)).meshes) <= 1


class Named:
    """A path of somebody else's kind."""

    def __init__(self, path):
        self.path = path

    def __fspath__(self):
        return str(self.path)


def test_a_relative_name_is_that_of_the_working_directory_when_it_was_opened(tmp_path, monkeypatch):
    for name in ("A", "B"):
        (tmp_path / name).mkdir()
        written(tmp_path / name, f'#usda 1.0\ndef SphereLight "Of{name}" {{\n}}\n', "lamp.usda")
        written(tmp_path / name, "#usda 1.0\n(subLayers = [@./lamp.usda@])\n")
    monkeypatch.chdir(tmp_path / "A")
    first = open_stage("stage.usda")
    monkeypatch.chdir(tmp_path / "B")
    again = open_stage(Named("../A/stage.usda"))
    for stage in (first, again):
        assert [prim.GetName() for prim in stage.Traverse()] == ["OfA"]
