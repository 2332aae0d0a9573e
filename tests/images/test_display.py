"""The view transform of pictures: its shoulder, its hue and its 8 bits."""

import numpy as np
import pytest

from photonbeams.images import display


def test_the_view_changes_nothing_below_its_shoulder_and_never_leaves_0_to_1():
    dark = np.random.default_rng(2).uniform(0, display.SHOULDER, (50, 3))
    np.testing.assert_array_equal(display.tone_mapped(dark), dark)
    bright = np.array([[3e4, 2e4, 1e4], [np.inf, 1, 0], [np.nan, -1, 0.25], [0.9, 0.1, 0.0]])
    view = display.tone_mapped(bright)
    assert view.min() >= 0.0 and view.max() <= 1.0
    assert view[2].tolist() == [0.0, 0.0, 0.25]


def test_an_exposure_puts_nearly_all_light_below_the_shoulder():
    pixels = np.zeros((10, 50, 4))
    pixels[:2, :, 1] = np.linspace(0.01, 0.02, 100).reshape(2, 50)
    pixels[:2, :, 3] = 1
    pixels[0, 0], pixels[1, 0, 0] = np.inf, 1e6  # lamps do not count, nor do black pixels
    stops = display.exposure_of(pixels)
    assert 0.02 * 2**stops == pytest.approx(display.SHOULDER, rel=0.08)  # a tenth of a stop, and the 95 % quantile
    assert display.exposure_of(np.zeros((2, 2, 4))) == 0


def test_the_view_is_smooth_and_rises_with_the_light():
    light = np.geomspace(0.01, 1e4, 4001)[:, None] * np.array([1.0, 0.6, 0.2])
    view = display.tone_mapped(light)
    assert np.all(np.diff(view, axis=0) >= 0.0)
    slope = np.diff(view[:, 0]) / np.diff(light[:, 0])
    at = int(np.searchsorted(light[:, 0], display.SHOULDER))
    assert slope[at + 1] == pytest.approx(slope[at - 2], rel=0.02)  # 2 |f''| Δ: 2 · 4 · 0.5 · 0.0035 at the joint


def test_the_view_keeps_hue_while_bright_colours_whiten():
    colour = np.array([1.0, 0.55, 0.2])
    for gain in (0.4, 1.0, 3.0, 30.0):
        view = display.tone_mapped(gain * colour)
        # Hue is where the middle channel lies between the others.
        assert (view[1] - view[2]) / (view[0] - view[2]) == pytest.approx((0.55 - 0.2) / (1.0 - 0.2), rel=1e-9)
    assert display.tone_mapped(1e4 * colour).min() > 0.98


def test_dither_keeps_the_mean_of_a_gradient_and_both_ends_exact():
    for level in (0.1, 0.37, 0.5, 0.9):
        flat = np.full((64, 64, 3), (20 + level) / 255)
        # 4096 evenly spread thresholds give a fraction to within 1/64.
        np.testing.assert_allclose(display.dithered(flat).mean(axis=(0, 1)), 20 + level, atol=1 / 64)
    ends = display.dithered(np.stack([np.zeros((8, 8)), np.ones((8, 8)), np.ones((8, 8))], axis=2))
    assert np.unique(ends[..., 0]).tolist() == [0]
    assert np.unique(ends[..., 1:]).tolist() == [255]
