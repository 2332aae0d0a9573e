"""The command as another process, and checks of its results."""

import sys
import time

import numpy as np

from photonbeams.images.files import read_layers


def fails(result, code, *parts, warnings=0):
    """Assert that a call fails with a one-line error message after so many warnings, and return the message."""
    found, stdout, stderr = result
    lines = stderr.splitlines()
    assert (found, stdout, len(lines)) == (code, "", warnings + 1), stderr
    assert lines[-1].startswith("Error: ")
    assert all(line.startswith("Warning: ") for line in lines[:-1])
    for part in parts:
        assert part in lines[-1]
    return lines[-1]


def untouched(out):
    """Return whether the output folder holds only its old file, unchanged."""
    return [path.name for path in out.iterdir()] == ["old.exr"] and (out / "old.exr").read_bytes() == b"yesterday"


def command(*arguments):
    return [sys.executable, "-m", "photonbeams", "render", *map(str, arguments)]


def until(ready, seconds=240):
    """Wait until `ready()` is true; fail after so many seconds."""
    end = time.monotonic() + seconds
    while not ready():
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.02)


def same(first, second, view=None):
    found, expected = read_layers(first, view), read_layers(second, view)
    return found.keys() == expected.keys() and all(np.array_equal(found[name], expected[name]) for name in expected)
