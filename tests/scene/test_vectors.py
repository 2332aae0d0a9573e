"""Vectors and points: directions, and planes."""

import numpy as np
import pytest

from photonbeams.scene.vectors import FLAT, ellipse_perimeter, ellipsoid_area, plane_of, unit


def test_unit_vectors_have_the_length_1_but_for_zeros():
    given = np.array([[3.0, 0, 4], [0, 0, 0], [0, -1e-30, 0]])
    assert unit(given) == pytest.approx(np.array([[0.6, 0, 0.8], [0, 0, 0], [0, -1, 0]]))
    assert unit(given[0]) == pytest.approx(unit(given)[0])


@pytest.mark.parametrize(("lift", "flat"), [(FLAT, True), (10 * FLAT, False)])
def test_points_are_in_a_plane_as_far_as_a_part_of_their_extent_tells(lift, flat):
    bent = np.array([[0, 0, 0], [1, 0, 0], [1, 1, lift], [0, 1, 0]])
    assert (plane_of(bent) is not None) == flat


@pytest.mark.parametrize(
    ("axes", "area"),
    [
        ((2, 2, 2), 16 * np.pi),
        ((3, 3, 0), 2 * np.pi * 9),  # a disk, of two sides
        ((1, 1, 2), 2 * np.pi * (1 + 2 * np.arcsin(np.sqrt(0.75)) / np.sqrt(0.75))),  # prolate
        ((2, 2, 1), 2 * np.pi * 4 * (1 + 0.25 * np.arctanh(np.sqrt(0.75)) / np.sqrt(0.75))),  # oblate
        ((100, 1e-2, 1e-2), np.pi**2 * 100 * 1e-2),  # a needle
        ((0, 0, 0), 0),
    ],
)
def test_the_area_of_an_ellipsoid_is_that_of_its_closed_forms(axes, area):
    for order in ((0, 1, 2), (2, 0, 1), (1, 2, 0)):
        assert ellipsoid_area(np.array(axes)[list(order)]) == pytest.approx(area, rel=2e-4)


def test_the_perimeter_of_an_ellipse_is_between_its_circle_and_its_line():
    assert ellipse_perimeter(2, 2) == pytest.approx(4 * np.pi)
    assert ellipse_perimeter(1, 0) == pytest.approx(4, rel=1e-4)
    assert ellipse_perimeter(2, 1) == pytest.approx(9.688448220547675)  # 8 E(3/4)
