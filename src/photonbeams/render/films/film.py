"""A view's film: sums over the passes, through a reconstruction filter, and the layers that are developed from them.

In a pass each pixel has one sample of the beams, and more if an edge of an object crosses the pixel; of everything else
it has one or more samples. Each sample has its own place in the pixel. A filter gathers the samples around each pixel,
always in the same order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import drjit as dr
import numpy as np

from ...estimators.lanes import Lattice
from ...numerics.arrays import taken, to_numpy
from ...numerics.samples import Samples
from ...numerics.sampling import z_order
from ...numerics.streams import Stream
from ...runtime.device import Array2f, Array3f, Float, Int32, UInt32, mitsuba
from ...scene import SceneError
from .layers import EMITTED, GATHERED, SCATTERED, SURFACE, develop, layer_of
from .pixel_filters import averaged, filter_weights, margin_of, spread
from .sample_layout import SampleLayout, SamplePiece
from .sums import ALBEDO, LIGHT, MEAN_NORMAL, SQUARES, PassSums

mi = mitsuba()

_NOT_LIGHT = ("alpha", "transmittance", ALBEDO, MEAN_NORMAL)
_BLOCK = 8  # pixels of overscan with neighbouring numbers: samples are well distributed over squares of pixels

#: Radiance (W · H, 3) by light groups; "" is the unnamed group.
Groups = Mapping[str, Any]


@dataclass
class PassPicture:
    """What camera rays see in a pass, except beams: a value for each ray.

    Attributes
    ----------
    surface, alpha
        (N, 3) radiance of surfaces by light groups, and (N,) their coverage.
    scattered
        Light that media scatter and that beams do not carry.
    transmittance
        (N, 3) transmittance of the media up to the surfaces, or None.
    reach
        (N,) distances that rays reach straight ahead, or None.
    guides
        (N, 3) albedos and normals of the surfaces seen, also in mirrors and through glass, by the names of their sums.
    emitted
        The part of `surface` that lamps, surfaces that glow and the background emit, by light groups, if it is known.
    """

    surface: Groups
    alpha: Any
    scattered: Groups = field(default_factory=dict)
    transmittance: Any = None
    reach: Any = None
    guides: Mapping[str, Any] = field(default_factory=dict)
    emitted: Groups = field(default_factory=dict)

    def taken(self, lanes: UInt32) -> PassPicture:
        """Return the picture of some of the rays."""
        surface, scattered, guides, emitted = (
            {name: taken(each, lanes) for name, each in values.items()}
            for values in (self.surface, self.scattered, self.guides, self.emitted)
        )
        alpha, transmittance = (
            None if each is None else taken(each, lanes) for each in (self.alpha, self.transmittance)
        )
        return PassPicture(surface, alpha, scattered, transmittance, guides=guides, emitted=emitted)

    @property
    def radiance(self) -> Any:
        """The radiance of everything but beams."""
        return sum((*self.surface.values(), *self.scattered.values()), dr.zeros(Array3f, 1))

    def values(self) -> dict[str, Any]:
        """Return all values by the names of their sums."""
        result = {"alpha": self.alpha, **self.guides}
        for prefix, light in ((SURFACE, self.surface), (SCATTERED, self.scattered), (EMITTED, self.emitted)):
            result |= {prefix + group: radiance for group, radiance in light.items()}
        return result if self.transmittance is None else result | {"transmittance": self.transmittance}


@dataclass
class BeamSamples:
    """The light of beams in a pass, by light groups, for samples at `places`.

    `share` is the weight of each sample in its pixel, and `layout` where they are; None: one for each pixel, of 1 each.
    """

    groups: Groups
    places: Array2f
    share: Any = None
    layout: SampleLayout | None = None


class SeenSums:
    """What camera rays see in a pass, except beams, summed over the samples of each pixel, one picture after the other.

    Attributes
    ----------
    exposure, typical
        A factor on light, and how many samples a pixel of the whole picture has on average, a power of two.
    values, light
        Sums by name, through the film's filter, and the unfiltered light of the pixels.
    nearest, farthest
        (pixels,) distances that the shortest and the longest of a pixel's rays reach straight ahead; None if unknown.
    """

    def __init__(self, film: Film, typical: int, exposure: Any = 1.0) -> None:
        self._film, self.typical, self.exposure = film, typical, exposure
        self.values: dict[str, Any] = {}
        self.light: dict[str, Any] = {}
        self.nearest: Any = None
        self.farthest: Any = None

    def add(
        self, picture: PassPicture, places: Array2f, share: Any = 1.0, layout: SampleLayout | None = None,
        pixels: UInt32 | None = None,
    ) -> None:  # fmt: skip
        """Add samples with their places in [0, 1)².

        `share` is the weight of each in its pixel, `layout` where they are, and `pixels` tells to which each belongs;
        None: each pixel has one.
        """
        found = {
            name: value * share * (1 if name in _NOT_LIGHT else self.exposure)
            for name, value in picture.values().items()
        }
        sums, light = self._film.summed(found, places, share, layout)
        for total, own in ((self.values, sums), (self.light, light)):
            total |= {name: total[name] + value if name in total else value for name, value in own.items()}
        if picture.reach is not None:
            self._extend(picture.reach, dr.arange(UInt32, dr.width(places)) if pixels is None else pixels)
        dr.eval(self.values, self.light, self.nearest, self.farthest)

    def _extend(self, reach: Any, pixel: UInt32) -> None:
        count = self._film.shape[0] * self._film.shape[1]
        if self.nearest is None:
            self.nearest, self.farthest = dr.full(Float, dr.inf, count), dr.zeros(Float, count)
        # By default, a kernel would contain the number of pixels.
        dr.scatter_reduce(dr.ReduceOp.Min, self.nearest, reach, pixel, mode=dr.ReduceMode.Local)
        dr.scatter_reduce(dr.ReduceOp.Max, self.farthest, reach, pixel, mode=dr.ReduceMode.Local)


class Film:
    """The sums over the passes of one view.

    Parameters
    ----------
    shape, corner
        Height and width in pixels, and (left, top) of a crop window in the whole picture.
    reconstruction
        A filter, as `reconstruction_filter` returns it; None is the box.
    groups
        The layer of each light group; a group without a layer is in `beams` alone.
    variances
        Whether the sums also tell the variance of each layer by itself.
    size
        Width and height of the whole picture, beyond which pixels are overscan; None: there is no overscan.

    Attributes
    ----------
    order
        Numbers of the pixels in the sample sequences, row by row: the same in every crop window.
    sums
        The sums so far.
    """

    def __init__(
        self,
        shape: tuple[int, int],
        corner: tuple[int, int] = (0, 0),
        reconstruction: Any = None,
        groups: Mapping[str, str] | None = None,
        variances: bool = False,
        size: tuple[int, int] | None = None,
    ) -> None:
        self.shape, self.groups, self._filter = shape, dict(groups or {}), reconstruction
        self._corner, self._variances = corner, variances
        ends = corner[0] + shape[1], corner[1] + shape[0]
        self._size = size or ends
        self._overscan = min(corner) < 0 or any(end > own for end, own in zip(ends, self._size, strict=True))
        self._lobes = reconstruction is not None and filter_weights(reconstruction).min() < -1e-4
        x, y = (self._number(each, axis) for axis, each in enumerate(self._pixels()))
        self.order = z_order(x, y)
        dr.eval(self.order)
        self.sums = PassSums()

    def places(self, samples: Samples, lattice: Lattice | None = None) -> Array2f:
        """Return the place in [0, 1)² of each pixel's sample; over the passes, and over the seeds, they fill the pixel.

        Pixels of a lattice have the lattice's place.
        """
        result = samples.pair(self.order, Stream.PIXEL)
        if lattice is not None:
            x, y = (Int32(each) + dr.opaque(Int32, own) for each, own in zip(self._pixels(), self._corner, strict=True))
            result = dr.select(((x | y) & 1) == 0, lattice.place, result)
        dr.eval(result)
        return result

    def lattice(self, samples: Samples, width: int, height: int) -> Lattice | None:
        """Return the lattice of a pass, for a whole picture of this size; None if the picture is small."""
        place = samples.pair(dr.opaque(UInt32, 0), Stream.LATTICE)
        dr.eval(place)
        result = Lattice.of(width, height, self._corner, place)
        return result if result.levels else None

    def spread(self, place: Array2f) -> Array2f:
        """Return places in and around pixels, as often as the filter weighs them, for `place` in [0, 1)²."""
        return place if self._filter is None else spread(self._filter, place)

    @property
    def averaged(self) -> float:
        """How many pixels the filter averages."""
        return averaged(self._filter)

    def centers(self) -> Array2f:
        """Return the centres of all pixels, as places."""
        result = Array2f(0.5) + dr.opaque(Float, 0, self.shape[0] * self.shape[1])
        dr.eval(result)
        return result

    def add(
        self, number: int, seen: SeenSums, beams: BeamSamples, exposure: Any = 1.0,
        first: Mapping[str, Any] | None = None,
    ) -> None:  # fmt: skip
        """Add pass `number`.

        Parameters
        ----------
        seen
            What camera rays see, except beams.
        beams
            The light of beams.
        exposure
            A factor on the light of beams.
        first
            Depths, normals and other pictures of first surfaces; only the first pass has them.
        """
        gathered = {GATHERED + group: light * exposure for group, light in beams.groups.items()}
        values, light = self.summed(gathered, beams.places, beams.share, beams.layout)
        if "weight" in values:
            values = self._weighed(values)
        values |= seen.values
        lights = [light, seen.light]
        values |= {**self._squares(lights), **(first or {})}
        dr.eval([each for each in values.values() if not isinstance(each, np.ndarray)])
        self.sums.add(number, {name: self._array(value) for name, value in values.items()})

    def _weighed(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the light of beams in a pass, divided by the sum of its weights, or together with it.

        Each pass is divided by its own weights: if passes differ in brightness, their sum over the sum of all weights
        would be as uneven from pixel to pixel as the weights are, though each pass is smooth. Weights of filters with
        negative lobes may be near 0, and are summed instead.
        """
        weight = values["weight"]
        light = {name: value for name, value in values.items() if name != "weight"}
        if self._lobes:
            return {**light, "beams weight": weight}
        return {name: value * dr.select(weight > 0, dr.rcp(weight), 0) for name, value in light.items()}

    def _squares(self, lights: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
        """Return the light of pixels in a pass and its square, for variances: of all light, and of each layer.

        What is emitted is not in those of layers.
        """
        black = dr.zeros(Array3f, self.shape[0] * self.shape[1])
        shining, layers = black, dict[str, Any]()
        for each in lights:
            shining = shining + sum((own for name, own in each.items() if not name.startswith(EMITTED)), black)
        for name, light in (item for each in lights if self._variances for item in each.items()):
            layer = layer_of(name, self.groups)
            if layer is not None:
                layers[layer] = layers.get(layer, black) + (-light if name.startswith(EMITTED) else light)
        result = dict[str, Any]()
        for suffix, sum_ in [("", shining), *((f"/{layer}", own) for layer, own in layers.items())]:
            light = dr.dot(sum_, Array3f(1 / 3))
            result |= {LIGHT + suffix: light, SQUARES + suffix: light * light}
        return result

    def summed(
        self, values: Mapping[str, Any], places: Array2f, share: Any, layout: SampleLayout | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return filtered sums of values, with the filter's weights, and the unfiltered light of pixels.

        `share` are the weights of samples in their pixels; the values are already multiplied by them. `layout` tells
        where the samples are; None: each pixel has one.
        """
        folded = {name: self._folded(value, layout) for name, value in values.items()}
        light = {name: each for name, each in folded.items() if name not in _NOT_LIGHT}
        if self._filter is None or not values:
            return folded, light
        factor = dr.ones(Float, dr.width(places)) * (1 if share is None else share)
        return self._filtered({**values, "weight": factor}, places, layout), light

    def _folded(self, value: Any, layout: SampleLayout | None) -> Any:
        """Return the sum over the samples of each pixel."""
        if layout is None:
            return value
        value, count = type(value)(value), self.shape[0] * self.shape[1]
        dr.make_opaque(value)
        begin, stride, most = layout.of_pixels(dr.arange(UInt32, count))

        def further(sample: UInt32, total: Any) -> tuple[Any, ...]:
            return sample + 1, total + dr.gather(type(value), value, begin + sample * stride)

        state = (dr.zeros(UInt32, count), dr.zeros(type(value), count))
        return dr.while_loop(state, lambda sample, _: sample < most, further, label="fold")[1]

    def _array(self, value: Any) -> np.ndarray:
        """Return the value of each pixel, (pixels,) or (3, pixels), even if it is a constant."""
        array = value if isinstance(value, np.ndarray) else to_numpy(value) if dr.depth_v(value) > 1 else value.numpy()
        return np.broadcast_to(array, (*array.shape[:-1], self.shape[0] * self.shape[1]))

    def _pixels(self) -> tuple[Any, Any]:
        """Return the column and the row of each pixel."""
        index, columns = dr.arange(UInt32, self.shape[0] * self.shape[1]), dr.opaque(UInt32, self.shape[1])
        return index % columns, index // columns

    def _number(self, place: UInt32, axis: int) -> UInt32:
        """Return the numbers of columns or rows in the sample sequences: their own in the picture.

        Those of overscan follow, in blocks that belong in turn to the right and the left, or the bottom and the top.
        """
        result = place + dr.opaque(UInt32, self._corner[axis] & 0xFFFFFFFF)
        if not self._overscan:
            return result
        size, own = dr.opaque(Int32, self._size[axis]), Int32(result)
        beyond = dr.select(own < 0, -1 - own, own - size)
        first = (size + (_BLOCK - 1)) // _BLOCK * _BLOCK + dr.select(own < 0, Int32(_BLOCK), 0)
        number = first + 2 * beyond - beyond % _BLOCK
        return UInt32(dr.select((own < 0) | (own >= size), number, own))

    def _within(self, own: UInt32, other: UInt32, axis: int) -> Any:
        """Return whether samples of the column or row `other` count in `own`: in the picture, none of overscan do."""
        begin, end = -self._corner[axis], self._size[axis] - self._corner[axis]
        inside = [(Int32(each) >= dr.opaque(Int32, begin)) & (Int32(each) < dr.opaque(Int32, end))
                  for each in (own, other)]  # fmt: skip
        return ~inside[0] | inside[1]

    def _filtered(
        self, values: Mapping[str, Any], places: Array2f, layout: SampleLayout | None
    ) -> dict[str, Any]:  # fmt: skip
        """Return the sums over the samples around each pixel of their values, times the filter's weight."""
        (x, y), (height, width) = self._pixels(), (dr.opaque(UInt32, each) for each in self.shape)
        margin, radius = margin_of(self._filter), float(self._filter.radius())
        side, layout = 2 * margin + 1, layout or SampleLayout.of(dr.width(x), [SamplePiece(None, 1, range(1))])
        taps = dr.opaque(UInt32, side * side)
        pictures, places = [*values.values()], Array2f(places)
        dr.make_opaque(pictures, places)

        def weight(distance: Float) -> Float:
            return dr.select(dr.abs(distance) < radius, Float(self._filter.eval(distance)), 0)

        def further(tap: UInt32, sums: list[Any]) -> tuple[Any, ...]:
            right, down = Int32(tap % side) - margin, Int32(tap // side) - margin
            column, row = x + UInt32(right), y + UInt32(down)
            inside = (column < width) & (row < height)  # unsigned: a number below 0 wraps to a large one
            if self._overscan:
                inside &= self._within(x, column, 0) & self._within(y, row, 1)
            begin, stride, count = layout.of_pixels(row * width + column, inside)

            def next_sample(sample: UInt32, sums: list[Any]) -> tuple[Any, ...]:
                there = begin + sample * stride
                place = dr.gather(Array2f, places, there, inside)
                own = weight(Float(right) + place.x - 0.5) * weight(Float(down) + place.y - 0.5)
                own = dr.select(inside, own, 0)
                sums = [
                    each + own * dr.gather(type(each), picture, there, inside)
                    for each, picture in zip(sums, pictures, strict=True)
                ]
                return sample + 1, sums

            none = dr.zeros(UInt32, dr.width(x))
            _, sums = dr.while_loop((none, sums), lambda sample, _: sample < count, next_sample, label="samples")
            return tap + 1, sums

        nothing = [dr.zeros(type(each), dr.width(x)) for each in pictures]
        state = (dr.zeros(UInt32, dr.width(x)), nothing)
        _, sums = dr.while_loop(state, lambda tap, _: tap < taps, further, label="filter")
        return dict(zip(values, sums, strict=True))

    def error(self) -> float:
        """Return the error of the sums so far."""
        return self.sums.error()

    def restore(self, sums: PassSums) -> None:
        """Continue from the sums of another film; raise SceneError if they are of another picture."""
        total, count = sums.total(), self.shape[0] * self.shape[1]
        complete = {"alpha", LIGHT, SQUARES} <= set(total) and any(name.startswith(SURFACE) for name in total)
        same = complete and ("weight" in total) is (self._filter is not None)
        if not same or any(each.shape not in ((count,), (3, count)) for each in total.values()):
            raise SceneError("the checkpoint is of another picture: expected one of its size, filter, views and layers")
        self.sums = sums

    def layers(self) -> dict[str, np.ndarray]:
        """Return the layers so far."""
        return develop(self.sums, self.shape, self.groups)
