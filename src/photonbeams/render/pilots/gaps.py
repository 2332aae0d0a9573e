"""Sentences about gaps that are finer than beams are wide, and how many beams resolve them."""

from __future__ import annotations

from collections.abc import Iterator
from math import ceil, log10

import numpy as np

from ...constants import DEFAULT_BEAMS, DEFAULT_PATHS
from ...scene import Array
from ...transport.gaps import Gap, fine_gaps
from ...transport.tuning import radius_scale
from ...world.cameras.cameras import View
from ..light import ShotLight
from ..settings import usual_passes

# Passes of which radii are averaged, at most; the most beams that are advised; and from how many on a portal is,
# too.
_PASSES, _MOST, _MANY = 1024, 1 << 22, 100_000


def sentences(light: ShotLight) -> Iterator[str]:
    """Yield a sentence about each lamp whose beams are wider than gaps in their way, with what to type."""
    settings, world = light.settings, light.world
    if not light.cameras:
        return
    passes = min(settings.passes if settings.error is None else usual_passes(None), _PASSES)
    scale = float(np.mean([radius_scale(settings.alpha, number) for number in range(passes)]))

    def pixel(places: Array) -> Array:
        return np.min([_pixel(each, places) for each in light.cameras], axis=0)

    for gap in fine_gaps(world, light.simulation.strata(world), settings.overlap, scale, pixel):
        yield _sentence(light, gap)


def _pixel(view: View, places: Array) -> Array:
    """Return how large a pixel of a view is at places, (N, 3), in scene units."""
    scale, camera = float(np.max(view.pixels_per_tangent)), view.camera
    if camera.orthographic:
        return np.full(len(places), 1 / scale)
    distance: Array = np.linalg.norm(places - np.asarray(camera.to_world)[:3, 3], axis=1)
    return distance / scale


def _sentence(light: ShotLight, gap: Gap) -> str:
    emitter, usual = light.world.emitters[gap.lamp], DEFAULT_PATHS if light.world.emits else DEFAULT_BEAMS
    own = emitter.beams.beam_count
    count = gap.factor * (light.settings.beams or usual if own is None else own)
    where = f"gaps of {gap.surface}" if gap.surface else f"gaps near {' '.join(f'{each:.3g}' for each in gap.place)}"
    who = f"{where} are {gap.size:.3g} units wide"
    what = f"{who}, but beams of {emitter.name or 'a lamp'} {gap.beam:.3g} there, so that their stripes blur"
    portal = "a photonbeams:portal around the gaps"
    if count > _MOST:
        return f"{what}: expected more than {_MOST:,} beams" + ("" if emitter.portal else f", or {portal}")
    step = 10 ** max(int(log10(count)) - 1, 0)  # two digits
    number = step * ceil(count / step)
    more = f"--beams {number}" if own is None else f"--set {emitter.name}.photonbeams:count={number}"
    return f"{what}: expected {more}" + (f", or {portal}" if number > _MANY and emitter.portal is None else "")
