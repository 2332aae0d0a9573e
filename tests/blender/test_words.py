"""What the renderer says in Blender: objects have their names, and nothing is said in USD's words or the command's."""

import ast
import re
from pathlib import Path

import pytest

import photonbeams
from photonbeams.blender.words import Words

SOURCE = Path(photonbeams.__file__).parent
#: What no user of Blender knows.
FOREIGN = re.compile(r"--[a-z]|photonbeams:|inputs:|(?<![\w/])g?prim(?:var)?s?\b|\w+API\b|UsdLux|\bstages?\b")
#: Rooms and modules whose messages are about commands, files that they write, scenes of other kinds, and references.
ELSEWHERE = {"blender", "cli", "composition", "export", "farm", "studies", "studio"}


@pytest.fixture
def words():
    found = Words()
    found.learn([
        {"path": "/Lights/Key_Light", "name": "Key Light"},
        {"path": "/Lights/stage_left", "name": "stage left"},
        {"path": "/Objects/Cube", "name": "Cube.001"},
        {"path": "/Objects/Cube/Volume"},
        {"path": "/Objects/Cube/Volume/Shader"},
        {"path": "/Materials/Wood", "name": "Material Wood"},
        {"path": "/Fog", "name": "World > Volume"},
    ])  # fmt: skip
    return found


@pytest.mark.parametrize(("said", "expected"), [
    ("the stage: there is no fog, so no beams are seen: expected a prim with PhotonBeamsMediumAPI, or a fog given by "
     "--scattering",
     "there is no fog, so no beams are seen: expected World > Volume, or a mesh whose material has a volume"),
    ("the stage: no beams have any light: expected some of /Lights/stage_left, /Gone to shine",
     "no beams have any light: expected some of stage left, /Gone to shine"),
    ("the stage: nothing makes beams at frame 1: expected photonbeams:enabled on /Lights/Key_Light",
     "nothing makes beams: expected Object Data > Beams of Key Light"),
    ("the stage: /Lights/Key_Light.inputs:radius is -1: expected 0 or more; 0 is used",
     "Key Light: Radius is -1: expected 0 or more; 0 is used"),
    ("the stage: /Lights/Key_Light.inputs:intensity is -15.9: expected 0 or more",
     "Key Light: Power is negative: expected 0 or more"),
    ("the stage: /Objects/Cube is not closed: its fog fills all (and 1 more like this: /Objects/Cube/Volume)",
     "Cube.001 is not closed: its fog fills all (and 1 more like this: Cube.001)"),
    ("the stage: /Objects/Cube/Volume/Shader.inputs:scattering is negative: expected colours",
     "Cube.001: Scattering is negative: expected colours"),
    ("gaps of /Objects/Cube are 0.01 units wide, but beams of /Lights/Key_Light 0.1 there, so that their stripes blur: "
     "expected --set /Lights/Key_Light.photonbeams:count=4000, or a photonbeams:portal around the gaps",
     "gaps of Cube.001 are 0.01 units wide, but beams of Key Light 0.1 there, so that their stripes blur: "
     "expected Key Light: Beams > Count = 4000, or a portal (Object Data > Beams) around the gaps"),
    ("/Lights/Key_Light.focalLength is 9 with horizontalAperture 1: expected a ratio below 2",
     "Key Light: Lens > Focal Length is 9 with Camera > Size 1: expected a ratio below 2"),
    ("1 x 1 pixels: expected fewer, or a part of the picture with --crop",
     "1 x 1 pixels: expected fewer, or a part of the picture with Format > Render Region"),
    ("the stage: /Materials/Wood.inputs:file names /tmp/photonbeamsab12_x3z/3_Oak.png, which is cut off",
     "Material Wood: image names Oak.png, which is cut off"),
    ("the stage: /Lights/Key_Light.photonbeams:portal names /Gone: expected a prim that is on the stage",
     "Key Light: Beams > Portal names /Gone: expected an object that is in the scene"),
    ("the stage has no light that makes beams: expected a UsdLux light, or drawn beams",
     "the scene has no light that makes beams: expected a lamp, or a curve with Object Data > Beams"),
])  # fmt: skip
def test_a_message_is_in_blenders_words(words, said, expected):
    assert words.of(said) == expected


@pytest.mark.parametrize("path", ["/home/prim/my--flag/stage.exr", "/Fog/stage/inputs.exr", "C:/stage/prim.exr"])
def test_names_of_files_stay(words, path):
    assert words.of(f"cannot read {path}: expected an image") == f"cannot read {path}: expected an image"


def test_a_longer_message_is_cut(words):
    assert len(words.of("--exposure " * 40)) <= 300


def messages():
    """Yield the texts of the source that a sentence may be made of; what is filled in is the path of a prim."""
    for path in sorted(SOURCE.rglob("*.py")):
        if not ELSEWHERE.isdisjoint(path.relative_to(SOURCE).with_suffix("").parts):
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        others = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}  # documentation
        others |= {id(each) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for each in node.values}
        for node in ast.walk(tree):
            if isinstance(node, ast.JoinedStr):
                yield "".join(each.value if isinstance(each, ast.Constant) else "/Objects/Cube" for each in node.values)
            elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in others:
                yield node.value


def test_no_sentence_of_the_renderer_has_other_words(words):
    sentences = [each for each in messages() if " " in each and FOREIGN.search(each) and "\n" not in each]
    assert len(sentences) > 50
    assert [(each, words.of(each)) for each in sentences if FOREIGN.search(words.of(each))] == []
