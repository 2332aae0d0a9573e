"""What a stage names and what is missing is told with its frame, and fails where that is asked for."""

import logging
from pathlib import Path

import pytest
from pxr import Usd

from photonbeams.scene import SceneError
from photonbeams.usd.common.warnings import MissingError, Warnings
from photonbeams.usd.stage import files_of, open_stage, read_scene, sample_times
from tests.helpers.small_stage import LAMP, write_stage
from tests.helpers.usda import textured

SEQUENCE = """def Volume "Smoke" {
    rel field:density = </Smoke/density>
    def OpenVDBAsset "density" {
        token fieldName = "density"
        asset filePath.timeSamples = {1: @here.vdb@, 2: @gone.vdb@, 3: @here.vdb@}
    }
}
"""
CLIPS = """def Sphere "Ball" (
    clips = { dictionary default = {
        asset[] assetPaths = [@here.usda@, @gone.usda@, @here.usda@]
        double2[] active = [(1, 0), (2, 1), (3, 2)]
        string primPath = "/Ball"
    } }
) { double radius
}
"""
TEMPLATE = """def Sphere "Ball" (
    clips = { dictionary default = {
        string templateAssetPath = "./clip.##.usda"
        double templateStartTime = 1
        double templateEndTime = 3
        double templateStride = 1
        string primPath = "/Ball"
    } }
) { double radius
}
"""
CLIP = '#usda 1.0\ndef Sphere "Ball" { double radius.timeSamples = {1: 1, 3: 3}\n}\n'
MANIFEST = CLIPS.replace("gone", "here").replace("string", "asset manifestAssetPath = @gone.usda@\n        string")
TEXTURE = """def Mesh "Floor" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    rel material:binding = </Paint>
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points = [(-2, -1, 2), (2, -1, 2), (2, -1, -2)]
}
""" + textured("Paint", "asset inputs:file = @gone.png@")
CONNECTION = TEXTURE.replace("</Paint/Image.outputs:rgb>", "</gone.outputs:rgb>")
INTERFACE = TEXTURE.replace("</Paint/Image.outputs:rgb>", "</Paint.inputs:color>").replace(
    'Material "Paint"\n{', 'Material "Paint"\n{ color3f inputs:color.connect = </gone.outputs:rgb>'
)
IES = LAMP.replace("inputs:radius", "inputs:radius = 0.1\n    asset inputs:shaping:ies:file = @gone.ies@\n    float x")
DOME = 'def DomeLight "Sky" { asset inputs:texture:file = @gone.hdr@\n}\n'
REFERENCE = 'def Xform "Props" (prepend references = @gone.usda@) {\n}\n'
MATERIAL = 'def Sphere "Ball" (prepend apiSchemas = ["MaterialBindingAPI"]) { rel material:binding = </gone>\n}\n'
SKELETON = """def SkelRoot "Figure" {
    def Mesh "Skin" (prepend apiSchemas = ["SkelBindingAPI"]) {
        rel skel:skeleton = </gone>
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        point3f[] points = [(-2, -1, 2), (2, -1, 2), (2, -1, -2)]
    }
}
"""
INSTANCES = """def PointInstancer "Trees" {
    rel prototypes = </gone>
    int[] protoIndices = [0]
    point3f[] positions = [(0, 0, 0)]
}
"""
UNNAMED = {
    "no file": SEQUENCE.replace("@gone.vdb@", "None"), "no grids": SEQUENCE.replace("@gone.vdb@", "@here.usda@"),
    "no prototype": INSTANCES,
}  # fmt: skip
VARYING = {"smoke": SEQUENCE, "clips": CLIPS, "template": TEMPLATE}
LASTING = {"texture": TEXTURE, "profile": IES, "sky": DOME, "reference": REFERENCE, "material": MATERIAL,
           "skeleton": SKELETON, "manifest": MANIFEST, "connection": CONNECTION,
           "interface": INTERFACE, "terminal": CONNECTION.replace("</Paint/Surface.", "</gone.")}  # fmt: skip


@pytest.fixture
def read(tmp_path):
    """Return a function that reads some frames of a stage, and returns the warnings about it."""
    smoke = Path(__file__).resolve().parents[2] / "examples" / "smoke" / "smoke.1.vdb"
    (tmp_path / "here.vdb").write_bytes(smoke.read_bytes())
    for name in ("here.usda", "clip.01.usda", "clip.03.usda"):
        (tmp_path / name).write_text(CLIP)

    def frames(prims, numbers, strict=False):
        warnings = Warnings(strict)
        stage = open_stage(write_stage(tmp_path / "stage.usda", prims), warnings=warnings)
        for number in numbers:
            read_scene(stage, number, warnings)
        return warnings

    return frames


@pytest.mark.parametrize("kind", VARYING)
def test_a_gap_in_a_sequence_is_told_with_its_frame(read, kind, caplog):
    warnings = read(VARYING[kind], (1, 2, 3))
    (message,) = (each.message for each in caplog.records if "gone" in each.message or "clip.02" in each.message)
    assert message.startswith("frame 2: ")
    assert [len(warnings.missing_at(number)) for number in (1, 2, 3)] == [0, 1, 0]


@pytest.mark.parametrize("kind", VARYING)
def test_a_frame_in_a_gap_can_be_made_to_fail(read, kind):
    read(VARYING[kind], (1, 3), strict="missing")
    with pytest.raises(MissingError, match=r"gone\.|clip\.02\."):
        read(VARYING[kind], (2,), strict="missing")


def test_only_the_first_of_several_connections_is_missed(read, image):
    painted = CONNECTION.replace("gone.png", str(image("a.png", [[[1, 1, 1]]])))
    both = "[</Paint/Image.outputs:rgb>, </gone.outputs:rgb>]"
    assert not read(painted.replace("</gone.outputs:rgb>", both), (1,)).missing_at(1)


def painted(image, source, *lines):
    """Return a mesh whose colour is connected to a source, with more lines in its material."""
    found = TEXTURE.replace("gone.png", str(image("a.png", [[[1, 1, 1]]]))).replace(
        "Paint/Image.outputs:rgb>", f"{source}>"
    )
    return LAMP + found.replace('"Paint"\n{', "\n".join(('"Paint"\n{', *lines, "")))


def graph(own, inner):
    """Return a node graph with another one in it, and what their outputs are connected to."""
    own, inner = (each and f".connect = </Paint/{each}>" for each in (own, inner))
    return f"""def NodeGraph "Graph" {{
        color3f outputs:out{own}
        def NodeGraph "In" {{
            color3f outputs:out{inner}
        }}
    }}"""


@pytest.mark.parametrize(
    ("source", "lines", "expected"),
    [
        ("Paint.inputs:a", [f"color3f inputs:{a}.connect = </Paint.inputs:{b}>" for a, b in ("ab", "ba")], "no loop"),
        ("Paint/Surface.inputs:diffuseColor", [], "no loop"),
        ("Paint/Graph.outputs:out", [graph("", "")], "an output that is connected"),
        (
            "Paint/Graph.outputs:out",
            [graph("", "").replace("out\n", "out.connect = None\n")],
            "an output that is connected",
        ),
        ("Paint/Graph.outputs:out", [graph("Graph/In.outputs:out", "Graph.outputs:out")], "no loop"),
        ("Paint/Graph.outputs:out", [graph("Graph/In.outputs:out", "")], "an output that is connected"),
        ("Paint/Image.inputs:file", [], "an output of a shader, or an input of a material or a graph"),
        ("Floor.points", [], "an output of a shader, or an input of a material or a graph"),
        ("Lamp.inputs:color", [], "an output of a shader, or an input of a material or a graph"),
    ],
)
def test_a_connection_that_leads_to_no_value_is_told(read, image, source, lines, expected):
    (missing,) = read(painted(image, source, *lines), (1,)).missing_at(1)
    assert f": expected {expected}; it is ignored" in missing


@pytest.mark.parametrize(
    ("source", "lines"),
    [
        ("Paint.inputs:a", ["color3f inputs:a"]),  # the shader's own default
        ("Paint.inputs:a", ["color3f inputs:a = (0, 0, 1)"]),
        (
            "Paint.inputs:a",
            ["color3f inputs:a.connect = </Paint/Graph.outputs:out>", graph("Image.outputs:rgb", "")],
        ),
        (
            "Paint/Graph.outputs:out",
            [graph("Graph/In.outputs:out", "Graph.inputs:a").replace("{", "{ color3f inputs:a", 1)],
        ),
    ],
)
def test_a_connection_may_lead_to_an_interface(read, image, source, lines):
    assert not read(painted(image, source, *lines), (1,)).missing_at(1)


def test_an_output_of_a_graph_may_have_a_value(read, image, caplog):
    own = graph("", "").replace("out\n", "out = (0, 0, 1)\n", 1)
    assert not read(painted(image, "Paint/Graph.outputs:out", own), (1,)).missing_at(1)
    assert "shader" not in caplog.text


def test_an_output_that_its_shader_does_not_declare_is_told_from_one_that_is_gone(read):
    (missing,) = read(TEXTURE.replace("Image.outputs:rgb>", "Image.outputs:rbg>"), (1,)).missing_at(1)
    assert "is connected to /Paint/Image.outputs:rbg: expected an attribute that /Paint/Image declares;" in missing


def test_what_openusd_says_of_a_gap_at_another_time_is_not_printed(tmp_path, capfd):
    (tmp_path / "here.usda").write_text(CLIP)
    (tmp_path / "manifest.usda").write_text('#usda 1.0\ndef Sphere "Ball" { double radius\n}\n')
    clips = CLIPS.replace("string", "asset manifestAssetPath = @manifest.usda@\n        string")
    stage = open_stage(write_stage(tmp_path / "stage.usda", clips))
    assert sample_times(stage, 8) == [1, 2, 3]
    assert capfd.readouterr().err == ""


def test_what_openusd_says_of_a_template_without_a_folder_is_not_printed(tmp_path, capfd):
    stage = open_stage(write_stage(tmp_path / "stage.usda", TEMPLATE.replace("./", "")))
    assert str(tmp_path / "stage.usda") in set(files_of(stage))
    assert capfd.readouterr().err == ""


def test_value_clips_of_wrong_types_are_ignored_on_stages_that_somebody_else_opened(tmp_path):
    wrong = CLIPS.replace("double2[] active = [(1, 0), (2, 1), (3, 2)]", "double3 active = (0, 0, 0)")
    stage = Usd.Stage.Open(str(write_stage(tmp_path / "stage.usda", wrong)))
    assert not read_scene(stage, 1).lights


def clip_stage(folder, weak, strong=""):
    """Return a stage whose prim /Ball has these value clips in a layer, and others of their set in a stronger one."""
    ball = 'Sphere "Ball" (clips = {{ dictionary default = {{\n{}\n}} }}) {{\n{}\n}}\n'
    (folder / "weak.usda").write_text("#usda 1.0\ndef " + ball.format(weak, "double radius"))
    path = folder / "strong.usda"
    path.write_text("#usda 1.0\n(subLayers = [@weak.usda@])\nover " + ball.format(strong, ""))
    return path


def frames_missing(path):
    """Return at which of the frames 1 to 3 a stage lacks something, and all warnings about it."""
    warnings = Warnings()
    stage = open_stage(path, warnings=warnings)
    for frame in (1, 2, 3):
        read_scene(stage, frame, warnings)
    return [frame for frame in (1, 2, 3) if warnings.missing_at(frame)], "\n".join(warnings.given)


NAMED = 'string primPath = "/Ball"\n'
PATHS = "asset[] assetPaths = [@here.usda@, @here.usda@]\n"
GAP = "asset[] assetPaths = [@here.usda@, @gone.usda@]\n"
ACTIVE = "double2[] active = [(1, 0), (2, 1)]\n"
LISTED = NAMED + PATHS + ACTIVE
NUMBERED = NAMED + "".join(
    f"{kind} template{name}\n"
    for kind, name in (
        ("string", 'AssetPath = "./clip.##.usda"'),
        ("double", "StartTime = 1"),
        ("double", "Stride = 1"),
    )
)
END = "double templateEndTime = %g\n"
TENTHS = (
    NAMED
    + 'string templateAssetPath = "./#/t.#.#.usda"\n'
    + ("double templateStartTime = 0\ndouble templateEndTime = 30\ndouble templateStride = 0.1")
)
MERGED = {
    "gap": (NAMED + GAP, ACTIVE, [2, 3]), "strong gap": (LISTED, GAP, [2, 3]),
    "active gap": (NAMED + GAP + "double2[] active = [(0, 0)]", "double2[] active = [(0, 1)]", [1, 2, 3]),
    "template": (NUMBERED, END % 3, [2]), "manifest": (LISTED, "asset manifestAssetPath = @gone.usda@", [1, 2, 3]),
    "weak gap": (NAMED + GAP + ACTIVE, "double2[] active = [(0, 0)]", []),
    "weak paths": (NAMED + GAP + ACTIVE, PATHS, []),
    "early end": (NUMBERED + END % 0, END % 3, [2]), "weak end": (NUMBERED + END % 3, END % 1, []),
    "weak index": (NAMED + "asset[] assetPaths = [@here.usda@]\n" + ACTIVE, "double2[] active = [(0, 0)]", []),
    "stray key": (LISTED, "int templateStartTime = 1", []), "stray file": (NUMBERED + END % 1, "", []),
    "folder": (TENTHS, "", [2]),
}  # fmt: skip


@pytest.mark.parametrize("kind", MERGED)
def test_value_clips_are_merged_over_layers_before_gaps_are_told(read, tmp_path, kind):
    (tmp_path / "clip.09.usda").write_text("")  # beside the template's numbers, and empty
    (tmp_path / "#").mkdir()
    for number in ("1.0", "3.0"):
        (tmp_path / "#" / f"t.{number}.usda").write_text(CLIP)
    weak, strong, missing = MERGED[kind]
    assert frames_missing(clip_stage(tmp_path, weak, strong))[0] == missing


def test_a_set_of_value_clips_that_clip_sets_do_not_name_lacks_nothing(read, tmp_path):
    path = clip_stage(tmp_path, NAMED + GAP + ACTIVE)
    path.write_text(path.read_text().replace('"Ball" (', '"Ball" (delete clipSets = ["default"]\n'))
    weak = tmp_path / "weak.usda"
    weak.write_text(weak.read_text().replace('"Ball" (', '"Ball" (clipSets = []\n'))
    assert frames_missing(path) == ([], "")


def numbered(name, more=""):
    return (NUMBERED + END % 3 + more).replace("clip.##", name)


IGNORED = {
    "number without a dot": (numbered("clip##"), "whose templateAssetPath is './clip##.usda': expected NAME.###.usd"),
    "number after a line": (numbered("clip_#"), "whose templateAssetPath is './clip_#.usda': expected NAME.###.usd"),
    "numbers apart": (numbered("a.#.x.#"), "whose templateAssetPath is './a.#.x.#.usda': expected NAME.###.usd"),
    "no number": (numbered("a"), "whose templateAssetPath is './a.usda': expected NAME.###.usd"),
    "early end": (NUMBERED + END % 0, "from 1 to 0 by 1: expected 1 to 1,000,000 clips"),
    "far": (numbered("clip.##", "double templateActiveOffset = 2"), "is 2: expected no more than the stride, 1"),
    "not far": (
        (NUMBERED + END % 1).replace("StartTime = 1", "StartTime = 1\ndouble templateActiveOffset = 0"),
        "whose templateActiveOffset is 0 for a single clip",
    ),
    "thrice": (LISTED + "double2[] times = [(0, 0), (1, 1), (1, 2), (1, 3)]", "whose times has 1 more than twice"),
    "one time": (NAMED + PATHS + "double2[] active = [(1, 0), (1, 1)]", "active has two clips from 1 on: expected one"),
    "no path": (PATHS + ACTIVE, "without primPath: expected assetPaths, active, primPath"),
    "no prim": (LISTED.replace("/Ball", "/Box"), "whose primPath is '/Box': expected a prim in the clips"),
    "blank": (LISTED.replace("here", "", 1).replace("@.usda@", "@@"), "one of whose assetPaths is empty"),
    "not active": (NAMED + PATHS + "double2[] active = []", "without active: expected"),
    "never active": (NAMED + PATHS, "without active: expected"),
    "index": (LISTED.replace("(2, 1)", "(2, 2)"), "active has the index 2: expected one of 2 assetPaths"),
    "below 0": (LISTED.replace("(2, 1)", "(2, -1)"), "active has the index -1: expected one of 2 assetPaths"),
    "asset": (NAMED + "asset assetPaths = @here.usda@", "assetPaths is of the type asset: expected asset[]"),
    "dictionary": ("dictionary assetPaths = {}", "assetPaths is of the type dictionary: expected asset[]"),
    "times": (LISTED + "int times = 3", "times is of the type int: expected double2[]"),
    "triple": (NAMED + PATHS + "double3 active = (0, 0, 0)", "active is of the type double3: expected double2[]"),
    "text": (LISTED + "string manifestAssetPath = 'a'", "manifestAssetPath is of the type string: expected asset"),
    "expression": (LISTED.replace("@here.usda@", "@`\"here.usda\"`@"), "is an expression: expected a path"),
}  # fmt: skip


@pytest.mark.parametrize("kind", IGNORED)
def test_value_clips_that_openusd_ignores_are_told_and_count_as_missing(read, tmp_path, kind):
    text, problem = IGNORED[kind]
    missing, told = frames_missing(clip_stage(tmp_path, text))
    assert missing == [1, 2, 3]
    assert "/Ball has the value clips 'default', " in told and problem in told


CALLED = 'string primPath = "/Ball"\n'
KEYS = "asset[] assetPaths = [@./k.1.usda@, @./k.2.usda@, @./k.4.usda@]\n"
BEGUN = "double2[] active = [(1, 0), (2, 1), (4, 2)]\n"
SHIFTED = "double2[] times = [(0, 1), (9, 10)]\n"
ACROSS = "bool interpolateMissingClipValues = true\n"
BY_TWO = CALLED + (
    'string templateAssetPath = "./k.#.usda"\ndouble templateStartTime = 0\n'
    "double templateEndTime = 4\ndouble templateStride = 2\n"
)
NAMING = "asset manifestAssetPath = @./names.usda@\n"
# The values of a weak layer, whose times are shifted by 1, and of a strong one; and the clip that is not there, or the
# folder without a manifest.
DIFFERENT = {
    "active": (CALLED + KEYS, BEGUN, 2), "times": (CALLED + KEYS + BEGUN, SHIFTED, 2),
    "paths": (CALLED + BEGUN, KEYS, 4), "first": (CALLED + KEYS + BEGUN, "", 1),
    "last across": (CALLED + KEYS + BEGUN + ACROSS, "", 4), "across": (CALLED + KEYS + BEGUN + ACROSS, "", 2),
    "template": (BY_TWO, "", 2), "strong template": (BY_TWO, 'string templateAssetPath = "./k.#.usda"', 4),
    "manifest": (CALLED + KEYS + BEGUN, NAMING, "weak"), "weak manifest": (CALLED + NAMING + BEGUN, KEYS, "strong"),
    "known manifest": (CALLED + KEYS + NAMING, BEGUN, 2), "referred": (CALLED + KEYS, BEGUN, 2),
    "both": (CALLED + KEYS + 'string templateAssetPath = "./k.#.usda"', BEGUN, 2),
}  # fmt: skip


def write_clip_stage(folder, kind, times, attribute, whole):
    """Write a stage and its clips, each with samples at these times after its number; return the stage's path."""
    weak, strong, gone = DIFFERENT[kind]
    ball = 'Sphere "Ball" (clips = {{ dictionary default = {{\n{}\n}} }}\n{}) {{\n{}\n}}\n'
    (folder / "weak").mkdir(parents=True)
    (folder / "weak" / "weak.usda").write_text("#usda 1.0\ndef " + ball.format(weak, "", attribute))
    layer, arc = "\n(subLayers = [@weak/weak.usda@ (offset = 1)])", ""
    if kind == "referred":
        layer, arc = "", "references = @weak/weak.usda@</Ball> (offset = 1)"
    path = folder / "strong.usda"
    path.write_text(f"#usda 1.0{layer}\ndef " + ball.format(strong, arc, ""))
    for place in (folder, folder / "weak"):
        for number in (0, 1, 2, 4):
            samples = ", ".join(f"{number + time}: {100 * 2**number + time}" for time in times)
            if whole or number != gone:
                clip = f'#usda 1.0\ndef "Ball" {{ {attribute}.timeSamples = {{{samples}}}\n}}\n'
                (place / f"k.{number}.usda").write_text(clip)
        if whole or place.name != gone:
            (place / "names.usda").write_text(f'#usda 1.0\ndef "Ball" {{ {attribute}\n}}\n')
    return path


DENSE = (-1, 0, 1, 2, 3, 4, 5)
NEEDED = [
    *((kind, DENSE, "double radius") for kind in DIFFERENT),
    *((kind, (0,), "double radius") for kind in ("first", "across", "last across", "template")),
    *((kind, DENSE, "int count") for kind in ("times", "strong template")),  # which is held between samples
]


@pytest.mark.parametrize("kind, times, attribute", NEEDED)
def test_clips_are_missing_at_the_times_whose_values_need_them(tmp_path, kind, times, attribute):
    frames = (0, 1, 2, 3, 3.5, 4.5, 5, 7)
    values, missing = {}, {}
    for whole in (True, False):
        warnings = Warnings()
        path = write_clip_stage(tmp_path / str(whole) / "strong", kind, times, attribute, whole)
        stage = open_stage(path, warnings=warnings)
        for frame in frames:
            read_scene(stage, frame, warnings)
        own = stage.GetPrimAtPath("/Ball").GetAttribute(attribute.split()[1])
        values[whole] = [own.Get(frame) for frame in frames]
        missing[whole] = {frame for frame in frames if warnings.missing_at(frame)}
    different = {frame for frame, *pair in zip(frames, *values.values(), strict=True) if pair[0] != pair[1]}
    assert not missing[True] and different and missing[False] == different


@pytest.mark.parametrize("kind", LASTING)
def test_a_missing_file_counts_for_every_frame_and_can_be_made_to_fail(read, kind, caplog):
    caplog.set_level(logging.WARNING)
    warnings = read(LASTING[kind], (1, 2))
    (message,) = (each.message for each in caplog.records if "gone" in each.message)
    assert "frame" not in message
    assert len(warnings.missing_at(1)) == len(warnings.missing_at(2)) == 1
    with pytest.raises(MissingError, match="gone"):
        read(LASTING[kind], (1,), strict="missing")


@pytest.mark.parametrize("kind", UNNAMED)
def test_what_is_told_without_the_name_of_a_file_can_be_made_to_fail(read, kind):
    assert len(read(UNNAMED[kind], (2,)).missing_at(2)) == 1
    with pytest.raises(MissingError):
        read(UNNAMED[kind], (2,), strict="missing")


def test_other_warnings_are_no_errors_where_only_missing_things_are(read):
    read(LAMP.replace("inputs:radius", "inputs:colour = 3\n    float inputs:radius"), (1,), strict="missing")
    with pytest.raises(SceneError, match="expected True, False or 'missing'"):
        Warnings("gone")
