"""The Python that has Blender as a module: bpy brings libraries of its own, so it has an environment of its own."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import OpenEXR

PYTHON = Path(sys.prefix) / "bpy" / "bin" / "python"
SCRIPT = Path(__file__).with_name("in_blender.py")
WIDTH, HEIGHT = 48, 27  # of its pictures


def blender(case, folder, script=SCRIPT):
    """Run a case in Blender, and return what it told; fail if it printed a traceback."""
    return _told(_run(script, case, folder))


class Case(NamedTuple):
    """What a case told, and the folder of its files."""

    told: list
    folder: Path


def together(names, folder, script=SCRIPT):
    """Run cases one after another in one Blender, each in a folder of its own; return a `Case` for each name.

    Blender and its renderer start once, which takes longer than most cases.
    """
    said = _run(script, ",".join(names), folder)
    parts = [part.partition("\n") for part in f"\n{said}".split("\ncase ")[1:]]
    assert [name for name, *_ in parts] == list(names)
    return {name: Case(_told(rest), folder / name) for name, _, rest in parts}


def _run(script, names, folder):
    environment = {"PHOTONBEAMS_PYTHON": sys.executable, **os.environ}
    ran = subprocess.run(
        [PYTHON, "-I", script, names, folder], capture_output=True, text=True, env=environment, timeout=480, check=False
    )
    said = ran.stdout + ran.stderr
    assert ran.returncode == 0 and "Traceback" not in said, said[-3000:]
    return said


def _told(said):
    return [json.loads(line.removeprefix("found ")) for line in said.splitlines() if line.startswith("found ")]


def passes_of(path):
    """Return the render passes of a multilayer EXR, (H, W, C), by name."""
    found = {}
    with OpenEXR.File(str(path), separate_channels=True) as file:
        for part in file.parts:
            for name, channel in part.channels.items():
                layer, _, letter = name.rpartition(".")
                found.setdefault(layer.removeprefix("ViewLayer."), {})[letter] = channel.pixels
    order = {letter: place for place, letter in enumerate("RGBAXYZV")}
    return {
        name: np.stack([channels[letter] for letter in sorted(channels, key=order.__getitem__)], axis=-1)
        for name, channels in found.items()
    }
