"""The rate to match: a minimal tiled Beam × Beam 1D gather in Dr.Jit, with a fixed radius, fog and kernel.

The estimators would be like this if they had to handle only one case: cylindrical beams, one pinhole, rays without an
end, a constant σt, Epanechnikov's one-dimensional kernel, and no view-angle factor. Tiles are visited row by row along
each beam's axis. A lane handles eight neighbouring pixels of a row, so that data loaded for a beam serves eight rays.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from photonbeams.runtime.device import Array2f, Array3f, Array4f, Float, Int32, UInt32

from .scenes import HEIGHT, RADIUS, WIDTH, Fan

EXTINCTION = (0.1, 0.12, 0.15)
_FOCAL = 0.8 * WIDTH
_TILE, _PIXELS = 16, 8
_COLUMNS, _ROWS = -(-WIDTH // _TILE), -(-HEIGHT // _TILE)


class Yardstick:
    """The gather for one fan of beams: call `bin`, then `gather`; `tests` counts the ray–beam tests of a gather."""

    def __init__(self, fan: Fan) -> None:
        down = np.array([1, -1, -1])  # x right, y down, z forward
        self._start, self._end = fan.start * down, fan.end * down
        axis = self._end - self._start
        length = np.linalg.norm(axis, axis=1)
        axis /= length[:, None]
        record = np.zeros((len(axis), 4, 4), np.float32)
        record[:, 0, :3], record[:, 0, 3] = axis, (axis * self._start).sum(1)
        record[:, 1, :3], record[:, 1, 3] = self._start, length
        record[:, 2, :3], record[:, 2, 3] = np.cross(axis, self._start), RADIUS
        record[:, 3, :3] = 1 / len(axis)
        self._beams = Float(record.ravel())
        self._tile, self._pixels = _pixels()
        self._rays = [_direction(x, y) for x, y in self._pixels]
        dr.eval(self._rays, self._tile)

    def bin(self) -> None:
        """List each tile's beams."""
        first, last = _project(self._start), _project(self._end)
        reach = dr.maximum(first[1], last[1]) * RADIUS + 1
        count = dr.zeros(UInt32, _COLUMNS * _ROWS)
        _walk(first[0], last[0], reach, count, None, None)
        dr.eval(count)
        self._offset, entries = dr.prefix_sum(count), int(dr.sum(count)[0])
        cursor, self._list = dr.zeros(UInt32, _COLUMNS * _ROWS), dr.empty(UInt32, entries)
        dr.eval(self._offset, cursor, self._list)
        _walk(first[0], last[0], reach, cursor, self._offset, self._list)
        dr.eval(self._list)
        self._count = count
        self.tests = entries * _TILE * _TILE

    def gather(self) -> list[Any]:
        """Return the radiance of each lane's pixels."""
        first = dr.gather(UInt32, self._offset, self._tile)
        radiance = _sum(self._rays, first, first + dr.gather(UInt32, self._count, self._tile), self._list, self._beams)
        dr.eval(radiance)
        return radiance

    def picture(self) -> Any:
        """Return the pixels row by row."""
        result = dr.zeros(Array3f, WIDTH * HEIGHT)
        for (x, y), value in zip(self._pixels, self.gather(), strict=True):
            dr.scatter(result, value, y * WIDTH + x, (x < WIDTH) & (y < HEIGHT))
        return result


def _pixels() -> tuple[Any, list[tuple[Any, Any]]]:
    per_tile = _TILE * _TILE // _PIXELS
    lane = dr.arange(UInt32, _COLUMNS * _ROWS * per_tile)
    tile, local = lane // per_tile, lane % per_tile * _PIXELS
    left, top = tile % _COLUMNS * _TILE, tile // _COLUMNS * _TILE
    return tile, [(left + (local + p) % _TILE, top + (local + p) // _TILE) for p in range(_PIXELS)]


def _direction(x: Any, y: Any) -> Any:
    return dr.normalize(Array3f((Float(x) + 0.5 - WIDTH / 2) / _FOCAL, (Float(y) + 0.5 - HEIGHT / 2) / _FOCAL, 1))


def _project(points: Any) -> tuple[Any, Any]:
    """Return pixel positions, and pixels per unit of length there."""
    q = Array3f(np.ascontiguousarray(points.T, np.float32))
    return Array2f(q.x / q.z * _FOCAL + WIDTH / 2, q.y / q.z * _FOCAL + HEIGHT / 2), _FOCAL / q.z


@dr.syntax
def _walk(first: Any, last: Any, reach: Any, counter: Any, offset: Any, out: Any) -> Any:
    """Visit the tiles under each beam's axis, widened by `reach` pixels: count, or write the beam's number."""
    row = _tile(dr.minimum(first.y, last.y) - reach, 0, _ROWS)
    bottom = _tile(dr.maximum(first.y, last.y) + reach, 1, _ROWS)
    d = last - first
    inv = dr.select(dr.abs(d.y) > 1e-6, 1 / d.y, 0)
    beam = dr.arange(UInt32, dr.width(first))
    while row < bottom:
        top = Float(row * _TILE) - reach
        enter = dr.select(inv == 0, 0, dr.clip((top - first.y) * inv, 0, 1))
        leave = dr.select(inv == 0, 1, dr.clip((top + _TILE + 2 * reach - first.y) * inv, 0, 1))
        xa, xb = first.x + d.x * enter, first.x + d.x * leave
        column = _tile(dr.minimum(xa, xb) - reach, 0, _COLUMNS)
        edge = _tile(dr.maximum(xa, xb) + reach, 1, _COLUMNS)
        while column < edge:
            tile = UInt32(row * _COLUMNS + column)
            slot = dr.scatter_inc(counter, tile, column < edge)
            if dr.hint(out is not None, mode="scalar"):
                dr.scatter(out, beam, dr.gather(UInt32, offset, tile) + slot, column < edge)
            column += 1
        row += 1


def _tile(pixel: Any, more: int, count: int) -> Any:
    return dr.clip(Int32(dr.floor(pixel / _TILE)) + more, 0, count)


@dr.syntax
def _sum(rays: list[Any], i: Any, stop: Any, numbers: Any, beams: Any) -> Any:
    """Return the radiance of a tile's beams toward each of the lane's rays."""
    radiance = [Array3f(0) for _ in range(_PIXELS)]
    while i < stop:
        base = dr.gather(UInt32, numbers, i) * 16
        # Sixteen single gathers were measured to be no slower than four packets.
        g = [Array4f(*[dr.gather(Float, beams, base + 4 * j + k) for k in range(4)]) for j in range(4)]
        axis, reach, start, length = g[0].xyz, g[0].w, g[1].xyz, g[1].w
        moment, radius, power = g[2].xyz, g[2].w, g[3].xyz
        for p in range(_PIXELS):
            d = rays[p]
            c, a = dr.dot(d, axis), dr.dot(d, start)
            inv = dr.rcp(dr.fma(-c, c, 1))
            s, t = dr.fma(c, a, -reach) * inv, dr.fma(-c, reach, a) * inv
            u2 = dr.square(dr.dot(d, moment)) * inv
            hit = (u2 < radius * radius) & (s > 0) & (s < length) & (t > 0)
            if hit:
                kernel = dr.fma(-u2, dr.rcp(radius * radius), 1) * 0.75 * dr.rcp(radius) * dr.sqrt(inv)
                radiance[p] += power * (kernel * dr.exp(-Array3f(*EXTINCTION) * (s + t)))
        i += 1
    return radiance
