"""What every test needs: Dr.Jit started on the CPU, and hypothesis without deadlines."""

import os

import pytest
from hypothesis import settings

# Kernels compile on first use, so the first example of a property takes far longer than the rest.
settings.register_profile("photonbeams", deadline=None, derandomize=True)
settings.load_profile("photonbeams")

# References are stored for the CPU; PHOTONBEAMS_DEVICE=cuda runs the same tests on a GPU.
os.environ.setdefault("PHOTONBEAMS_DEVICE", "cpu")


@pytest.fixture
def rng():
    """Return NumPy's generator from a fixed seed."""
    import numpy as np

    return np.random.default_rng(7)
