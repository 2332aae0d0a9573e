"""Sessions: the next picture shows an edit, and the finished picture equals that of `Shot.render`, bit for bit."""

import gc
import subprocess
import sys
import time
import weakref
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import photonbeams as pb
from photonbeams.render import gathering
from photonbeams.render.films import denoising
from photonbeams.render.passes import PlannedPasses
from photonbeams.shot.development import Development
from photonbeams.studio import viewing
from photonbeams.studio.live import Cancelled
from photonbeams.studio.session import Session, SessionView
from tests.studio.sessions import INTENSITY, STAGE, TINT, VIEW, Watched, are_equal, rendered

PLACE = "/World/Ball.xformOp:translate"


@pytest.fixture(scope="module")
def refusing(tmp_path_factory):
    """Return a session that nothing may change: its tests give it what it refuses."""
    path = tmp_path_factory.mktemp("refusing") / "shot.usda"
    path.write_text(STAGE)
    with Watched(path) as shown:
        shown.finished()
        yield shown.session


def test_the_finished_picture_is_that_of_a_render_with_the_saved_layer(stage, tmp_path):
    """After each of several edits, the picture that reuses parts of earlier frames equals a new render."""
    edits = {
        "look": {TINT: [0.2, 0.5, 1.0]}, "light": {INTENSITY: 35.0},
        "group": {"/World/Lamp.photonbeams:lightGroup": "a"},
        "fog": {"/World/Fog.photonbeams:scattering": [0.4, 0.2, 0.1]}, "surface": {PLACE: [-0.8, 0.2, 0]},
        "camera": {"/World/Camera.xformOp:translate": [0.2, 0.1, 3.5]},
        "expression": {"/World/Look.photonbeams:across:expression": "1 - 0.5 * r"},
        "hidden": {"/World/Ball.visibility": "invisible"},
        "shown again": {"/World/Ball.visibility": "inherited"},
    }  # fmt: skip
    with Watched(stage) as shown:
        before = shown.finished()
        assert are_equal(before, rendered(stage))
        for kind, values in edits.items():
            after = shown.finished(shown.session.edit(values))
            layer = shown.session.edits.save(tmp_path / f"{kind}.usda")
            assert are_equal(after, rendered(stage, layer)), kind
            assert not are_equal(after, before), kind
            before = after
        assert "there is no light" in shown.problem(shown.session.edit({"/World/Lamp.visibility": "invisible"}))


def test_the_finished_picture_does_not_depend_on_the_sizes_before_it():
    """A picture after a change of size is that of a render, although light is sent toward what each size shows."""
    keyhole = Path(__file__).parents[2] / "examples" / "keyhole" / "keyhole.usda"
    with Watched(keyhole, view=SessionView(width=96, height=27, passes=2, denoise=False, bounces=0)) as shown:
        shown.finished()
        after = shown.finished(shown.session.show(width=48, height=27))
    assert are_equal(after, rendered(keyhole))


def test_an_edit_of_a_look_traces_no_light_and_shades_no_surface(stage):
    with Watched(stage) as shown:
        shown.finished()
        version = shown.session.edit({TINT: [0.2, 0.5, 1.0]})
        first = shown.wait(version, lambda each: True)
        assert "simulate" not in first.statistics.seconds and "beams" in first.statistics.seconds
        version = shown.session.edit({INTENSITY: 5.0})
        assert "simulate" in shown.wait(version, lambda each: True).statistics.seconds


def test_first_pictures_are_small_and_whole_ones_follow(stage):
    view = SessionView(width=480, height=270, passes=2, denoise=False)
    with Watched(stage, view=view) as shown:
        shown.finished()
        sizes = [(each.scale, each.layers["rgba"].shape[:2], each.passes) for each in shown.told
                 if each.version == shown.session.version]  # fmt: skip
    assert sizes[0][0] < 0.5 and np.prod(sizes[0][1]) < 160 * 91
    assert [each[1:] for each in sizes[1:]] == [((270, 480), 1), ((270, 480), 2)]


def test_a_later_edit_ends_what_is_under_way(stage):
    with Watched(stage) as shown:
        shown.finished()
        shown.session.show(passes=5000)
        version = shown.session.version
        shown.wait(version, lambda each: each.passes >= 1)
        after = shown.session.show(passes=2)
        shown.finished(after)
        assert max(each.passes for each in shown.told if each.version == version) < 5000


def test_a_closed_session_keeps_no_scene(stage):
    with Watched(stage) as shown:
        shown.finished()
        frame = weakref.ref(shown.session._live.frame())
        gc.disable()
    try:
        assert frame() is None
    finally:
        gc.enable()


def test_undo_redo_and_revert(stage):
    with Watched(stage) as shown:
        plain = shown.finished()
        session = shown.session
        for number in range(3):
            session.edit({INTENSITY: 30.0 + number}, step="drag")
        changed = shown.finished()
        assert session.undo() and are_equal(shown.finished(), plain)
        assert not session.undo() and session.edits.is_saved
        assert session.redo() and are_equal(shown.finished(), changed) and not session.redo()
        session.revert()
        assert are_equal(shown.finished(), plain)
        assert session.undo() and are_equal(shown.finished(), changed)
        session.edit({INTENSITY: None})
        assert are_equal(shown.finished(), plain)


def test_edits_are_read_from_their_file_and_saved_to_it(stage, tmp_path):
    layer = tmp_path / "look.usda"
    with Watched(stage, layer=layer) as shown:
        shown.session.edit({TINT: [0.2, 0.5, 1.0]})
        found = shown.finished()
        assert not shown.session.edits.is_saved
        assert shown.session.edits.save() == layer and shown.session.edits.is_saved
    with Watched(stage, layer=layer) as again:
        assert are_equal(again.finished(), found)
        assert again.session.edits.is_saved and not again.session.edits.can_undo


@pytest.mark.parametrize(
    "path, value, message",
    [
        ("/World/Gone.inputs:intensity", 1.0, "has no prim /World/Gone"),
        ("/World/Lamp.photonbeams:cuont", 3, "has no attribute photonbeams:cuont"),
        ("/World/Lamp", 1.0, "expected /prim.attribute"),
        ("not a path", 1.0, "expected /prim.attribute"),
        (INTENSITY, "bright", "expected a finite number"),
        (INTENSITY, float("nan"), "expected a finite number"),
        (INTENSITY, True, "expected a finite number"),
        (INTENSITY, 10**400, "expected a finite number"),
        (TINT, [1.0, -(10**5000), 1.0], "expected a finite number"),  # Python refuses to print so many digits
        ("/World/Lamp.photonbeams:count", 10**400, "expected a whole number"),
        (TINT, [1.0, 2.0], "expected 3 numbers"),
        (TINT, 1.0, "expected 3 numbers"),
        ("/World/Lamp.photonbeams:count", 1.5, "expected a whole number"),
        ("/World/Lamp.photonbeams:enabled", 1, "expected true or false"),
        ("/World/Look.photonbeams:along:ramp:knots", 1.0, "expected a list"),
        ("/World/Lamp.photonbeams:look", "/World/Look", "expected a list of paths"),
        ("/World/Lamp.photonbeams:look", ["Look"], "expected the paths of prims"),
        ("/World/Look.photonbeams:along:expression", 3.0, "expected a text"),
    ],
)
def test_values_that_cannot_be_set_are_refused_and_change_nothing(refusing, path, value, message):
    text = refusing.edits.text()
    with pytest.raises(pb.SceneError, match=message):
        refusing.edit({INTENSITY: 7.0, path: value})
    assert refusing.edits.text() == text and not refusing.edits.can_undo


def test_what_cannot_be_rendered_is_told_in_a_sentence_and_the_session_lives(stage):
    expression = "/World/Look.photonbeams:along:expression"
    with Watched(stage) as shown:
        plain = shown.finished()
        text = shown.problem(shown.session.edit({"/World/Look.photonbeams:across:values": [1.0],
                                                 "/World/Look.photonbeams:across:profile": "tabulated"}))  # fmt: skip
        assert "expects two values or more" in text
        shown.session.undo()
        assert are_equal(shown.finished(), plain)
        text = shown.problem(shown.session.edit({expression: "s * (1 +"}))
        assert "column" in text and "physical look" not in text  # the last picture stays
        shown.session.edit({expression: ""})
        shown.finished()


def test_a_free_camera_is_where_it_is_far_from_zero(stage, tmp_path):
    """A stage at survey coordinates is measured from a point near it, as its cameras are; see `scene.places`."""
    place = np.array([691000.0, 5334000.0, 520.0])
    moved = f"double3 xformOp:translate = {tuple(place.tolist())}"
    order = 'uniform token[] xformOpOrder = ["xformOp:translate"]'
    path = tmp_path / "far.usda"
    path.write_text(STAGE.replace('def Xform "World"\n{', f'def Xform "World"\n{{\n    {moved}\n    {order}'))
    pictures = []
    for file, away in ((stage, np.zeros(3)), (path, place)):
        pose = np.eye(4)
        pose[:3, 3] = np.add(away, (0.3, 0.1, 3.0))
        with Watched(file) as shown:
            shown.finished(shown.session.show(pose=pose))
            pictures.append(shown.finished(shown.session.edit({PLACE: [-0.8, 0.2, 0]}))["rgba"])
    near, far = pictures
    # Rounding in single precision, on the same light paths.
    assert np.abs(near - far).mean() < 1e-2 * near.mean()


def test_a_free_camera_sees_what_the_stages_camera_would_from_there(stage, tmp_path):
    pose = np.eye(4)
    pose[:3, 3] = 0.3, 0.1, 3.0
    with Watched(stage) as shown:
        plain = shown.finished()
        free = shown.finished(shown.session.show(pose=pose))
        there = shown.finished(shown.session.edit({"/World/Camera.xformOp:translate": [0.3, 0.1, 3.0]}))
        np.testing.assert_array_equal(free["depth"], there["depth"])
        shown.session.undo()
        assert are_equal(shown.finished(shown.session.show(pose=None)), plain)


def test_a_pixel_tells_of_the_beams_in_it_and_how_the_brightest_is_integrated(stage):
    with Watched(stage, view=replace(VIEW, passes=1)) as shown:
        layers = shown.wait(shown.session.version, lambda each: each.scale == 1).layers
        row, column = np.unravel_index(np.argmax(layers["beams"][:, :20].mean(axis=2)), (27, 20))
        at = ((column + 0.5) / 48, (row + 0.5) / 27)
        beams, ray = shown.session.inspect(at, float(layers["depth"][row, column].ravel()[0]))
        nothing = shown.session.inspect((2.0, 0.0))
    (light,) = beams
    assert light.light == "/World/Lamp" and light.fraction == 1
    # The picture's ray passes through another place in the pixel, and the beam is only a few pixels wide.
    np.testing.assert_allclose(light.radiance, layers["beams"][row, column], rtol=0.5)
    assert ray.interval[0] < ray.interval[1] and len(ray.s) == len(ray.integrand)
    gauss, riemann = (np.abs(each.error) for each in (ray.gauss, ray.riemann))
    # Along a chord the kernel is a polynomial of degree two, and all else is smooth: six points leave only rounding.
    assert gauss[5] < 1e-4 < riemann[5]
    assert [len(each) for each in ray.gauss.points] == [1, 2, 3, 4, 5, 6]
    assert nothing == ([], None)


@pytest.mark.parametrize(
    "changes, message",
    [({"width": 0}, "expected 1 to"), ({"pose": [1, 2]}, "expected 16 numbers"),
     ({"pose": np.zeros((4, 4))}, "is no transform"), ({"pose": "here"}, "expected 16 numbers")],
)  # fmt: skip
def test_views_that_cannot_be_shown_are_refused(refusing, changes, message):
    view = refusing.view
    with pytest.raises(pb.SceneError, match=message):
        refusing.show(**changes)
    assert refusing.view is view


def test_overrides_of_the_command_line_are_weaker_than_edits(stage):
    with Watched(stage, overrides=[f"{INTENSITY}=1"]) as shown:
        dim = shown.finished()["beams"].mean()
        bright = shown.finished(shown.session.edit({INTENSITY: 4.0}))["beams"].mean()
    assert bright == pytest.approx(4 * dim, rel=1e-3)
    assert Path(stage).read_text() == STAGE


def test_pictures_of_few_passes_are_denoised_and_the_finished_one_is_that_of_a_render(stage, monkeypatch):
    """After an edit of a look the surfaces are unchanged and are not denoised again."""
    calls, filtered = [], denoising._filtered
    monkeypatch.setattr(denoising, "_filtered", lambda *given: calls.append(1) or filtered(*given))

    def of_one_pass():
        version = shown.session.version
        return [each.layers for each in shown.told if (each.version, each.passes) == (version, 1)]

    with Watched(stage, view=replace(VIEW, denoise=True)) as shown:
        finished = shown.finished()
        first, second = of_one_pass()
        for values, count in (({TINT: [0.2, 0.5, 1.0]}, 0), ({INTENSITY: 35.0}, 2)):
            calls.clear()
            after = shown.finished(shown.session.edit(values))
            assert len(calls) == count and not np.array_equal(after["beams"], finished["beams"])
            pairs = zip(of_one_pass(), (first, second), strict=True)
            same = [np.array_equal(each["surface"], before["surface"]) for each, before in pairs]
            assert same == [count == 0] * 2
    part = pb.Shot.open(stage).render_part(PlannedPasses(range(1), 2), width=48, height=27, denoise=True)
    kept = Development.of(part.development)
    denoised, noisy = (
        replace(kept, settings=replace(kept.settings, denoise=each)).frame(part) for each in (True, False)
    )  # fmt: skip
    assert are_equal(second, denoised.layers) and not are_equal(second, noisy.layers)
    assert are_equal(finished, rendered(stage))


ROOM = """
    def Cube "Room"
    {
        double size = 12
    }
}
"""


def test_light_bounces_in_rooms_until_that_is_switched_off(stage, tmp_path):
    """Most of what surfaces scatter comes from other surfaces in a room, and from the sky around the ball alone."""
    room, own = tmp_path / "room.usda", tmp_path / "own.usda"
    room.write_text(STAGE.rstrip().removesuffix("}") + ROOM)
    medium = "color3f photonbeams:scattering"
    own.write_text(room.read_text().replace(medium, f"int photonbeams:bounces = 1\n        {medium}"))
    for path, bounces, usual in ((room, 3, 3), (own, 1, 1), (stage, 0, 3)):
        with Watched(path) as shown:
            finished = shown.finished()
            assert shown.session.bounces() == (bounces, usual)
            command = pb.Shot.open(path).render(passes=2, width=48, height=27, max_depth=bounces + 2)
            assert are_equal(finished, command.layers)
            flags = shown.session.wanted(2).flags
            assert ("--bounces" in flags) == (path == room) and ("3" in flags) == (path == room)
            direct = shown.finished(shown.session.show(bounces=0))
            assert shown.session.bounces() == (0, usual)
            assert are_equal(direct, finished) == (path == stage)
            if path == room:
                assert np.median(direct["surface"]) < 0.9 * np.median(finished["surface"])
    with Watched(room) as shown, pytest.raises(pb.SceneError, match="bounces is -2: expected 0 to 65536, or -1"):
        shown.session.show(bounces=-2)


def test_while_pictures_rest_an_edit_has_its_first_picture_and_no_further_passes(stage):
    with Watched(stage) as shown:
        with shown.session.resting():
            version = shown.session.edit({INTENSITY: 40.0})
            shown.wait(version, lambda each: each.is_first)
            time.sleep(0.5)  # many times as long as the passes take
            assert all(each.is_first for each in shown.told if each.version == version)
        shown.finished(version)


def test_later_pictures_are_few_where_they_are_denoised(stage, monkeypatch):
    monkeypatch.setattr(viewing, "_EACH", 2)
    monkeypatch.setattr(viewing, "_ONE_OF", 3)
    for denoise, passes in ((True, [1, 2, 3, 6, 7]), (False, [1, 2, 3, 4, 5, 6, 7])):
        with Watched(stage, view=replace(VIEW, passes=7, denoise=denoise)) as shown:
            shown.finished()
            assert [each.passes for each in shown.told if not each.is_first] == passes


@pytest.mark.parametrize("axis", ["Y", "Z"])
def test_the_up_axis_is_the_stages(tmp_path, axis):
    path = tmp_path / "shot.usda"
    path.write_text(STAGE.replace('defaultPrim = "World"', f'defaultPrim = "World"\n    upAxis = "{axis}"'))
    with Session(path, view=VIEW) as session:
        assert session.up() == axis


def test_a_mitsuba_scene_is_refused_with_what_to_do_instead(tmp_path):
    with pytest.raises(pb.SceneError, match=r"scene\.xml is a Mitsuba scene.*`photonbeams render`") as refused:
        Session(tmp_path / "scene.xml")
    assert len(str(refused.value)) < 300


def test_a_listener_that_fails_ends_neither_the_session_nor_other_listeners(stage, caplog):
    with Watched(stage) as shown:

        def failing(_):
            raise RuntimeError("a listener's own fault")

        end = shown.session.listen(failing)
        shown.finished(shown.session.edit({INTENSITY: 7.0}))
        end(), end()
        shown.finished(shown.session.edit({INTENSITY: 8.0}))
    assert "a listener of the session failed" in caplog.text


def test_a_small_picture_of_few_light_paths_is_not_the_finished_one(stage):
    """A view with one pass, no larger than first pictures are, has a first picture and then a finished one."""
    with Watched(stage, view=SessionView(width=48, height=27, passes=1, denoise=False)) as shown:
        version = shown.session.version
        first = shown.wait(version, lambda each: True)
        last = shown.wait(version, lambda each: each.is_finished)
    assert first.is_first and not first.is_finished and first.scale == last.scale == 1


def test_a_program_that_ends_with_an_open_session_ends_well(stage):
    """A program that ends while a picture is rendered does not abort the interpreter."""
    program = (
        "import sys, threading; from photonbeams.studio.session import Session, SessionView\n"
        "view = SessionView(width=48, height=27, passes=5000, denoise=False)\n"
        "session, came = Session(sys.argv[1], view=view), threading.Event()\n"
        "session.listen(lambda told: came.set()); session.show()\n"
        "assert came.wait(120)\n"
    )
    done = subprocess.run([sys.executable, "-c", program, str(stage)], capture_output=True, text=True, timeout=200)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(("most", "count"), [(9, 2), (1, 1)])
def test_a_frame_that_is_unwanted_ends_between_two_sets_of_beams(tmp_path, monkeypatch, most, count):
    """An unwanted frame ends within a phase: after the first set is gathered, the second one is not."""
    path, gathered, estimate = tmp_path / "two.usda", [], gathering.estimate_image
    lamp = STAGE[STAGE.index("    def SphereLight") : STAGE.index("    def PhotonBeamsLook")]
    path.write_text(STAGE.replace(lamp, lamp + lamp.replace('"Lamp"', '"Other"')))

    def counted(*given, **named):
        gathered.append(1)
        return estimate(*given, **named)

    monkeypatch.setattr(gathering, "estimate_image", counted)
    with Session(path, view=replace(VIEW, paused=True)) as session:
        live = session._live
        frame, _ = live.begun(session.view, live._whole, 1.0, lambda: len(gathered) >= most)
        with pytest.raises(Cancelled) if most == 1 else nullcontext():
            frame.add_pass(0)
    assert len(gathered) == count
