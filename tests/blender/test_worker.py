"""The renderer that Blender starts: its pictures, and how it is cancelled, ended, and told what is wrong."""

import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager

import numpy as np
import pytest

import photonbeams as pb
from photonbeams.blender.extension import messages
from photonbeams.usd.authoring.prims import new_stage, write_prims
from tests.blender.scene import CAMERA, prims

SIZE = {"width": 32, "height": 18, "crop": None}
SETTINGS = {"passes": 2, "beams": 256}


class Renderer:
    def __init__(self, process):
        self.process = process

    def send(self, do, **content):
        messages.write(self.process.stdin, {"do": do, **content})

    def until(self, kind):
        """Return the messages up to the first one of a kind."""
        found = []
        while (message := messages.read(self.process.stdout)) is not None:
            found.append(message)
            if message["is"] == kind:
                return found
        raise AssertionError(f"the renderer ended before {kind}: {found}")

    def picture(self, number=1, **given):
        self.send("render", number=number, camera=CAMERA, **SIZE, settings={**SETTINGS, **given})
        return self.until("end")


@contextmanager
def renderer():
    command = [sys.executable, "-m", "photonbeams.blender.worker"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        yield Renderer(process)
        process.stdin.close()
        assert process.wait(20) == 0


@pytest.fixture(scope="module")
def warm():
    """A renderer that has the scene."""
    with renderer() as found:
        assert found.until("ready")[-1]["version"] == pb.__version__
        found.send("scene", prims=prims(), whole=True)
        yield found


def shot(**given):
    stage = new_stage("Z", 1.0)
    write_prims(stage, prims(**given))
    return pb.Shot(stage, CAMERA)


def test_a_picture_has_the_bits_of_a_shot(warm):
    found = warm.picture()
    assert found[-1] == {"is": "end", "number": 1, "problem": None}
    progress = [each["done"] for each in found if each["is"] == "progress"]
    assert progress == [0, 1, 2]
    *_, picture = (each for each in found if each["is"] == "picture")
    expected = shot().render(width=32, height=18, **SETTINGS).layers
    assert picture["layers"].keys() == expected.keys() and "beams_key" in expected
    assert all(np.array_equal(each, picture["layers"][name]) for name, each in expected.items())


def test_an_edit_sends_what_changed_alone(warm):
    warm.send("scene", prims=[each for each in prims(30.0) if each["path"] == "/Lamp"])
    *_, picture, _ = warm.picture()
    warm.send("scene", prims=[each for each in prims() if each["path"] == "/Lamp"])
    expected = shot(intensity=30.0).render(width=32, height=18, **SETTINGS).layers["rgba"]
    assert np.array_equal(picture["layers"]["rgba"], expected)


def test_a_render_is_cancelled_within_a_second_and_the_next_one_is_whole(warm):
    warm.send("render", number=7, camera=CAMERA, **SIZE, settings={**SETTINGS, "passes": 100_000})
    warm.until("progress")
    begin = time.monotonic()
    warm.send("cancel", number=7)
    found = warm.until("end")
    assert time.monotonic() - begin < 1.0
    assert found[-1] == {"is": "end", "number": 7, "problem": None}
    assert [each["is"] for each in warm.picture(8)][-2:] == ["picture", "end"]


def test_a_render_that_is_cancelled_before_it_began_is_not_rendered(warm):
    for number in (20, 21):
        warm.send("render", number=number, camera=CAMERA, **SIZE, settings={**SETTINGS, "passes": 100_000})
    warm.send("cancel", number=21)
    assert [warm.until("end")[-1]["number"] for _ in range(2)] == [20, 21]


@pytest.mark.parametrize(("given", "sentence"), [({"passes": 0}, "passes"), ({"pases": 1}, "pases is not a setting")])
def test_what_is_wrong_is_a_sentence(warm, given, sentence):
    end = warm.picture(30, **given)[-1]
    assert sentence in end["problem"] and len(end["problem"]) <= 300


VIEW = {"width": 320, "height": 180, "passes": 2, "denoise": False, "bounces": 0}


def test_a_view_shows_a_small_picture_and_whole_ones(warm):
    warm.send("view", number=40, camera=CAMERA, view=VIEW)
    *pictures, end = (each for each in warm.until("end") if each["is"] != "warning")
    assert [(each["scale"] < 1, each["done"], each["layers"]["rgba"].shape) for each in pictures] == [
        (True, 1, (90, 160, 4)), (False, 1, (180, 320, 4)), (False, 2, (180, 320, 4)),
    ]  # fmt: skip
    assert end == {"is": "end", "number": 40, "problem": None}
    expected = shot().render(width=320, height=180, passes=2, max_depth=2).layers["rgba"]
    assert np.array_equal(pictures[-1]["layers"]["rgba"], expected)


def test_a_view_ends_when_another_comes(warm):
    for number in (41, 42):
        warm.send("view", number=number, camera=CAMERA, view={**VIEW, "passes": 10_000 if number == 41 else 1})
    found = warm.until("end") + warm.until("end")
    assert [each["number"] for each in found if each["is"] == "end"] == [41, 42]
    assert [each["done"] for each in found if each["is"] == "picture" and each["number"] == 42] == [1, 1]


def test_a_finished_view_is_denoised_if_that_is_wanted(warm):
    given = {"passes": 2, "max_depth": 2, "width": 320, "height": 180}
    warm.send("view", number=43, camera=CAMERA, view={**VIEW, "denoise": True})
    *_, last, _ = warm.until("end")
    raw, denoised = (shot().render(denoise=each, **given).layers["rgba"] for each in (False, True))
    assert np.abs(last["layers"]["rgba"] - denoised).mean() < 0.1 * np.abs(raw - denoised).mean()


def test_warnings_are_told(warm):
    values = {"inputs:texture:file": ["asset", "/nowhere.exr"]}
    warm.send("scene", prims=[{"path": "/Sky", "name": "World", "type": "DomeLight", "values": values}])
    found = warm.picture(31)
    warm.send("scene", prims=[], removed=["/Sky"])
    (text,) = (each["text"] for each in found if each["is"] == "warning")
    assert text.startswith("World: image names /nowhere.exr")
    assert found[-1]["problem"] is None


def test_a_scene_without_fog_or_light_is_told_in_blenders_words(warm):
    warm.send("scene", prims=[], removed=["/Fog"])
    (text,) = (each["text"] for each in warm.picture(32) if each["is"] == "warning")
    assert "no fog" in text and "expected World > Volume" in text
    warm.send("scene", prims=[], removed=["/Lamp"])
    end = warm.picture(33)[-1]
    warm.send("scene", prims=prims(), whole=True)
    assert "no light" in end["problem"] and "expected a lamp" in end["problem"]


def test_a_look_that_leaves_values_out_has_the_defaults_of_the_schema(warm):
    """The process knows the schemas before its first stage: without them, the list `noise:drift` has no default."""
    tint = {"photonbeams:along:tint": ["color3f", [1.0, 0.5, 0.0]]}
    (lamp,) = (each for each in prims() if each["path"] == "/Lamp")
    warm.send("scene", prims=[{"path": "/Look", "type": "PhotonBeamsLook", "values": tint},
                              {**lamp, "targets": {"photonbeams:look": ["/Look"]}}])  # fmt: skip
    found = warm.picture(32)
    warm.send("scene", prims=[lamp], removed=["/Look"])
    assert not [each for each in found if each["is"] == "warning"]
    *_, picture, _ = found
    red, green, blue = picture["layers"]["beams"].mean(axis=(0, 1))
    assert green == pytest.approx(red / 2, rel=1e-4) and blue == 0


def test_a_renderer_ends_when_blender_does():
    with renderer() as found:
        found.until("ready")
        found.send("scene", prims=prims(), whole=True)
        found.send("render", number=1, camera=CAMERA, **SIZE, settings={**SETTINGS, "passes": 100_000})
        found.until("progress")
        begin = time.monotonic()
        os.kill(found.process.pid, signal.SIGINT)  # Ctrl-C in Blender's terminal reaches both: Blender decides
        found.process.stdin.close()
        assert found.process.wait(20) == 0 and time.monotonic() - begin < 5
