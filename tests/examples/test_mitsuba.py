"""Every Mitsuba scene of examples/mitsuba renders from the command line."""

from pathlib import Path

import numpy as np
import pytest

from photonbeams import cli
from photonbeams.images.files import read_layers
from tests.helpers.sweep import sweep

SCENES = sorted((Path(__file__).parents[2] / "examples" / "mitsuba").glob("*.xml"))

assert SCENES


# Others are rendered by tests/docs (glass_ball) and test_gather.py (cloud, slits), or read by tests/docs (cornell_fog).
KEPT = ("flask", "mirrors")
NAMES = [path.stem for path in SCENES]


@pytest.mark.parametrize("path", sweep(SCENES, KEPT, NAMES), ids=lambda path: path.stem)
def test_scenes_render_small(path, tmp_path):
    out = tmp_path / "a.exr"
    with pytest.raises(SystemExit) as stop:
        cli.main(["render", str(path), "-o", str(out), "--res", "32", "0", "--passes", "1", "--beams", "500", "-q"])
    assert stop.value.code == 0
    layers = read_layers(out)
    for name in ("surface", "beams"):
        assert np.isfinite(layers[name]).all() and layers[name].max() > 0, name
