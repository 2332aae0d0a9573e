"""What a frame will cost is told: seconds like those that it takes, and the memory that a render checks."""

import json
import re
import time
from types import SimpleNamespace

import pytest

import photonbeams as pb
from photonbeams.cli import main, progress
from photonbeams.cli.render import PROGRAM_BYTES
from photonbeams.render import memory
from photonbeams.shot import estimate
from tests.helpers.small_stage import CAMERA, FLOOR, FOG, LAMP, write_stage

FLAGS = {"width": 256, "passes": 24, "seed": 3}


@pytest.fixture
def stage(tmp_path):
    return write_stage(tmp_path / "shot.usda", CAMERA, LAMP, FLOOR, FOG)


def told(*arguments, capsys):
    """Return what the command prints."""
    with pytest.raises(SystemExit) as ending:
        main([*map(str, arguments)])
    found = capsys.readouterr()
    return ending.value.code or 0, found.out, found.err


def test_seconds_are_those_that_a_frame_takes(stage, monkeypatch):
    """In seconds of the processor, because the machine has other things to do; and with kernels that are known."""
    monkeypatch.setattr(estimate, "time", SimpleNamespace(perf_counter=time.process_time))
    shot = pb.Shot.open(stage)
    shot.render(**{**FLAGS, "passes": 1})
    found, start = shot.estimate(**FLAGS), time.process_time()
    shot.render(**FLAGS)
    real = time.process_time() - start
    assert (found.size, found.measured, found.passes) == ((256, 144), (256, 144), 24)
    # Nine frames of the examples are within 15 %; this one is short, and a garbage collection is a part of it.
    assert 1 / estimate.WITHIN_SMALLER < real / found.seconds < estimate.WITHIN_SMALLER
    assert found.seconds == pytest.approx(found.once + 24 * found.each)


def test_memory_is_what_a_render_checks(stage, monkeypatch):
    shot, asked = pb.Shot.open(stage), []

    def check(*given):
        asked.append(memory.check_memory(*given))
        return asked[-1]

    monkeypatch.setattr("photonbeams.render.stage_frame.check_memory", check)
    found = shot.estimate(width=64, passes=1, beams=128)
    assert found.memory == asked[0] == memory.PIXEL_BYTES * 64 * 36 + memory.BEAM_BYTES * 128
    # A size that no machine has memory for is refused as a render refuses it, before anything is rendered.
    start = time.perf_counter()
    with pytest.raises(pb.scene.SceneError, match=r"36000 x 20250 pixels .* take .* GiB, and this machine has"):
        shot.estimate(width=36_000)
    assert time.perf_counter() - start < 5


def test_a_time_limit_bounds_the_estimate_and_a_crop_is_of_the_frame(stage):
    shot = pb.Shot.open(stage)
    limited = shot.estimate(width=128, passes=1_000_000, time_limit=3.0, beams=64)
    assert limited.seconds < 3.0 + limited.once + limited.each + 1e-6
    whole, part = (shot.estimate(width=256, passes=8, crop=each) for each in (None, (0.4, 0.4, 0.6, 0.6)))
    assert part.size == whole.size and part.memory < 0.6 * whole.memory


def test_the_command_tells_a_frame_all_frames_and_memory_and_takes_the_flags_of_render(stage, tmp_path, capsys):
    code, out, err = told("render", "--estimate", stage, "--res", 64, 0, "--passes", 2, "--beams", 64, capsys=capsys)
    assert (code, err) == (0, "")
    assert "seen by /Camera, 64 x 36 pixels" in out
    assert re.search(r"a frame +about [\d.]+ s, from [\d.]+ s to [\d.]+ s: [\d.]+ s, and 2 passes of [\d.e-]+ s", out)
    assert re.search(r"all +3 frames like the first: about ", out)
    assert re.search(r"memory +[\d.e-]+ GiB a pass", out)
    assert [path.name for path in tmp_path.iterdir()] == ["shot.usda"]
    many = ("--passes", 8, "--pass-range", "1/4", "-o", tmp_path / "a.checkpoint", "--res", 64, 0, "--beams", 64)
    found = json.loads(told("render", "--estimate", "--json", stage, *many, capsys=capsys)[1])
    assert (found["size"], found["frames"], found["passes"]) == ([64, 36], 3, 2)
    assert found["seconds"] == pytest.approx(found["once"] + 2 * found["each"])
    assert found["memory"] == PROGRAM_BYTES + memory.PIXEL_BYTES * 64 * 36 + memory.BEAM_BYTES * 64
    code, out, err = told("render", stage, "--json", capsys=capsys)
    assert (code, err) == (2, "Error: --json is for estimates: expected --estimate, too\n")


def test_lines_of_progress_tell_how_much_time_is_left_from_a_minute_on(monkeypatch, capsys):
    """After a first pass of 50 s, which does not count, each takes 20 s."""
    clock = iter([50.0, 70.0, 90.0, 110.0, 130.0, 150.0])
    monkeypatch.setattr(progress, "time", SimpleNamespace(perf_counter=lambda: next(clock)))
    with progress.bar("plain", False, 1, 6) as show:
        for done in range(1, 7):
            show(0, "1", done, "")
    left = ["", ", about 80 s left", ", about 60 s left", "", "", ""]
    assert capsys.readouterr().err.splitlines() == [f"pass {done} of 6{each}" for done, each in enumerate(left, 1)]
