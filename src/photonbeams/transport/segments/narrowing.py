"""Narrow beams straight from a lamp where a surface blocks their rim.

A beam is a single ray with a width. Where a surface blocks its rim but not its axis, as in corners and at edges, a wide
beam would shine through the surface. From there on it keeps its flux and becomes narrower. Up to there it is as wide as
its neighbours: narrow beams among wide ones would be a bright line.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import reduce
from typing import TYPE_CHECKING

import drjit as dr
import numpy as np

from ...numerics.hashing import hash32, unit_float
from ...runtime.device import Array3f, Bool, Float, UInt32
from ...world.warp import facing, perpendicular
from ...world.world import World

if TYPE_CHECKING:
    from .records import LightPaths

RIM = 6  # rays that test a beam's rim for surfaces
# Beams are narrower the nearer they are to a surface that blocks others, from so many radii on. If their radii changed
# within one radius, light would be missing beside a shadow's edge, and lie between there and the edge.
_FARTHEST = 4.0
#: What is within a ring, but not within the next one, is this part of the ring's radius away.
WITHIN = 2**-0.25
# Part of the seed of a beam's rings. If all beams had the same, a line would lie where their radii change.
_RINGS = 0x51
_SLACK = 0.25  # radii by which the rim may stop before the plane where the axis ended: surfaces are curved


def narrow(world: World, paths: LightPaths, scale: Float, halvings: UInt32, most: int) -> None:
    """Find where paths that leave their lamps are stopped, and the factors on their radii.

    Parameters
    ----------
    scale
        The pass's factor on all radii.
    halvings, most
        How often each beam is halved at most, and the greatest of these: a beam that is too narrow is a bright streak,
        one that is too wide a soft edge.
    """
    alive = paths.initial > 0
    stop(world, paths)
    begin = dr.select(paths.portal < paths.total, paths.portal, 0)
    radius = paths.width(paths.total) * scale
    dr.eval(paths.total, paths.against, begin, radius)
    least = dr.exp2(-Float(halvings))
    nearer = dr.exp2(-0.5 * unit_float(hash32(paths.index, paths.key, UInt32(_RINGS))))
    for number in range(2 * most + 1 if most else 0):
        tried = alive & (paths.narrow > least)
        part = nearer * dr.opaque(Float, 2 ** (-number / 2))
        clear = reduce(dr.minimum, beside(world, paths, begin, radius * _FARTHEST * part, tried))
        paths.narrow = dr.select(dr.isfinite(clear), dr.maximum(WITHIN * part, least), paths.narrow)
        paths.clear = dr.minimum(paths.clear, clear)
        dr.eval(paths.narrow, paths.clear)


def stop(world: World, paths: LightPaths) -> None:
    """Find the surfaces that stop paths that leave their lamps."""
    seed = hash32(paths.index, paths.key)
    hit, _ = world.solids.behind_panes(paths.origin, paths.direction, paths.initial > 0, seed, paths.link)
    met = hit.is_valid()
    paths.total = dr.select(met, hit.t, paths.total)
    paths.against = dr.select(met, facing(Array3f(hit.n), paths.direction), -paths.direction)


def beside(
    world: World, paths: LightPaths, begin: Float, at_end: Float, active: Bool, sides: int = RIM
) -> Iterator[Float]:  # fmt: skip
    """Yield the distances along beams at which rays on each side first meet a surface that does not stop the axis.

    They are infinite where none is met. The rays lead to places `at_end` from the axis' end. They begin on the axis,
    not on the rim: beside a portal's edge the rim begins in the wall, which is not a leak.
    """
    across, up = perpendicular(paths.direction)
    start = paths.origin + begin * paths.direction
    end = paths.origin + paths.total * paths.direction
    seed = hash32(paths.index, paths.key)
    for angle in np.arange(sides) * (2 * np.pi / sides):
        side = float(np.cos(angle)) * across + float(np.sin(angle)) * up
        ray = end + at_end * side - start
        length = dr.norm(ray)
        ray *= dr.rcp(length)
        facing = dr.dot(ray, paths.against)
        plane = dr.dot(end - start, paths.against) / dr.minimum(facing, -1e-3)
        reach = dr.minimum(plane, length + at_end) - _SLACK * at_end
        clear = world.solids.clear(start, ray, reach, active & (reach > 0), seed, paths.link)
        yield begin + clear * dr.dot(ray, paths.direction)
