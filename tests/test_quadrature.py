"""Rules on [−1, 1] and their use on [a, b] (Talk, equations 1 and 2)."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from photonbeams.quadrature import MOST_POINTS, Rule, gauss_legendre, riemann
from photonbeams.runtime.device import Array3f, Float

EPSILON32 = float(np.finfo(np.float32).eps)

bounds = st.floats(-10, 10)
rules = st.one_of(st.integers(1, 12).map(gauss_legendre), st.integers(1, 12).map(riemann))


def slope(counts, errors):
    """Return the order p of errors that fall as n^−p."""
    return -np.polyfit(np.log(counts), np.log(errors), 1)[0]


# -- The rules -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [1, 2, 3, 6, 10, 20])
def test_gauss_is_exact_to_degree_2n_minus_1(n):
    for degree in range(2 * n):
        exact = (1 - (-1) ** (degree + 1)) / (degree + 1)
        # n terms of at most 1, each rounded once or twice; the nodes are accurate to a few units in the last place.
        assert gauss_legendre(n).integrate(lambda x, k=degree: x**k, -1.0, 1.0) == pytest.approx(exact, abs=1e-14 * n)


@pytest.mark.parametrize("n", [1, 2, 3, 6, 10])
def test_gauss_is_not_exact_for_degree_2n(n):
    exact = 2 / (2 * n + 1)
    assert abs(gauss_legendre(n).integrate(lambda x: x ** (2 * n), -1.0, 1.0) - exact) > 1e-7


def test_riemann_is_exact_for_straight_lines_and_no_further():
    assert riemann(3).integrate(lambda x: 2 * x + 1, 0.0, 2.0) == pytest.approx(6, rel=1e-15)
    assert riemann(3).integrate(lambda x: x * x, -1.0, 1.0) == pytest.approx(2 / 3 - 2 / 27, rel=1e-14)


def test_riemann_converges_with_order_2():
    counts = np.array([8, 16, 32, 64, 128])
    errors = [abs(riemann(n).integrate(np.exp, 0.0, 1.0) - np.expm1(1)) for n in counts]
    assert slope(counts, errors) == pytest.approx(2, abs=0.01)


def test_gauss_converges_geometrically_on_an_analytic_function():
    exact = np.arctan(1) * 2
    errors = [abs(gauss_legendre(n).integrate(lambda x: 1 / (1 + x * x), -1.0, 1.0) - exact) for n in range(2, 12)]
    # Poles at ±i: each further point divides the error by ρ², ρ = 1 + √2 of the Bernstein ellipse through the poles.
    rate = np.exp(-np.polyfit(range(2, 12), np.log(errors), 1)[0])
    assert rate == pytest.approx((1 + np.sqrt(2)) ** 2, rel=0.1)


def test_riemann_needs_more_than_twice_the_points_of_gauss():
    def f(x):
        return np.exp(-2 * x) * (1 - x * x)

    exact = gauss_legendre(64).integrate(f, -1.0, 1.0)
    gauss = abs(gauss_legendre(6).integrate(f, -1.0, 1.0) - exact)
    assert gauss < abs(riemann(2 * 6).integrate(f, -1.0, 1.0) - exact)


@pytest.mark.parametrize("make", [gauss_legendre, riemann])
@pytest.mark.parametrize("n", [1, 2, 7, 64, MOST_POINTS])
def test_rules_are_symmetric_inside_the_interval_and_sum_to_two(make, n):
    rule = make(n)
    assert len(rule) == n and rule.points.dtype == rule.weights.dtype == np.float64
    assert np.all(np.diff(rule.points) > 0) and np.all(np.abs(rule.points) < 1) and np.all(rule.weights > 0)
    np.testing.assert_allclose(rule.points, -rule.points[::-1], atol=1e-15)
    assert rule.weights.sum() == pytest.approx(2, rel=1e-13)


def test_a_rule_is_one_read_only_object_that_names_itself():
    rule = gauss_legendre(6)
    assert rule is gauss_legendre(np.int64(6)) and repr(rule) == "gauss_legendre(6)"
    with pytest.raises(ValueError, match="read-only"):
        rule.points[0] = 0


# -- On [a, b] -----------------------------------------------------------------------------------------------------


def test_points_and_sum_are_scaled_as_in_equation_2():
    rule, a, b, seen = gauss_legendre(4), 1.5, 4.0, []
    total = rule.integrate(lambda t: seen.append(t) or t**2, a, b)
    expected = (b - a) / 2 * rule.points + (a + b) / 2
    np.testing.assert_allclose(seen, expected, rtol=1e-15)
    assert total == pytest.approx((b - a) / 2 * (rule.weights * expected**2).sum(), rel=1e-15)


@given(rules, bounds, bounds, st.floats(-5, 5), st.floats(-5, 5))
def test_integration_is_linear(rule, a, b, p, q):
    both = rule.integrate(lambda x: p * np.cos(x) + q * x, a, b)
    apart = p * rule.integrate(np.cos, a, b) + q * rule.integrate(lambda x: x, a, b)
    # Terms are at most 5 · (1 + 10), over an interval of at most 20, and each is rounded a few times.
    assert both == pytest.approx(apart, abs=1e-12)


@given(rules, bounds, bounds, st.lists(bounds, max_size=3))
def test_swapping_the_bounds_changes_the_sign(rule, a, b, breaks):
    forth, back = rule.integrate(np.cos, a, b, breaks), rule.integrate(np.cos, b, a, breaks)
    assert forth == pytest.approx(-back, abs=1e-13)


@given(rules, bounds, bounds, st.lists(bounds, max_size=4))
def test_breaks_change_nothing_where_the_rule_is_exact(rule, a, b, breaks):
    assert rule.integrate(lambda x: 3 * x + 1, a, b, breaks) == pytest.approx(
        1.5 * (b * b - a * a) + (b - a), abs=1e-11
    )


@given(bounds, bounds, st.lists(bounds, min_size=1, max_size=4), st.randoms())
def test_the_order_of_the_breaks_does_not_matter(a, b, breaks, random):
    shuffled = random.sample(breaks, len(breaks))
    rule = gauss_legendre(3)
    assert rule.integrate(np.abs, a, b, breaks) == rule.integrate(np.abs, a, b, shuffled)


def test_breaks_outside_the_interval_are_clamped_to_it():
    rule = gauss_legendre(3)
    assert rule.integrate(np.exp, 0.0, 1.0, [-7.0, 9.0]) == pytest.approx(rule.integrate(np.exp, 0.0, 1.0), rel=1e-15)


def test_an_interval_of_no_length_has_no_integral():
    assert gauss_legendre(4).integrate(np.cos, 2.0, 2.0, [1.0, 3.0]) == 0


@pytest.mark.parametrize("make", [gauss_legendre, riemann])
def test_a_kink_spoils_convergence_and_a_break_restores_it(make):
    def kinked(x):
        return np.abs(x - 0.3) * np.exp(x)

    exact = gauss_legendre(64).integrate(kinked, -1.0, 1.0, [0.3])
    counts = np.array([4, 8, 16, 32, 64])
    without = [abs(make(n).integrate(kinked, -1.0, 1.0) - exact) for n in counts]
    with_break = [abs(make(n).integrate(kinked, -1.0, 1.0, [0.3]) - exact) for n in counts]
    assert slope(counts, without) < 3
    if make is gauss_legendre:
        # The break leaves two entire functions: eight points reach double precision, as for the exponential alone.
        assert with_break[1] < 1e-13 < 1e-4 < without[1]
    else:
        assert slope(counts, with_break) == pytest.approx(2, abs=0.02)


def test_each_element_has_its_own_bounds_and_breaks():
    a, b, kink = np.array([-1.0, 2.0, 0.0]), np.array([1.0, -1.0, 3.0]), np.array([0.25, 0.5, 7.0])
    values = gauss_legendre(2).integrate(lambda x: np.abs(x - kink), a, b, [kink])
    distance_a, distance_b = a - kink, b - kink
    np.testing.assert_allclose(values, (distance_b * abs(distance_b) - distance_a * abs(distance_a)) / 2, rtol=1e-14)


def test_numbers_arrays_and_whole_numbers_mix():
    values = gauss_legendre(2).integrate(lambda x: x, 0, np.array([1, 2]), [np.array([0.5, 0.1]), 1])
    np.testing.assert_allclose(values, [0.5, 2.0], rtol=1e-15)


def test_a_vector_valued_function_is_integrated_by_component():
    b = np.array([[1.0], [2.0]])  # (N, 1), to scale the function's values (N, 3)
    values = gauss_legendre(3).integrate(lambda x: x ** np.arange(3), 0.0, b)
    np.testing.assert_allclose(values, [[1, 1 / 2, 1 / 3], [2, 2, 8 / 3]], rtol=1e-14)


# -- Dr.Jit --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [gauss_legendre, riemann])
@pytest.mark.parametrize("broken", [False, True])
def test_drjit_equals_numpy_to_float32_rounding(make, broken, rng):
    import drjit as dr

    rule = make(6)
    a, b = rng.uniform(-2, 2, (2, 100)).astype(np.float32)
    kink = rng.uniform(-3, 3, 100).astype(np.float32)
    exact = rule.integrate(
        lambda x: np.exp(-x) * np.abs(x - kink), *map(np.float64, (a, b)), [np.float64(kink), 0.5] if broken else ()
    )
    device_kink = Float(kink)
    found = rule.integrate(
        lambda x: dr.exp(-x) * dr.abs(x - device_kink), Float(a), Float(b), [device_kink, 0.5] if broken else ()
    )
    # The sum is at most e² · 5 over a length of 4; 18 terms and an exponential of 2 ulp are about ten roundings.
    np.testing.assert_allclose(found.numpy(), exact, rtol=0, atol=np.e**2 * 5 * 4 * 10 * EPSILON32)


def test_a_drjit_function_of_a_number_keeps_its_type():
    total = gauss_legendre(3).integrate(lambda t: Array3f(1, 2, 3) * t, 0.0, 2.0, [np.float64(0.5)])
    assert type(total) is Array3f
    np.testing.assert_allclose(total.numpy().ravel(), [2, 4, 6], rtol=4 * EPSILON32)


def test_a_drjit_bound_may_be_one_of_two():
    total = gauss_legendre(3).integrate(lambda t: t, 0.0, Float(1, 2, -2), [0.5])
    np.testing.assert_allclose(total.numpy(), [0.5, 2, 2], rtol=4 * EPSILON32)


def test_bounds_and_breaks_are_data_and_no_part_of_the_kernel():
    import drjit as dr

    def kernels(a, b, edge):
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
            dr.kernel_history_clear()
            bounds = [dr.opaque(Float, value) for value in (a, b, edge)]
            dr.eval(gauss_legendre(4).integrate(dr.cos, bounds[0], bounds[1], bounds[2:]))
            return [kernel["hash"] for kernel in dr.kernel_history([dr.KernelType.JIT])]

    first = kernels(0, 1, 0.5)
    assert len(first) == 1 and kernels(-1, 3, 0.25) == first


def test_the_integral_can_be_differentiated():
    import drjit as dr

    b = Float(1.5)
    dr.enable_grad(b)
    dr.backward(gauss_legendre(8).integrate(dr.cos, 0.0, b, [0.75]))
    assert b.grad[0] == pytest.approx(np.cos(1.5), abs=10 * EPSILON32)


# -- Bad input -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [gauss_legendre, riemann])
@pytest.mark.parametrize("n", [0, -1, 2.0, True, "six", None, MOST_POINTS + 1])
def test_a_rule_wants_a_positive_whole_number_of_points(make, n):
    with pytest.raises(ValueError, match=r"expected a whole number of points from 1 to 256"):
        make(n)


@pytest.mark.parametrize(
    ("points", "weights", "message"),
    [
        ([], [], "finite numbers"),
        ([[0.0]], [2.0], "one row"),
        ("", [2.0], "points of the rule mine: expected one row of finite numbers"),
        ([0.0], len, "weights of the rule mine: expected one row of finite numbers"),
        ([0.0], [np.nan], "weights of the rule mine"),
        (np.array([0.5j]), [2.0], "points of the rule mine: expected one row of finite numbers"),
        ([0.0], np.ma.array([2.0], mask=True), "weights of the rule mine: expected one row of finite numbers"),
        ([0.0], [1.0, 1.0], "1 points and 2 weights"),
        ([1.5], [2.0], "between -1 and 1"),
        ([0.0], [1.0], "sum to 1: expected 2"),
    ],
)
def test_a_rule_of_one_s_own_is_checked(points, weights, message):
    with pytest.raises(ValueError, match=message):
        Rule("mine", points, weights)


def test_bounds_and_breaks_of_no_number_are_refused():
    with pytest.raises(TypeError, match="bound is 'far'"):
        gauss_legendre(2).integrate(np.cos, 0.0, "far")
    with pytest.raises(TypeError, match="expected a sequence"):
        gauss_legendre(2).integrate(np.cos, 0.0, 1.0, 0.5)
    with pytest.raises(TypeError, match="expected a sequence"):
        gauss_legendre(2).integrate(np.cos, 0.0, 1.0, Float(0.5))


def test_rules_are_equal_by_their_points_and_weights():
    def simpson(middle=4 / 3):
        return Rule("simpson", [-1, 0, 1], [1 / 3, middle, 5 / 3 - middle])

    assert simpson() == simpson() and len({simpson(), simpson(), pickle.loads(pickle.dumps(simpson()))}) == 1
    assert pickle.loads(pickle.dumps(gauss_legendre(3))) == gauss_legendre(3)
    assert len({simpson(), simpson(1.0), gauss_legendre(3), riemann(3), gauss_legendre(4)}) == 5
    assert gauss_legendre(3) != "gauss_legendre(3)"
