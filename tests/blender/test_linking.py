"""Lights of Blender's scenes that are linked to some things only, beside Cycles."""

from pathlib import Path

import numpy as np
import pytest

from tests.blender.bpy_python import PYTHON, blender, passes_of

pytestmark = pytest.mark.skipif(
    not PYTHON.exists(), reason=f"{PYTHON} is missing: the set-up makes it with Python 3.11"
)
SCRIPT = Path(__file__).with_name("linking.py")


def test_links_are_those_of_cycles(tmp_path):
    blender("links", tmp_path, SCRIPT)
    pictures = {}
    for path in tmp_path.glob("*.exr"):
        name, engine, _ = path.name.split(".")
        picture = passes_of(path)[""][..., :3]
        pictures[name, engine] = picture[:24].reshape(6, 4, 12, 4, 3).mean(axis=(1, 3))
    names = {name for name, _ in pictures}
    assert len(names) == 8
    for name in names:
        ours, theirs, plain = (pictures[each] for each in (
            (name, "PHOTONBEAMS"), (name, "CYCLES"), ("plain", "CYCLES")))  # fmt: skip
        # Noise and the filters of edges make 2 % of the brightest in a block of 16 pixels, a link makes 16 % or more.
        assert ours.mean() == pytest.approx(theirs.mean(), rel=0.02), name
        assert np.abs(ours - theirs).max() < 0.03 * theirs.max(), name
        assert name == "plain" or np.abs(plain - theirs).max() > 0.1 * plain.max(), name


def test_what_a_link_leaves_out_in_part_is_a_sentence(tmp_path):
    (found,) = blender("told", tmp_path, SCRIPT)
    key, fill = (found["lamps"][f"/Lights/{name}"] for name in ("Key", "Fill"))
    assert key["collection:lightLink:includes"] == ["/Objects/Fog"]
    assert key["collection:lightLink:includeRoot"] == ["bool", False]
    assert fill["photonbeams:enabled"] == ["bool", False] and fill["inputs:diffuse"] == ["float", 0]
    assert any("Key: its light link leaves out the fog World > Volume" in each for each in found["said"])
    assert any("Fill is hidden from some surfaces" in each for each in found["said"])
    assert all(len(each) <= 300 for each in found["said"])
