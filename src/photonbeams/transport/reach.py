"""Estimate, from a few light paths, what fractions of a lamp's light get into fog and are seen by cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..numerics.arrays import to_numpy
from ..world.world import World
from . import paths
from .emission import Emission, Stratum
from .guiding.importance import CameraImportance
from .light_tracer import LightTracer
from .strata import Allotment
from .tuning import Tuning

if TYPE_CHECKING:
    from ..estimators.projection import Projection

# Number of light paths of each lamp.
_PATHS = 1 << 13


class Reach(NamedTuple):
    """Fractions of a lamp's direct light: the paths that get into fog, and those that each camera sees in part."""

    in_fog: float
    seen: tuple[float, ...]


def reach_of_lamps(world: World, views: Sequence[Sequence[Projection]], seed: int = 0) -> dict[str, Reach]:
    """Return the reach of lamps that make beams, by name; of a lamp with a portal, that of the light through it.

    `views` are those of each camera.
    """
    cameras = [(place, CameraImportance(world, [view])) for place, own in enumerate(views, 1) for view in own]
    result = {}
    tuning = Tuning(seed, 0)
    for stratum in Allotment(_PATHS).strata(world, tuning):
        own = Stratum(stratum.emitter, stratum.count, stratum.sequence)
        tracing = LightTracer(world, Emission([own]), tuning, world.sources).tracing(0)
        emitted = replace(own.emit(0), halvings=0)
        flux = to_numpy(emitted.flux).max(axis=0)
        reached = np.zeros((1 + len(views), len(flux)), dtype=bool)
        for segments, _ in paths.trace(tracing, paths.begin(tracing, [emitted])):
            if segments is not None:
                reached[0, segments.number.numpy()] = True
                for place, camera in cameras:
                    reached[place, camera.seen(segments, None).path] = True
        fractions = reached @ flux / max(flux.sum(), 1e-30)
        result[stratum.emitter.name] = Reach(float(fractions[0]), tuple(map(float, fractions[1:])))
    return result
