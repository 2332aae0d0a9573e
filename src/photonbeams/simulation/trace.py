"""Light tracing: beams from lights to the first surface, in strata, the same for the same seed.

A light without a portal has one stratum: all its directions. A light with a portal has two that add up to it: the paths
through the portal, and, where the camera sees the light's own side of it, all others.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Collection
from typing import TYPE_CHECKING, Any, NamedTuple

import drjit as dr
import numpy as np

from .. import scene
from ..beams import Beams
from ..device import Array2f, Array3f, Bool, Float, UInt32
from .emission import Emission, emit, emit_through
from .footprints import FLOOR, radius_along, unblocked
from .lights import DistantSource, DomeSource, opaque
from .portals import count_candidates
from .sampling import hash32, sobol_block

if TYPE_CHECKING:
    from ..looks import Look
    from ..render.world import World

# How far beyond the bounding sphere, in its radii, light of a lamp goes on that meets no surface. With nothing behind
# them the beams would otherwise end in view; what is further away adds less than a percent of a beam's light.
ESCAPE = 8.0
LIGHT_SIDE = 0.25  # the part of a light's beams that do not go through its portal, where they are seen

# How often a beam is halved that a surface stands in the way of: seldom where it would be seen as a streak, often
# behind a portal, where it would be seen through the wall.
HALVINGS, HALVINGS_ASIDE = 1, 5

_PORTAL, _ALL = 0, 1  # names of strata in seeds


class BeamSet(NamedTuple):
    """Beams that share a light group and a look (None: the physical one)."""

    group: str
    look: Look | None
    beams: Beams


class Run(NamedTuple):
    """How a stratum is sampled: samples, number of the pass, width of a beam in spacings, and how often to halve it."""

    samples: int
    pass_index: int
    overlap: float
    halvings: int


def trace(
    world: World,
    *,
    beams_per_light: int = 4096,
    pass_index: int = 0,
    seed: int = 0,
    light_side: Collection[str] = (),
    overlap: float = 1.0,
) -> list[BeamSet]:
    """Return the beams of one pass, a set for each light that has any, and for each set of drawn beams.

    Parameters
    ----------
    beams_per_light
        Light paths a pass, for lights that do not say themselves. A path through a portal is two beams.
    pass_index, seed
        Passes continue one Sobol sequence for each light; the seed names the sequence.
    light_side
        Names of lights whose paths that miss the portal are wanted too: see `sides.lights_seen`.
    overlap
        Width of a beam in units of the distance to its neighbours.

    Notes
    -----
    The power of each pass is that of the whole light: frames average over passes.
    """
    sets = []
    for light, source in zip(world.description.lights, world.sources, strict=True):
        count = beams_per_light if light.beam_count is None else light.beam_count
        if not light.emits_beams or count <= 0:
            continue
        portal = world.portals.get(light.name)
        pieces: list[Beams] = []
        if portal is not None:
            aside = max(1, round(LIGHT_SIDE * count)) if light.name in light_side else 0
            candidates = count_candidates(portal, count - aside)
            u, v = _points(light, candidates, pass_index, seed, _PORTAL)
            emission = emit_through(light, source, portal, world.bounds, u, v, candidates)
            pieces += _beams(world, source, emission, Run(candidates, pass_index, overlap, HALVINGS), split=True)
            count = aside
        if count:
            u, v = _points(light, count, pass_index, seed, _ALL)
            emission = emit(light, source, world.bounds, u, v, count)
            if portal is not None:
                emission.valid &= ~portal.crosses(emission.origin, emission.direction)
            pieces += _beams(
                world,
                source,
                emission,
                Run(count, pass_index, overlap, HALVINGS if portal is None else HALVINGS_ASIDE),
                split=False,
            )
        if pieces:
            sets.append(BeamSet(light.group, light.look, _joined(pieces)))
    return sets + [BeamSet(drawn.group, drawn.look, _drawn(drawn)) for drawn in world.description.drawn]


def _points(light: scene.Light, count: int, block: int, seed: int, stratum: int) -> tuple[Array2f, Array2f]:
    """Return the 4D samples of a pass; lights of the same seed differ by their names."""
    return sobol_block(count, block, (seed & 0xFFFFFFFF, light.seed & 0xFFFFFFFF, stratum, _name_key(light.name)))


def _name_key(name: str) -> int:
    return zlib.crc32(name.encode())


def _beams(world: World, source: Any, emission: Emission, run: Run, split: bool) -> list[Beams]:
    """Return the beams of light paths: to the first surface, inside the fog, cut at the portal."""
    alive = emission.valid & (dr.max(emission.flux) > 0)
    seed = hash32(dr.arange(UInt32, dr.width(emission.origin)), dr.opaque(UInt32, run.pass_index))
    hit = world.intersect(emission.origin, emission.direction, alive, seed)
    scale = 1.0 if isinstance(source, DistantSource | DomeSource) else ESCAPE
    escape = world.bounds.exit(emission.origin, emission.direction, scale)
    total = dr.select(hit.is_valid(), hit.t, escape)
    against = dr.select(hit.is_valid(), _facing(hit.n, emission.direction), -emission.direction)
    kept = _compressed(alive, emission, total, against)
    if not kept:
        return []
    emission, total, against = kept
    reference = float(np.median(np.minimum(total.numpy(), 2 * world.radius)))
    radius = radius_along(emission, run.samples, reference, run.overlap, opaque(FLOOR * reference))
    light, everywhere = 0 * total, dr.full(Bool, True, dr.width(total))
    portal = emission.portal * (1 - 1e-5)
    passes = (total > portal) & split
    begin = dr.select(passes, portal, light)
    narrowed = unblocked(world, emission, radius, begin, total, against, run.halvings)
    if not split:
        return _piece(world, emission, lambda s: radius(s) * narrowed, (light, total), total, against, everywhere)
    middle = dr.minimum(portal, total)
    first_normal = dr.select(passes, -emission.direction, against)
    before = dr.select(passes, 1, narrowed)
    first = _piece(world, emission, lambda s: radius(s) * before, (light, middle), total, first_normal, everywhere)
    return first + _piece(world, emission, lambda s: radius(s) * narrowed, (middle, total), total, against, passes)


def _compressed(keep: Bool, *values: Any) -> list[Any]:
    """Return the entries of arrays and structs where `keep`, in order; an empty list if there is none.

    Everything is made opaque, also what happens to be constant: kernels would differ between frames.
    """
    dr.make_opaque(keep, values)
    index: Any = dr.compress(keep)
    return [dr.gather(type(value), value, index) for value in values] if len(index) else []


def _facing(normal: Any, direction: Array3f) -> Array3f:
    """Return the normal turned against the direction."""
    n = Array3f(normal)
    return dr.select(dr.dot(n, direction) > 0, -n, n)


def _piece(
    world: World,
    emission: Emission,
    radius: Callable[[Float], Float],
    stretch: tuple[Float, Float],
    total: Float,
    normal: Array3f,
    alive: Bool,
) -> list[Beams]:
    """Return a stretch of light paths, as far as it lies in the fog, as beams; none as an empty list."""
    near, far = stretch
    entry = 0 * total
    if world.fog is not None and world.fog.boundary is not None:
        entry, leave, outward = world.fog.interval(emission.origin, emission.direction)
        normal = dr.select(leave < far, -outward, normal)
        near, far = dr.maximum(near, entry), dr.minimum(far, leave)
    start, end = emission.origin + near * emission.direction, emission.origin + far * emission.direction
    kept = _compressed(
        alive & (far > near), start, end, radius(near), radius(far), emission.flux, near, total, entry, normal
    )
    if not kept:
        return []
    return [Beams(*kept[:5], offset=kept[5], total=kept[6], entry=kept[7], end_normal=kept[8])]


def _joined(pieces: list[Beams]) -> Beams:
    """Return all beams as one struct, in order.

    Not by `dr.concat`, which makes the lengths a part of its kernels: every pass has others.
    """
    if len(pieces) == 1:
        return pieces[0]
    result, first = dr.zeros(Beams, sum(map(len, pieces))), 0
    for piece in pieces:
        dr.scatter(result, piece, dr.arange(UInt32, len(piece)) + dr.opaque(UInt32, first))
        first += len(piece)
    return result


def _drawn(drawn: scene.DrawnBeams) -> Beams:
    return Beams(drawn.start, drawn.end, drawn.radius_start, drawn.radius_end, drawn.power)
