"""The scene description: planes and areas of meshes."""

import numpy as np
import pytest

from photonbeams.scene import Mesh


def test_a_flat_mesh_has_a_plane_and_its_area_whatever_point_no_face_has():
    square = np.array([[0, 0, 0], [2, 0, 2], [2, 3, 2], [0, 3, 0], [9, -9, 9]], dtype=np.float64)
    mesh = Mesh("/Square", square, np.array([[0, 1, 2], [0, 2, 3]]))
    plane = mesh.plane()
    assert mesh.area == pytest.approx(2 * np.sqrt(2) * 3)
    assert np.abs(plane.normal) == pytest.approx(np.array([1, 0, 1]) / np.sqrt(2))
    assert plane.center == pytest.approx([1, 1.5, 1])
    assert plane.extent == pytest.approx(3)  # four points, each 1.5 away along the longer side
