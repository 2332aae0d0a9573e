"""Environments behind a portal, sampled from the points that they light: half of the samples go through the portal.

A window shows a small part of the sky, so directions that are sampled by brightness mostly meet the wall beside it. The
density is the mean of both ways of sampling (the balance heuristic of Veach 1997), so no light past the portal is lost.
"""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING, Any

import drjit as dr

from ...runtime.device import Array2f, Array3f, Bool, Float, UInt32, mitsuba
from .lamp import Illumination, Lamp, LightHit
from .mitsuba_emitter import MitsubaEmitter
from .portals import Portal
from .rectangles import Rectangle, widened

if TYPE_CHECKING:
    from ...runtime.mitsuba_types import DirectionSample, EmitterPtr

mi = mitsuba()

# Rectangles are widened by this fraction on each side: light just beside a fitted one would be bright dots.
_MARGIN = 0.05


class ThroughPortal:
    """A lamp (see `lamp`) for an environment: half of its samples are directions to a portal's rectangle.

    Parameters
    ----------
    lamp
        The environment, which samples directions and says what rays see of it.
    portal
        The opening, which must be planar: only then does a direction have a density in closed form.
    """

    def __init__(self, lamp: Lamp, portal: Portal) -> None:
        assert portal.sides is not None
        self.lamp, self._opening = lamp, Rectangle.of(widened(portal.sides, _MARGIN))

    def at(self, acting: UInt32 | None) -> ThroughPortal:
        """Return the lamp for sites where these of its filters act: see `Linking.acting`."""
        result = copy(self)
        result.lamp = self.lamp.at(acting)
        return result

    def illuminate(self, point: Array3f, u: Array2f) -> Illumination:
        """Return a sample of the light, by either way with the same probability."""
        first = u.x < 0.5
        own = Array2f(dr.select(first, 2 * u.x, 2 * u.x - 1), u.y)
        sample = self.lamp.illuminate(point, own)
        direction = dr.select(first, dr.normalize(self._opening.point(own) - point), sample.direction)
        found = self.see(point, direction)
        weight = dr.select(found.pdf > 0, found.radiance / dr.maximum(found.pdf, 1e-30), 0)
        return Illumination(direction, sample.distance, weight, found.pdf)

    def see(self, origin: Array3f, direction: Array3f) -> LightHit:
        """Return the light of the environment along a ray that meets nothing else."""
        found = self.lamp.see(origin, direction)
        return LightHit(found.hit, found.distance, found.radiance, self.density(origin, direction, found.pdf))

    def density(self, point: Array3f, direction: Array3f, own: Float) -> Float:
        """Return the density of a direction per solid angle, where the environment alone has `own`."""
        return 0.5 * (own + self._opening.density(point, direction))


def behind(lamp: Lamp, portal: Portal | None) -> Any:
    """Return the lamp to sample from lit points: `ThroughPortal` for an environment behind a planar portal."""
    if portal is None or portal.sides is None or not lamp.environment:
        return lamp
    return ThroughPortal(lamp, portal)


class EnvironmentPortal:
    """The planar portal before the environment of a Mitsuba scene, for samples of all the scene's emitters."""

    def __init__(self, plugin: Any, portal: Portal) -> None:
        environment = plugin.environment()
        self._lamp = ThroughPortal(MitsubaEmitter(environment), portal)
        self._number = dr.opaque(UInt32, int(UInt32(dr.reinterpret_array(mi.UInt32, mi.EmitterPtr(environment)))[0]))

    def _is_environment(self, emitter: EmitterPtr) -> Bool:
        numbers: Any = dr.reinterpret_array(UInt32, emitter)
        return numbers == self._number

    def sampled(
        self, place: Array3f, light: DirectionSample, radiance: Array3f, u: Array2f, probability: Float
    ) -> tuple[Any, Any]:
        """Return a sample of an emitter and its radiance over the density; samples of the environment are replaced.

        `ThroughPortal` makes these. `probability` is that with which the emitter was chosen.
        """
        own, mine = self._lamp.illuminate(place, u), self._is_environment(light.emitter)
        light.d = dr.select(mine, mi.Vector3f(own.direction), light.d)
        light.p = dr.select(mine, mi.Point3f(place + light.dist * own.direction), light.p)
        light.n = dr.select(mine, mi.Normal3f(-own.direction), light.n)
        light.pdf = dr.select(mine, own.pdf * probability, light.pdf)
        return light, dr.select(mine, own.weight / probability, radiance)

    def density(self, emitter: EmitterPtr, place: Array3f, direction: Array3f, own: Float, probability: Float) -> Float:
        """Return the density of `sampled` for a direction to an emitter, for which the emitter itself has `own`."""
        through = self._lamp.density(place, direction, own / probability) * probability
        return dr.select(self._is_environment(emitter), through, own)
