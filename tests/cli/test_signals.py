"""Signals end a render also while a kernel runs, when Python calls no handler."""

import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from photonbeams.cli.outputs import Output, checkpoint_of, snapshots_of
from photonbeams.cli.progress import held_signals
from photonbeams.render.checkpoint import Checkpoint
from photonbeams.render.films.frame_sums import FrameSums
from photonbeams.render.films.sums import ADDING, PassSums

# `libc.poll` stands for a kernel: it returns to Python, but to no check. The main thread is never asked.
STUCK = """
import ctypes, sys
from photonbeams.cli import progress
progress.GRACE, progress._SOON = float(sys.argv[1]), 0.1
wait = ctypes.CDLL(None).poll
with progress.held_signals() as check, check.forced(lambda: "a.checkpoint has 3 passes"):
    print("ready", flush=True)
    while True:
        wait(None, 0, 10)
"""


@pytest.mark.parametrize(("number", "word"), [(signal.SIGTERM, "Ended by SIGTERM"), (signal.SIGINT, "Interrupted")])
def test_a_signal_ends_a_pass_that_does_not_end(number, word):
    with subprocess.Popen(
        [sys.executable, "-c", STUCK, "0.2"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "ready\n"
        process.send_signal(number)
        _, errors = process.communicate(timeout=30)
    assert process.returncode == 128 + number
    assert errors == f"{word} in the middle of a pass; a.checkpoint has 3 passes\n"


def test_a_signal_outside_of_passes_waits_for_a_check(monkeypatch):
    monkeypatch.setattr("photonbeams.cli.progress.GRACE", 0.0)
    with held_signals() as check:
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.3)
        with pytest.raises(KeyboardInterrupt):
            check()
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


def test_a_checkpoint_of_whole_passes_is_rescued(tmp_path):
    def view(passes):
        result = PassSums()
        for number in range(passes):
            result.add(number, {"light": np.ones(4, np.float32), "squares": np.ones(4, np.float32)})
        return result

    for second, passes in ((3, 3), (2, 0)):  # in the second case, one eye lacks a pass that the other has
        checkpoint = Checkpoint(tmp_path / f"{second}.checkpoint")
        checkpoint.source = partial(FrameSums, [view(3), view(second)], 5)
        checkpoint.rescue()
        ADDING.release()  # it is held until the process ends
        assert checkpoint.passes == passes
    assert len(FrameSums.load(tmp_path / "3.checkpoint")) == 3


def test_a_snapshot_asked_for_before_the_command_has_begun_does_not_end_it():
    ask = "import os, signal\nfrom photonbeams import cli\ncli.app = lambda **_: os.kill(os.getpid(), signal.SIGUSR1)\n"
    assert subprocess.run([sys.executable, "-c", f"{ask}cli.main(['doctor'])"], check=False).returncode == 0


def test_files_beside_outputs_of_long_names_have_names_as_long_as_names_may_be():
    for stem in ("é" * 120 + ".0007", "b" * 251, "short"):
        outputs = [Output(Path(f"out/{stem}.exr"))]
        (snapshot,) = snapshots_of(outputs)
        for path, end in ((snapshot.path, ".snapshot.exr"), (checkpoint_of(outputs), ".checkpoint")):
            assert len(os.fsencode(path.name)) <= 255
            assert path.name.endswith(stem[-5:] + end)
