"""NumPy's numbers as Dr.Jit arrays."""

import numpy as np
import pytest

from photonbeams.numerics.arrays import to_float, to_numpy, to_uint, to_vectors
from photonbeams.runtime import device
from tests.helpers.kernels import compiled


@pytest.mark.parametrize("count", [1, 3, 17, 1000])
def test_numbers_are_kept_and_their_memory_is_aligned(count):
    numbers = np.arange(2 * count)[::2]  # strided, so memory cannot be shared
    for array in (to_float(numbers), to_uint(numbers), to_float(numbers.reshape(-1, 1))):
        assert np.array_equal(array.numpy(), numbers)
        assert device.backend() != "llvm" or array.numpy().ctypes.data % 64 == 0  # a view, on the CPU


def test_vectors_go_by_their_axes():
    vectors = np.arange(12.0).reshape(4, 3)
    assert np.array_equal(to_vectors(vectors).numpy(), vectors.T)
    assert np.array_equal(to_numpy(to_vectors(vectors)), vectors.T)


def test_vectors_of_another_length_go_to_numpy_by_the_same_kernels():
    vectors = [to_vectors(np.ones((count, 3))) for count in (5, 11)]
    to_numpy(2 * vectors[0])
    assert not compiled(lambda: to_numpy(2 * vectors[1]))


def test_arrays_do_not_share_memory_with_what_they_were_made_of():
    numbers = np.zeros(64, np.float32)
    array = to_float(numbers)
    numbers[:] = 1
    assert not array.numpy().any()
