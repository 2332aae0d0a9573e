"""Beams as rows: how they are indexed, sliced, joined and shown."""

import drjit as dr
import numpy as np
import pytest

import photonbeams as pb
from photonbeams.runtime.device import Array3f, Bool, Float, UInt32
from photonbeams.scene import SceneError

RNG = np.random.default_rng(7)
COUNT = 6
PLAIN = {
    "start": RNG.normal(size=(COUNT, 3)), "end": RNG.normal(size=(COUNT, 3)) + np.array([4, 0, 0]),
    "radius_start": RNG.uniform(0.2, 0.5, COUNT), "radius_end": RNG.uniform(0.2, 0.5, COUNT),
    "power": RNG.uniform(1, 2, (COUNT, 3)),
}  # fmt: skip
ORIGIN = np.array([1.5, 0.5, -5.0]) + 0.3 * RNG.normal(size=(200, 3))
DIRECTION = RNG.normal(size=(200, 3)) * [1.5, 0.8, 0.8] + [1.5, 0, 0] - ORIGIN
#: A look that uses every quantity of a beam.
LOOK = pb.Look(along="(0.5 + random) * (1 + s) * exp(-0.2 * distance) * (1 + generation)", eye=1.0, angle=1.0)


def seen(beams):
    return pb.estimate(beams, ORIGIN, DIRECTION, look=LOOK).numpy()


def rich():
    """Return beams with all optional arrays."""
    axis = PLAIN["end"] - PLAIN["start"]
    unit = axis / np.linalg.norm(axis, axis=1, keepdims=True)
    numbers = np.arange(COUNT) + 10.0
    return pb.Beams(
        **PLAIN, offset=0.5, total=9.0, entry=0.1, end_normal=-unit, start_tangent=unit, end_tangent=unit,
        power_end=(1, 2, 3), random=numbers / 20, id=numbers, generation=numbers % 3,
        start_normal=unit, side=PLAIN["start"] - 1, side_normal=unit[::-1],
    )  # fmt: skip


@pytest.mark.parametrize(
    ("index", "rows"),
    [
        (2, [2]), (-1, [5]), (np.int64(3), [3]), (slice(1, 4), [1, 2, 3]), (slice(None, None, -2), [5, 3, 1]),
        ([4, 0, 4], [4, 0, 4]), (np.array([-1, 1]), [5, 1]), ([], []), (slice(6, None), []),
        (np.arange(COUNT) % 2 == 0, [0, 2, 4]), (UInt32([1, 3]), [1, 3]), (Bool([True] + 5 * [False]), [0]),
    ],
)  # fmt: skip
@pytest.mark.parametrize("beams", [pb.Beams(**PLAIN), rich()], ids=["plain", "rich"])
def test_an_index_takes_the_rows_of_all_arrays(beams, index, rows):
    found, all_of_them = beams[index].arrays(), beams.arrays()
    assert found["id"].tolist() == (beams.arrays().get("id", np.arange(COUNT))[rows]).tolist()
    for name, value in all_of_them.items():
        assert np.array_equal(found[name], value[rows])


def test_beams_one_by_one_are_seen_as_all_of_them():
    beams = pb.Beams(**PLAIN)
    one_by_one = [seen(each) for each in beams]
    assert len(one_by_one) == COUNT
    # The six numbers are summed in another order.
    np.testing.assert_allclose(np.sum(one_by_one, axis=0), seen(beams), rtol=1e-5, atol=1e-6)


def test_joined_beams_are_seen_as_both_whatever_they_have():
    plain, full = pb.Beams(**PLAIN), rich()
    for first, second in ((plain, full), (full, plain)):
        whole = first + second
        assert len(whole) == 2 * COUNT and whole.arrays().keys() == full.arrays().keys()
        named = pb.Beams(**{**first.arrays(), "id": whole.arrays()["id"][:COUNT]})
        other = pb.Beams(**{**second.arrays(), "id": whole.arrays()["id"][COUNT:]})
        expected = seen(named) + seen(other)
        # Among joined beams, straight ones have planes at their ends, which cut them there up to rounding.
        np.testing.assert_allclose(seen(whole), expected, rtol=1e-3, atol=1e-4 * expected.max())


def test_beams_that_are_taken_apart_and_joined_are_the_same():
    beams = rich()
    again = pb.Beams.join([beams[:2], beams[2:3], beams[3:]])
    assert all(np.array_equal(value, again.arrays()[name]) for name, value in beams.arrays().items())
    assert pb.Beams.join([pb.Beams(**PLAIN)] * 2).id is None  # each id is the row's number


def test_gradients_pass_an_index_and_a_join():
    beams = pb.Beams(**PLAIN)
    dr.enable_grad(beams.power)
    dr.backward(dr.sum((beams[1:3] + beams[0]).power, axis=None))
    assert np.array_equal(dr.grad(beams.power).numpy().T, np.repeat([[1.0], [1], [1], [0], [0], [0]], 3, axis=1))


def test_arrays_go_in_as_rows_of_any_library_and_come_out_as_rows():
    tensor = dr.tensor_t(Float)(PLAIN["start"].astype(np.float32))
    dr.enable_grad(tensor)
    beams = pb.Beams(**{**PLAIN, "start": tensor, "power": Array3f(1, 2, 3)})
    expected = PLAIN["start"].astype(np.float32)
    assert np.array_equal(beams.arrays()["start"], expected)
    assert beams.arrays()["power"].tolist() == [[1, 2, 3]] * COUNT
    dr.backward(dr.sum(beams.start.y))
    assert dr.grad(tensor).numpy().tolist() == [[0, 1, 0]] * COUNT


def test_beams_say_what_they_are():
    assert repr(pb.Beams(**PLAIN)) == "Beams(6)"
    assert repr(pb.Beams(**PLAIN)[:2]) == "Beams(2 with id)"
    assert repr(pb.Beams(**PLAIN, offset=1.0, generation=2)) == "Beams(6 with offset, generation)"


@pytest.mark.parametrize(
    "index", [6, -7, 1.5, "start", None, (0, 1), True, [True, False], [[0]], [0.5], slice("a"), Float(1.0), {}]
)
def test_an_index_of_no_beam_is_told_in_a_sentence(index):
    with pytest.raises(SceneError, match=r"6 beams are indexed by .*: expected a slice, .* from -6 to 5"):
        _ = pb.Beams(**PLAIN)[index]


@pytest.mark.parametrize(
    ("message", "call"),
    [
        ("joined with 3: expected Beams", lambda beams: beams + 3),
        ("joined with none: expected Beams", lambda beams: pb.Beams.join([])),
        ("joined with None: expected Beams", lambda beams: pb.Beams.join([beams, None])),
        ("no argument 'strat', did you mean start\\? Expected start, end", lambda beams: pb.Beams(strat=1)),
        ("got 7 positional arguments: expected up to 5", lambda beams: pb.Beams(*range(7))),
        ("start is not given: expected numbers of shape", lambda beams: pb.Beams(end=[[0, 0, 0]])),
        ("start is 'a': expected numbers of shape", lambda beams: pb.Beams("a", "b", 1, 1, 1)),
        ("start is \\[\\[0, 0, 0\\], \\[1\\]\\]: expected", lambda beams: pb.Beams([[0, 0, 0], [1]], 0, 1, 1, 1)),
        ("power is Look\\(.*: expected", lambda beams: pb.Beams(**{**PLAIN, "power": pb.Look()})),
        ("radius_end is <object.*: expected", lambda beams: pb.Beams(**{**PLAIN, "radius_end": object()})),
        ("radius_end of beam 0 is not finite", lambda beams: pb.Beams(**{**PLAIN, "radius_end": 1e39})),
        ("radius_end is a Array3f of shape", lambda beams: pb.Beams(**{**PLAIN, "radius_end": Array3f(1)})),
    ],
)
def test_what_are_no_beams_is_told_in_a_sentence(message, call):
    with pytest.raises(SceneError, match=message) as error:
        call(pb.Beams(**PLAIN))
    assert len(str(error.value)) <= 300
