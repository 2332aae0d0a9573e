"""Aimed scattering: light that is scattered before a portal is sent through it in half of all cases.

A path that is scattered outside of a room seldom finds the keyhole by chance, but then carries much light: a bright dot
on the wall. So a scattered direction is sampled either by the phase function or BSDF, or as a point on a portal. The
light is divided by the density of this mixture (one-sample multiple importance sampling: Veach 1997, section 9.2.4).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from ..numerics.arrays import to_numpy
from ..numerics.hashing import hash32, unit_float
from ..numerics.sampling import pixel_sample
from ..numerics.streams import Stream
from ..numerics.structs import pack
from ..runtime.device import Array3f, Bool, Float, UInt32
from ..world.emitters.rays import EmittedRays
from ..world.emitters.rectangles import Rectangle, Sides
from .emission import Stratum

# Probability with which a direction is that of a point on a portal.
_AIMED = 0.5


@dataclass(frozen=True)
class Openings:
    """The surrounds of planar portals, packed, and their number (opaque).

    The cross product of the edges points in the direction of the light.
    """

    packed: Rectangle
    count: UInt32

    @classmethod
    def of(cls, strata: Sequence[Stratum], emitted: Sequence[EmittedRays]) -> Openings | None:
        """Return the openings that emitted light paths pass; None if there are none."""
        found = {}
        for stratum, paths in zip(strata, emitted, strict=True):
            emitter = stratum.emitter
            if emitter.portal is None or not emitter.through or emitter.without is not None:
                continue
            surround = emitter.portal.surround
            if surround is None or surround.sides is None:
                continue
            corner, across, up = surround.sides
            light = np.asarray(to_numpy(paths.direction) @ to_numpy(paths.flux).max(axis=0), dtype=float)
            if light @ np.cross(across, up) < 0:
                across, up = up, across
            found[tuple(np.concatenate([corner, across, up]))] = corner, across, up
        return cls.from_sides(list(found.values())) if found else None

    @classmethod
    def from_sides(cls, openings: Sequence[Sides]) -> Openings:
        """Return openings by their corners and edges."""
        return cls(pack([Rectangle.of(each) for each in openings]), dr.opaque(UInt32, len(openings)))

    def aimed(self, point: Array3f, index: UInt32, stream: UInt32) -> Aimed:
        """Return a direction from each point to one of the openings, by the sample `index` of a `stream`."""
        return Aimed(self, point, index, stream)


class Aimed:
    """Directions from points to openings.

    Attributes
    ----------
    able
        Whether the point is on the lit side of the opening. Only there are directions mixed.
    taken
        Whether to take this direction, rather than one sampled by the phase function or BSDF.
    direction
        The direction, a unit vector.
    """

    def __init__(self, openings: Openings, point: Array3f, index: UInt32, stream: UInt32) -> None:
        number = hash32(index, stream, UInt32(Stream.WHICH_OPENING)) % openings.count
        self._opening, self._point = dr.gather(Rectangle, openings.packed, number), point
        self.able = self._opening.depth(point) > 0
        self.taken = self.able & (unit_float(hash32(index, stream, UInt32(Stream.WHETHER_AIMED))) < _AIMED)
        u = pixel_sample(index, hash32(stream, UInt32(Stream.POINT_OF_OPENING)))
        self.direction = dr.normalize(self._opening.point(u) - point)

    def ratio(self, direction: Array3f, density: Float, smooth: Bool) -> Float:
        """Return the density of directions without openings over their density in the mixture.

        Parameters
        ----------
        direction, density
            Directions, and their density without openings.
        smooth
            Whether directions have a density. Those of ideal lobes have none, but the mixture samples them less often.
        """
        aimed: Any = dr.select(smooth, self._opening.density(self._point, direction), 0)
        mixed = (1 - _AIMED) * density + _AIMED * aimed
        return dr.select(self.able, dr.select(smooth, density * dr.rcp(dr.maximum(mixed, 1e-30)), 1 / (1 - _AIMED)), 1)
