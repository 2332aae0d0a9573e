"""Triangulation of polygons."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from photonbeams.usd.geometry.triangles import polygon_normals, triangulate


def area(points, corners, indices):
    a, b, c = (points[indices[corners[:, i]]] for i in range(3))
    return 0.5 * np.cross(b - a, c - a)


def flat(polygon):
    return np.column_stack([polygon, np.zeros(len(polygon))])


ARROW = [(0, 0), (2, 0), (2, 2), (1, 0.5), (0, 2)]
U = [(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)]
DART = [(1, 0.5), (0, 2), (0, 0), (2, 0)]
# A square with a square hole. The outline joins the two by a bridge, which it follows in both directions.
FRAME = [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)]


@pytest.mark.parametrize(
    ("polygon", "expected"), [(ARROW, 2.5), (U, 7.0), (DART, 1.5), (FRAME, 12.0), (ARROW[2:] + ARROW[:2], 2.5)]
)
@pytest.mark.parametrize("tilt", [0.0, 1.1])
def test_a_concave_polygon_keeps_its_area_and_its_side(polygon, expected, tilt):
    rotation = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    points = flat(np.array(polygon, float)) @ rotation.T
    corners, _, dropped = triangulate(np.array([len(polygon)]), np.arange(len(polygon)), points)
    areas = area(points, corners, np.arange(len(polygon)))
    # Triangles outside of the polygon would increase this sum, because it is of absolute areas.
    assert np.linalg.norm(areas, axis=1).sum() == pytest.approx(expected)
    assert np.all(areas @ rotation[:, 2] >= -1e-12)
    assert len(corners) == len(polygon) - 2
    assert dropped == 0


@given(st.lists(st.floats(0.2, 1.0), min_size=4, max_size=24))
def test_any_star_shaped_polygon_keeps_its_area(radii):
    angle = 2 * np.pi * np.arange(len(radii)) / len(radii)
    points = flat(np.array(radii)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    corners, _, _ = triangulate(np.array([len(radii)]), np.arange(len(radii)), points)
    expected = polygon_normals(points[None])[0, 2]
    assert np.abs(area(points, corners, np.arange(len(radii)))[:, 2]).sum() == pytest.approx(expected, rel=1e-9)


def test_convex_polygons_become_fans_in_the_order_of_faces():
    counts = np.array([4, 3, 4])
    indices = np.array([0, 1, 2, 3, 0, 1, 2, 0, 1, 2, 3])
    corners, faces, _ = triangulate(counts, indices, flat(np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)))
    assert faces.tolist() == [0, 0, 1, 2, 2]
    assert corners.tolist() == [[0, 1, 2], [0, 2, 3], [4, 5, 6], [7, 8, 9], [7, 9, 10]]


def test_faces_without_area_are_dropped_and_counted():
    points = flat(np.array([(0, 0), (1, 0), (2, 0), (0, 1)], float))
    corners, faces, dropped = triangulate(np.array([3, 2, 3]), np.array([0, 1, 2, 0, 1, 0, 1, 3]), points)
    assert faces.tolist() == [2]
    assert corners.tolist() == [[5, 6, 7]]
    assert dropped == 2


def test_a_polygon_that_crosses_itself_ends_in_triangles():
    bow = flat(np.array([(0, 0), (2, 2), (2, 0), (0, 1)], float))
    corners, _, _ = triangulate(np.array([4]), np.arange(4), bow)
    assert len(corners) == 2
