"""Mitsuba's colours as kernels need them."""

from __future__ import annotations

from typing import Any

import drjit as dr

from ..runtime.device import Array3f, Float


def rgb(value: Any) -> Array3f:
    """Return a spectrum of Mitsuba's; in variants without colours its one channel three times."""
    return Array3f(value) if dr.size_v(type(value)) == 3 else Array3f(Float(value[0]))
