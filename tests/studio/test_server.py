"""The studio's server: who has access, what pages receive, and what happens after bad messages."""

import json

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from photonbeams.cli.render import PROGRAM_BYTES
from photonbeams.images.display import viewed
from photonbeams.images.files import read_layers
from photonbeams.render.memory import BEAM_BYTES, PIXEL_BYTES
from tests.studio.serving import TOKEN, Served, asked
from tests.studio.sessions import INTENSITY, STAGE, TINT, rendered


@pytest.fixture
def served(stage, tmp_path):
    result = Served(stage, layer=tmp_path / "look.usda")
    yield result
    result.close()


@pytest.fixture(scope="module")
def refusing(tmp_path_factory):
    """Return a server that no test changes: pages send it what it refuses."""
    path = tmp_path_factory.mktemp("refusing") / "shot.usda"
    path.write_text(STAGE)
    result = Served(path)
    yield result
    result.close()


def test_a_page_is_told_of_the_scene_and_shown_the_picture_of_a_render(served, stage):
    with served.page() as page:
        scene = page.told("scene")
        assert scene["name"] == "shot.usda" and scene["cameras"] == ["/World/Camera"] and scene["frames"] is None
        groups = {each["path"]: each for each in scene["controls"]}
        assert [each["kind"] for each in groups.values()] == ["light", "medium", "look"]
        controls = {each["path"]: each for each in groups["/World/Lamp"]["controls"]}
        assert controls[INTENSITY]["value"] == 20 and controls[INTENSITY]["kind"] == "number"
        header, pixels = page.finished()
    assert (header["width"], header["height"], header["passes"]) == (48, 27, 2)
    np.testing.assert_array_equal(pixels, viewed(rendered(stage)["rgba"]))


def test_edits_of_one_page_are_seen_by_all_and_are_saved(served, stage, tmp_path):
    with served.page() as page, served.page() as other:
        page.finished(), other.finished()
        page.send("set", values={TINT: [0.1, 0.2, 1.0]}, step="drag")
        for each in (page, other):
            values = each.wait(lambda found: found.get("type") == "values" and found["values"])
            assert values["values"] == {TINT: [0.1, 0.2, 1.0]} and values["canUndo"] and not values["saved"]
        version = served.session.version
        (_, mine), (_, theirs) = page.finished(version), other.finished(version)
        np.testing.assert_array_equal(mine, theirs)
        page.send("save")
        assert page.wait(lambda found: found.get("type") == "values" and found["saved"])
        np.testing.assert_array_equal(mine, viewed(rendered(stage, tmp_path / "look.usda")["rgba"]))
        other.send("undo")
        assert page.wait(lambda found: TINT in found.get("values", {}))["values"][TINT] == [1.0, 0.5, 0.2]
        other.send("set", values={INTENSITY: 50.0})
        other.send("set", values={INTENSITY: None})
        found = page.wait(lambda found: found.get("values", {}).get(INTENSITY) == 20.0)
        assert found["authored"][INTENSITY] is True  # the stage has it


def test_a_page_is_asked_if_another_program_has_changed_the_file(served):
    path, theirs = served.session.edits.path, '#usda 1.0\nover "Nobody" {\n}\n'
    with served.page() as page:
        page.send("set", values={INTENSITY: 50.0})
        path.write_text(theirs)
        page.send("save")
        asked = page.wait(lambda found: found.get("type") == "changed")
        assert (asked["file"], asked["copy"], path.read_text()) == (path.name, None, theirs)
        page.send("save", changed="merge")
        assert page.wait(lambda found: found.get("type") == "values" and found["saved"])
        assert "Nobody" in path.read_text() and "50" in path.read_text()
        path.write_text(theirs)
        page.send("save", changed="copy")
        copy = page.wait(lambda found: found.get("type") == "changed")["copy"]
        assert "50" in path.with_name(copy).read_text() and path.read_text() == theirs


def test_a_page_chooses_layer_exposure_and_view_transform_for_itself(served, stage):
    layers = rendered(stage)
    with served.page() as page:
        page.finished()
        page.send("show", layer="beams", exposure=1.5, display="Un-tone-mapped")
        _, pixels = page.wait(lambda each: each.get("layer") == "beams" and each["mime"] == "image/png")
        np.testing.assert_array_equal(pixels, viewed(layers["beams"], "Un-tone-mapped", 1.5))
        page.send("show", display="Sepia")
        assert "Sepia" in page.told("refused")["text"]
        page.send("inspect", at=[0.5, 0.5])
        found = page.told("pixel")["layers"]
        np.testing.assert_allclose(found["rgba"], layers["rgba"][13, 24], rtol=1e-6)


def test_the_view_is_changed_for_all(served):
    with served.page() as page:
        page.finished()
        page.send("show", size=[32, 18])
        assert page.wait(lambda each: each.get("mime") == "image/png" and each["width"] == 32)
        for bad in ({"size": [0, 4]}, {"camera": "/Gone"}, {"frame": 7.0}, {"area": [0.5, 0, 0.4, 1]},
                    {"size": [100000, 100000]}, {"pose": [0.0] * 16}):  # fmt: skip
            page.send("show", **bad)
            assert page.told("refused")["text"]
        assert served.session.view.width == 32


def test_a_text_with_nul_is_refused_and_the_page_goes_on(served):
    with served.page() as page:
        page.finished()
        for kind, values in (("render", {"passes": 1, "size": [16, 12], "file": "a\0.exr"}),
                             ("show", {"camera": "/Camera\0"}), ("keep", {"path": "/\0"})):  # fmt: skip
            page.send(kind, **values)
            assert "holds the character NUL" in page.told("refused")["text"]
        page.send("show", size=[32, 18])
        assert page.wait(lambda each: each.get("mime") == "image/png" and each["width"] == 32)


def test_a_problem_names_its_attribute_and_the_column_and_the_picture_comes_back(served):
    path = "/World/Look.photonbeams:along:expression"
    with served.page() as page:
        page.finished()
        page.send("set", values={path: "1 + )"})
        problem = page.wait(lambda each: each.get("type") == "state" and each["problem"])["problem"]
        assert problem["path"] == path and problem["column"] == 5 and problem["text"].startswith(f"{path} is wrong")
        page.send("undo")
        page.finished(served.session.version)


@pytest.mark.parametrize("given", [{"token": "wrong"}, {"token": ""}, {"Origin": "http://evil.example"}])
def test_strangers_are_refused(refusing, given):
    with pytest.raises(InvalidStatus) as refused, refusing.page(**given):
        pass
    assert refused.value.response.status_code == 403


def test_the_final_picture_is_rendered_by_the_command_and_handed_out(served, stage, tmp_path):
    with served.page() as page:
        page.finished()
        page.send("set", values={TINT: [0.1, 0.2, 1.0]})
        page.send("render", passes=3)
        found = page.wait(lambda each: each.get("type") == "render" and (each["file"] or each["problem"]), 120)
        assert found["problem"] is None and found["done"] == found["of"] == 100
        status, _, data = asked(served, f"/{found['file']}")
        served.session.edits.save()
    assert status == 200
    (tmp_path / "final.exr").write_bytes(data)
    layers = read_layers(tmp_path / "final.exr")
    wanted = rendered(stage, tmp_path / "look.usda", passes=3)
    np.testing.assert_allclose(layers["rgba"], wanted["rgba"], rtol=2**-11, atol=2**-25)  # the file has half floats


def test_an_estimate_is_of_all_frames_with_the_edits_and_a_new_one_replaces_it(stage):
    stage.write_text(STAGE.replace("(\n", "(\n    startTimeCode = 1\n    endTimeCode = 5\n", 1))
    served, size = Served(stage), [48, 27]
    try:
        with served.page() as page:
            page.send("estimate", number=1, passes=60000, frames=[1, 4], size=size)  # gets no answer
            page.send("estimate", number=2, passes=2, frames=[1, 4], size=size)
            four = page.wait(lambda each: each.get("type") == "estimate", 120)
            assert four["number"] == 2 and four["seconds"] > 0 and four["problem"] is None
            assert four["memory"] == PROGRAM_BYTES + PIXEL_BYTES * 48 * 27 + BEAM_BYTES * 300
            page.send("estimate", number=3, passes=2, frames=[1, 5], size=size)  # the same first frame
            assert page.told("estimate")["seconds"] == pytest.approx(four["seconds"] / 4 * 5)
            page.send("set", values={"/World/Lamp.photonbeams:count": 500})
            page.send("estimate", number=4, passes=2, frames=[1, 4], size=size)
            more = page.wait(lambda each: each.get("type") == "estimate", 120)
            assert more["memory"] == four["memory"] + BEAM_BYTES * 200
            for bad, text in ({"passes": 0}, "passes is 0: "), ({"passes": 2, "frames": [1, 9]}, "the frame is 9.0: "):
                page.send("estimate", number=5, **bad)
                assert page.told("estimate")["problem"].startswith(text)
            page.send("show", pose=[*np.eye(4).ravel()])
            page.send("estimate", number=6, passes=2)
            assert page.told("estimate")["problem"].startswith("the camera was moved freely: ")
            page.send("estimate", number=7, passes=2, size=[1 << 12, 1 << 11])
            page.send("cancel", estimate=True)
            page.send("inspect", at=[0.5, 0.5])
            page.told("pixel")
    finally:
        served.close()


def test_a_final_render_is_cancelled_and_one_is_enough(served):
    with served.page() as page:
        page.finished()
        page.send("render", passes=60000)
        page.wait(lambda each: each.get("type") == "render", 120)
        page.send("render", passes=1)
        assert "under way" in page.told("refused")["text"]
        page.send("cancel")
        assert page.wait(lambda each: each.get("problem") and each["type"] == "render")["file"] is None
        page.send("show", pose=[1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 5, 0, 0, 0, 1])
        page.send("render", passes=1)
        assert "free" in page.told("refused")["text"]


def test_the_page_is_for_those_who_know_the_token_and_asks_nobody_else(refusing):
    status, headers, _ = asked(refusing, f"/?token={TOKEN}")
    assert status == 200 and "default-src 'self'" in headers["content-security-policy"]
    for path, headers in (("/", {}), (f"/?token={TOKEN}x", {}), (f"/?token={TOKEN}", {"Host": "evil.example"}),
                          (f"/?token={TOKEN}", {"Host": f"evil.example:{refusing.port}"}),
                          (f"/?token={TOKEN}", {"Origin": "null"})):  # fmt: skip
        assert asked(refusing, path, **headers)[0] == 403
    long = f"/assets/{'a' * 5000}"
    for path in (
        long,
        "/assets/../server.py",
        "/assets/..%2Fserver.py",
        "/assets/gone.js",
        f"/etc/passwd?token={TOKEN}",
    ):
        assert asked(refusing, path)[0] == 404


@pytest.mark.parametrize(
    "data",
    [b"\x00\x01", "", "[]", "{}", '{"type":"sett"}', '{"type":"set"}', '{"type":"set","values":3}', "[" * 50000,
     '{"type":"show","exposure":"bright"}', '{"type":"undo","more":1}', '{"type":"set","values":{"x":1},"step":5}',
     '{"type":"set","values":' + json.dumps({f"/A.b{k}": 1 for k in range(300)}) + "}", "x" * 70000],
    ids=range(13),
)  # fmt: skip
def test_malformed_messages_are_answered_with_a_reason_and_end_the_connection(refusing, data):
    with refusing.page() as page:
        page.told("scene")
        page.send_raw(data)
        assert len(page.told("refused")["text"]) <= 300
        with pytest.raises(ConnectionClosed):
            page.wait(lambda each: False)
    with refusing.page() as again:
        assert again.told("scene")


def test_a_page_that_sends_too_much_is_let_go(served):
    with served.page() as page:
        page.told("scene")
        with pytest.raises(ConnectionClosed):
            for _ in range(2000):
                page.send("cancel")
            page.wait(lambda each: False)
