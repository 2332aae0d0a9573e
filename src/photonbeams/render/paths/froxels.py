"""Froxels, cells of a camera's frustum, in which the fluence of scattered light is tallied.

Deposits a add up in the cell in which they lie, if its pixel sees that far. Divided by the volume V that the rays of
the cell's pixels see of it, that is the fluence, F = Σ a / V. The ratio leaves out light behind walls and silhouettes
without any test of visibility. Both are blurred alike before. The radiance along a ray is the integral of

    L = ∫ σs F / 4π exp(−σt t) dt,

a running sum over the cells of a column, from where the ray enters the medium: distances t begin there. In media that
vary, rays look up F, and meet σs and σt as they are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import numpy as np
from scipy.ndimage import gaussian_filter, gaussian_filter1d, zoom

from ...estimators.projection import Projection
from ...numerics.arrays import joined, to_float, to_uint
from ...numerics.structs import Struct, pack
from ...runtime.device import Array2f, Array3f, Bool, Float, Int64, UInt32
from ...scene import Array, Medium

# The most columns of cells, 160 × 90 for all of a picture, and cells in a column. More change nothing that is seen
# (tried: half and twice as many of each). With many light groups there are fewer: see `_BYTES`.
_COLUMNS, _SLABS = 160 * 90, 64
_BYTES = 1 << 28  # of all sums together, at most
# The width of a cell, as a part of the blur, at this part of the length of rays in the medium; but there are so many
# cells across at least.
_FINE, _MIDDLE, _FEWEST = 0.5, 0.25, 80
# Cells are thin near the camera and thicker by this factor at the far end.
_THICKER = 20.0
# A blur in cells, across a column: the least, without which the nearest cells are noise, and the most.
_LEAST, _MOST = 0.6, 12.0
_WHOLE = 2.0**48  # of the least volumes make up the largest one of a ray
_SEEN = 1e-6  # of the largest volume in a slab: cells of which less is seen are dark

#: Returns 4π times the phase function for light that goes on toward the camera in these directions.
Phase = Callable[[Array3f, Bool], Array3f]


@dataclass(frozen=True)
class Froxels:
    """The cells of a view, (columns, rows, slabs), in one medium.

    Attributes
    ----------
    view
        The projection of a pinhole that sees the whole picture.
    corner, side, shape
        The pixel (x, y) at the cells' upper left, pixels across a cell, and numbers of cells: (slabs, rows, columns).
    near, far
        Where the medium begins and ends on the ray of each pixel, (W · H,) in scene units.
    keys
        The same as `_key`, with whether a ray meets the medium.
    longest
        The greatest length in the medium that counts, in scene units.
    volume
        The volume that rays see of each cell, in cubic scene units.
    """

    view: Projection
    corner: tuple[int, int]
    side: int
    shape: tuple[int, int, int]
    near: Float
    far: Float
    keys: Array3f
    longest: Float
    volume: Array

    @classmethod
    def of(
        cls, view: Projection, facing: Float, near: Float, far: Float, *, deepest: float, blur: float,
        most: int = _COLUMNS,
    ) -> Froxels:  # fmt: skip
        """Return cells, no wider than `blur` where that takes no more columns than there may be.

        Parameters
        ----------
        view
            A pinhole's projection.
        facing, near, far
            Of the rays of all pixels, row by row: the cosine to the view's axis, and where the medium begins and ends;
            these do not meet it where `far` is not beyond `near`.
        deepest, blur, most
            The length in the medium that counts at most, the blur's length, and the most columns.
        """
        length = np.maximum((far - near).numpy(), 0).reshape(view.height, view.width)
        rows, columns = (np.flatnonzero((length > 0).any(axis=axis)) for axis in (1, 0))
        top, left, height, width = rows[0], columns[0], np.ptp(rows) + 1, np.ptp(columns) + 1
        seen = length.ravel() > 0
        away = 1.0 if view.orthographic else float(np.median(near.numpy()[seen] + _MIDDLE * length.ravel()[seen]))
        side = int(np.clip(_FINE * blur / (_pixel(view) * away), 1, max(height, width) // _FEWEST + 1))
        while -(-height // side) * -(-width // side) > most:
            side += 1
        shape = _SLABS, int(-(-height // side)), int(-(-width // side))
        longest = dr.opaque(Float, max(min(float(length.max()), deepest), 1e-30) * (1 + 1e-6))
        meets = far > near
        least = dr.maximum(near, 1e-6 * longest)
        keys = Array3f(_key(view, least * facing), _key(view, far * facing), dr.select(meets, Float(1), Float(0)))
        dr.eval(keys)
        corner = int(left), int(top)
        empty = cls(
            view=view, corner=corner, side=side, shape=shape, near=near, far=far, keys=keys, longest=longest,
            volume=np.zeros(0),
        )  # fmt: skip
        return replace(empty, volume=empty._volumes(facing))

    @property
    def _ends(self) -> Array:
        """The lengths in the medium at which slabs begin, and the last one ends."""
        first = float(self.longest[0]) / _THICKER
        return first * np.expm1(np.arange(_SLABS + 1) / _SLABS * np.log1p(float(self.longest[0]) / first))

    def _volumes(self, facing: Float) -> Array:
        """Return the volumes that rays see of cells.

        A ray stands for the solid angle Ω of its pixel, and sees Ω ∫ (n + t)² dt of a slab, with the distance n to the
        medium: for the slabs before the one in which it ends, sums of Ω n², 2 Ω n and Ω over rays are enough.
        """
        index, there, ends = dr.arange(UInt32, dr.width(facing)), self.far > self.near, self._ends
        length = dr.minimum(self.far - self.near, self.longest)
        width, columns = (dr.opaque(UInt32, each) for each in (self.view.width, self.shape[2]))
        left, top, side = (dr.opaque(UInt32, each) for each in (*self.corner, self.side))
        column = (index // width - top) // side * columns + (index % width - left) // side
        last = dr.minimum(UInt32(_slab(length, self.longest)), _SLABS - 1)
        begin = dr.gather(Float, to_float(ends), last)
        area, most = (float(each[0]) for each in (dr.rcp(self.view.scale[0] * self.view.scale[1]), dr.max(self.near)))
        weights, bounds = [dr.opaque(Float, area) + 0 * facing], [area]
        if not self.view.orthographic:
            angle = area * facing**3
            weights, bounds = (
                [angle * self.near**2, 2 * angle * self.near, angle],
                [area * most**2, 2 * area * most, area],
            )
        cells = _SLABS * self.shape[1] * self.shape[2]
        sums, units = dr.zeros(Int64, 2 * len(weights) * cells), []
        place = last * dr.opaque(UInt32, cells // _SLABS) + column
        for power, (weight, bound) in enumerate(zip(weights, bounds, strict=True), 1):
            parts = weight, weight * (length**power - begin**power)
            for part, largest in zip(parts, (bound, bound * float(ends[-1]) ** power), strict=True):
                units.append(max(largest, 1e-30) / _WHOLE)
                own = place + dr.opaque(UInt32, (len(units) - 1) * cells)
                dr.scatter_reduce(dr.ReduceOp.Add, sums, Int64(part / dr.opaque(Float, units[-1])), own, there)
        found = sums.numpy().reshape(len(weights), 2, _SLABS, -1) * np.reshape(units, (-1, 2, 1, 1))
        result = np.zeros(found.shape[2:])
        for power, (here, part) in enumerate(found, 1):
            beyond = np.flip(np.cumsum(np.flip(here, 0), 0), 0) - here
            result += (part + beyond * np.diff(ends**power)[:, None]) / power
        return np.maximum(result, 0).reshape(self.shape)

    # -- radiance ----------------------------------------------------------------------------------------------------

    def tables(self, medium: Medium, blur: float, sums: Array) -> list[Float]:
        """Return, for each light group, the radiance up to the ends of cells, by slabs, rows, columns and channels.

        `blur` is the standard deviation of the fluence's blur, in scene units, and `sums` what was deposited.
        """
        ends, result = self._ends, []
        for fluence in self.fluence(blur, sums):
            table = np.zeros((_SLABS + 1, *self.shape[1:], 3))
            for channel, (scattering, extinction) in enumerate(zip(medium.scattering, medium.extinction, strict=True)):
                passed = np.exp(-extinction * ends)
                seen = (passed[:-1] - passed[1:]) / extinction if extinction > 0 else np.diff(ends)
                light = fluence[..., channel] * (scattering / (4 * np.pi) * seen)[:, None, None]
                np.cumsum(light, axis=0, out=table[1:, ..., channel])
            result.append(to_float(table.ravel()))
        return result

    def fluence(self, blur: float, sums: Array, beyond: bool = False, along_least: float = 0.0) -> list[Array]:
        """Return, for each light group, 4π times the mean of phase function times radiance in cells, (…, channels).

        Parameters
        ----------
        blur, sums
            The standard deviation of the blur, in scene units, and what was deposited, by groups.
        beyond
            Whether cells that no ray sees are as bright as those around them, at the same distance.
        along_least
            The least blur along rays, in cells.
        """
        ends = self._ends
        middle = 0.5 * (ends[1:] + ends[:-1])
        pixel = _pixel(self.view)
        there = (self.far - self.near).numpy() > 0
        nearest = float(np.median(self.near.numpy()[there])) if there.any() else 0.0
        size = self.side * pixel * (1 + 0 * middle if self.view.orthographic else nearest + middle)
        across = np.clip(blur / size, _LEAST, _MOST)
        along = max(float(np.median(blur / np.diff(ends))), along_least)

        def blurred(cells: Array) -> Array:
            wide = [
                gaussian_filter(each, own, mode="constant", truncate=3) for each, own in zip(cells, across, strict=True)
            ]
            result: Array = np.stack(wide)
            return (
                result if along < _LEAST / 2 else gaussian_filter1d(result, along, axis=0, mode="constant", truncate=3)
            )

        volume = blurred(self.volume)
        least = _SEEN * volume.max(axis=(1, 2), keepdims=True)
        volume = np.where(volume > least, np.maximum(volume, 1e-300), 0)
        cells = sums.reshape(-1, 3, *self.shape)
        return [np.stack([_ratio(blurred(each), volume, beyond) for each in own], axis=-1) for own in cells]

    def radiance(self, table: Float, at: Array2f, length: Float) -> Array3f:
        """Return the radiance along rays at places in the picture, in pixels, after a length in the medium."""
        return self._between(table, at, _slab(length, self.longest), _SLABS + 1)

    def source(self, table: Float, at: Array2f, length: Float) -> Array3f:
        """Return the mean of phase function times radiance there: `table` is of the `fluence`."""
        return self._between(table, at, _slab(length, self.longest) - 0.5, _SLABS) * dr.inv_four_pi

    def seen(self, place: Array3f) -> tuple[Bool, Float]:
        """Return which places their pixels' rays see in the medium, and how far in it these are."""
        seen, (width, height) = self.view.seen(place), (self.view.width, self.view.height)
        inside = (seen.depth > 0) & (seen.at.x >= 0) & (seen.at.y >= 0)
        inside &= (seen.at.x < dr.opaque(Float, width)) & (seen.at.y < dr.opaque(Float, height))
        index = UInt32(dr.select(inside, seen.at.y, 0)) * dr.opaque(UInt32, width) + UInt32(
            dr.select(inside, seen.at.x, 0)
        )
        near, far = dr.gather(Float, self.near, index, inside), dr.gather(Float, self.far, index, inside)
        return inside & (seen.distance > near) & (seen.distance < far), seen.distance - near

    def gathered(
        self, source: Callable[[Array3f], Array3f], origin: Array3f, direction: Array3f, length: Float, *,
        scattering: Array3f, extinction: Array3f,
    ) -> Array3f:  # fmt: skip
        """Return the radiance along rays that begin anywhere, over lengths in the medium.

        That is Σ σs S (exp(−σt a) − exp(−σt b)) / σt over slabs from a to b, with the `source` S in the middle of each.
        """
        ends = to_float(self._ends)

        def passed(slab: UInt32, result: Array3f) -> tuple[Any, ...]:
            begin, end = dr.gather(Float, ends, slab), dr.minimum(dr.gather(Float, ends, slab + 1), length)
            depth = extinction * (end - begin)
            part = dr.select(depth > 1e-4, (1 - dr.exp(-depth)) * dr.rcp(dr.maximum(extinction, 1e-30)), end - begin)
            light = scattering * source(origin + 0.5 * (begin + end) * direction)
            return slab + 1, result + light * dr.exp(-extinction * begin) * part

        last = UInt32(dr.ceil(_slab(dr.minimum(length, self.longest), self.longest)))
        state = UInt32(0), dr.zeros(Array3f, dr.width(length))
        _, result = dr.while_loop(state, lambda slab, _: slab < dr.minimum(last, _SLABS), passed, label="slabs")
        return Array3f(result)

    def _between(self, table: Float, at: Array2f, slab: Float, slabs: int) -> Array3f:
        """Return entries of a table of so many slabs at places in the picture, interpolated."""
        side, columns = dr.opaque(Float, self.side), dr.opaque(UInt32, self.shape[2])
        cells = columns * dr.opaque(UInt32, self.shape[1])
        left, top = (dr.opaque(Float, each) for each in self.corner)
        places = (at.x - left) / side - 0.5, (at.y - top) / side - 0.5, slab
        counts = self.shape[2], self.shape[1], slabs
        begins, parts = [], []
        for place, count in zip(places, counts, strict=True):
            bounded = dr.clip(place, 0, dr.opaque(Float, count - 1))
            begin = dr.minimum(UInt32(bounded), dr.opaque(UInt32, max(count - 2, 0)))
            begins.append(begin)
            parts.append(bounded - Float(begin))
        result = dr.zeros(Array3f, dr.width(slab))
        for (x, y, z), weight in _corners(begins, parts):
            x, y = (dr.minimum(each, dr.opaque(UInt32, most - 1)) for each, most in ((x, counts[0]), (y, counts[1])))
            result += weight * dr.gather(Array3f, table, z * cells + y * columns + x)
        return result


def _ratio(sums: Array, volume: Array, beyond: bool) -> Array:
    """Return sums over volumes, (…, rows, columns), 0 where there is none; with `beyond`, the mean around it.

    Means are over squares of cells, each twice as wide as the one before, until there is any volume.
    """
    seen = volume > 0
    result: Array = np.where(seen, sums, 0) / np.where(seen, volume, 1)
    if not beyond or seen.all() or volume.shape[-2:] == (1, 1):
        return result
    odd = [(0, 0)] * (volume.ndim - 2) + [(0, each % 2) for each in volume.shape[-2:]]

    def squares(cells: Array) -> Array:
        own = np.pad(np.where(seen, cells, 0), odd)
        rows = own[..., ::2, :] + own[..., 1::2, :]
        return rows[..., ::2] + rows[..., 1::2]

    around = _ratio(squares(sums), squares(volume), beyond)
    near = zoom(around, (*[1] * (volume.ndim - 2), 2, 2), order=1, mode="nearest", grid_mode=True)
    return np.where(seen, result, near[..., : volume.shape[-2], : volume.shape[-1]])


class _Cells(Struct):
    """What deposits read of `Froxels`; where their keys and sums begin, and the `next` cells of the same medium.

    A place (x, y) in the picture of all cells is `finer` times it, less (`x`, `y`), in that of these, which has `width`
    times `height` pixels.
    """

    finer: Float
    x: Float
    y: Float
    width: UInt32
    height: UInt32
    left: Float
    top: Float
    side: Float
    rows: UInt32
    columns: UInt32
    keys: UInt32
    sums: UInt32
    next: UInt32
    longest: Float


class FroxelSums:
    """What is deposited in the cells of a view, by light groups: one kernel serves any number of media.

    Parameters
    ----------
    view
        The projection of a pinhole that sees the whole picture.
    froxels, media
        The cells in parts of that picture, and the numbers of their media: one may have several.
    units
        The least deposit of each light group. Sums are in these units: whole numbers have the same sum in any order.
    """

    def __init__(
        self, view: Projection, froxels: Sequence[Froxels], media: Sequence[int], units: Sequence[float]
    ) -> None:  # fmt: skip
        self._view, self._units, self._keys = view, units, joined([each.keys for each in froxels])
        self._inverse, self._none = to_float([*(1 / each for each in units), 0]), dr.opaque(UInt32, len(froxels))
        sizes = [3 * len(units) * int(np.prod(each.shape)) for each in froxels]
        self._starts = np.cumsum([0, *sizes])
        heads, cells = np.full(max(media) + 2, len(froxels)), []
        keys = np.cumsum([0, *(dr.width(each.keys) for each in froxels)])
        for number, (each, medium) in enumerate(zip(froxels, media, strict=True)):
            own, there = _Cells(), each.view
            own.finer = there.scale[0] / view.scale[0]
            own.x, own.y = (own.finer * a - b for a, b in zip(view.center, there.center, strict=True))
            numbers = {
                "width": there.width, "height": there.height, "left": each.corner[0], "top": each.corner[1],
                "side": each.side, "rows": each.shape[1], "columns": each.shape[2], "keys": keys[number],
                "sums": self._starts[number], "next": heads[medium],
            }  # fmt: skip
            for name, value in numbers.items():
                setattr(own, name, _Cells.DRJIT_STRUCT[name](int(value)))
            own.longest, heads[medium] = each.longest, number
            cells.append(own)
        self._cells, self._heads = pack(cells), to_uint(heads)
        self._sums = dr.zeros(Int64, int(self._starts[-1]))

    def of(self, number: int) -> Array:
        """Return what was deposited in some of the cells, (groups, channels · slabs · rows · columns)."""
        own = self._sums.numpy()[self._starts[number] : self._starts[number + 1]]
        return own.reshape(len(self._units), -1) * np.array(self._units)[:, None]

    def add(
        self, place: Array3f, value: Array3f, medium: UInt32, group: UInt32, phase: Phase, active: Bool
    ) -> None:  # fmt: skip
        """Deposit light at places, in media and of light groups, where the camera sees them."""
        view, seen = self._view, self._view.seen(place)
        active &= seen.depth > 0
        key, light = _key(view, seen.depth), value * dr.gather(Float, self._inverse, group)

        def deposit(number: UInt32) -> tuple[UInt32]:
            cells = dr.gather(_Cells, self._cells, number)
            at = cells.finer * seen.at - Array2f(cells.x, cells.y)
            inside = (at.x >= 0) & (at.y >= 0) & (at.x < Float(cells.width)) & (at.y < Float(cells.height))
            near, far, meets = self._keys_at(dr.select(inside, at, 0), cells)
            # Along a line of sight, distances are in proportion to depths.
            begin = -near if view.orthographic else seen.distance * key * dr.rcp(near)
            slab = _slab(seen.distance - begin, cells.longest)
            inside &= (meets > 0) & (key < near) & (key > far) & (slab < _SLABS)
            x, y = (
                UInt32(dr.maximum(each - begin, 0) / cells.side)
                for each, begin in ((at.x, cells.left), (at.y, cells.top))
            )
            inside &= (x < cells.columns) & (y < cells.rows)
            cell = (UInt32(dr.select(inside, slab, 0)) * cells.rows + y) * cells.columns + x
            found = light * phase(seen.toward, inside)
            for channel in range(3):
                own = (group * 3 + channel) * (cells.rows * cells.columns * _SLABS) + cell
                dr.scatter_reduce(dr.ReduceOp.Add, self._sums, Int64(found[channel]), cells.sums + own, inside)
            return (cells.next,)

        active &= medium < dr.opaque(UInt32, dr.width(self._heads))
        head = dr.gather(UInt32, self._heads, medium, active)
        dr.while_loop((head,), lambda number: active & (number < self._none), deposit, label="cells")

    def _keys_at(self, at: Array2f, cells: _Cells) -> Array3f:
        """Return keys at places in the picture of cells: those of planes are linear there.

        Beside a ray that does not meet the medium they are those of the place's own pixel.
        """
        width, height, first = cells.width, cells.height, cells.keys
        own = dr.gather(Array3f, self._keys, first + UInt32(at.y) * width + UInt32(at.x))
        # Beyond the middles of the outermost pixels planes go on.
        ends = [dr.maximum(size, 2) - 2 for size in (width, height)]
        begins = [
            dr.minimum(UInt32(dr.maximum(each - 0.5, 0)), end) for each, end in zip((at.x, at.y), ends, strict=True)
        ]
        parts = [each - 0.5 - Float(begin) for each, begin in zip((at.x, at.y), begins, strict=True)]
        result = Array3f(0)
        for (x, y), weight in _corners(begins, parts):
            x, y = dr.minimum(x, width - 1), dr.minimum(y, height - 1)
            result += weight * dr.gather(Array3f, self._keys, first + y * width + x)
        return dr.select(result.z > 1 - 1e-4, result, own)


def _corners(begins: Sequence[UInt32], parts: Sequence[Float]) -> Iterator[tuple[list[UInt32], Float]]:
    """Yield the corners of cells that begin at integers along axes, and their weights at a part of each axis."""
    for corner in range(1 << len(begins)):
        steps, weight = [corner >> axis & 1 for axis in range(len(begins))], Float(1)
        for part, step in zip(parts, steps, strict=True):
            weight *= part if step else 1 - part
        yield [begin + step for begin, step in zip(begins, steps, strict=True)], weight


def _key(view: Projection, depth: Float) -> Float:
    """Return a number that falls with planar depths, and is linear in the picture on each plane."""
    return -depth if view.orthographic else dr.rcp(dr.maximum(depth, 1e-30))


def _pixel(view: Projection) -> float:
    """Return how large pixels are at unit depth, or of a parallel projection at any, in scene units."""
    return float(dr.sqrt(dr.rcp(view.scale[0] * view.scale[1]))[0])


def _slab(length: Float, longest: Float) -> Float:
    """Return the number of slabs up to lengths in a medium, in proportion to log(1 + t / t₁), of the thinnest cells."""
    first = longest / _THICKER
    return dr.log(1 + dr.maximum(length, 0) / first) * dr.rcp(dr.log(1 + longest / first)) * _SLABS


def most_columns(sums: int) -> int:
    """Return how many columns of cells fit into memory with so many sums of each cell."""
    return max(min(_COLUMNS, _BYTES // (8 * sums * _SLABS)), 1)
