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
from ...world.emitters.groups import ONE_GROUP
from ...world.world import World
from .branches import CameraPaths, add_to_pixels
from .camera_paths import CameraVertex, ShadingPoint
from .stage_emitters import LampGroup
from .stage_lighting import LitVertex
from .walk_vertices import Vertex

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
        self._domes = [LampGroup(self._world, [each], ONE_GROUP, 0, linked=True) for each in skies]
        self.radiance: dict[str, Any] = {world.emitters[each].beams.group: dr.zeros(Array3f, count) for each in skies}

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
        distance, weight = self._world.media.scattering_point(
            paths.medium, start, paths.direction, far, sample=sample, active=inside,
            seed=hash32(vertex.seed, UInt32(Stream.SCATTERING_POINT)),
        )  # fmt: skip
        weight *= paths.throughput
        point = ShadingPoint(None, paths.medium, paths.order, vertex.name, self._samples)
        place = start + distance * paths.direction
        lit = inside & bounds.holds(place) & (dr.max(dr.abs(weight)) > 0)
        scattering = Vertex(
            self._world, dr.zeros(mi.SurfaceInteraction3f), medium=paths.medium, incident=paths.direction,
            bounces=UInt32(0), position=place, scattered=lit, on_surface=Bool(False),
        )  # fmt: skip
        points = LitVertex(point, scattering, lit, Stream.PHASE_LOBE, Stream.PHASE_TURN)
        for number, dome in enumerate(self._domes):
            light = self._world.emitters[dome.numbers[0]].beams
            incident = points.scattered(dome, points.open(dome), (UInt32(Stream.DOME), UInt32(number)), dome.first)
            value = weight * incident * dr.opaque(Float, light.beam_scale)
            dr.eval(value)
            add_to_pixels(self.radiance[light.group], value, paths.pixel, paths.branch, lit)
