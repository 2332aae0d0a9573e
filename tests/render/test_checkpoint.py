"""Checkpoints: a resumed render equals an uninterrupted one; a checkpoint of another render is refused."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from photonbeams import scene
from photonbeams.beams.modify import recolor
from photonbeams.beams.programs import Program
from photonbeams.render import scene_frame
from photonbeams.render.checkpoint import Checkpoint, check_passes
from photonbeams.render.memory import check_memory
from photonbeams.render.passes import RunOptions
from photonbeams.render.settings import Settings
from photonbeams.render.stage_frame import render
from photonbeams.scene import SceneError
from photonbeams.world.cameras.cameras import Window
from photonbeams.world.shutter import Moment, Shutter
from tests.helpers.mitsuba_pictures import LAMP
from tests.helpers.mitsuba_scenes import camera, cube_of, fog, load

CAMERA = scene.Camera(
    "/camera", to_world=np.eye(4), focal_length=1.0, horizontal_aperture=1.2, vertical_aperture=0.8, lens_radius=0.1,
    focus_distance=4.0,
)  # fmt: skip
WINDOW = Window.full(24, 16)


def shutter(moving, *cameras):
    """Return the shutter of a shot: a wall and two groups of drawn beams, one of which moves if `moving` is true."""
    wall = scene.Mesh("/wall", np.array([[-9.0, -9, -9], [9, -9, -9], [0, 9, -9]]), np.array([[0, 1, 2]]))
    still = drawn("/a", "key", 0.0)

    def at(fraction):
        other = drawn("/b", "fill", fraction if moving else 0.0)
        content = scene.Scene((wall,), (), (still, other), (scene.Medium(scattering=(0.2, 0.2, 0.2)),))
        return Moment(content, cameras or (CAMERA,))

    return Shutter(at, moving=True) if moving else Shutter.still(*at(0.0)[:1], *(cameras or (CAMERA,)))


def drawn(name, group, shift):
    start, end = np.array([[-1.0 + shift, -0.6, -4.0]]), np.array([[1.2, 0.7 + shift, -5.0]])
    return scene.DrawnBeams(name, start, end, np.full(1, 0.1), np.full(1, 0.15), np.ones((1, 3)), group=group)


class Stop(KeyboardInterrupt):
    """Stands for Ctrl-C after some passes."""


def stopping(after):
    def progress(done, _):
        if done == after:
            raise Stop

    return progress


@pytest.mark.parametrize("moving", [False, True], ids=["still", "moving"])
@pytest.mark.parametrize("pixel_filter", [None, "mitchell"])
def test_a_stage_goes_on_to_the_bits_of_an_unbroken_render(tmp_path, moving, pixel_filter):
    eyes = CAMERA, dataclasses.replace(CAMERA, to_world=np.eye(4) + np.eye(4, k=3) * 0.1)
    settings = Settings(passes=5, pixel_filter=pixel_filter)
    given = shutter(moving, *eyes), WINDOW, settings
    whole = render(*given)
    for after in (2, 4):
        with pytest.raises(Stop):
            render(*given, RunOptions(stopping(after), Checkpoint(tmp_path / "a.npz", 1e9)))
    resumed = render(*given, RunOptions(checkpoint=Checkpoint(tmp_path / "a.npz")))
    groups = ["beams_fill", "beams_key", "surface_default", "surface_fill", "surface_key"]
    assert list(whole.layers()) == ["rgba", "surface", "beams", *groups, "transmittance", "depth"]
    assert whole.layers()["beams_fill"].any() and whole.layers()["beams_key"].any()
    for before, after in zip(whole.views(), resumed.views(), strict=True):
        assert all(np.array_equal(before[name], after[name]) for name in before)
    assert not np.array_equal(whole.views()[0]["beams"], whole.views()[1]["beams"])
    counts = [(each.passes, each.beams, each.tests, each.error) for each in (whole.statistics, resumed.statistics)]
    assert counts[0] == counts[1]


@pytest.mark.parametrize("name", ["box", "gaussian"])
def test_a_mitsuba_scene_goes_on_to_the_bits_of_an_unbroken_render(tmp_path, name):
    content = load(fog=cube_of(fog(0.5)), light=LAMP, sensor=camera(rfilter={"type": name}))
    given = content, content.sensors()[0], Settings(passes=4, beams=1024, method="beams")
    whole = scene_frame.render(*given)
    with pytest.raises(Stop):
        scene_frame.render(*given, RunOptions(stopping(2), Checkpoint(tmp_path / "a.npz", 1e9)))
    resumed = scene_frame.render(*given, RunOptions(checkpoint=Checkpoint(tmp_path / "a.npz")))
    assert all(np.array_equal(each, resumed.layers()[layer]) for layer, each in whole.layers().items())
    assert resumed.error() == whole.error()


def test_more_passes_go_on_where_samples_do_not_depend_on_their_number(tmp_path):
    kept = tmp_path / "a.npz"
    with pytest.raises(Stop):
        render(shutter(False), WINDOW, Settings(passes=3), RunOptions(stopping(3), Checkpoint(kept, 1e9)))
    longer = render(shutter(False), WINDOW, Settings(passes=4), RunOptions(checkpoint=Checkpoint(kept)))
    whole = render(shutter(False), WINDOW, Settings(passes=4))
    assert all(np.array_equal(whole.layers()[name], longer.layers()[name]) for name in whole.layers())


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 1}, {"beams": 8}, {"pixel_filter": "tent"}, {"estimator": "frustum"},
        {"program": Program(recolor((1, 1, 0.5)))}, {"program": None},
    ],
    ids=["seed", "beams", "filter", "estimator", "another program", "no program"],
)  # fmt: skip
def test_passes_of_other_settings_are_refused(tmp_path, change):
    kept, settings = tmp_path / "a.npz", Settings(passes=3, program=Program(recolor((1, 0.5, 1))))
    with pytest.raises(Stop):
        render(shutter(False), WINDOW, settings, RunOptions(stopping(1), Checkpoint(kept, 1e9)))
    with pytest.raises(SceneError, match="the checkpoint of another scene or of other settings"):
        render(shutter(False), WINDOW, dataclasses.replace(settings, **change), RunOptions(checkpoint=Checkpoint(kept)))


def test_passes_of_another_content_camera_window_or_shutter_are_refused(tmp_path):
    kept, settings = tmp_path / "a.npz", Settings(passes=3)
    moving = shutter(True)
    with pytest.raises(Stop):
        render(moving, WINDOW, settings, RunOptions(stopping(1), Checkpoint(kept, 1e9)), content="a")
    other = shutter(True, dataclasses.replace(CAMERA, focal_length=2.0))
    crop = dataclasses.replace(WINDOW, crop=(0, 0, 24, 15))
    for given, content in [
        ((moving, WINDOW, settings), "b"), ((other, WINDOW, settings), "a"), ((moving, crop, settings), "a"),
        ((shutter(False), WINDOW, settings), "a"),
    ]:  # fmt: skip
        with pytest.raises(SceneError, match="the checkpoint of another scene or of other settings"):
            render(*given, RunOptions(checkpoint=Checkpoint(kept)), content=content)
    assert render(moving, WINDOW, settings, RunOptions(checkpoint=Checkpoint(kept)), content="a").statistics.passes == 3


def test_a_checkpoint_is_written_when_it_is_due_and_not_after_the_last_pass(tmp_path):
    seen = []

    def progress(done, _):
        seen.append((done, kept.passes))

    kept = Checkpoint(tmp_path / "a.npz", 1e-9)
    render(shutter(False), WINDOW, Settings(passes=3), RunOptions(progress, kept))
    assert seen == [(0, 0), (1, 1), (2, 2), (3, 2)] and kept.passes == 2
    kept.remove()
    assert not kept.path.exists()
    never = Checkpoint(tmp_path / "b.npz", None)
    with pytest.raises(Stop):
        render(shutter(False), WINDOW, Settings(passes=3), RunOptions(stopping(2), never))
    assert not never.path.exists()


def test_without_resume_a_render_begins_anew(tmp_path):
    with pytest.raises(Stop):
        render(shutter(False), WINDOW, Settings(passes=3), RunOptions(stopping(2), Checkpoint(tmp_path / "a", 1e9)))
    begun = []
    again = Checkpoint(tmp_path / "a", 1e9, resume=False)
    render(shutter(False), WINDOW, Settings(passes=3), RunOptions(lambda done, _: begun.append(done), again))
    assert begun == [0, 1, 2, 3]


@pytest.mark.parametrize("content", [b"nothing", b"PK\x05\x06" + bytes(18), b""])
def test_a_file_that_is_no_checkpoint_is_refused(tmp_path, content):
    (tmp_path / "a.npz").write_bytes(content)
    with pytest.raises(SceneError, match=r"a\.npz: expected a checkpoint of photonbeams"):
        Checkpoint(tmp_path / "a.npz").begin("a")


def test_seconds_that_are_none_are_refused(tmp_path):
    for every in (0, -1.0, "5", float("nan")):
        with pytest.raises(SceneError, match="expected a positive number of seconds, or None"):
            Checkpoint(tmp_path / "a.npz", every)


def test_passes_cannot_be_taken_out_of_a_checkpoint():
    done = SimpleNamespace(ranges=lambda: [range(0, 8)])
    check_passes("a.checkpoint", done, 8)
    check_passes("a.checkpoint", done, None)
    with pytest.raises(SceneError, match=r"a\.checkpoint: has passes up to 8, and 7 are asked for"):
        check_passes("a.checkpoint", done, 7)


def test_a_film_that_no_memory_holds_is_refused_before_it_is_made(monkeypatch):
    with pytest.raises(SceneError, match="100000 x 100000 pixels are more than"):
        check_memory(Window.full(100_000, 100_000), 1)
    monkeypatch.setattr("photonbeams.render.memory.memory", lambda: 2**20)
    with pytest.raises(SceneError, match="expected fewer, or a part of the picture with --crop"):
        check_memory(Window.full(1000, 1000), 1)
    monkeypatch.setattr("photonbeams.render.memory.memory", lambda: 2**30)
    check_memory(Window.full(1000, 1000), 1)
    with pytest.raises(SceneError, match="1000 x 1000 pixels of 30 light groups"):
        check_memory(Window.full(1000, 1000), 1, 30)
