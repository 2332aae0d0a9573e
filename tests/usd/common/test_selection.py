"""Population masks, purposes, variants and complexity."""

import pytest

import photonbeams as pb
from photonbeams.scene import SceneError
from photonbeams.usd.common.selection import Selection
from photonbeams.usd.stage import open_stage, read_scene, stage_digest

STAGE = """#usda 1.0
def Xform "World"
{
    def Cube "Plain" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {
        rel material:binding = </Looks/Red>
    }
    def Cube "Proxy"
    {
        uniform token purpose = "proxy"
    }
    def Cube "Final"
    {
        uniform token purpose = "render"
    }
    def PointInstancer "Many"
    {
        rel prototypes = [</World/Many/Box>]
        int[] protoIndices = [0]
        point3f[] positions = [(9, 0, 0)]
        def Cube "Box"
        {
            uniform token purpose = "proxy"
        }
    }
    def Camera "Camera"
    {
    }
}
def Xform "Shape" (
    variants = {
        string kind = "ball"
    }
    prepend variantSets = "kind"
)
{
    variantSet "kind" = {
        "ball" {
            def Sphere "Ball"
            {
            }
        }
        "box" {
            def Cube "Box"
            {
            }
        }
    }
}
def Scope "Looks"
{
    def Material "Red"
    {
    }
}
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "stage.usda"
    path.write_text(STAGE)
    return path


@pytest.mark.parametrize(
    ("given", "names"),
    [
        ({}, {"/World/Plain", "/World/Final", "/Shape/Ball"}),
        ({"purposes": "proxy"}, {"/World/Plain", "/World/Proxy", "/World/Many[0]", "/Shape/Ball"}),
        ({"purposes": ""}, {"/World/Plain", "/Shape/Ball"}),
        ({"mask": "/World/Plain, /Shape"}, {"/World/Plain", "/Shape/Ball"}),
        ({"mask": ("/World/Final",)}, {"/World/Final"}),
        ({"variants": "/Shape{kind=box}"}, {"/World/Plain", "/World/Final", "/Shape/Box"}),
        ({"variants": ["/Shape{kind=}"]}, {"/World/Plain", "/World/Final"}),
    ],
)
def test_what_is_selected_is_read(file, given, names):
    stage = open_stage(file, selection=Selection.of(**given))
    assert {each.name for each in read_scene(stage).meshes} == names
    # A mask includes what its prims refer to, wherever that is.
    assert bool(stage.GetPrimAtPath("/Looks/Red")) == ("/World/Plain" in names)


def test_python_takes_what_the_flags_take(file):
    shot = pb.Shot.open(file, mask="/World", purposes="proxy", complexity="low")
    assert {each.name for each in shot.read()[0].meshes} == {"/World/Plain", "/World/Proxy", "/World/Many[0]"}


@pytest.mark.parametrize("given", [{"purposes": "proxy"}, {"complexity": "low"}])
def test_a_selection_is_a_part_of_the_stages_digest(file, given):
    assert stage_digest(open_stage(file)) != stage_digest(open_stage(file, selection=Selection.of(**given)))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"mask": "World"}, "the mask names 'World'"),
        ({"mask": iter([1])}, "the mask names '1'"),
        ({"mask": "/Gone"}, "the mask names /Gone"),
        ({"purposes": "final"}, r"purposes name 'final': expected some of default, render, proxy, guide"),
        ({"complexity": "huge"}, "complexity is 'huge'"),
        ({"variants": "/Shape"}, "cannot select '/Shape'"),
        ({"variants": "/Gone{kind=box}"}, r"cannot select '/Gone\{kind=box\}': .*stage\.usda has no prim /Gone"),
        ({"variants": "/Shape{color=box}"}, r"/Shape has no variant set color, expected one of kind"),
        ({"variants": "/Shape{kind=cone}"}, r"expected kind to be one of ball, box"),
    ],
)
def test_what_cannot_be_selected_is_an_error(file, given, message):
    with pytest.raises(SceneError, match=message):
        open_stage(file, selection=Selection.of(**given))
