"""Sums over passes have the same bits for any ranges and order; sums of different pictures are refused."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from photonbeams.render.films.frame_sums import FrameSums
from photonbeams.render.films.sums import BLOCK, LIGHT, SQUARES, PassSums
from photonbeams.scene import SceneError


def picture(number, count=5):
    """Return a pass; every third pass has light of a group, and the first has a depth."""
    rng = np.random.default_rng(number)
    result = {"surface": rng.exponential(size=(3, count)), "alpha": rng.random(count)}
    if number % 3 == 0:
        result["beams/key"] = rng.exponential(1e-3, (3, count))
    if number == 0:
        result["depth"] = np.full(count, 7.0)
    return {name: each.astype(np.float32) for name, each in result.items()}


def summed(numbers):
    sums = PassSums()
    for number in numbers:
        sums.add(number, picture(number))
    return sums


def same(first, second):
    return first.keys() == second.keys() and all(np.array_equal(first[name], second[name]) for name in first)


@settings(max_examples=60, deadline=None)
@given(
    passes=st.integers(1, 3 * BLOCK + 5), cuts=st.lists(st.integers(0, 60), max_size=6),
    order=st.randoms(use_true_random=False),
)  # fmt: skip
def test_ranges_in_any_order_join_to_the_bits_of_one_machine(passes, cuts, order):
    whole = summed(range(passes))
    ends = sorted({0, passes, *(cut % passes for cut in cuts)})
    parts = [summed(range(a, b)) for a, b in pairwise(ends)]
    order.shuffle(parts)
    joined = parts[0]
    for each in parts[1:]:
        joined.join(PassSums.restored(each.state()))
    assert len(joined) == passes and joined.ranges() == [range(passes)]
    assert same(joined.total(), whole.total()) and same(joined.state(), whole.state())
    expected = np.sum([picture(number)["surface"] for number in range(passes)], axis=0, dtype=np.float64)
    assert np.allclose(joined.total()["surface"], expected, rtol=3e-6)  # some sixty additions of float32
    assert np.array_equal(joined.total()["depth"], np.full(5, 7, np.float32))


def test_memory_does_not_grow_with_the_passes():
    sums, most = PassSums(), 0
    for number in range(40 * BLOCK):
        sums.add(number, picture(number))
        most = max(most, len({name.partition("/")[0] for name in sums.state()}))
    assert most <= 1 + np.log2(BLOCK)  # whole blocks, and one part for each power of two


def test_a_pass_that_is_there_is_refused_and_gaps_are_known():
    sums = summed([0, 1, 2, 3, 6])
    assert sums.ranges() == [range(4), range(6, 7)] and len(sums) == 5
    for more in (summed([2]), summed(range(4, 8))):
        with pytest.raises(SceneError, match=r"passes [26] to [26] are there twice"):
            sums.join(more)
    assert same(PassSums.restored(sums.state()).total(), sums.total())


def test_the_variance_of_a_layer_is_that_of_the_mean_of_its_passes(rng):
    sums, light = PassSums(), rng.exponential(size=(6, 9)).astype(np.float32)
    for number, each in enumerate(light):
        sums.add(number, {f"{LIGHT}/beams": each, f"{SQUARES}/beams": each**2})
    np.testing.assert_allclose(sums.variance("beams"), light.var(axis=0, ddof=1) / len(light), rtol=1e-4)


def test_the_error_does_not_jump_where_half_of_the_light_has_no_noise(rng):
    def error(calm):
        sums, light = PassSums(), np.ones(1000, np.float32)
        for number in range(64):
            light = light.copy()
            light[calm:] = rng.uniform(0.5, 1.5, 1000 - calm)
            sums.add(number, {"light": light, "squares": light**2})
        return sums.error()

    # The noisy pixels have the standard error 1 / √12 / √64, and as many of them as calm ones are in the middle half.
    few, many = error(490), error(510)
    assert few == pytest.approx(many, rel=0.1) and many == pytest.approx(0.5 / np.sqrt(12 * 64), rel=0.15)


def test_the_error_of_infinite_light_is_not_known():
    sums = PassSums()
    for number in range(3):
        light = np.ones(9, np.float32) + number
        light[4] = np.inf
        sums.add(number, {"light": light, "squares": light**2})
    assert np.isnan(sums.error())


def test_the_error_of_light_whose_squares_overflow_is_not_known():
    sums = PassSums()
    for number, light in enumerate((2e19, 1e19, 3e19)):
        with np.errstate(over="ignore"):
            pictures = {"light": np.full(9, light, np.float32), "squares": np.full(9, light, np.float32) ** 2}
        sums.add(number, pictures | {f"{name}/beams": each for name, each in pictures.items()})
    assert np.isnan(sums.error()) and sums.variance("beams") is None


def test_frames_are_kept_in_files_and_joined(tmp_path):
    first, second = (FrameSums([summed(each)], 8, 3, 50, "hash", {"a": np.ones(2)}) for each in (range(3), range(3, 8)))
    first.save(tmp_path / "a.checkpoint")
    found = FrameSums.load(tmp_path / "a.checkpoint")
    assert found.about == "hash" and found.planned == 8 and np.array_equal(found.development["a"], np.ones(2))
    found.join(second)
    assert (len(found), found.beams, found.tests) == (8, 6, 100)
    assert same(found.views[0].total(), summed(range(8)).total())
    for change in ({"about": "x"}, {"planned": 9}, {"views": []}):
        with pytest.raises(SceneError, match="is of another scene or of other settings"):
            found.join(FrameSums(**{"views": [summed([9])], "planned": 8, "about": "hash"} | change))


@pytest.mark.parametrize("change", ["cut", "key", "range", "order", "format", "nan", "size", "counts"])
def test_a_file_that_is_no_checkpoint_is_named(tmp_path, change):
    path = tmp_path / "a.checkpoint"
    state = FrameSums([summed(range(3))], 4).state()
    if change == "key":
        del state["counts"]
    if change == "format":
        state["counts"] = state["counts"] + 1
    if change == "nan":
        state["view 0/2+1/alpha"] = np.full_like(state["view 0/2+1/alpha"], np.nan)
    if change == "size":
        state["view 0/2+1/alpha"] = state["view 0/2+1/alpha"][1:]
    if change == "order":
        state["view 0/3+2/alpha"] = state["view 0/2+1/alpha"]
    if change == "counts":
        state["counts"][3] = -1
    if change == "range":
        state["view 0/1+1/alpha"] = state["view 0/2+1/alpha"]
    with path.open("wb") as file:
        np.savez(file, **state)
    if change == "cut":
        path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(SceneError, match=r"a\.checkpoint: expected a checkpoint of photonbeams"):
        FrameSums.load(path)
