"""Light straight from domes that media scatter toward the camera, sampled along camera paths.

A dome shines from everywhere, so its beams would be wide and would blur the shadows of smoke in itself. Instead, a
point is chosen on each segment of a camera path, by how much light would be scattered there. It gets one sample of each
dome and one of the phase function, as on surfaces. Light that is scattered more often comes from beams.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr

from ...numerics.hashing import hash32
from ...numerics.samples import Samples
from ...numerics.streams import Stream
from ...runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ...world.emitters.packed import LinkedSurfaces, single
from ...world.media.interfaces import pointers
from ...world.world import World
from .branches import CameraPaths, add_to_pixels
from .camera_paths import CameraVertex, ShadingPoint
from .lighting import LitPoints, scattered

mi = mitsuba()


class SingleScattering:
    """The radiance of a view's pixels in a pass, by light groups.

    Parameters
    ----------
    world, skies, count
        The world, the numbers of the domes, and the number of pixels.
    samples
        The samples of the pass.
    max_depth
        The longest path in edges, as in Mitsuba's integrators; None: no limit.
    """

    def __init__(self, world: World, skies: Sequence[int], count: int, samples: Samples, max_depth: int | None) -> None:
        self._world = world.feeling_all()
        self._samples, self._max_depth = samples, max_depth
        self._domes = [(world.emitters[each].beams, single(self._world, world.emitters[each])) for each in skies]
        self.radiance: dict[str, Any] = {light.group: dr.zeros(Array3f, count) for light, _ in self._domes}

    def add(self, paths: CameraPaths, vertex: CameraVertex) -> None:
        """Add the segments of one step of camera paths."""
        inside = paths.alive & (vertex.end > paths.near)
        if self._max_depth is not None:
            inside &= paths.depth + 2 <= dr.opaque(UInt32, self._max_depth)
        inside &= dr.max(self._world.media.scattering(paths.medium)) > 0
        if not bool(dr.any(inside)):
            return
        start, bounds = paths.origin + paths.near * paths.direction, self._world.bounds
        # As beams do, the light begins at the bounds.
        far = dr.minimum(vertex.end - paths.near, bounds.exit(start, paths.direction))
        sample = self._samples.pair(paths.order, Stream.SCATTERING_POINT, vertex.name).x
        seed = hash32(vertex.seed, UInt32(Stream.SCATTERING_POINT))
        distance, weight = dr.zeros(Float, dr.width(far)), dr.zeros(Array3f, dr.width(far))
        for medium in self._world.media.all:
            own = inside & (paths.medium == dr.opaque(UInt32, medium.number))
            there, part = medium.scattering_point(start, paths.direction, far, seed, sample, own)
            distance, weight = dr.select(own, there, distance), dr.select(own, part, weight)
        weight *= paths.throughput
        point = ShadingPoint(None, paths.medium, paths.order, vertex.name, self._samples)
        place = start + distance * paths.direction
        lit = inside & bounds.holds(place) & (dr.max(dr.abs(weight)) > 0)
        linking = self._world.linking
        for number, (light, (lamp, links, _, source)) in enumerate(self._domes):
            world = self._world if links is None else links.world
            points = _ScatteringPoints(world, point, place, paths.direction, lit, links)
            lamp = lamp.at(linking.acting(source, paths.medium))
            incident = scattered(world, points, lamp, (UInt32(Stream.DOME), UInt32(number)))
            value = weight * incident * dr.opaque(Float, light.beam_scale)
            value = dr.select(linking.lights(source, paths.medium, lit), value, 0)
            dr.eval(value)
            add_to_pixels(self.radiance[light.group], value, paths.pixel, paths.branch, lit)


class _ScatteringPoints(LitPoints):
    """Points in media that scatter light toward the camera, and a sample of the phase function at each."""

    def __init__(
        self,
        world: World,
        point: ShadingPoint,
        place: Array3f,
        ray: Array3f,
        active: Bool,
        links: LinkedSurfaces | None,
    ) -> None:
        self.point, self.place, self.reference, self.size, self.active = point, place, place, None, active
        self.shadow_reach: Any = Float(dr.inf) if links is None else links.reach
        self.shadow = None if links is None else links.shadow
        self._interaction = dr.zeros(mi.MediumInteraction3f, dr.width(place))
        self._interaction.p, self._interaction.wi = mi.Point3f(place), mi.Vector3f(-ray)
        self._interaction.sh_frame = mi.Frame3f(self._interaction.wi)
        self._phase = pointers(dr.select(active, point.medium, 0)).phase_function()
        lobe = point.samples.single(point.order, Stream.PHASE_LOBE, point.step)
        u = mi.Point2f(point.samples.pair(point.order, Stream.PHASE_TURN, point.step))
        sample = self._phase.sample(mi.PhaseFunctionContext(), self._interaction, lobe, u, active)
        self.direction, self.pdf = Array3f(sample[0]), Float(sample[2])
        self.weight = dr.select(active, Array3f(sample[1]), 0)
        self._bounds, self.seed = world.bounds, point.samples.bits(point.order, Stream.PHASE_LOBE, point.step)
        self.open = self.unblocked(world)

    def dimmed_over(self, direction: Array3f, distance: Float) -> Float:
        """Return the distance to the bounds, where the light begins."""
        return self._bounds.behind(self.place, -direction)

    def sees(self, world: World, met: Bool, distance: Float) -> Array3f:
        """Return what surfaces let through to samples that meet a dome."""
        return dr.select(met, self.open, 0)

    def evaluate(self, direction: Array3f) -> tuple[Array3f, Float]:
        """Return the phase function, and the pdf of sampling that direction."""
        value, pdf = self._phase.eval_pdf(
            mi.PhaseFunctionContext(), self._interaction, mi.Vector3f(direction), self.active
        )
        return Array3f(value), Float(pdf)
