"""Faults that a farm must survive without loss: kills, full disks, deleted folders, two runs at once."""

import gc
import logging
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from photonbeams.farm import preload
from photonbeams.images.files import read_layers
from photonbeams.render.frame import FrameRenderer
from tests.helpers.commands import command, fails, same, until
from tests.helpers.disks import limited
from tests.helpers.small_stage import CAMERA, FLOOR, FOG, LAMP, write_stage

KILLS = 2

# This process imports the modules that do not start Dr.Jit, and forks a render for each line that it reads: after a
# kill, the next render starts within one second instead of five.
FORKS = """
import os, sys
import numpy, pxr.Usd, pxr.UsdGeom, pxr.UsdLux, typer, rich.progress
import OpenEXR, OpenImageIO
from photonbeams import cli
for line in sys.stdin:
    child = os.fork()
    if not child:
        cli.main(line.split())
    print(child, flush=True)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


@pytest.fixture
def stage(tmp_path):
    return write_stage(tmp_path / "stage.usda", FOG, CAMERA, LAMP, FLOOR)


def test_kills_at_random_moments_lose_one_interval_at_most(render, stage, out):
    flags = ("--res", 48, 0, "--passes", 30, "--beams", 64)
    assert render(stage, "-o", out / "whole.exr", *flags, "-q")[0] == 0
    rng, log = random.Random(4), out / "log"
    again = ("--checkpoint", 0.02, "--resume", "--progress", "plain")
    line = " ".join(map(str, ("render", stage, "-o", out / "a.exr", *flags, *again)))
    with (
        log.open("w") as errors,
        subprocess.Popen(
            [sys.executable, "-c", FORKS], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, text=True
        ) as forks,
    ):
        kills, reached = 0, 0
        while True:
            print(line, file=forks.stdin, flush=True)
            child = int(forks.stdout.readline())
            if kills < KILLS:
                kept = out / "a.checkpoint"
                before = kept.stat().st_mtime_ns if kept.exists() else 0
                until(lambda: kept.exists() and kept.stat().st_mtime_ns != before, 60)  # noqa: B023
                time.sleep(rng.uniform(0, 0.1))
                os.kill(child, signal.SIGKILL)
                kills += 1
            code = int(forks.stdout.readline())
            if code == 0:
                break
            assert code == -signal.SIGKILL, log.read_text()
            with np.load(out / "a.checkpoint") as archive:  # complete, whenever the kill came
                passes = sum(int(name.split("/")[1].partition("+")[2]) for name in archive.files if "alpha" in name)
            assert passes > reached
            reached = passes
        forks.stdin.close()
    assert kills == KILLS and same(out / "a.exr", out / "whole.exr")
    assert sorted(each.name for each in out.iterdir()) == ["a.exr", "log", "old.exr", "whole.exr"]


def test_a_full_disk_ends_no_render_before_its_end(stage, out):
    """If the disk has room for pictures but not for checkpoints, the command warns and writes the pictures."""

    def limited():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (6000, 6000))

    arguments = command(stage, "-o", out / "a.png", "--res", 32, 0, "--passes", 3, "--beams", 64, "--checkpoint", 1e-9)
    ended = subprocess.run(
        [*arguments, "--progress", "none"], capture_output=True, text=True, check=False, preexec_fn=limited
    )
    warnings = [line for line in ended.stderr.splitlines() if line.startswith("Warning: ")]
    assert ended.returncode == 0 and (out / "a.png").stat().st_size > 0, ended.stderr
    told = f"Warning: {out / 'a.checkpoint'}: File too large; the render goes on without this checkpoint"
    assert warnings == [told] * 2
    assert sorted(each.name for each in out.iterdir()) == ["a.png", "old.exr"]


def test_a_full_disk_leaves_pictures_and_what_they_are_made_of(call, render, stage, out):
    flags = ("--res", 32, 0, "--passes", 2, "--beams", 64, "-q")
    for number in range(2):
        assert render(stage, "-o", out / f"{number}.checkpoint", *flags, "--pass-range", f"{number}:{number}")[0] == 0
    shutil.copy(out / "0.checkpoint", out / "old.checkpoint")
    before = {each.name: each.read_bytes() for each in out.iterdir()}
    full = str(out / "old.exr"), "File too large"
    merge = "merge", out / "0.checkpoint", out / "1.checkpoint", "-o", out / "old.exr", "--remove", "-q"
    for size in (500, 2000, 4000):  # the command's messages fit, and the smaller picture fits the last ones
        # What failed commands leave, cycles with tracebacks, would give the next ones kernels of their own, which
        # Dr.Jit cannot keep on a full disk, and says so.
        gc.collect()
        with limited(size):
            fails(render(stage, "-o", out / "old.exr", *flags, "--resume"), 1, *full)
            fails(call(*merge), 1, *full)
            if size > 500:
                gc.collect()
                fails(render(stage, "-o", out / "new" / "a.png", "-o", out / "old.exr", *flags), 1, *full)
        assert {each.name: each.read_bytes() for each in out.iterdir()} == before
    assert call(*merge)[0] == 0 and len(read_layers(out / "old.exr")) == 5
    assert {each.name for each in out.iterdir()} == {"old.exr", "old.checkpoint"}


def test_a_folder_that_goes_is_made_again(render, stage, out, monkeypatch):
    add_pass = FrameRenderer.add_pass

    def gone(self, number):
        add_pass(self, number)
        if number == 2:
            shutil.rmtree(out)

    monkeypatch.setattr(FrameRenderer, "add_pass", gone)
    flags = ("--res", 32, 0, "--passes", 4, "--beams", 64, "--checkpoint", 1e-9, "-q")
    assert render(stage, "-o", out / "a.exr", *flags) == (0, "", "")
    assert [each.name for each in out.iterdir()] == ["a.exr"]


def test_two_runs_with_the_same_output_leave_one_whole_picture(render, stage, out):
    flags = ("--res", 32, 0, "--passes", 15, "--beams", 64, "-q")
    assert render(stage, "-o", out / "whole.exr", *flags)[0] == 0
    arguments = command(stage, "-o", out / "a.exr", *flags, "--checkpoint", 0.01, "--resume")
    both = [subprocess.Popen(arguments, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    ended = [(each.communicate(timeout=120)[1], each.returncode) for each in both]
    assert ended == [("", 0)] * 2
    assert same(out / "a.exr", out / "whole.exr")
    assert {each.name for each in out.iterdir()} <= {"a.exr", "whole.exr", "old.exr", "a.checkpoint"}


def test_a_truncated_checkpoint_is_named_and_kept(render, stage, out):
    flags = ("--res", 32, 0, "--passes", 4, "--beams", 64, "-q")
    assert render(stage, "-o", out / "a.checkpoint", *flags, "--pass-range", "0:1")[0] == 0
    kept = out / "a.checkpoint"
    kept.write_bytes(kept.read_bytes()[:-100])
    for more in ((), ("--workers", 1)):
        fails(render(stage, "-o", out / "a.exr", *flags, "--resume", *more), 1, str(kept), "expected a checkpoint")
    assert kept.exists() and not (out / "a.exr").exists()


@pytest.mark.parametrize("command", ["info a.usda", "merge a.checkpoint -o a.exr", "swatch a.usda -o a.png"])
def test_a_limit_of_memory_is_told_before_libraries_crash(tmp_path, command):
    (tmp_path / "a.usda").write_text("#usda 1.0\n")
    words = ["bash", "-c", f"ulimit -v 500000; exec {sys.executable} -m photonbeams {command}"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    text = "Error: the limit of virtual memory (ulimit -v) is 0.477 GiB: expected at least 2.25 GiB\n"
    assert (done.returncode, done.stderr) == (1, text)


def test_pipes_are_named_wherever_a_command_reads(call, tmp_path):
    for name in ("a.checkpoint", "a.exr", "a.png", "a.vdb", "a.vol", "a.usda", "a.xml"):
        os.mkfifo(tmp_path / name)
    output = tmp_path / "out.exr"
    for words in (
        ("merge", "a.checkpoint", "-o", output), ("merge", "a.exr", "-o", output), ("info", "a.exr"), ("info", "a.png"),
        ("info", "a.vdb"), ("info", "a.vol"), ("info", "a.usda"), ("render", "a.usda", "-o", output),
        ("render", "a.xml", "-o", output),
    ):  # fmt: skip
        command, name, *rest = words
        fails(call(command, tmp_path / name, *rest), 1, str(tmp_path / name), "it is a named pipe")
    assert not output.exists()


def test_messages_are_no_longer_than_a_sentence(call, tmp_path):
    path = tmp_path / "/".join(["folder" * 20] * 3) / "a.checkpoint"
    path.parent.mkdir(parents=True)
    path.write_bytes(b"PK nothing")
    assert len(fails(call("merge", path, "-o", tmp_path / "a.exr"), 1, "expected a checkpoint")) <= 300


def test_warnings_of_local_workers_look_like_those_of_the_command(monkeypatch):
    logger = logging.getLogger("photonbeams")
    monkeypatch.setattr(preload.signal, "signal", lambda *_: None)
    before = [*logger.handlers]
    preload.dask_setup(None)
    (handler,) = [each for each in logger.handlers if each not in before]
    logger.removeHandler(handler)
    assert handler.format(logging.LogRecord("a", logging.WARNING, "", 0, "dark", (), None)) == "Warning: dark"
