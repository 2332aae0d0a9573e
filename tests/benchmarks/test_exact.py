"""The adaptive twin of the beam integral against closed forms."""

import numpy as np
import pytest

from benchmarks.exact import Cone, Factors, radiance

CYLINDER = Cone(np.array([1.0, -2.0, 3.0]), np.array([1.0, -2.0, 7.0]), 0.5, 0.5)
ORIGIN = np.array([0.9, -1.8, 5.0])  # inside, at r = (−0.1, 0.2)


def constant(value):
    return lambda t: np.full((len(t), 3), value)


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.3, -0.4, 0.2), (0.0, 0.0, 1.0), (1e-5, 2e-5, -1.0)])
def test_exponential_falloffs_in_a_cylinder(direction):
    way = np.array(direction) / np.linalg.norm(direction)
    r, across = ORIGIN[:2] - [1.0, -2.0], way[:2]
    A, B, C = across @ across, r @ across, r @ r - 0.25
    with np.errstate(divide="ignore"):
        wall = (-B + np.sqrt(B * B - A * C)) / A if A else np.inf
        end = min(wall, ((7.0 if way[2] > 0 else 3.0) - 5.0) / way[2] if way[2] else np.inf)
    rate = 0.7 + 0.3 * way[2]  # of exp(−0.7 t) · exp(−0.3 s)
    expected = np.exp(-0.3 * 2) * -np.expm1(-rate * end) / rate / (np.pi * 0.25)
    factors = Factors(
        lambda rho: np.full((len(rho), 1), 1 / np.pi), lambda u: np.exp(-0.3 * 4 * u)[:, None] * np.ones(3),
        lambda t: np.exp(-0.7 * t)[:, None] * np.ones(3),
    )  # fmt: skip
    assert radiance(CYLINDER, factors, ORIGIN, way) == pytest.approx([expected] * 3, rel=1e-8)


@pytest.mark.parametrize("radii", [(0.1, 100.0), (100.0, 0.1), (1e-4, 1.0)])
def test_the_axis_of_a_cone(radii):
    """∫ ds / R² = L / (r0 r1), however much the cone opens."""
    cone = Cone(np.zeros(3), np.array([0.0, 0.0, 2.0]), *radii)
    factors = Factors(constant(1.0), constant(1.0), constant(1.0))
    found = radiance(cone, factors, np.array([0.0, 0.0, -5.0]), np.array([0.0, 0.0, 1.0]))
    assert found == pytest.approx([2 / (radii[0] * radii[1])] * 3, rel=1e-8)


def test_a_narrow_core_and_a_step_are_found():
    """A ray across the axis has 2 ∫ density dρ / R of light, of which a step along the beam takes the rest."""
    width = 0.01
    factors = Factors(
        lambda rho: np.exp(-0.5 * (rho / width) ** 2)[:, None],
        lambda u: np.where(u < 0.5, 2.0, 1.0)[:, None] * np.ones(3),
        constant(1.0), rings=(width, 3 * width, 6 * width), knots=(0.5,),
    )  # fmt: skip
    way = np.array([1.0, 0.0, 0.0])
    for height, expected in ((4.9, 2.0), (5.1, 1.0)):
        found = radiance(CYLINDER, factors, np.array([-5.0, -2.0, height]), way)
        assert found == pytest.approx([expected * width * np.sqrt(2 * np.pi) / 0.5] * 3, rel=1e-8)
