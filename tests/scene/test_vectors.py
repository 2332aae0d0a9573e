"""Vectors and points: directions, and planes."""

import numpy as np
import pytest

from photonbeams.scene.vectors import FLAT, plane_of, unit


def test_unit_vectors_have_the_length_1_but_for_zeros():
    given = np.array([[3.0, 0, 4], [0, 0, 0], [0, -1e-30, 0]])
    assert unit(given) == pytest.approx(np.array([[0.6, 0, 0.8], [0, 0, 0], [0, -1, 0]]))
    assert unit(given[0]) == pytest.approx(unit(given)[0])


@pytest.mark.parametrize(("lift", "flat"), [(FLAT, True), (10 * FLAT, False)])
def test_points_are_in_a_plane_as_far_as_a_part_of_their_extent_tells(lift, flat):
    bent = np.array([[0, 0, 0], [1, 0, 0], [1, 1, lift], [0, 1, 0]])
    assert (plane_of(bent) is not None) == flat
