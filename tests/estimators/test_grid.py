"""Rays through the grid against all pairs: no beam is missed or counted twice, wherever rays begin and end."""

import drjit as dr
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import photonbeams as pb
from photonbeams.beams.curves import curved
from photonbeams.estimators import cells
from photonbeams.estimators.estimate import ENDLESS, bind, estimate_rays, sum_over_all
from photonbeams.estimators.geometry import Rays
from photonbeams.estimators.grid import build, sum_over_grid, traverse_grid
from photonbeams.estimators.points import Points
from photonbeams.estimators.records import pack
from photonbeams.numerics.arrays import to_float, to_vectors
from photonbeams.runtime.device import Array3f, Float, UInt32
from tests.helpers.kernels import compiled

EPSILON32 = float(np.finfo(np.float32).eps)
MEDIUM = pb.Medium((0.3, 0.2, 0.1), (0.05, 0.1, 0.2), 0.4)
POINTS = Points(pb.gauss_legendre(6))
ESTIMATORS = ("auto", "billboard", "frustum")


def rays_of(origin, direction, t_min=0.0, t_max=ENDLESS, time=None):
    direction = np.asarray(direction, dtype=float)
    direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    count = len(direction)
    return Rays(
        to_vectors(np.broadcast_to(origin, (count, 3))), to_vectors(direction),
        to_float(np.broadcast_to(t_max, count)), to_float(np.broadcast_to(t_min, count)),
        time=None if time is None else to_float(time),
    )  # fmt: skip


def both(beams, rays, estimator, look=None, close=None):
    """Return the radiance by the grid and by trying all pairs, each (N, 3)."""
    look = bind(look or pb.Look(), beams, close, MEDIUM)
    packed = pack(beams, Array3f(0), shared=False, close=close, identity=look.of_beams)
    by_grid = sum_over_grid(beams, close, packed, rays, look, estimator, POINTS)
    by_all = sum_over_all(packed, rays, look, estimator, POINTS)
    return [np.ascontiguousarray(each.numpy().T).astype(np.float64) for each in (by_grid, by_all)]


def agree(found, expected, count):
    """Assert that sums of up to `count` positive numbers, the same ones in another order, agree.

    Both kernels compute a beam's light by the same formulas, but the compiler may fuse operations differently. For a
    ray that grazes a beam or passes an end, the results may then differ by more than rounding. A beam that is missed or
    counted twice would show in far more rays than those few.
    """
    error = np.abs(found - expected)
    allowed = count * EPSILON32 * expected + 8 * EPSILON32 * np.quantile(expected, 0.9)
    seen = np.count_nonzero(expected[:, 0])
    assert seen > 200
    assert np.count_nonzero(np.any(error > allowed, axis=1)) <= 0.005 * seen
    assert np.linalg.norm(error) <= 1e-5 * np.linalg.norm(expected)


def random_ends(rng, count, parallel=True):
    """Return ends and radii of beams of all sizes: long and thin, short and thick, parallel to axes, tapered."""
    start = rng.uniform(-1, 1, (count, 3)) * rng.choice([0.3, 2, 5], (count, 1))
    way = rng.normal(size=(count, 3)) * rng.choice([0.05, 1, 10], (count, 1))
    straight = rng.random(count) < 0.2 * parallel
    way[straight] *= np.eye(3)[rng.integers(0, 3, np.count_nonzero(straight))]
    radius = rng.choice([0.004, 0.05, 0.5], (count, 1)) * rng.uniform(0.1, 1, (count, 2))
    radius[::7, 0] = 0  # pointed
    return start, start + way, radius


def random_beams(rng, count, parallel=True):
    start, end, radius = random_ends(rng, count, parallel)
    return pb.Beams(start, end, radius[:, 0], radius[:, 1], rng.uniform(0.1, 1, (count, 3)))


def random_rays(rng, count, time=False, targets=None):
    """Return rays from far away, from outside and from inside, infinite and finite, some parallel to axes."""
    origin = rng.normal(size=(count, 3)) * rng.choice([0.3, 3, 30], (count, 1))
    target = rng.normal(size=(count, 3))
    if targets is not None:
        target = 0.005 * target + targets[rng.integers(0, len(targets), count)]
    direction = target - origin
    direction[::5] *= np.eye(3)[rng.integers(0, 3, len(direction[::5]))]
    direction[1::5, rng.integers(0, 3)] = 0
    direction[2::50] = (0, -1, 0)
    origin[2::50] = target[2::50] * [1, 0, 1] + [0, 4, 0]
    t_min = rng.choice([0.0, 0.0, 1.0, 5.0], count)
    t_max = rng.choice([0.0, 0.5, 3.0, 30.0, 100.0, ENDLESS], count)
    return rays_of(origin, direction, t_min, t_max, rng.random(count) if time else None)


KINDS = ("straight", "capped", "beside", "moving", "curved", "curved and capped", "curved and moving")
# `auto` has both of the others in it, which are tried alone for the plainest beams and for those that have most.
ALONE = ("straight", "curved and moving")


@pytest.mark.parametrize(
    ("kind", "estimator"),
    [
        pytest.param(kind, each, marks=() if each == "auto" or kind in ALONE else pytest.mark.soak)
        for kind in KINDS
        for each in ESTIMATORS
    ],
)
def test_the_grid_gives_what_trying_all_gives(estimator, kind, rng):
    count, close, targets = 300, None, None
    if "curved" in kind:
        beams, targets = coils(rng)
        count = len(beams)
    else:
        # The billboard alone is meaningless for a ray parallel to a beam: it counts beams that the ray does not meet.
        beams = random_beams(rng, count, parallel=estimator != "billboard")
    if "capped" in kind:
        walls = unit(rng.normal(size=(count, 3)))  # turned to face the light below
        numbers = beams.arrays()
        walls *= -np.sign(np.sum(walls * (numbers["end"] - numbers["start"]), axis=1, keepdims=True))
        beams = pb.Beams(**numbers, end_normal=walls)
    if "beside" in kind:
        numbers = beams.arrays()
        middle, normal = 0.5 * (numbers["start"] + numbers["end"]), unit(rng.normal(size=(count, 3)))
        beams = pb.Beams(**numbers, side=middle, side_normal=normal, start_normal=normal[::-1])
    if "moving" in kind:
        numbers = beams.arrays()
        shift = rng.normal(size=(count, 3)) * 0.2 if kind == "moving" else np.array([0.03, -0.02, 0.01])
        numbers["start"], numbers["end"] = numbers["start"] + shift, numbers["end"] + 0.5 * shift
        close = pb.Beams(**numbers)
    found, expected = both(beams, random_rays(rng, 5000, close is not None, targets), estimator, close=close)
    agree(found, expected, count)


def coils(rng):
    """Return beams along coils, in pieces that are longer than wide, and points on the coils."""
    points = []
    for _ in range(6):
        turn = np.linspace(0, 2, 41) * rng.uniform(1, 6)
        coil = np.stack([np.cos(turn), np.sin(turn), 0.2 * turn], axis=1) * rng.uniform(0.3, 1)
        points.append(coil @ np.linalg.qr(rng.normal(size=(3, 3)))[0] + 0.5 * rng.normal(size=3))
    points = np.concatenate(points)
    # Pieces are at least 0.3 · 2/40 = 0.015 long.
    radius = rng.choice([0.002, 0.01], 6).repeat(41) * rng.uniform(0.5, 1.5, len(points))
    return curved(points, radius, (1, 0.7, 0.4), [41] * 6), points


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def test_the_look_is_asked_where_the_light_is(rng):
    look = pb.Look(
        along=pb.looks.ColorRamp([0, 0.5, 1], [[1, 0, 0], [0, 1, 0], [0, 0, 1]]) * pb.looks.Attenuation(),
        across=pb.looks.Gaussian() * pb.looks.Function(lambda P: 1.5 + dr.sin(3 * P.x)),
        eye=lambda t, random: dr.exp(-0.1 * t) * (0.5 + random),
    )
    found, expected = both(random_beams(rng, 100), random_rays(rng, 3000), "auto", look)
    agree(found, expected, 100)


@pytest.mark.parametrize("estimator", ["billboard", "frustum"])
@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), size=st.sampled_from([1e-3, 1.0, 1e3]), away=st.sampled_from([0.0, 3.0, 100.0]))
def test_every_beam_counts_once(estimator, seed, size, away):
    """Copies of one beam, each with the power 1, have a whole multiple of the radiance of one.

    This holds at every scale, at every distance from the world's origin and for every size of the cells, which other
    beams without power change.
    """
    rng = np.random.default_rng(seed)
    start, end, radius = random_ends(rng, 40)
    start, end, radius = start * size + away * size, end * size + away * size, radius * size
    copies = 2 ** rng.integers(0, 3)
    power = np.zeros((40, 3))
    start[:copies], end[:copies], radius[:copies], power[:copies] = start[0], end[0], radius[0] + 0.01 * size, 1
    beams = pb.Beams(start, end, radius[:, 0], radius[:, 1], power)
    toward = start[0] + (end[0] - start[0]) * rng.random((500, 1)) + radius[0].max() * rng.normal(size=(500, 3))
    origin = toward + rng.normal(size=(500, 3)) * size * rng.choice([0.1, 2.0], (500, 1))
    direction = toward - origin
    direction[::4, rng.integers(0, 3)] = 0
    rays = rays_of(origin, direction, 0.0, rng.choice([0.5, 4.0, 1e9], 500) * size)
    flat = pb.Look(across=pb.looks.Uniform(), along=1.0, eye=1.0, angle=1.0)
    found, _ = both(beams, rays, estimator, flat)
    once = pb.Beams(*(each[:1] for each in (start, end, radius[:, 0], radius[:, 1], power)))
    _, expected = both(once, rays, estimator, flat)
    # At a hard rim the rounding of positions decides whether a ray sees the beam; elsewhere equal numbers are summed.
    seen = (found[:, 0] > 0) & (expected[:, 0] > 0)
    assert np.mean((found[:, 0] > 0) != (expected[:, 0] > 0)) <= 0.01
    ratio = found[seen, 0] / expected[seen, 0] / copies
    assert np.mean(np.abs(ratio - 1) > 1e-3) <= 0.01
    assert np.all(ratio < 1.5) and np.all(ratio > 0.5)


def boxed(rng, rays, count=200):
    """Return the grid of some beams, its lists of beams by cell, and the spans of the rays in it."""
    beams = random_beams(rng, count)
    grid, marks, span = build(beams, None, rays)
    lists = cells.Sorting(grid.cells, marks.visit, 0, count).lists()
    return grid, lists, span


def test_rays_walk_every_cell_on_their_way_once(rng):
    """The spans of t in the cells that a ray visits add up to its whole length in the grid."""
    rays = random_rays(rng, 2000)
    grid, _, span = boxed(rng, rays)
    number = dr.arange(UInt32, grid.cells + 1)
    full = cells.CellLists(dr.minimum(number, grid.cells - 1), number, grid.cells)  # one item per cell: its number

    def visit(total, ray, cell, interval):
        enter, leave = dr.maximum(interval[0], span[0]), dr.minimum(interval[1], span[1])
        middle = grid.local(ray.point(0.5 * (enter + leave)))
        x, y, z = (grid.index(middle[axis], axis) for axis in range(3))
        # The middle of a span lies in the cell, unless the span is so short that rounding decides.
        sure = (leave - enter) > 1e-3 * grid.size
        wrong = sure & (grid.number(x, y, z) != cell)
        return total + Array3f(dr.maximum(leave - enter, 0), Float(wrong), 1)

    way, wrong, turns = traverse_grid(rays, span, grid, full, visit, dr.zeros(Array3f, 2000)).numpy()
    length = np.maximum(np.asarray(span[1]) - np.asarray(span[0]), 0)
    assert grid.cells > 500 and turns.max() > 20 and np.count_nonzero(length) > 500
    assert not wrong.any()
    # Every step rounds t, which is at most `largest`, and the sum.
    largest = np.where(length > 0, np.asarray(span[1]), 0)
    assert np.all(np.abs(way - length) <= 2 * EPSILON32 * (turns + 1) * (largest + length))


def test_the_lists_hold_the_beams_in_order_and_each_once_a_cell(rng):
    grid, lists, _ = boxed(rng, random_rays(rng, 2000), 300)
    first, items = np.asarray(lists.first), np.asarray(lists.items)
    assert first[0] == 0 and first[-1] == lists.entries and np.all(np.diff(first.astype(int)) >= 0)
    for cell in range(grid.cells):
        inside = items[first[cell] : first[cell + 1]]
        assert np.all(np.diff(inside.astype(int)) > 0)


@pytest.mark.parametrize("cells_along", [1, 3, 16, 128])
def test_sorting_is_complete_and_always_the_same(cells_along, rng):
    """For items with one known cell each, the lists equal NumPy's sort and are the same every time."""
    count, total = 5000, cells_along**3
    where = rng.integers(0, total, count).astype(np.uint32)
    of_item = UInt32(where)

    def visit(item, lane, entry):
        entry(dr.gather(UInt32, of_item, item), item, lane, True)

    lists = cells.Sorting(total, visit, 0, count).lists()
    assert lists.entries == count
    assert np.array_equal(np.asarray(lists.first), np.searchsorted(np.sort(where), np.arange(total + 1)))
    items = np.asarray(lists.items)
    assert np.array_equal(where[items], np.sort(where)) and len(set(items.tolist())) == count
    again = cells.Sorting(total, visit, 0, count).lists()
    assert np.array_equal(np.asarray(again.items), items)


def test_lists_longer_than_memory_allows_are_worked_off_in_parts(rng, monkeypatch):
    beams, rays = random_beams(rng, 200), random_rays(rng, 2000)
    whole, expected = both(beams, rays, "auto")
    monkeypatch.setattr(cells, "ENTRIES", 3000)
    parts, _ = both(beams, rays, "auto")
    agree(parts, expected, 200)
    # The same numbers, summed in another order.
    np.testing.assert_allclose(parts, whole, rtol=200 * EPSILON32)


def test_the_same_beams_give_the_same_bits(rng):
    beams, rays = random_beams(rng, 2000), random_rays(rng, 2000)
    first, second = (both(beams, rays, "auto")[0] for _ in range(2))
    assert first.any() and np.array_equal(first, second)


def test_rays_that_meet_no_beams_see_nothing(rng):
    beams = pb.Beams([[0, 0, 0]], [[1, 0, 0]], 0.1, 0.1, [[1, 1, 1]])
    for rays in (
        rays_of((0, 5, 0), rng.normal(size=(50, 3)) + np.array([0, 5, 0])),  # away from the beam
        rays_of((0, 5, 0), [[0, -1, 0]] * 50, t_max=2.0),  # ending before the beam
        rays_of((0.5, 0, 0), [[0, -1, 0]] * 50, t_min=2.0, t_max=1.0),  # empty: t_min is beyond t_max
    ):
        found, expected = both(beams, rays, "auto")
        assert not found.any() and not expected.any()


@pytest.mark.parametrize("given", [{}, {"end_normal": [[0, 0, 1]] * 20}])
def test_beams_without_a_length_are_left_out(given, rng):
    numbers = random_beams(rng, 20).arrays() | given
    numbers["end"][:5] = numbers["start"][:5]
    numbers["radius_start"][:] = numbers["radius_end"][:] = 0.3
    rays = random_rays(rng, 2000, targets=numbers["end"])
    points, others = (
        pb.Beams(**{name: each[part] for name, each in numbers.items()}) for part in (np.s_[:5], np.s_[5:])
    )
    found, _ = both(pb.Beams(**numbers), rays, "frustum")
    _, expected = both(others, rays, "frustum")
    agree(found, expected, 20)
    assert not both(points, rays, "frustum")[0].any()


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_one_ray_and_one_beam(estimator):
    """The grid equals trying all where its box is thin, a line or a point, and for rays along its faces."""
    beams = pb.Beams([[0, 0, 0]], [[1, 0, 0]], 0.25, 0.25, [[1, 1, 1]])
    for origin, direction in (
        ((0.5, 0, -1), (0, 0, 1)),
        ((-1, 0, 0), (1, 0, 0)),
        ((0.5, 0.1, 0), (0, 0, 1)),
        ((0.5, 0.2, -1), (0.3, 0, 1)),
        ((-1, 0.25, 0), (1, -1e-3, 0)),
        ((2, 1, 0.1), (-1, -0.8, -1e-7)),
    ):
        found, expected = both(beams, rays_of(origin, [direction]), estimator)
        np.testing.assert_allclose(found, expected, rtol=8 * EPSILON32)
        assert expected.any() or estimator == "billboard" or direction[2] == 0


def test_estimate_takes_the_grid_where_rays_and_beams_are_many(rng, monkeypatch):
    from photonbeams.estimators.estimate import estimate

    module = __import__("sys").modules["photonbeams.estimators.estimate"]
    beams, rays = random_beams(rng, 100), random_rays(rng, 1000)
    origin, direction = (np.ascontiguousarray(each.numpy().T) for each in (rays.origin, rays.direction))
    found = []
    for most in (0, 10**9):
        monkeypatch.setattr(module, "MOST_PAIRS", most)
        radiance = estimate(beams, origin, direction, rays.t_max, t_min=rays.t_min, medium=MEDIUM)
        given = estimate_rays(beams, rays, look=pb.Look(), medium=MEDIUM, points=POINTS)
        found.append(radiance.numpy())
        np.testing.assert_allclose(given.numpy().T, found[-1], rtol=2e-4, atol=1e-6 * found[-1].max())
    agree(*(each.astype(np.float64) for each in found), 100)


def test_other_beams_and_rays_compile_nothing(rng):
    def run(beams, rays):
        dr.eval(sum_of(random_beams(rng, beams), random_rays(rng, rays)))

    def sum_of(beams, rays):
        bound = bind(look, beams, None, MEDIUM)
        packed = pack(beams, Array3f(0), shared=False)
        return sum_over_grid(beams, None, packed, rays, bound, "auto", POINTS)

    look = pb.Look(along=pb.looks.ColorRamp([0, 1], [[1, 0, 0], [0, 0, 1]]) * pb.looks.Attenuation())
    run(300, 1000)
    assert not compiled(run, 517, 2311)
