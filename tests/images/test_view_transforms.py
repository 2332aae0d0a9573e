"""View transforms: our own, those built into OpenColorIO, and those of a user's configuration with other names."""

import numpy as np
import pytest

from photonbeams.images import display as module
from photonbeams.images.display import srgb_encoded, tone_mapped, view_transforms, viewed
from photonbeams.scene import SceneError

#: A configuration in the format of 2011, with linear colours, a gamma of 2.2, and raw colours.
OLD = """ocio_profile_version: 1
roles: {default: raw, scene_linear: linear}
displays:
  monitor:
    - !<View> {name: Film, colorspace: film}
    - !<View> {name: Raw, colorspace: raw}
colorspaces:
  - !<ColorSpace> {name: linear, bitdepth: 32f, isdata: false}
  - !<ColorSpace> {name: raw, bitdepth: 32f, isdata: true}
  - !<ColorSpace>
    name: film
    bitdepth: 32f
    isdata: false
    from_reference: !<ExponentTransform> {value: [0.45454545, 0.45454545, 0.45454545, 1]}
"""
GREY = np.full((8, 8, 4), 0.18, dtype=np.float32)


@pytest.fixture
def configuration(monkeypatch, tmp_path):
    """Return a function that makes a text OpenColorIO's configuration; with None its file is missing."""

    def use(text):
        path = tmp_path / "config.ocio"
        if text is not None:
            path.write_text(text)
        monkeypatch.setenv("OCIO", str(path))
        module._views.cache_clear()

    yield use
    module._views.cache_clear()


@pytest.fixture
def no_configuration(monkeypatch):
    monkeypatch.delenv("OCIO", raising=False)
    module._views.cache_clear()
    yield
    module._views.cache_clear()


def test_the_own_view_is_that_of_pngs():
    exposed = viewed(GREY, exposure=1.0)
    assert exposed.shape == (8, 8, 3) and exposed.dtype == np.uint8
    assert np.abs(exposed - 255 * srgb_encoded(tone_mapped(GREY[..., :3], 1.0))).max() < 1


def test_aces_is_there_without_a_configuration_and_keeps_greys_grey(no_configuration):
    aces = next(each for each in view_transforms() if each.startswith("ACES 2.0 - SDR"))
    dark, light = (viewed(GREY, aces, stops).astype(int) for stops in (0.0, 2.0))
    assert (dark.max(axis=2) - dark.min(axis=2) <= 1).all()  # dithered
    # ACES 2.0 shows the grey card at a tenth of white's luminance, which is 0.35 in sRGB: 89 of 255.
    assert 80 < dark.mean() < 100 and dark.max() < light.min()


def test_views_of_an_old_configuration_have_its_names_and_colours(configuration):
    configuration(OLD)
    assert view_transforms() == ["photonbeams", "Film", "Raw"]
    for name, value in (("Film", 0.18 ** (1 / 2.2)), ("Raw", 0.18)):
        assert np.abs(viewed(GREY, name) - 255 * value).max() < 1.5  # by a table of 16 bits, and dithered


def test_a_configuration_that_is_not_there_is_told_and_the_own_view_stays(configuration, caplog):
    configuration(None)
    assert view_transforms() == ["photonbeams"]
    assert "config.ocio cannot be used" in caplog.text
    with pytest.raises(SceneError, match="no view transform 'Film': expected one of photonbeams"):
        viewed(GREY, "Film")
