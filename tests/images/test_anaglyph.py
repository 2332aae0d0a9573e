"""Anaglyphs: each eye sees its own picture through its filter, and what both eyes see alike keeps its grey."""

import numpy as np
import pytest

from photonbeams.images.display import anaglyph, srgb_decoded
from photonbeams.scene import SceneError


def test_what_both_eyes_see_alike_keeps_its_grey():
    """Grey stays grey: the rows of both matrices add up to 1 to three digits, and half a step of 4095 is less."""
    grey = np.repeat(np.arange(256, dtype=np.uint8)[None, :, None], 3, axis=2)
    shown = anaglyph(grey, grey)
    assert shown.dtype == np.uint8 and shown.shape == grey.shape
    assert np.abs(srgb_decoded(shown / 255) - srgb_decoded(grey / 255)).max() < 0.006


def test_the_left_eye_sees_red_and_the_right_one_cyan():
    white, black = np.full((2, 3, 3), 255, np.uint8), np.zeros((2, 3, 3), np.uint8)
    left, right = anaglyph(white, black)[0, 0], anaglyph(black, white)[0, 0]
    assert left[0] == 255 and left[1] == left[2] == 0
    assert right[0] == 0 and right[1] == right[2] == 255


def test_a_thing_at_two_places_is_red_at_one_and_cyan_at_the_other():
    left, right = np.zeros((1, 8, 3), np.uint8), np.zeros((1, 8, 3), np.uint8)
    left[0, 2], right[0, 5] = 200, 200
    shown = anaglyph(left, right)
    assert np.argmax(shown[0, :, 0]) == 2 and np.argmax(shown[0, :, 1]) == np.argmax(shown[0, :, 2]) == 5


def test_pictures_of_two_sizes_are_refused():
    with pytest.raises(SceneError, match="expected one size"):
        anaglyph(np.zeros((2, 2, 3), np.uint8), np.zeros((2, 3, 3), np.uint8))
