"""`photonbeams render` of stages with checkpoints, pixel filters and bounces."""

import os
import signal

import numpy as np
import pytest

from photonbeams.cli.progress import held_signals
from photonbeams.images.files import read_layers
from photonbeams.render.frame import FrameRenderer
from tests.helpers.commands import fails, untouched
from tests.helpers.small_stage import CAMERA, FILL, FLOOR, FOG, KEY, write_stage

SMALL = ("--res", 24, 0, "--passes", 3, "--beams", 64, "--progress", "none")


@pytest.fixture
def stage(tmp_path):
    """Return a stage with two light groups, one of which moves while the shutter is open."""
    camera = CAMERA.replace("float focal", "double shutter:close = 0.5\n    float focal", 1)
    return write_stage(tmp_path / "stage.usda", FOG, camera, KEY, FILL, FLOOR, metadata="startTimeCode = 1")


def interrupted(monkeypatch, after, sent=signal.SIGINT):
    """Send the signal of Ctrl-C, or another one, when so many passes of all frames are done."""
    add_pass, done = FrameRenderer.add_pass, []

    def pressed(self, number):
        add_pass(self, number)
        done.append(number)
        if len(done) == after:
            os.kill(os.getpid(), sent)

    monkeypatch.setattr(FrameRenderer, "add_pass", pressed)


def test_frames_of_two_eyes_go_on_where_ctrl_c_ended_them(render, stage, out, monkeypatch):
    flags = (*SMALL, "-f", "1:3", "--passes", 3, "--stereo", "--interaxial", 0.2, "--convergence", 5)
    assert render(stage, "-o", out / "whole.#.exr", *flags)[0] == 0
    with monkeypatch.context() as patched:
        interrupted(patched, 5)
        result = render(stage, "-o", out / "a.#.exr", *flags, "--checkpoint", 1000)
    kept = out / "a.2.checkpoint"
    told = f"1 frame was written, {kept} has 2 passes: --skip-existing --resume go on from there"
    assert (result[0], result[2].splitlines()[-1]) == (130, f"Interrupted; {told}")
    assert (out / "a.1.exr").exists() and kept.exists() and not (out / "a.2.exr").exists()
    asked = (stage, "-o", out / "a.#.exr", *flags, "--resume", "--skip-existing")
    fails(render(*asked, "--seed", 8, "-q"), 1, "frame 2: ", str(kept), "of another scene or of other settings")
    assert kept.exists()
    assert render(*asked)[0] == 0 and not kept.exists()
    for number in (1, 2, 3):
        for view in ("left", "right"):
            whole, resumed = (read_layers(out / f"{name}.{number}.exr", view) for name in ("whole", "a"))
            assert {"beams_key", "beams_fill"} <= set(whole) == set(resumed)
            assert all(np.array_equal(each, resumed[layer]) for layer, each in whole.items())


@pytest.mark.parametrize(("name", "code"), [("SIGTERM", 143), ("SIGHUP", 129)])
def test_a_signal_ends_a_render_as_ctrl_c_does(render, stage, out, monkeypatch, name, code):
    number = getattr(signal, name)
    with monkeypatch.context() as patched:
        interrupted(patched, 2, number)
        result = render(stage, "-o", out / "a.exr", *SMALL, "--checkpoint", 1000)
    kept = out / "a.checkpoint"
    assert result == (code, "", f"Ended by {name}; {kept} has 2 passes: --resume goes on from there\n")
    assert signal.getsignal(number) == signal.SIG_DFL
    fails(render(stage, "-o", out / "a.exr", *SMALL, "--passes", 1, "--resume"), 1, str(kept),
          "has passes up to 2, and 1 are asked for: expected at least 2, or no --resume")  # fmt: skip
    assert render(stage, "-o", out / "a.exr", *SMALL, "--passes", 1)[0] == 0 and kept.exists()
    assert render(stage, "-o", out / "a.exr", *SMALL, "--passes", 2, "--resume")[0] == 0 and not kept.exists()


def test_an_ended_render_tells_of_its_snapshot(render, stage, out, monkeypatch):
    interrupted(monkeypatch, 2)
    result = render(stage, "-o", out / "a.exr", *SMALL, "--snapshot", 1e-9)
    assert result[0] == 130 and result[2].endswith(f"Interrupted; wrote {out / 'a.snapshot.exr'}\n")


@pytest.mark.parametrize("name", ["a.snapshot.exr", "a.checkpoint"])
def test_files_of_others_are_no_snapshots_and_checkpoints(render, stage, out, name):
    """Those of the program are replaced and, at the end, removed."""
    (out / name).write_bytes(b"\x76\x2f\x31\x01 of somebody else")
    told = f"{out / name} would be removed: expected a {'snapshot' if 'snap' in name else 'checkpoint'} of photonbeams"
    fails(render(stage, "-o", out / "a.exr", *SMALL, "--checkpoint", 9), 1, told)
    assert (out / name).read_bytes().endswith(b"else")


def test_what_nohup_ignores_stays_ignored(monkeypatch):
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with held_signals() as check:
            assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
            assert signal.getsignal(signal.SIGTERM) != signal.SIG_DFL
            os.kill(os.getpid(), signal.SIGHUP)
            check()
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_changed_stage_look_or_function_is_refused(render, stage, out, monkeypatch):
    monkeypatch.chdir(out)
    mine = out / "mine.py"
    mine.write_text("import photonbeams as pb\nred = pb.recolor((1, 0, 0))\ngreen = pb.Look(along='[0, 1, 0]')\n")
    asked = (stage, "-o", "a.exr", *SMALL, "--simulate", "mine.py:red", "--look", "mine.py:green")
    with monkeypatch.context() as patched:
        interrupted(patched, 1)
        assert render(*asked, "--checkpoint", 1000)[0] == 130
    texts = {mine: ("(1, 0, 0)", "(1, 0, 1)"), stage: ("inputs:intensity = 10", "inputs:intensity = 11")}
    for path, (old, new) in texts.items():
        before = path.read_text()
        path.write_text(before.replace(old, new))
        assert path.read_text() != before
        fails(render(*asked, "--resume"), 1, "a.checkpoint", "of another scene or of other settings")
        path.write_text(before)
    mine.write_text(mine.read_text().replace("[0, 1, 0]", "[0, 1, 1]"))
    fails(render(*asked, "--resume"), 1, "a.checkpoint", "of another scene or of other settings")
    mine.write_text(mine.read_text().replace("[0, 1, 1]", "[0, 1, 0]"))
    assert render(*asked, "--resume")[0] == 0


def test_a_file_that_is_no_checkpoint_is_named(render, stage, out):
    (out / "a.checkpoint").write_bytes(b"nothing")
    fails(render(stage, "-o", out / "a.exr", "--resume", *SMALL), 1, "a.checkpoint", "expected a checkpoint")
    (out / "a.checkpoint").unlink()
    fails(render(stage, "-o", out / "a.exr", "--checkpoint", 0), 2, "--checkpoint is 0.0: expected a positive")
    assert untouched(out)


def test_progress_tells_the_error_of_a_stage(render, stage, out):
    code, _, stderr = render(stage, "-o", out / "a.exr", *SMALL, "--passes", 2, "--progress", "plain")
    lines = stderr.splitlines()
    assert code == 0 and lines[:2] == ["pass 0 of 2", "pass 1 of 2"]
    assert lines[2].startswith("pass 2 of 2, error ") and any(line.startswith("error ") for line in lines)


def test_a_filter_is_the_flags_or_that_of_the_render_settings(render, stage, out):
    settings = 'def RenderSettings "Settings" {\n    token photonbeams:pixelFilter = "gaussian"\n}\n'
    stage.write_text(stage.read_text() + settings)
    asked = {
        "box": (), "settings": ("-rs", "/Settings"), "flag": ("--filter", "gaussian"),
        "both": ("-rs", "/Settings", "--filter", "box"),
    }  # fmt: skip
    for name, flags in asked.items():
        assert render(stage, "-o", out / f"{name}.exr", *SMALL, "--passes", 1, *flags)[0] == 0
    found = {name: read_layers(out / f"{name}.exr")["rgba"] for name in asked}
    assert np.array_equal(found["settings"], found["flag"]) and np.array_equal(found["box"], found["both"])
    assert not np.array_equal(found["box"], found["flag"])
    stage.write_text(stage.read_text().replace('"gaussian"', '"sinc"'))
    fails(render(stage, "-o", out / "a.exr", *SMALL, "-rs", "/Settings", "--strict"), 1,
          "/Settings.photonbeams:pixelFilter is 'sinc': expected one of box, tent")  # fmt: skip


def test_bounces_are_counted_after_the_first(render, stage, out):
    once = (*SMALL, "--passes", 1)
    assert render(stage, "-o", out / "a.exr", *once)[0] == render(stage, "-o", out / "b.exr", *once, "--bounces", 0)[0]
    assert np.array_equal(*(read_layers(out / f"{name}.exr")["rgba"] for name in "ab"))
