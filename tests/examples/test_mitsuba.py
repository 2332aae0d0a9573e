"""Every Mitsuba scene of examples/mitsuba renders from the command line."""

from pathlib import Path

import numpy as np
import pytest

from photonbeams import cli
from photonbeams.images.files import read_layers
from tests.helpers.sweep import sweep

SCENES = sorted((Path(__file__).parents[2] / "examples" / "mitsuba").glob("*.xml"))

assert SCENES


def render(path, out, *more):
    small = ("--res", "32", "0", "--passes", "1", "--beams", "500", "-q")
    with pytest.raises(SystemExit) as stop:
        cli.main(["render", str(path), "-o", str(out), *small, *more])
    assert stop.value.code == 0


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_every_scene_is_read_and_checked(path, tmp_path):
    render(path, tmp_path / "a.exr", "--dry-run")
    assert not list(tmp_path.iterdir())


# Others are rendered in small by tests/docs (glass_ball, slits) and tests/examples/test_gather.py (cloud).
KEPT = ("cornell_fog", "mirrors")
NAMES = [path.stem for path in SCENES]


@pytest.mark.parametrize("path", sweep(SCENES, KEPT, NAMES), ids=lambda path: path.stem)
def test_scenes_render_small(path, tmp_path):
    out = tmp_path / "a.exr"
    render(path, out)
    layers = read_layers(out)
    for name in ("surface", "beams"):
        assert np.isfinite(layers[name]).all() and layers[name].max() > 0, name
