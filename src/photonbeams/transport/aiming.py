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

from ..numerics.arrays import to_float, to_numpy
from ..numerics.hashing import hash32, unit_float
from ..numerics.sampling import pixel_sample
from ..numerics.streams import Stream
from ..runtime.device import Array3f, Bool, Float, UInt32
from ..world.emitters.rays import EmittedRays
from .emission import Stratum

# Probability with which a direction is that of a point on a portal.
_AIMED = 0.5


@dataclass(frozen=True)
class Openings:
    """The surrounds of planar portals: a corner and two edges each, as flat arrays of K × 3 numbers.

    The cross product of the edges points in the direction of the light.
    """

    corners: Any
    across: Any
    up: Any
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
            if surround is None:
                continue
            corner, across, up = surround.sides
            light = np.asarray(to_numpy(paths.direction) @ to_numpy(paths.flux).max(axis=0), dtype=float)
            if light @ np.cross(across, up) < 0:
                across, up = up, across
            found[tuple(np.concatenate([corner, across, up]))] = corner, across, up
        if not found:
            return None
        corners, across, up = (to_float(each) for each in zip(*found.values(), strict=True))
        return cls(corners, across, up, dr.opaque(UInt32, len(found)))

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
        corner, self._across, self._up = (
            dr.gather(Array3f, each, number) for each in (openings.corners, openings.across, openings.up)
        )
        self._corner: Any = corner - point
        self._normal: Any = dr.cross(self._across, self._up)
        self._depth = dr.dot(self._corner, self._normal)
        self.able = self._depth > 0
        self.taken = self.able & (unit_float(hash32(index, stream, UInt32(Stream.WHETHER_AIMED))) < _AIMED)
        u = pixel_sample(index, hash32(stream, UInt32(Stream.POINT_OF_OPENING)))
        self.direction = dr.normalize(self._corner + u.x * self._across + u.y * self._up)

    def ratio(self, direction: Array3f, density: Float, smooth: Bool) -> Float:
        """Return the density of directions without openings over their density in the mixture.

        Parameters
        ----------
        direction, density
            Directions, and their density without openings.
        smooth
            Whether directions have a density. Those of ideal lobes have none, but the mixture samples them less often.
        """
        cosine = dr.dot(direction, self._normal)
        distance = self._depth * dr.rcp(dr.select(cosine > 0, cosine, 1))
        place: Any = distance * direction - self._corner
        area2 = dr.squared_norm(self._normal)
        x = dr.dot(dr.cross(place, self._up), self._normal)
        y = dr.dot(dr.cross(self._across, place), self._normal)
        within = (cosine > 0) & (x >= 0) & (x <= area2) & (y >= 0) & (y <= area2)
        aimed = dr.select(within & smooth, dr.square(distance) * dr.rcp(cosine), 0)
        mixed = (1 - _AIMED) * density + _AIMED * aimed
        return dr.select(self.able, dr.select(smooth, density * dr.rcp(dr.maximum(mixed, 1e-30)), 1 / (1 - _AIMED)), 1)
