"""Light tracing: beams from lights to the first surface, in strata, the same for the same seed.

A light without a portal has one stratum: all its directions. A light with a portal has two that add up to it: the paths
through the portal, and, where the camera sees the light's own side of it, all others.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Collection, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import drjit as dr
import numpy as np

from .. import scene
from ..beams import Beams
from ..beams.guides import known_guides, led, pieces_along
from ..beams.sets import BeamSet
from ..numerics.arrays import compressed, joined, opaque
from ..numerics.hashing import hash32, unit_float
from ..numerics.sampling import sobol_block
from ..runtime.device import Array2f, Array3f, Bool, Float, UInt32
from ..world.gobos import Masked, bare
from ..world.lights import DistantSource, DomeSource
from ..world.portals import count_candidates
from .lamps import Emission, emit, emit_through
from .stage_radii import FLOOR, radius_along, unblocked

if TYPE_CHECKING:
    from ..looks import Look
    from ..world.stage_world import StageWorld

LIGHT_SIDE = 0.25  # the part of a light's beams that do not go through its portal, where they are seen

# How often a beam is halved that a surface stands in the way of: seldom where it would be seen as a streak, often
# behind a portal, where it would be seen through the wall.
HALVINGS, HALVINGS_ASIDE = 1, 5

# Paths that tell how much of a light its images leave, and how many paths at most are tried for one that is left.
_PROBE, _MOST_DARK, _MOST_PATHS = 4096, 64, 1 << 22

_PORTAL, _ALL = 0, 1  # names of strata in seeds


class _Moment(NamedTuple):
    """A light at one time of the shutter, and the world around it, with the surfaces that stop it."""

    world: StageWorld
    light: scene.Light
    source: Any


class Run(NamedTuple):
    """How a stratum is sampled: samples, number of the pass, width of a beam in spacings, and how often to halve it.

    `key` names the stratum, for the beams' random numbers.
    """

    samples: int
    pass_index: int
    overlap: float
    halvings: int
    key: int


def trace(
    world: StageWorld,
    *,
    beams_per_light: int = scene.DEFAULT_BEAMS,
    pass_index: int = 0,
    seed: int = 0,
    light_side: Collection[str] = (),
    overlap: float = 1.0,
    close: StageWorld | None = None,
    looks: Mapping[str, Look | None] | None = None,
) -> list[BeamSet]:
    """Return the beams of one pass, a set for each light that has any, and for each set of drawn beams.

    Parameters
    ----------
    world, close
        The shot, and the same shot at shutter close where anything in it moves. A light path then has the same samples
        at both times. What is the same object in both is taken to be at rest.
    beams_per_light
        Light paths a pass, for lights that do not say themselves. A path through a portal is two beams.
    pass_index, seed
        Passes continue one Sobol sequence for each light; the seed names the sequence.
    looks
        Looks by the names of lights and drawn beams, instead of those that they have in `world`.
    light_side
        Names of lights whose paths that miss the portal are wanted too: see `sides.lights_seen`.
    overlap
        Width of a beam in units of the distance to its neighbours.

    Notes
    -----
    The power of each pass is that of the whole light: frames average over passes.
    """
    sets = []
    for index, moments in enumerate(_moments(world, close)):
        light = moments[0].light
        count = beams_per_light if light.beam_count is None else light.beam_count
        if not light.emits_beams or count <= 0:
            continue
        pieces: list[_Piece] = []
        key = zlib.crc32(repr((_name_key(light.name), seed, light.seed)).encode())
        portal = world.portals.get(light.name)
        if portal is not None:
            aside = max(1, round(LIGHT_SIDE * count)) if light.name in light_side else 0
            lit = _lit_part(moments[0], through=True)
            candidates = count_candidates(portal.fill, _more(count - aside, lit))
            samples = _points(light, candidates, pass_index, seed, _PORTAL)
            paths = [_through(moment, samples, candidates) for moment in moments]
            pieces += _beams(moments, paths, Run(candidates, pass_index, overlap, HALVINGS, key ^ _PORTAL), split=True)
            count = aside
        if count:
            candidates = _more(count, _lit_part(moments[0], through=False))
            samples = _points(light, candidates, pass_index, seed, _ALL)
            halvings = HALVINGS if portal is None else HALVINGS_ASIDE
            paths = [_aside(moment, samples, candidates) for moment in moments]
            run = Run(candidates, pass_index, overlap, halvings, key ^ _ALL)
            pieces += _beams(moments, paths, run, split=False)
        if pieces:
            states = [joined(list(state)) for state in zip(*pieces, strict=True)]
            states = _led(states, moments)
            dr.eval(states)  # each light alone: what has the same width by chance would share a kernel
            later = states[1] if len(states) > 1 else None
            look = (looks or {}).get(light.name, light.look)
            sets.append(BeamSet(light.group, look, states[0], later, light.name, index, light.frame))
    return sets + _drawn(world, close, looks or {})


def pieces_of(light: scene.Light) -> int:
    """Return how many beams a light's guides make of one."""
    return pieces_along(known_guides(light.guides)) + 2 if light.guides else 1


def _led(states: list[Beams], moments: list[_Moment]) -> list[Beams]:
    """Return beams at the times that differ, along their light's guides if it has any."""
    guides = [known_guides(moment.light.guides) for moment in moments]
    count = max(pieces_along(each) for each in guides)
    return [led(state, each, count) for state, each in zip(states, guides, strict=True)]


def _moments(world: StageWorld, close: StageWorld | None) -> list[list[_Moment]]:
    """Return each light at the times that differ."""
    lights = zip(world.description.lights, world.lights, strict=True)
    result = [[_Moment(world.stopping(light), light, source)] for light, source in lights]
    if close is not None:
        still = close.surfaces is world.surfaces and close.fog is world.fog
        later = zip(close.description.lights, close.lights, strict=True)
        for moments, (light, source) in zip(result, later, strict=True):
            if not still or light is not moments[0].light:
                moments.append(_Moment(close.stopping(light), light, source))
    return result


def _through(moment: _Moment, samples: tuple[Array2f, Array2f], count: int) -> Emission:
    world, light, source = moment
    return _scaled(emit_through(light, source, world.portals[light.name], world.bounds, *samples, count), light)


def _aside(moment: _Moment, samples: tuple[Array2f, Array2f], count: int) -> Emission:
    world, light, source = moment
    emission = emit(light, source, world.bounds, *samples, count)
    if light.name in world.portals:
        emission.valid &= ~world.portals[light.name].crosses(emission.origin, emission.direction)
    return _scaled(emission, light)


def _scaled(emission: Emission, light: scene.Light) -> Emission:
    emission.flux *= opaque(light.beam_scale)
    return emission


def _lit_part(moment: _Moment, through: bool) -> float:
    """Return which part of a light's paths passes its images: of a few of them, and 1 of a light without."""
    source = moment.source
    if not isinstance(source, Masked):
        return 1.0
    if through not in source.lit:
        probe = sobol_block(_PROBE, 0, (_PROBE,))
        paths = _through(moment, probe, _PROBE) if through else _aside(moment, probe, _PROBE)
        there = np.broadcast_to(paths.valid.numpy(), _PROBE)
        lit = there & (paths.flux.numpy().max(axis=0) > 0)
        source.lit[through] = float(lit.sum() / max(there.sum(), 1))
    return source.lit[through]


def _more(count: int, lit: float) -> int:
    """Return how many paths leave about `count` that are lit, within reason."""
    most = max(count, min(_MOST_DARK * count, _MOST_PATHS))
    return min(count_candidates(max(lit, 1 / _MOST_DARK), count), most)


def _points(light: scene.Light, count: int, block: int, seed: int, stratum: int) -> tuple[Array2f, Array2f]:
    """Return the 4D samples of a pass; lights of the same seed differ by their names."""
    return sobol_block(count, block, (seed & 0xFFFFFFFF, light.seed & 0xFFFFFFFF, stratum, _name_key(light.name)))


def _name_key(name: str) -> int:
    return zlib.crc32(name.encode())


# Beams at each of the times: one, or shutter open and shutter close.
_Piece = list[Beams]


def _beams(moments: list[_Moment], paths: list[Emission], run: Run, split: bool) -> list[_Piece]:
    """Return the beams of light paths: to the first surface, inside the fog, cut at the portal."""
    alive = [path.valid & (dr.max(path.flux) > 0) for path in paths]
    # Not a bare counter: once that is evaluated, Dr.Jit takes it for every other counter of its length, in kernels of
    # another form than those of other lengths.
    numbers = dr.arange(UInt32, dr.width(paths[0].origin)) + dr.opaque(UInt32, 0)
    kept = compressed(_any(alive), *alive, *paths, numbers)
    if not kept:
        return []
    alive, paths, numbers = kept[: len(moments)], kept[len(moments) : -1], kept[-1]
    stretches = [
        _stretches(moment, path, there, numbers, run, split)
        for moment, path, there in zip(moments, paths, alive, strict=True)
    ]
    return [piece for states in zip(*stretches, strict=True) if (piece := _piece(list(states)))]


def _any(masks: list[Bool]) -> Bool:
    result = masks[0]
    for mask in masks[1:]:
        result = result | mask
    return result


class _Stretch(NamedTuple):
    """A stretch of light paths at one time, and which of them are there."""

    alive: Bool
    beams: Beams


def _stretches(
    moment: _Moment, emission: Emission, alive: Bool, numbers: UInt32, run: Run, split: bool
) -> list[_Stretch]:
    """Return light paths at one time: up to the portal and behind it, or the whole of them."""
    world = moment.world
    seed = hash32(numbers, dr.opaque(UInt32, run.pass_index))
    hit = world.solid(emission.origin, emission.direction, alive, seed)
    scale = 1.0 if isinstance(bare(moment.source), DistantSource | DomeSource) else scene.ESCAPE
    escape = world.bounds.exit(emission.origin, emission.direction, scale)
    total = dr.select(hit.is_valid(), hit.t, escape)
    against = dr.select(hit.is_valid(), _facing(hit.n, emission.direction), -emission.direction)
    names = unit_float(hash32(seed, dr.opaque(UInt32, run.key))), Float(2 * numbers + (1 if split else 0))
    dr.eval(total, against, names)
    reference = float(np.median(np.minimum(total.numpy()[alive.numpy()], 2 * world.radius))) if dr.any(alive) else 1.0
    radius = radius_along(emission, run.samples, reference, run.overlap, opaque(FLOOR * reference))
    light = 0 * total
    portal = emission.portal * (1 - 1e-5)
    passes = (total > portal) & split
    begin = dr.select(passes, portal, light)
    narrowed = unblocked(world, emission, radius, begin, total, against, run.halvings)
    if not split:
        return [_stretch(world, emission, lambda s: radius(s) * narrowed, (light, total), total, against, alive, names)]
    middle = dr.minimum(portal, total)
    first_normal = dr.select(passes, -emission.direction, against)
    before = dr.select(passes, 1, narrowed)
    return [
        _stretch(world, emission, lambda s: radius(s) * before, (light, middle), total, first_normal, alive, names),
        _stretch(
            world, emission, lambda s: radius(s) * narrowed, (middle, total), total, against, alive & passes, names
        ),
    ]


def _facing(normal: Any, direction: Array3f) -> Array3f:
    """Return the normal turned against the direction."""
    n = Array3f(normal)
    return dr.select(dr.dot(n, direction) > 0, -n, n)


def _stretch(
    world: StageWorld,
    emission: Emission,
    radius: Callable[[Float], Float],
    ends: tuple[Float, Float],
    total: Float,
    normal: Array3f,
    alive: Bool,
    names: tuple[Float, Float],
) -> _Stretch:
    """Return a stretch of light paths as beams, as far as it lies in the fog; `names` are random number and number."""
    near, far = ends
    entry = 0 * total
    if world.fog is not None and world.fog.boundary is not None:
        entry, leave, outward = world.fog.interval(emission.origin, emission.direction)
        normal = dr.select(leave < far, -outward, normal)
        near, far = dr.maximum(near, entry), dr.minimum(far, leave)
    start, end = emission.origin + near * emission.direction, emission.origin + far * emission.direction
    beams = Beams()
    beams.start, beams.end, beams.radius_start, beams.radius_end = start, end, radius(near), radius(far)
    beams.power, beams.offset, beams.total, beams.entry, beams.end_normal = emission.flux, near, total, entry, normal
    beams.random, beams.id, beams.generation = *names, 0 * total
    return _Stretch(alive & (far > near), beams)


def _piece(states: list[_Stretch]) -> _Piece:
    """Return the beams that are there at any of the times; at another they have no power, if they are not there."""
    kept = compressed(_any([state.alive for state in states]), *(part for state in states for part in state))
    if not kept:
        return []
    if len(states) == 1:
        return [kept[1]]
    (there, first), (later, last) = kept[:2], kept[2:]
    return [_present(first, last, there), _present(last, first, later)]


def _present(beams: Beams, other: Beams, there: Bool) -> Beams:
    """Return beams where they are there, and elsewhere those of another time, without power."""
    result = dr.select(there, beams, other)
    result.power = dr.select(there, beams.power, 0)
    return result


def _drawn(world: StageWorld, close: StageWorld | None, looks: Mapping[str, Look | None]) -> list[BeamSet]:
    """Return the beams that someone drew."""
    sets = []
    for number, drawn in enumerate(world.description.drawn):
        later = close.description.drawn[number] if close is not None else drawn
        moved = Beams(**later.arrays()) if later is not drawn and _are_same(drawn, later) else None
        look, index = looks.get(drawn.name, drawn.look), len(world.description.lights) + number
        sets.append(BeamSet(drawn.group, look, Beams(**drawn.arrays()), moved, drawn.name, index))
    return sets


def _are_same(drawn: scene.DrawnBeams, later: scene.DrawnBeams) -> bool:
    """Return whether drawn beams can be followed from one time to the other."""
    return len(later.start) == len(drawn.start) and later.arrays().keys() == drawn.arrays().keys()
