"""The scene description: planes and areas of meshes."""

import numpy as np
import pytest

from photonbeams.scene import DensityGrid, Medium, Mesh, SceneError


def test_a_flat_mesh_has_a_plane_and_its_area_whatever_point_no_face_has():
    square = np.array([[0, 0, 0], [2, 0, 2], [2, 3, 2], [0, 3, 0], [9, -9, 9]], dtype=np.float64)
    mesh = Mesh("/Square", square, np.array([[0, 1, 2], [0, 2, 3]]))
    plane = mesh.plane()
    assert mesh.area == pytest.approx(2 * np.sqrt(2) * 3)
    assert np.abs(plane.normal) == pytest.approx(np.array([1, 0, 1]) / np.sqrt(2))
    assert plane.center == pytest.approx([1, 1.5, 1])
    assert plane.extent == pytest.approx(3)  # four points, each 1.5 away along the longer side


def test_a_grid_that_no_path_would_get_through_is_refused():
    values = np.zeros((2, 2, 2), np.float32)
    values[0, 0, 0] = 2500
    Medium(scattering=1.0, grid=DensityGrid(values, np.diag([4.0, 1, 1, 1])))
    with pytest.raises(SceneError, match=r"extinction of up to 2.5e\+03, which is 1.25e\+04 mean free paths"):
        Medium(scattering=1.0, grid=DensityGrid(values, np.diag([5.0, 1, 1, 1])))
