"""Long sweeps: what runs in `make test`, and what `make soak` notes."""

import pytest

from tests.helpers.sweep import sweep
from tools.soak import passed


def names_for_soak(values):
    marked = [value for value in values if isinstance(value, type(pytest.param()))]
    return [value.values[0] for value in marked if any(mark.name == "soak" for mark in value.marks)]


def test_a_sweep_keeps_what_represents_it_and_leaves_the_rest_to_soak():
    values = sweep(["ball", "disk", "cone"], keep={"disk"})
    assert [getattr(each, "values", (each,))[0] for each in values] == ["ball", "disk", "cone"]
    assert names_for_soak(values) == ["ball", "cone"]


def test_values_with_names_are_kept_by_their_names_and_keep_their_marks():
    slow = pytest.param(7, marks=pytest.mark.filterwarnings("ignore"), id="seven")
    values = sweep([slow, 8], keep={"eight"}, ids=["seven", "eight"])
    assert names_for_soak(values) == [7] and values[0].id == "seven" and len(values[0].marks) == 2


def test_a_sweep_of_which_nothing_is_left_is_an_error():
    with pytest.raises(ValueError, match="a sweep of 2 values has none"):
        sweep(["ball", "disk"], keep={"cube"})


def test_the_note_counts_the_tests_that_passed():
    assert passed("....\n6100 passed, 3 skipped in 1200.00s\n") == 6100 and passed("no tests ran") == 0
