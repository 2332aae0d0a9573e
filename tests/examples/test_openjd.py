"""The Open Job Description is valid, and its job renders the same frame as a single command."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.helpers.commands import same
from tests.helpers.small_stage import CAMERA, FLOOR, FOG, LAMP, write_stage

TEMPLATE = Path(__file__).parents[2] / "examples" / "farm" / "photonbeams.openjd.yaml"


@pytest.fixture
def openjd(tmp_path):
    """Return a function that runs `openjd` with the command `photonbeams` of these sources."""
    program = shutil.which("openjd", path=str(Path(sys.executable).parent)) or "openjd"
    folder = tmp_path / "bin"
    folder.mkdir()
    command = folder / "photonbeams"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m photonbeams "$@"\n')
    command.chmod(0o755)
    path = os.pathsep.join([str(folder), os.environ["PATH"]])
    environment = {**os.environ, "PATH": path, "PYTHONPATH": os.pathsep.join(sys.path)}
    return lambda *arguments: subprocess.run(
        [program, *map(str, arguments)], capture_output=True, text=True, check=False, env=environment
    )


def test_the_template_is_valid(openjd):
    checked = openjd("check", TEMPLATE)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    summary = openjd(
        "summary", TEMPLATE, "-p", "Scene=a.usda", "-p", "OutputFolder=out", "-p", "Frames=1-10", "-p", "Parts=4"
    )
    assert "Total tasks: 50" in summary.stdout, summary.stdout


def test_the_job_renders_the_frame_of_one_command(openjd, render, tmp_path):
    stage = write_stage(tmp_path / "stage.usda", FOG, CAMERA, LAMP, FLOOR)
    arguments = ("-p", f"Scene={stage}", "-p", f"OutputFolder={tmp_path / 'out'}", "-p", "Frames=8", "-p", "Passes=3",
                 "-p", "Width=24")  # fmt: skip
    done = openjd("run", TEMPLATE, "--step", "Join", "--run-dependencies", *arguments)
    assert done.returncode == 0, done.stdout + done.stderr
    assert [each.name for each in (tmp_path / "out").iterdir()] == ["shot.0008.exr"]
    small = ("--res", 24, 0, "--passes", 3, "-q", "-o", tmp_path / "serial.exr")
    assert render(stage, "-f", 8, *small)[0] == 0
    assert same(tmp_path / "out" / "shot.0008.exr", tmp_path / "serial.exr")
