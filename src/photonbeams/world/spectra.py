"""Mitsuba's spectra as the RGB colours that kernels use."""

from __future__ import annotations

import drjit as dr

from ..runtime.device import Array3f, Float


def rgb(value: dr.ArrayBase) -> Array3f:
    """Return a Mitsuba spectrum as RGB; in monochrome variants, its one channel is repeated."""
    return Array3f(value) if dr.size_v(type(value)) == 3 else Array3f(Float(value[0]))
