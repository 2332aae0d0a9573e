"""Widths of scattered beams where few of them are."""

import drjit as dr
import numpy as np
import pytest

from photonbeams.numerics.arrays import to_float, to_uint, to_vectors
from photonbeams.runtime.device import Bool, Float
from photonbeams.transport.segments.density import widened
from photonbeams.transport.segments.radii import Width
from photonbeams.transport.segments.records import Segments

CENTER, EXTENT = np.array([5.0, -2.0, 1.0]), 3.0


def segments_of(start, direction, length, radius, scattered=True, source=0):
    result = dr.zeros(Segments, len(start))
    result.origin, result.direction, result.length = to_vectors(start), to_vectors(direction), to_float(length)
    none = dr.zeros(Float, len(start))
    result.width = Width(none, none + radius, none, none)
    result.scattered = Bool(np.full(len(start), scattered))
    result.source, result.medium = to_uint(np.full(len(start), source)), to_uint(np.full(len(start), 1))
    return result


def through_the_box(count, x, seed=0):
    """Return `count` segments along +Z through a box of 2 × 2 × 2 around the centre, at abscissas within `x`."""
    numbers = np.random.default_rng(seed).random((count, 2))
    across = np.column_stack([x[0] + (x[1] - x[0]) * numbers[:, 0], 2 * numbers[:, 1] - 1, np.full(count, -1.0)])
    return CENTER + across, np.tile([0.0, 0, 1], (count, 1)), np.full(count, 2.0)


def ends(segments):
    return np.array([np.asarray(segments.width(s).numpy()) for s in (Float(0), segments.length)])


def test_a_dozen_beams_cover_a_point():
    # Of 50,000 lines, a cell has about 200, so its radius is known to 4 %.
    (found,) = widened([segments_of(*through_the_box(50_000, (-1, 1)), radius=1e-4)], CENTER, EXTENT)
    np.testing.assert_allclose(np.median(ends(found)), np.sqrt(12 / (np.pi * 50_000 / 4)), rtol=0.04)


def test_beams_are_wide_where_few_are():
    many, few = through_the_box(40_000, (-1, 0)), through_the_box(400, (0, 1), 1)
    found = widened([segments_of(*many, radius=0.02), segments_of(*few, radius=0.02)], CENTER, EXTENT)
    # 12 / (π n) with 20,000 and 200 beams per unit of area.
    assert np.median(ends(found[0])) == pytest.approx(0.02)
    assert np.median(ends(found[1])) == pytest.approx(np.sqrt(12 / (np.pi * 200)), rel=0.15)


def test_each_lamp_counts_its_own_beams_and_light_that_was_not_scattered_keeps_its_width():
    many, few = through_the_box(40_000, (-1, 1)), through_the_box(400, (-1, 1), 1)
    given = [segments_of(*many, radius=0.02), segments_of(*few, radius=0.02, source=1)]
    alone = widened(given[1:], CENTER, EXTENT)[0]
    np.testing.assert_array_equal(ends(widened(given, CENTER, EXTENT)[1]), ends(alone))
    (straight,) = widened([segments_of(*few, radius=0.02, scattered=False)], CENTER, EXTENT)
    np.testing.assert_array_equal(ends(straight), np.float32(0.02))


def test_light_that_goes_far_away_leaves_the_grid_as_it_is():
    given = through_the_box(10_000, (-1, 1))
    far = segments_of(np.stack([CENTER, CENTER]), [[1.0, 0, 0], [0, 1, 0]], [1e6, np.inf], radius=1e-4)
    (alone,) = widened([segments_of(*given, radius=1e-4)], CENTER, EXTENT)
    both = widened([segments_of(*given, radius=1e-4), far], CENTER, EXTENT)
    assert np.median(ends(both[0])) == pytest.approx(np.median(ends(alone)), rel=0.3)
    assert np.isfinite(both[1].width.radius.numpy()).all()
    assert both[1].width.radius.numpy()[1] == np.float32(1e-4)  # a line without an end does not count
