"""The shaft of sunlight: the stage is what its script writes, and the layer that directs it changes only beams."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf

import photonbeams as pb

FOLDER = Path(__file__).parents[2] / "examples" / "shaft"
STAGE, DIRECTED = FOLDER / "physical.usda", FOLDER / "directed.usda"
TINY = {"passes": 2, "width": 64, "beams": 256}


def test_the_stage_is_what_the_script_writes(tmp_path):
    runpy.run_path(str(FOLDER / "model.py"))["model"](tmp_path)
    assert (tmp_path / STAGE.name).read_bytes() == STAGE.read_bytes()


@pytest.fixture(scope="module")
def pictures():
    shots = pb.Shot.open(STAGE), pb.Shot.open(STAGE, session_layers=[DIRECTED])
    return [shot.render(**TINY).layers for shot in shots]


def test_both_render_to_beams(pictures):
    for layers in pictures:
        assert np.isfinite(layers["rgba"]).all()
        assert layers["beams"].max() > 0.01


def test_the_directed_picture_differs_in_its_beams_alone(pictures):
    physical, directed = pictures
    for name in ("surface", "transmittance", "depth"):
        assert np.array_equal(physical[name], directed[name]), name
    assert not np.allclose(physical["beams"], directed["beams"], rtol=0.5)


def test_the_directed_shaft_turns_from_gold_to_violet(pictures):
    # The ratio of green to red in the nearest shaft, beside the window and where it reaches the floor.
    window, floor = (slice(9, 12), slice(52, 57)), (slice(28, 31), slice(40, 46))
    greens = [[np.divide(*layers["beams"][part].sum(axis=(0, 1))[[1, 0]]) for part in (window, floor)]
              for layers in pictures]  # fmt: skip
    assert greens[0][1] == pytest.approx(greens[0][0], rel=0.02)  # a grey fog
    assert greens[1][1] < 0.7 * greens[1][0]


def test_what_directs_is_a_thin_layer_of_looks_and_beams():
    changed = []
    layer = Sdf.Layer.FindOrOpen(str(DIRECTED))
    layer.Traverse("/", lambda path: changed.append(path) if path.IsPropertyPath() else None)
    assert len(changed) > 10
    assert all(path.name.startswith("photonbeams:") for path in changed)
