"""Thumbnails: the renderer makes the pictures of presets, and every preset looks different."""

from io import BytesIO

import numpy as np
from PIL import Image

from photonbeams.studio.encoding import thumbnail_of
from photonbeams.usd.authoring.presets import PRESETS, preset_of


def test_presets_are_rendered_without_a_warning_and_look_different(caplog):
    shown: dict[str, list[tuple[str, np.ndarray]]] = {}
    for each in PRESETS:
        pixels = np.asarray(Image.open(BytesIO(thumbnail_of(each)))).astype(float)
        assert pixels.shape == (60, 144, 3) and pixels.max() > 120 and pixels[0].max() == 0, each.name
        for other, before in shown.setdefault(each.factor, []):
            # A mean difference of one 8-bit step per pixel is visible at a glance.
            assert np.abs(pixels - before).mean() > 1, f"{each.name} looks as {other}"
        shown[each.factor].append((each.name, pixels))
    assert not caplog.records


def test_a_thumbnail_is_made_once():
    assert thumbnail_of(preset_of("look-ember")) is thumbnail_of(preset_of("look-ember"))
