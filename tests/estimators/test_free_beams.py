"""Six points keep their promise on beams, looks and rays that are drawn freely, against an adaptive twin."""

import numpy as np
import pytest

import photonbeams as pb
from benchmarks.free_beams import FALLOFFS, PROFILES, SHAPES, VIEWS, draw
from tests.helpers.sweep import sweep

SIX, TWELVE = pb.gauss_legendre(6), pb.riemann(12)
SEEDS = {"some": range(24), "all": range(100, 300)}
#: What was wrong before: each has rays that were off by several per cent, up to all of their light.
KINDS = [
    *({"profile": each} for each in ("gaussian", "table", "hollow")),
    *({"falloff": each} for each in ("none", "smooth", "catmull-rom", "monotone", "fade")),
    *({"shape": each} for each in ("opening", "needle", "point")),
    *({"view": each} for each in ("along", "tip")),
]


def shares(draws, estimator, rule):
    """Return which part of all lit rays errs by more than 1 %, and by more than 0.1 %."""
    counts = np.zeros(3)
    for each in draws:
        found = each.estimate(estimator, rule)
        counts += [each.wrong(found, 1e-2).sum(), each.wrong(found, 1e-3).sum(), each.lit.sum()]
    assert counts[2] > 6 * len(draws)
    return counts[:2] / counts[2]


@pytest.mark.parametrize("seeds", sweep(SEEDS, ["some"]))
def test_random_rays_are_right(seeds):
    draws = [draw(seed) for seed in SEEDS[seeds]]
    six, auto = shares(draws, "frustum", SIX), shares(draws, "auto", SIX)
    assert max(six[0], auto[0]) <= 0.005 and max(six[1], auto[1]) <= 0.02


@pytest.mark.parametrize("kinds", sweep([{"profile": "epanechnikov"}, {}], [{"profile": "epanechnikov"}]), ids=str)
def test_a_sum_with_twice_as_many_steps_is_far_behind(kinds):
    draws = [draw(seed, **kinds) for seed in range(300, 310 if kinds else 400)]
    assert shares(draws, "frustum", TWELVE)[1] >= 5 * max(shares(draws, "frustum", SIX)[1], 0.005)


@pytest.mark.parametrize(
    "kinds", sweep(KINDS, [{"profile": "gaussian"}, {"falloff": "none"}, {"shape": "needle"}]), ids=str
)
def test_each_kind_is_right(kinds):
    six = shares([draw(seed, **kinds) for seed in range(500, 510)], "auto", SIX)
    assert six[0] <= 0.01 and six[1] <= 0.05  # of some hundred rays


def test_every_kind_is_drawn():
    draws = [draw(seed).kinds for seed in SEEDS["all"]]
    for name, kinds in {"profile": PROFILES, "falloff": FALLOFFS, "shape": SHAPES}.items():
        assert {each[name] for each in draws} == {*kinds}
    assert {view for each in draws for view in each["view"]} == {*VIEWS}
