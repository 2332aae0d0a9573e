"""Presets in the studio: applying one is a single undo step, and the picture and the page show it."""

from dataclasses import replace

import numpy as np
import pytest

import photonbeams as pb
from photonbeams.studio.session import Session
from photonbeams.usd.authoring.presets import PRESETS
from tests.studio.serving import TOKEN, Served, asked
from tests.studio.sessions import STAGE, TINT, VIEW, Watched, are_equal, rendered

LAMP, LOOK = "/World/Lamp", "/World/Look"
BARE = STAGE.replace("        rel photonbeams:look = </World/Look>\n", "").replace(
    """    def PhotonBeamsLook "Look"
    {
        color3f photonbeams:along:tint = (1, 0.5, 0.2)
    }
""",
    "",
)


@pytest.fixture
def stage(tmp_path):
    path = tmp_path / "shot.usda"
    path.write_text(BARE)
    return path


def test_a_light_without_a_look_gets_one_that_is_undone_and_saved_at_once(stage, tmp_path):
    with Watched(stage, view=replace(VIEW, passes=1)) as shown:
        session = shown.session
        plain = shown.finished()
        assert session.apply("look-ember", LAMP) == "/World/Looks/Ember"
        ember = shown.finished()
        red, green, blue = ember["beams"].mean(axis=(0, 1)) / plain["beams"].mean(axis=(0, 1))
        assert red > 1.05 * green > 1.2 * blue
        layer = session.edits.save(tmp_path / "look.usda")
        assert are_equal(ember, rendered(stage, layer, passes=1))
        assert session.undo() and are_equal(shown.finished(), plain) and not session.edits.can_undo
        assert session.redo() and session.edits.text() == layer.read_text()
    assert stage.read_text() == BARE


def test_lengths_of_presets_go_with_the_size_of_the_scene(stage):
    with Session(stage, view=VIEW) as session:
        look = session.apply("look-dust", LAMP)
        radius = session.shot.exposure(None, blur=False)(0.0)[0].bounds[1]
        controls = {each.path: each.value for group in session.controls() for each in group.controls}
        assert controls[f"{look}.photonbeams:along:outer"] == pytest.approx(radius, rel=0.05)  # rounded to two digits
        for preset, path, message in (("look-gone", LAMP, "no preset"), ("look-dust", "/World", "no light or look")):
            text = session.edits.text()
            with pytest.raises(pb.SceneError, match=message):
                session.apply(preset, path)
            assert session.edits.text() == text


def test_pages_are_told_of_new_looks_and_of_looks_that_are_gone_again(tmp_path):
    path = tmp_path / "shot.usda"
    path.write_text(STAGE)
    served = Served(path, view=replace(VIEW, paused=True))
    try:
        with served.page() as page, served.page() as other:
            scene = page.told("scene")
            assert [each["name"] for each in scene["presets"]] == [each.name for each in PRESETS]
            other.told("scene")
            page.send("apply", preset="look-fading", path=LAMP)
            look = "/World/Fading"
            for each in (page, other):
                groups = {group["path"]: group for group in each.told("scene")["controls"]}
                assert groups[LAMP]["uses"] == [look] and groups[look]["kind"] == "look"
            assert page.told("applied") == {"type": "applied", "path": LAMP, "look": look}
            page.send("apply", preset="along-even", path=LOOK)
            values = page.wait(lambda each: each.get("type") == "values" and TINT in each["values"])
            assert values["values"][TINT] == [1, 1, 1] and values["authored"][TINT] is False and values["canUndo"]
            page.send("undo")
            values = page.wait(lambda each: each.get("type") == "values" and TINT in each["values"])
            assert values["values"][TINT] == [1, 0.5, 0.2]
            page.send("undo")
            groups = {group["path"]: group for group in page.told("scene")["controls"]}
            assert groups[LAMP]["uses"] == [LOOK] and look not in groups
            page.send("set", values={f"{LAMP}.photonbeams:look": []})
            assert {group["path"]: group for group in page.told("scene")["controls"]}[LAMP]["uses"] == []
            page.send("apply", preset="look-gone", path=LAMP)
            assert "no preset" in page.told("refused")["text"]
    finally:
        served.close()


def test_thumbnails_are_for_those_who_know_the_token(tmp_path):
    path = tmp_path / "shot.usda"
    path.write_text(STAGE)
    served = Served(path, view=replace(VIEW, paused=True))
    try:
        status, headers, data = asked(served, f"/presets/look-fading.png?token={TOKEN}")
        assert status == 200 and headers["content-type"] == "image/png" and data[:4] == b"\x89PNG"
        assert headers["x-content-type-options"] == "nosniff" and len(data) < 10_000
        assert asked(served, "/presets/look-fading.png")[0] == 403
        for name in ("look-gone.png", "..%2Fserver.py", "%2Fetc%2Fpasswd"):
            assert asked(served, f"/presets/{name}?token={TOKEN}")[0] == 404
    finally:
        served.close()


def test_edits_that_were_not_saved_come_back_and_a_page_may_give_them_up(tmp_path):
    path, layer = tmp_path / "shot.usda", tmp_path / "look.usda"
    path.write_text(STAGE)
    with Session(path, layer=layer, view=VIEW) as session:
        session.edit({TINT: [0.1, 0.2, 1.0]})
    served = Served(path, layer=layer, view=replace(VIEW, passes=1))
    try:
        with served.page() as page:
            assert page.told("values")["restored"]
            _, restored = page.finished()
            page.send("discard")
            values = page.wait(lambda each: each.get("type") == "values" and TINT in each["values"])
            assert values["values"][TINT] == [1, 0.5, 0.2] and values["saved"] and not values["restored"]
            _, pixels = page.finished(served.session.version)
            assert np.abs(pixels.astype(int) - restored).max() > 10
            page.send("undo")
            values = page.wait(lambda each: each.get("type") == "values" and TINT in each["values"])
            assert values["values"][TINT] == [0.1, 0.2, 1.0] and not values["restored"]
            page.send("save")
            assert page.wait(lambda each: each.get("type") == "values" and each["saved"])
    finally:
        served.close()
    assert not layer.with_name("look.usda.autosave").exists() and "0.1, 0.2, 1" in layer.read_text()
