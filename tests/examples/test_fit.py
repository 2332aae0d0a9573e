"""The example that fits a look to a painting finds a known look, and writes a layer that renders."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

import photonbeams as pb
from photonbeams.cli import main
from photonbeams.images.files import read_image

EXAMPLES = Path(__file__).parents[2] / "examples"
STAGE = EXAMPLES / "shaft" / "physical.usda"
KNOWN = np.linspace([1.5, 0.8, 0.3], [0.3, 0.4, 1.2], 10)


@pytest.fixture(scope="module")
def fit():
    spec = importlib.util.spec_from_file_location("fit", EXAMPLES / "fit" / "fit.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_it_finds_colours_that_are_known(fit):
    scene = fit.Fit(pb.Shot.open(STAGE), 48, 27, beams=32)
    target = scene.picture(KNOWN)
    found = scene.picture(scene.colors(target, steps=60))
    lit = target > 0.2 * target.max()
    before = np.median(np.abs(scene.picture(None) / np.maximum(target, 1e-9) - 1)[lit])
    # Pixels do not determine all colours along the beams, so pictures are compared instead of colours.
    assert np.median(np.abs(found[lit] / target[lit] - 1)) < 0.05 < before


def test_the_command_writes_a_layer_that_renders(fit, tmp_path, monkeypatch):
    output = tmp_path / "fit"
    painting = EXAMPLES / "fit" / "painted.png"
    monkeypatch.setattr(fit, "WIDTH", 48)
    monkeypatch.setattr(fit, "BEAMS", 16)
    monkeypatch.setattr(sys, "argv", ["fit.py", str(STAGE), str(painting), "-o", str(output), "--steps", "3"])
    fit.main()
    assert read_image(output.with_suffix(".png")).shape[1] == 3 * 48 + 2 * 4
    picture = tmp_path / "fitted.png"
    flags = ["--res", "32", "0", "--passes", "1", "--beams", "16", "-q"]
    with pytest.raises(SystemExit) as stop:
        main(["render", str(STAGE), "--session-layer", str(output.with_suffix(".usda")), "-o", str(picture), *flags])
    assert stop.value.code == 0
    assert read_image(picture).max() > 0
