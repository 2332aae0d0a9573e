"""Messages between Blender and the renderer: what is written is read again, and a broken pipe is the end."""

import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from photonbeams.blender.extension import messages

PLAIN = st.none() | st.booleans() | st.integers(-(2**53), 2**53) | st.floats(allow_nan=False) | st.text(max_size=9)
ARRAY = arrays.arrays(
    st.sampled_from(["<f4", "<i4", "<f8", "|u1"]), arrays.array_shapes(min_dims=1, min_side=0, max_side=4)
)
CONTENT = st.recursive(
    PLAIN | ARRAY,
    lambda each: (
        st.lists(each, max_size=3)
        | st.dictionaries(st.text(max_size=5).filter(lambda k: k != "array"), each, max_size=3)
    ),
    max_leaves=8,
)


def same(found, expected):
    if isinstance(expected, np.ndarray):
        return found.dtype == expected.dtype and np.array_equal(found, expected, equal_nan=expected.dtype.kind == "f")
    if isinstance(expected, dict):
        return found.keys() == expected.keys() and all(same(found[key], each) for key, each in expected.items())
    if isinstance(expected, list):
        return len(found) == len(expected) and all(map(same, found, expected))
    return found == expected


@given(st.lists(st.dictionaries(st.text(max_size=5).filter(lambda k: k != "array"), CONTENT, max_size=4), max_size=3))
def test_what_is_written_is_read_again(sent):
    pipe = io.BytesIO()
    for each in sent:
        messages.write(pipe, each)
    pipe.seek(0)
    assert all(same(messages.read(pipe), each) for each in sent)
    assert messages.read(pipe) is None


def test_numbers_of_numpy_are_plain_numbers():
    pipe = io.BytesIO()
    messages.write(pipe, {"a": np.float32(0.5), "b": np.int64(3)})
    pipe.seek(0)
    assert messages.read(pipe) == {"a": 0.5, "b": 3}


@pytest.mark.parametrize("length", [0, 5, 9, 30, -1])
def test_a_message_that_was_cut_off_is_the_end(length):
    pipe = io.BytesIO()
    messages.write(pipe, {"layers": np.ones((4, 4), np.float32)})
    cut = io.BytesIO(pipe.getvalue()[:length])
    assert messages.read(cut) is None
