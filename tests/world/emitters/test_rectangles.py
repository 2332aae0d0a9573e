"""Directions to rectangles, and their density."""

import drjit as dr
import numpy as np
import pytest

from photonbeams.numerics.arrays import opaque
from photonbeams.numerics.sampling import pairs, sobol_points
from photonbeams.runtime.device import Array3f
from photonbeams.world.emitters.rectangles import Rectangle, mesh_of, widened

COUNT = 1 << 14


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_the_mean_of_one_over_the_density_is_the_solid_angle(side, scale):
    """∫ p · 1/p dω over the rectangle, whose solid angle on its axis is 4 atan(ab / (d √(a² + b² + d²)))."""
    a, b, d, place = 0.7 * scale, 0.3 * scale, 0.5 * scale, 5 * scale * np.array([1.0, -2.0, 0.5])
    sides = place + np.array([-a, -b, side * d]), np.array([2 * a, 0, 0]), np.array([0, 2 * b, 0])
    rectangle, point = Rectangle.of(sides), opaque(place)
    u, _ = pairs(sobol_points(COUNT, 0, (1,)))
    direction = dr.normalize(rectangle.point(u) - point)
    density = rectangle.density(point, direction).numpy()
    # Rounding errors of places move points at the rim out of it: at most one in a thousand here.
    assert (density > 0).mean() > 0.999
    angle = 4 * np.arctan(a * b / (d * np.sqrt(a * a + b * b + d * d)))
    assert (1 / density[density > 0]).mean() == pytest.approx(angle, rel=2e-3)
    assert not rectangle.density(point, -direction).numpy().any()
    assert bool((rectangle.depth(point) > 0)[0]) == (side > 0)


def test_a_direction_along_the_plane_has_no_density():
    rectangle = Rectangle.of((np.array([1.0, -1, 0]), np.array([0, 2.0, 0]), np.array([0, 0, 2.0])))
    assert rectangle.density(Array3f(0), Array3f(0, 0, 1)).numpy()[0] == 0
    assert rectangle.density(Array3f(1, 0, 0), Array3f(0, 0, 1)).numpy()[0] == 0


def test_a_wider_rectangle_has_the_same_middle():
    sides = np.array([0.0, 1, 2]), np.array([2.0, 0, 0]), np.array([0, 1.0, 1])
    corner, x, y = widened(sides, 0.25)
    np.testing.assert_allclose([x, y], [1.5 * sides[1], 1.5 * sides[2]])
    np.testing.assert_allclose(corner + 0.5 * (x + y), sides[0] + 0.5 * (sides[1] + sides[2]))
    assert mesh_of("hole", sides).area == pytest.approx(np.linalg.norm(np.cross(*sides[1:])))
