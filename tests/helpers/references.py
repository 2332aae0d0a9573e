"""Stored pictures by Mitsuba's own integrators: compiling and rendering them would take half of a test's time.

    PHOTONBEAMS_REFERENCES=render make test ARGS=tests/render/test_hostile.py

renders the references of the tests that are run anew, and stores them in tests/references/. A test whose scene or
samples have changed needs that: its name in the file stands for its scene, which no number there describes.
"""

import json
import math
import os
from pathlib import Path

import numpy as np

from tests.helpers.mitsuba_scenes import volpath

FOLDER = Path(__file__).parents[1] / "references"
SIZE = 4  # blocks in each row and column, or the largest divisor of it that also divides the picture's


def reference(name, scene, samples, seeds=1, plugin="volpath", **parameters):
    """Return the pictures of a scene by a plugin of Mitsuba, as means of blocks of pixels, mostly (seeds, 4, 4, 3).

    Their spread between seeds is their noise. `name` is that of the file, a slash, and that of the scene in the file.
    """
    file, _, scene_name = name.partition("/")
    path = FOLDER / f"{file}.json"
    known = json.loads(path.read_text()) if path.is_file() else {}
    made = {"plugin": plugin, "samples": samples, "seeds": seeds, **parameters}
    if os.environ.get("PHOTONBEAMS_REFERENCES") == "render":
        pictures = [volpath(scene, samples, seed, plugin, **parameters) for seed in range(seeds)]
        means = blocks(pictures)
        numbers = [float(f"{each:.5g}") for each in means.ravel()]
        known[scene_name] = {"made": made, "shape": means.shape, "blocks": numbers}
        FOLDER.mkdir(exist_ok=True)
        lines = (f"{json.dumps(key)}: {json.dumps(known[key])}" for key in sorted(known))
        path.write_text("{\n" + ",\n".join(lines) + "\n}\n")
    found = known.get(scene_name, {})
    assert found.get("made") == made, f"{path} has no such reference of {scene_name}: see {__name__}"
    return np.reshape(found["blocks"], found["shape"])


def blocks(pictures):
    """Return the means of blocks of pixels of pictures, mostly (…, 4, 4, channels)."""
    *more, height, width, channels = np.shape(pictures)
    rows, columns = math.gcd(height, SIZE), math.gcd(width, SIZE)
    cut = np.reshape(pictures, (*more, rows, height // rows, columns, width // columns, channels))
    return cut.mean(axis=(-4, -2), dtype=np.float64)
