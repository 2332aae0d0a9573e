"""Vectors and points: directions, and planes."""

import numpy as np
import pytest

from photonbeams.scene import Camera, Gobo, SphereLight
from photonbeams.scene.vectors import FLAT, ellipse_perimeter, ellipsoid_area, plane_of, unit


def test_unit_vectors_have_the_length_1_but_for_zeros():
    given = np.array([[3.0, 0, 4], [0, 0, 0], [0, -1e-200, 0], [0, 3e300, 4e300]])
    expected = np.array([[0.6, 0, 0.8], [0, 0, 0], [0, -1, 0], [0, 0.6, 0.8]])
    assert unit(given) == pytest.approx(expected)
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


@pytest.mark.parametrize("length", [1e-200, 1e-30, 1e30, 1e200])
def test_a_camera_and_a_lamp_take_directions_of_any_length(length):
    found, expected = (Camera.look_at((6, 1, 0), (0, 1, 0), (0, up, 0)).to_world for up in (length, 1))
    assert np.array_equal(found, expected)
    gobo = Gobo(np.ones((1, 1, 1)))
    lamps = (SphereLight("/Lamp", 1.0, axis=(0, -each, each), gobo=gobo) for each in (length, 1))
    found, expected = (lamp.slide(gobo) for lamp in lamps)
    for one, other in zip(found, expected, strict=True):  # of float64, whose rounding is 1e-16
        np.testing.assert_allclose(np.asarray(one, float), np.asarray(other, float), rtol=0, atol=1e-12)
