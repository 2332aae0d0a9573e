"""Passes end at the first check at which the error meets the goal, also when resumed, and the true error meets it."""

from itertools import pairwise

import numpy as np
import pytest

from photonbeams import Shot
from photonbeams.render.passes import PLAIN_RUN, Statistics, accumulate, next_check
from photonbeams.render.settings import Settings
from tests.helpers.small_stage import CAMERA, FLOOR, FOG, LAMP, write_stage
from tests.helpers.sweep import sweep

SMALL = {"width": 48, "height": 32, "beams": 256}


class Falling:
    """A frame whose error is `first` after one pass, and falls with the square root of the number of passes."""

    about = ""

    def __init__(self, first, together=1):
        self.statistics, self.first, self._together, self.begun = Statistics(), first, together, []

    def together(self, number):
        return self._together

    def add_passes(self, numbers):
        self.statistics.passes += len(numbers)
        self.begun.append(numbers)

    def error(self):
        done = self.statistics.passes
        return self.first / np.sqrt(done) if done else np.nan

    def sums(self):
        raise AssertionError("no checkpoint was asked for")


def passes_for(error, first=1.0, together=1, **given):
    return accumulate(lambda _: Falling(first, together), Settings(error=error, **given), PLAIN_RUN).statistics.passes


def test_checks_are_at_powers_of_two_and_half_way_between():
    checks = [next_check(0)]
    while checks[-1] < 500:
        checks.append(next_check(checks[-1]))
    assert checks == [8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512]
    assert all(next_check(done) == b for a, b in pairwise(checks) for done in range(a, b))


@pytest.mark.parametrize(("error", "passes"), [(0.5, 8), (0.3, 12), (0.25, 16), (0.2, 32), (0.1, 128)])
def test_passes_end_at_the_first_check_whose_error_is_small_enough(error, passes):
    # 1 / √passes is at most the goal; rounding does not put 1 / √16 above 0.25.
    assert passes_for(error) == passes
    assert passes_for(error, together=64) == passes  # also if 64 passes are rendered at once


def test_there_are_no_more_passes_than_the_user_gives():
    assert passes_for(0.01, passes=40) == 40
    assert Settings(error=0.1).passes == Settings.of(Settings(), {"error": 0.1}).passes == 4096
    assert Settings().passes == 16 and Settings.of(None, {"error": 0.1, "passes": 7}).passes == 7


def test_a_time_limit_ends_them_before():
    assert passes_for(0.01, time_limit=1e-9) == 1


def test_the_number_of_passes_is_planned_by_nobody():
    planned = []
    accumulate(lambda number: planned.append(number) or Falling(1.0), Settings(error=0.5), PLAIN_RUN)
    assert planned == [None]


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    return Shot.open(write_stage(tmp_path_factory.mktemp("stage") / "stage.usda", FOG, CAMERA, LAMP, FLOOR))


def light(frame):
    return frame.layers["rgba"][..., :3].mean(axis=2)


@pytest.mark.parametrize("seed", sweep(range(3), [0]))
def test_the_true_error_is_no_more_than_the_goal(shot, seed):
    # These are as many light paths as in 1,024 small passes, whose time would go into starting kernels.
    many = {**SMALL, "passes": 32, "beams": 16 * SMALL["beams"]}
    reference = np.mean([light(shot.render(seed=seed, **many)) for seed in (100, 101)], axis=0)
    goal = 0.05
    frame = shot.render(error=goal, seed=seed, **SMALL)
    done = frame.statistics.passes
    # At the check before, there were at most a third fewer passes, and their error was larger than the goal.
    assert 8 < done < 64 and 0.7 * goal < frame.statistics.error <= goal
    relative = np.abs(light(frame) - reference) / reference
    order = np.argsort(relative, axis=None)
    half = np.searchsorted(np.cumsum(reference.ravel()[order]), 0.5 * reference.sum())
    # Half of the light is in pixels with a smaller error than this, as half of normal errors are below 0.6745
    # standard deviations; the estimate is a mean around such a median. Samples that are more even than
    # independent ones have a smaller error.
    assert 0.05 * goal < relative.ravel()[order][half] / 0.6745 < goal


def test_a_frame_that_was_interrupted_ends_at_the_same_pass(shot, tmp_path):
    given = {"error": 0.08, **SMALL}
    whole = shot.render(**given)
    path = tmp_path / "frame.checkpoint"

    def interrupt(done, statistics):
        if done == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        shot.render(checkpoint=path, progress=interrupt, **given)
    resumed = shot.render(checkpoint=path, **given)
    assert resumed.statistics.passes == whole.statistics.passes >= 8
    assert all(np.array_equal(resumed.layers[name], whole.layers[name]) for name in whole.layers)
