"""A quadrature rule in device memory, for kernels."""

from __future__ import annotations

import drjit as dr
import numpy as np

from ..numerics.arrays import to_float
from ..quadrature import Rule
from ..runtime.device import Array2f, UInt32


class Points:
    """A rule's points and weights in device memory: neither their values nor their number is part of a kernel."""

    def __init__(self, rule: Rule) -> None:
        self._data = to_float(np.stack([rule.points, rule.weights], axis=1))
        self.count = dr.opaque(UInt32, len(rule.points))

    def __call__(self, number: UInt32) -> Array2f:
        """Return the point and the weight with this number."""
        return dr.gather(Array2f, self._data, number)
