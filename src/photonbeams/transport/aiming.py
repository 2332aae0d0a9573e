"""Aimed scattering: light that is scattered before a portal is sent through it, in half of all cases.

A path that is scattered outside of a room seldom finds the keyhole by chance, and brings all the more light when it
does: a bright dot on the wall. So a scattered direction is either that of the phase function or BSDF, or that of a
point on a portal. Both together are one density, by which the light is divided (multiple importance sampling of one
sample: Veach 1997, section 9.2.4).
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
from ..runtime.device import Array3f, Bool, Float, UInt32
from .emission import Emitted, Stratum
from .lamps import PortalEmitter

# How often a direction is that of a point on a portal.
_AIMED = 0.5

# Streams of samples, beside those of interactions, splitting and Russian roulette.
_WHICH, _WHETHER, _POINT = 6, 7, 8


@dataclass(frozen=True)
class Openings:
    """The surrounds of planar portals, (K, 3) each, flat: a corner and two edges.

    The cross product of the edges points the way that light takes.
    """

    corners: Any
    across: Any
    up: Any
    count: UInt32

    @classmethod
    def of(cls, strata: Sequence[Stratum], emitted: Sequence[Emitted]) -> Openings | None:
        """Return the openings that light paths as they leave their emitters pass, None where there are none."""
        found = {}
        for stratum, paths in zip(strata, emitted, strict=True):
            emitter = stratum.emitter
            if not isinstance(emitter, PortalEmitter) or not emitter.through or emitter.without is not None:
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
        """Return a direction from each point to one of the openings."""
        return Aimed(self, point, index, stream)


class Aimed:
    """Directions from points to openings.

    Attributes
    ----------
    able
        Whether the point is where light comes from: only there, directions are mixed.
    taken
        Whether the direction is to be taken, rather than one that is sampled otherwise.
    direction
        The direction, a unit vector.
    """

    def __init__(self, openings: Openings, point: Array3f, index: UInt32, stream: UInt32) -> None:
        number = hash32(index, stream, UInt32(_WHICH)) % openings.count
        corner, self._across, self._up = (
            dr.gather(Array3f, each, number) for each in (openings.corners, openings.across, openings.up)
        )
        self._corner: Any = corner - point
        self._normal: Any = dr.cross(self._across, self._up)
        self._depth = dr.dot(self._corner, self._normal)
        self.able = self._depth > 0
        self.taken = self.able & (unit_float(hash32(index, stream, UInt32(_WHETHER))) < _AIMED)
        u = pixel_sample(index, hash32(stream, UInt32(_POINT)))
        self.direction = dr.normalize(self._corner + u.x * self._across + u.y * self._up)

    def ratio(self, direction: Any, density: Float, smooth: Bool) -> Float:
        """Return the density of sampled directions over that of the mixture.

        Parameters
        ----------
        direction, density
            Directions, and their density without openings.
        smooth
            Whether they have a density; ideal lobes have none, but are sampled more seldom.
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
