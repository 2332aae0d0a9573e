"""Phase functions of media at the places that rays reach."""

from __future__ import annotations

from typing import NamedTuple

import drjit as dr

from ...runtime.device import Array2f, Array3f, Bool, Float, UInt32, mitsuba
from ..spectra import rgb
from .interfaces import pointers

mi = mitsuba()


class PhaseSample(NamedTuple):
    """Directions in which rays go on, phase functions over densities, and the densities."""

    direction: Array3f
    weight: Array3f
    pdf: Float


class Phases:
    """The phase functions of media at positions that rays reach along directions, where these are `active`."""

    def __init__(self, position: Array3f, direction: Array3f, medium: UInt32, active: Bool) -> None:
        self._at = dr.zeros(mi.MediumInteraction3f, dr.width(position))
        self._at.p, self._at.wi = mi.Point3f(position), mi.Vector3f(-direction)
        self._at.sh_frame = mi.Frame3f(self._at.wi)
        self._at.medium = pointers(dr.select(active, medium, 0))
        self._function, self._context = self._at.medium.phase_function(), mi.PhaseFunctionContext()

    def value(self, direction: Array3f, active: Bool) -> tuple[Array3f, Float]:
        """Return the phase functions for directions in which rays go on, and their densities."""
        value, pdf = self._function.eval_pdf(self._context, self._at, mi.Vector3f(direction), active)
        return rgb(value), Float(pdf)

    def sample(self, lobe: Float, turn: Array2f, active: Bool) -> PhaseSample:
        """Return samples of directions: a number chooses the lobe, and a point the direction."""
        direction, weight, pdf = self._function.sample(self._context, self._at, lobe, mi.Point2f(turn), active)
        return PhaseSample(Array3f(direction), rgb(weight), Float(pdf))
