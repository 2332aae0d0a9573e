"""UsdRenderPass: which settings a pass has, and what it renders."""

import logging

import pytest

from photonbeams.scene import SceneError
from photonbeams.usd.render_passes import apply_pass
from photonbeams.usd.stage import read_scene
from tests.helpers.usda import prim

CONTENT = "".join(
    [
        prim("Sphere", "Front", (0, 0, 0)),
        prim("Sphere", "Back", (0, 0, -5)),
        prim("SphereLight", "Key", (0, 4, 0), "float inputs:radius = 0.1"),
        prim("SphereLight", "Fill", (2, 4, 0), "float inputs:radius = 0.1"),
        'def RenderSettings "Beauty" {\n}\n',
    ]
)


def render_pass(*lines):
    body = "\n    ".join(lines)
    return f'def RenderPass "Pass" {{\n    {body}\n}}\n'


@pytest.mark.parametrize(
    ("lines", "names"),
    [
        ((), "Front Back Key Fill"),
        (("rel collection:prune:includes = [</Back>, </Fill>]",), "Front Key"),
        (("rel collection:renderVisibility:excludes = [</Front>]",), "Back Key Fill"),
        (
            (
                "uniform bool collection:renderVisibility:includeRoot = 0",
                "rel collection:renderVisibility:includes = [</Front>, </Key>]",
            ),
            "Front Key",
        ),
    ],
)
def test_a_pass_renders_what_its_collections_leave(usd, lines, names):
    stage = usd(CONTENT + render_pass("rel renderSource = </Beauty>", *lines))
    assert apply_pass(stage, "/Pass") == "/Beauty"
    found = read_scene(stage)
    assert [each.name for each in (*found.meshes, *found.lights)] == [f"/{name}" for name in names.split()]


def test_a_pass_hides_from_the_camera_and_holds_out(usd, caplog):
    caplog.set_level(logging.WARNING, "photonbeams")
    stage = usd(
        CONTENT
        + render_pass(
            "rel collection:matte:includes = </Front>",
            "rel collection:cameraVisibility:excludes = </Back>",
            "rel collection:prune:includes = None",
            'string[] command = ["rm", "-rf"]',
        )
    )
    assert apply_pass(stage, "/Pass") is None
    found = {each.name: each for each in read_scene(stage).meshes}
    assert [each.name for each in found.values() if each.holdout] == ["/Front"]
    assert [each.name for each in found.values() if not each.seen] == ["/Back"]
    assert not caplog.messages


@pytest.mark.parametrize(
    ("path", "line", "message"),
    [
        ("/Key", "", "has no render pass '/Key'"),
        ("Pass", "", "has no render pass 'Pass'"),
        ("/Pass", "rel renderSource = </Key>", "/Pass.renderSource names /Key"),
        ("/Pass", 'asset fileName = @other.usda@', "/Pass.fileName names another file"),
    ],
)  # fmt: skip
def test_a_pass_that_is_none_is_refused(usd, path, line, message):
    with pytest.raises(SceneError, match=message):
        apply_pass(usd(CONTENT + render_pass(line)), path)
