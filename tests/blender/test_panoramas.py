"""Blender's panoramic cameras, as the extension reads them."""

from types import SimpleNamespace

import numpy as np
import pytest

from photonbeams.blender.extension.reading.cameras import panoramic


def data(kind, **given):
    usual = {
        "name": "Dome", "panorama_type": kind, "longitude_min": -np.pi, "longitude_max": np.pi,
        "latitude_min": -np.pi / 2, "latitude_max": np.pi / 2, "fisheye_fov": np.pi, "fisheye_lens": 10.5,
        "sensor_width": 36.0, "sensor_height": 24.0, "clip_start": 0.1, "clip_end": 100.0,
    }  # fmt: skip
    return SimpleNamespace(**usual | given)


@pytest.mark.parametrize(
    ("given", "projection", "field", "offset"),
    [
        (data("EQUIRECTANGULAR"), "equirectangular", (360, 180), (0, 0)),
        # From 0 to 90 degrees: the middle is half of the range to the right.
        (data("EQUIRECTANGULAR", longitude_min=0, longitude_max=np.pi / 2), "equirectangular", (90, 180), (0.5, 0)),
        (data("FISHEYE_EQUIDISTANT"), "fisheyeEquidistant", (180, 180), (0, 0)),
        # 18 mm = 2 · 10.5 mm · sin(angle / 4) at the side, if the circle is wider than that.
        (data("FISHEYE_EQUISOLID", fisheye_fov=2 * np.pi), "fisheyeEquisolid",
         np.degrees(4 * np.arcsin([18 / 21, 12 / 21])), (0, 0)),
    ],
)  # fmt: skip
def test_panoramas_are_those_of_cycles(given, projection, field, offset):
    told = []
    values = panoramic(given, told.append)
    assert values["photonbeams:projection"] == projection and not told
    np.testing.assert_allclose(values["photonbeams:fieldOfView"], field)
    np.testing.assert_allclose([values[f"{axis}ApertureOffset"] for axis in ("horizontal", "vertical")], offset)


def test_other_panoramas_are_told():
    told = []
    assert panoramic(data("MIRRORBALL"), told.append) == {}
    assert told == ["Dome is a panorama of the kind Mirrorball: it is rendered in perspective"]
