"""Every example, gathered along fewer rays than pixels, against a render with a ray for each pixel."""

from pathlib import Path

import numpy as np
import pytest

import photonbeams as pb
from tests.helpers.sweep import sweep

EXAMPLES = Path(__file__).parents[2] / "examples"
# Stages, except for layers over others, and Mitsuba scenes; and the flight toward, inside and along the shaft.
STAGES = [path for path in EXAMPLES.glob("*/*.usda") if "def Camera" in path.read_text()]
SCENES = [(path, None, None) for path in sorted([*STAGES, *EXAMPLES.glob("mitsuba/*.xml")])]
FLIGHT = [(EXAMPLES / "keyhole" / "keyhole.usda", "Flight", frame) for frame in (20, 45, 60)]
ALL = {f"{path.stem} {frame}" if frame else path.stem: (path, camera, frame) for path, camera, frame in SCENES + FLIGHT}
#: For `make test`: the shaft of a portal from within, gobos with looks of noise, a grid, and beams at surfaces.
KEPT = ("keyhole 45", "forest", "cloud", "slits")
ERROR = 0.002


@pytest.mark.parametrize("name", sweep(ALL, KEPT))
def test_fast_pictures_err_as_little_as_stated(name):
    path, camera, frame = ALL[name]
    shot = pb.Shot.open(path, camera=camera)
    given = {"method": "beams", "max_depth": 3} if path.suffix == ".xml" else {}
    exact, fast = (
        shot.render(frame, 1, width=400, beams=512, surfaces=False, gather_error=error, **given).layers["beams"]
        for error in (0.0, ERROR)
    )
    light = exact.mean(axis=2, dtype=np.float64)
    bright = light > 0.05 * light.mean()
    found = (np.abs(fast - exact).mean(axis=2)[bright] / light[bright]) if bright.any() else np.zeros(1)
    assert np.median(found) <= ERROR
    assert np.percentile(found, 95) <= 3 * ERROR
    assert abs(fast.mean(dtype=np.float64) - light.mean()) <= ERROR * light.mean()
