"""Equal values have the same hash, and different values have different hashes."""

import os
import subprocess
import sys
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
import pytest

import photonbeams as pb
from photonbeams.runtime.digest import digest

STRENGTH = 2.0


@dataclass(frozen=True)
class Part:
    """A value with fields, one of which is computed."""

    size: float
    pixels: np.ndarray

    @cached_property
    def mean(self):
        return self.pixels.mean()


def scaled(factor):
    return lambda value: factor * value


def strong(value):
    return STRENGTH * value


def stronger(value):
    return strong(value)


class Modifier:
    """A function with state."""

    def __init__(self, factor):
        self.factor = factor

    def __call__(self, value):
        return self.factor * value


class Slots:
    """A value whose attributes are in slots."""

    __slots__ = ("size",)

    def __init__(self, size):
        self.size = size


PART = Part(1.0, np.arange(3.0))
DIFFERENT = [
    None, 0, False, 0.0, "", "0", b"0", (), [], (0,), {}, {"a": 0}, {"a": 1}, {"b": 0}, set(), {1}, {1, 2},
    np.arange(3), np.arange(3.0), np.arange(3.0)[None], PART, replace(PART, size=2.0), (PART, PART),
    (PART, replace(PART, size=2.0)), scaled(1.0), scaled(2.0), strong, stronger, partial(strong, 1), partial(strong, 2),
    Modifier(1), Modifier(2), Modifier(1).__call__, Modifier, Slots(1), Slots(2),
    np.sin, np.cos,
]  # fmt: skip


def test_what_differs_has_another_hash():
    found = [digest(each) for each in DIFFERENT]
    assert len(set(found)) == len(found)


def test_what_is_the_same_has_the_same_hash():
    assert digest(Part(1.0, np.arange(3.0))) == digest(PART)
    assert digest({"a": 1, "b": 2}) == digest({"b": 2, "a": 1})
    assert digest(scaled(2.0)) == digest(scaled(2.0)) and digest(Modifier(2)) == digest(Modifier(2))
    before = digest(PART)
    assert PART.mean == 1 and digest(PART) == before  # cached properties are not hashed
    itself = []
    itself.append(itself)
    assert digest(itself) == digest(itself)


def test_a_function_is_its_text_and_what_that_names(monkeypatch):
    before = digest(stronger)
    monkeypatch.setitem(globals(), "STRENGTH", 3.0)
    assert digest(stronger) != before


def test_arrays_of_drjit_are_their_numbers():
    from photonbeams.runtime.device import Array3f, Float

    assert digest(Float(1, 2)) == digest(Float(1, 2)) != digest(Float(1, 3))
    assert digest(Array3f(1, 2, 3)) != digest(Array3f(1, 2, 4))


def test_looks_are_their_factors():
    alongs = ["s", "2 * s", pb.looks.Exponential(1.0), pb.looks.Exponential(2.0), lambda s: s, lambda s: 2 * s]
    looks = [pb.Look(), *(pb.Look(along=each) for each in alongs)]
    looks += [pb.Look(across=pb.looks.Gaussian(width)) for width in (2.0, 3.0)]
    found = [digest(each) for each in looks]
    assert len(set(found)) == len(found) and digest(pb.Look(along="s")) == found[1]


@pytest.mark.parametrize("seed", ["1", "2"])
def test_another_process_has_the_same_hash(seed):
    script = "from photonbeams.runtime.digest import digest; print(digest({'b', 'a', 'c'}, {'x': (1.5, None)}))"
    env = {**os.environ, "PYTHONHASHSEED": seed}
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, env=env)
    assert done.stdout.strip() == digest({"b", "a", "c"}, {"x": (1.5, None)})
