"""Move points by their velocities from a time sample, as UsdGeomPointBased defines it.

Caches whose topology changes from frame to frame can only be blurred by velocities. While a shutter is open, the
points, and everything that belongs to their topology, come from one sample: the last one at or before the frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...scene import Array
from ..common.openusd import Usd, UsdGeom
from ..common.reading import Reading

_ROUNDING = 1e-9  # error of sample times after the offset and scale of a layer


@dataclass(frozen=True)
class PointSample:
    """The points, or `name`, of a prim, and the stage at the time whose topology they have.

    `moved` are the points (N, 3) as velocities move them to the present time, those of an instancer as they are at that
    time; None: USD interpolates them.
    """

    reading: Reading
    prim: Usd.Prim
    name: str
    moved: Array | None = None

    @classmethod
    def of(cls, reading: Reading, prim: Usd.Prim, name: str = "points") -> PointSample:
        """Return the points (or `name`) of a prim, moved by its velocities if it has some that can be used.

        They cannot if there are more or fewer velocities than points.
        """
        still = cls(reading, prim, name)
        velocities = prim.GetAttribute("velocities")
        if not (velocities and velocities.HasAuthoredValue()):
            return still
        samples = _samples(prim, name, reading.base)
        if not samples or not _agree(_samples(prim, "velocities", reading.base), samples):
            reading.warn(prim, f"is not used: expected the same time samples as those of {name}", "velocities")
            return still
        sample = samples[0]
        at = replace(reading, time=sample)
        points, velocity = at.array(prim, name, 3), at.array(prim, "velocities", 3)
        if points is None or velocity is None or len(velocity) != len(points):
            count = 0 if points is None else len(points)
            reading.warn(prim, f"is not used: expected {count} values, as {name} has at time {sample:g}", "velocities")
            return still
        if reading.time.IsEarliestTime() or not prim.IsA(UsdGeom.PointBased):  # instancers have transforms instead
            return cls(at, prim, name, points)
        moved = UsdGeom.PointBased(prim).ComputePointsAtTime(reading.time, reading.base)
        return cls(at, prim, name, at.array(prim, name, 3, moved))

    @property
    def points(self) -> Array | None:
        """The points, (N, 3), or None if there are none."""
        return self.reading.array(self.prim, self.name, 3) if self.moved is None else self.moved


def _samples(prim: Usd.Prim, name: str, base: Usd.TimeCode) -> tuple[float, ...]:
    """Return the times of the samples around a time, the same time twice if there is one at it; () without any."""
    attribute = prim.GetAttribute(name)
    return tuple(attribute.GetBracketingTimeSamples(base.GetValue())) if attribute else ()


def _agree(these: tuple[float, ...], those: tuple[float, ...]) -> bool:
    return len(these) == len(those) and np.allclose(these, those, rtol=_ROUNDING, atol=_ROUNDING)
