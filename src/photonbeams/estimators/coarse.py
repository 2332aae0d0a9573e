"""Fewer rays than pixels for wide beams, whose pictures are smooth strokes: corners of squares, and what lies between.

A tile sees a beam that neither ends in it nor may reach behind a surface of it through the corners of squares of 2, 4
or 8 pixels, and pixels have the bilinear interpolation. No light crosses an edge of depth: such a beam lies before all
surfaces of the tile. Interpolation over δ half widths of a stroke errs by about δ², the more beams a tile has the less
of their sum, so δ grows with their number to the power of a quarter.
"""

from __future__ import annotations

from functools import lru_cache, partial
from typing import Any

import drjit as dr
import numpy as np

from ..looks import BoundLook
from ..looks.across import Across
from ..numerics.arrays import to_float
from ..runtime.device import Array3f, Float, UInt32
from .estimate import ENDLESS
from .lanes import Lanes, PixelRays, Sheet, tiles_of
from .tiles import TILE, Bins, Detail, Projection

# Strokes are seen by so many rays over their half width at least.
_WIDEST = 0.5
# Of how many beams one has the weight of all: some are brighter than others, and do not cover the tile.
_UNEVEN = 8.0
_SAMPLES = 1 << 12


def detail_of(view: Projection, rays: PixelRays, look: BoundLook, bins: Bins, tolerance: float) -> Detail:
    """Return how finely beams have to be seen, for a relative error of about `tolerance`.

    `bins` are all beams of the picture without detail.
    """
    first, stop = bins.places()
    beams = dr.clip(Float(stop - first) * (1 / _UNEVEN), 1, 1e6)
    alone = dr.opaque(Float, widest_step(look.profile, tolerance))
    fraction = dr.minimum(alone * dr.sqrt(dr.sqrt(beams)), _WIDEST)
    tile = tiles_of(view, rays)
    nearest, first, last = (dr.full(Float, each, view.tiles) for each in (dr.inf, dr.inf, 0))
    dr.scatter_reduce(dr.ReduceOp.Min, nearest, dr.minimum(rays.t_max, ENDLESS) * rays.facing, tile)
    dr.scatter_reduce(dr.ReduceOp.Min, first, rays.t_min * rays.facing, tile)
    dr.scatter_reduce(dr.ReduceOp.Max, last, rays.t_min * rays.facing, tile)
    # The factor toward the eye counts from where the medium begins, which corners take to be at one depth in a tile.
    even = (last - first) * look.rate_eye <= dr.opaque(Float, tolerance)
    nearest, rate = dr.select(even, nearest, 0), look.rate_along + look.rate_eye
    dr.eval(nearest, first, last, fraction, rate)
    return Detail(nearest, 0.5 * (first + last), fraction, rate, look.rate_fraction)


@lru_cache(maxsize=64)
def widest_step(profile: Across, tolerance: float) -> float:
    """Return how much of a half width may lie between rays for a single stroke to err by `tolerance` of its mean."""
    u = np.linspace(-1.5, 1.5, _SAMPLES)
    x = np.minimum(u * u, 1)
    stroke = np.sqrt(1 - x) * (profile.line(to_float(x)) + dr.zeros(Float, _SAMPLES)).numpy()
    step = _WIDEST
    while step > 0.02:
        error = 0.0
        for offset in (0.0, 0.25, 0.5, 0.75):
            knots = np.arange(-2, 2, step) + offset * step
            seen = np.interp(knots, u, stroke, left=0, right=0)
            error += 0.25 * np.abs(np.interp(u, knots, seen) - stroke).mean() / stroke.mean()
        if error <= tolerance:
            break
        step *= 0.9
    return step


def sheet(view: Projection, rays: PixelRays, begin: Any, level: int) -> Sheet:
    """Return the corners of a level's squares; `begin` is the planar depth where the medium begins, by tiles."""
    side = (TILE >> level) + 1
    corner, each = dr.arange(UInt32, view.tiles * side * side), dr.opaque(UInt32, side * side)
    step, across = dr.opaque(UInt32, 1 << level), dr.opaque(UInt32, side)
    (tile, own), columns = (corner // each, corner % each), dr.opaque(UInt32, view.columns)
    x, y = (tile % columns) * TILE + own % across * step, (tile // columns) * TILE + own // across * step
    pose = view.poses[0]
    right, up = (Float(x) - view.center[0]) / view.scale[0], (view.center[1] - Float(y)) / view.scale[1]
    direction = dr.normalize(pose.right * right + pose.up * up + pose.forward)
    facing = dr.dot(direction, pose.forward)
    near, far = dr.gather(Float, begin, tile) / facing, dr.full(Float, ENDLESS, dr.width(corner))
    corners = PixelRays(rays.origin, direction, facing, far, near)
    dr.eval(corners)
    return Sheet(corners, side * side, partial(_carried, view, side * side), partial(_spread, view, rays, level))


def _carried(view: Projection, per_tile: int, count: int) -> Lanes:
    """Return lanes that carry `count` corners each."""
    for_tile = -(-per_tile // count)
    lane, own = dr.arange(UInt32, view.tiles * for_tile), dr.opaque(UInt32, for_tile)
    tile, each = lane // own, dr.opaque(UInt32, per_tile)
    numbers = [lane % own + number * own for number in range(count)]
    carried = [(tile * each + own, own < each) for own in numbers]
    dr.eval(tile, carried)
    return Lanes(tile, dr.opaque(UInt32, 0, dr.width(lane)), carried)


def _spread(view: Projection, rays: PixelRays, level: int, radiance: Any) -> Any:
    """Return the radiance along pixels' rays, interpolated from that at corners."""
    pose, side = view.poses[0], dr.opaque(UInt32, (TILE >> level) + 1)
    depth = dr.rcp(dr.dot(rays.direction, pose.forward))
    x = view.center[0] + view.scale[0] * dr.dot(rays.direction, pose.right) * depth
    y = view.center[1] - view.scale[1] * dr.dot(rays.direction, pose.up) * depth
    tile, columns = tiles_of(view, rays), dr.opaque(UInt32, view.columns)
    inverse = dr.opaque(Float, 1 / (1 << level))

    def between(place: Float, begin: UInt32) -> tuple[UInt32, Float]:
        local = dr.clip((place - Float(begin * TILE)) * inverse, 0, Float(side - 1))
        first = dr.minimum(UInt32(local), side - 2)
        return first, local - Float(first)

    (column, u), (row, v) = between(x, tile % columns), between(y, tile // columns)
    at = tile * side * side + row * side + column
    above = dr.lerp(dr.gather(Array3f, radiance, at), dr.gather(Array3f, radiance, at + 1), u)
    below = dr.lerp(dr.gather(Array3f, radiance, at + side), dr.gather(Array3f, radiance, at + side + 1), u)
    return dr.lerp(above, below, v)
