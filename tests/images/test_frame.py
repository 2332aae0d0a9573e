"""Pictures for notebooks: small frames are shown as their file has them, large ones are made smaller."""

from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from photonbeams.images import frame as frames
from photonbeams.images.display import srgb_decoded
from photonbeams.images.frame import Frame
from photonbeams.render.passes import Statistics
from photonbeams.scene import SceneError


def frame_of(*eyes):
    return Frame.of({name: ({"rgba": each}, {}) for name, each in zip(("left", "right"), eyes, strict=False)},
                    Statistics(passes=3))  # fmt: skip


def pixels_of(png):
    with Image.open(BytesIO(png)) as image:
        return np.asarray(image.convert("RGB"))


@pytest.fixture
def noise(rng):
    return rng.uniform(0.1, 0.4, (90, 160, 4)).astype(np.float32)


@pytest.mark.parametrize("count", [1, 2])
def test_a_frame_shows_what_it_writes(noise, tmp_path, count):
    frame = frame_of(*(noise, noise[::-1])[:count])
    frame.write(tmp_path / "shot.png")
    assert frame._repr_png_() == (tmp_path / "shot.png").read_bytes()


@pytest.mark.parametrize("exposure", [np.nan, 1e6, "1"])
def test_an_exposure_is_a_number_of_stops(noise, tmp_path, exposure):
    with pytest.raises(SceneError, match=r"exposure is .*: expected a finite number at least -100 and at most 100"):
        frame_of(noise).write(tmp_path / "a.png", exposure=exposure)
    with pytest.raises(OSError, match="a name cannot have a NUL"):
        frame_of(noise).write(tmp_path / "a\0.png")


def test_a_frame_says_its_size_passes_and_layers_in_one_line(noise):
    assert repr(frame_of(noise)) == "Frame(160 x 90 pixels, 3 passes, rgba)"
    assert repr(frame_of(noise, noise)) == "Frame(two eyes of 160 x 90 pixels, 3 passes, rgba)"


@pytest.mark.parametrize("name, limit", [("MOST_BYTES", 20_000), ("MOST_PREVIEWED", 5000)])
def test_large_pictures_are_made_smaller_and_keep_their_aspect_and_their_light(noise, monkeypatch, name, limit):
    noise += np.linspace(-0.1, 0.1, 160, dtype=np.float32)[None, :, None]
    monkeypatch.setattr(frames, name, limit)
    found = frames.preview(noise)
    small = pixels_of(found)
    assert (len(found) if name == "MOST_BYTES" else small.shape[0] * small.shape[1]) <= 1.02 * limit
    assert small.shape[0] < 90 and small.shape[1] / small.shape[0] == pytest.approx(160 / 90, rel=0.02)
    # Nothing is above the shoulder; the mean of 43,200 uniform numbers over a range of 0.3 errs by 0.0004.
    halves = [srgb_decoded(each / 255).mean() for each in np.array_split(small, 2, axis=1)]
    np.testing.assert_allclose(halves, [0.2, 0.3], atol=0.003)


def test_a_limit_that_nothing_meets_is_met_by_all_that_is_usual(rng):
    """Even noise meets the limit, although no picture is harder to compress: 800 x 480 pixels exceed a megabyte."""
    found = frames.preview(rng.uniform(0, 1, (480, 800, 3)).astype(np.float32))
    assert 300_000 < len(found) <= frames.MOST_BYTES


def test_broken_and_infinite_pixels_stay_where_they_are(monkeypatch):
    monkeypatch.setattr(frames, "MOST_PREVIEWED", 40 * 40)
    pixels = np.full((80, 80, 3), 0.2, np.float32)
    pixels[10, 10], pixels[60, 60] = np.nan, np.inf
    small = pixels_of(frames.preview(pixels)).astype(int)
    usual = small[20, 20]
    assert (small[5, 5] < usual).all() and (small[30, 30] == 255).all()
    away = np.abs(small - usual).max(axis=2) > 1  # beyond what dithering does
    assert away.sum() == 2
