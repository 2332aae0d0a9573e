"""A few beams, and rays among them, whose estimates are differentiated."""

import numpy as np

import photonbeams as pb
from photonbeams.runtime.device import Array3f, Float

FOG = pb.Medium((0.3, 0.2, 0.1), (0.05, 0.1, 0.2), 0.3)
COUNT, RAYS = 6, 64
CONVERGED = pb.gauss_legendre(64)


def numbers(seed=0):
    """Return beams as arrays, and rays that pass among them."""
    rng = np.random.default_rng(seed)
    beams = {
        "start": rng.normal(size=(COUNT, 3)), "end": rng.normal(size=(COUNT, 3)) + np.array([4, 0, 0]),
        "radius_start": rng.uniform(0.2, 0.5, COUNT), "radius_end": rng.uniform(0.2, 0.6, COUNT),
        "power": rng.uniform(1, 2, (COUNT, 3)),
    }  # fmt: skip
    origin = np.array([1.5, 0.5, -5.0]) + 0.3 * rng.normal(size=(RAYS, 3))
    target = rng.normal(size=(RAYS, 3)) * [1.5, 0.8, 0.8] + [1.5, 0, 0]
    return beams, origin, target - origin


def array(value):
    columns = np.asarray(value, dtype=np.float32).T
    return Float(columns) if columns.ndim == 1 else Array3f(*(Float(np.ascontiguousarray(each)) for each in columns))
