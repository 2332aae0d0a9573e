"""A view's film: sums over the passes, through a reconstruction filter, and the layers that are developed from them.

Each pixel has its own place for the sample of a pass. A filter gathers the samples around each pixel, always in the
same order.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any

import drjit as dr
import numpy as np

from ..numerics.samples import Samples
from ..numerics.sampling import z_order
from ..runtime.device import Array2f, Array3f, Float, Int32, UInt32, mitsuba
from ..scene import SceneError
from .sums import DEPTH, NORMAL, PassSums

mi = mitsuba()

_BEAMS = "beams/"  # sums of light groups are called this and the group
_PLACE = 104  # stream of samples


@dataclass
class PassPicture:
    """The picture of a view in one pass: a value for each pixel, row by row.

    Attributes
    ----------
    surface, alpha
        (W · H, 3) radiance of surfaces, and (W · H,) their coverage.
    beams
        Light groups, "" for the unnamed one, each with a (W · H, 3) radiance; a group may be there more than once.
    transmittance
        (W · H, 3) transmittance of the media up to the surfaces, or None.
    depth, normal
        (W · H,) planar depths, and (W · H, 3) normals if they are asked for; of the first pass alone.
    """

    surface: Any
    alpha: Any
    beams: Sequence[tuple[str, Any]] = ()
    transmittance: Any = None
    depth: Any = None
    normal: Any = None


class Film:
    """The sums over the passes of one view.

    Parameters
    ----------
    shape, corner
        Height and width in pixels, and (left, top) of a crop window in the whole picture.
    reconstruction
        A filter as `reconstruction_filter` returns it; None is the box.
    groups
        The layer of each light group; a group without one is in `beams` alone.

    Attributes
    ----------
    order
        Numbers of the pixels, row by row, for their samples: the same ones in every crop window.
    sums
        The sums so far.
    """

    def __init__(
        self,
        shape: tuple[int, int],
        corner: tuple[int, int] = (0, 0),
        reconstruction: Any = None,
        groups: Mapping[str, str] | None = None,
    ) -> None:
        self.shape, self.groups, self._filter = shape, dict(groups or {}), reconstruction
        x, y = self._pixels()
        self.order = z_order(x + dr.opaque(UInt32, corner[0]), y + dr.opaque(UInt32, corner[1]))
        dr.eval(self.order)
        self.sums = PassSums()

    def places(self, samples: Samples) -> Array2f:
        """Return the places in [0, 1)² of each pixel's sample: over the passes, and over the seeds, they fill it."""
        result = samples.pair(self.order, _PLACE)
        dr.eval(result)
        return result

    def centers(self) -> Array2f:
        """Return the centres of all pixels, as places."""
        result = Array2f(0.5) + dr.opaque(Float, 0, self.shape[0] * self.shape[1])
        dr.eval(result)
        return result

    def add(self, number: int, picture: PassPicture, places: Array2f, exposure: Any = 1.0) -> None:
        """Add pass `number`, with its samples' `places` in [0, 1)² of their pixels; `exposure` multiplies its light."""
        values = {"surface": picture.surface * exposure, "alpha": picture.alpha}
        for group, radiance in picture.beams:
            name = _BEAMS + group
            values[name] = values.get(name, 0) + radiance * exposure
        if picture.transmittance is not None:
            values["transmittance"] = picture.transmittance
        light = sum((each for name, each in values.items() if name.startswith(_BEAMS)), values["surface"])
        if self._filter is not None:
            values = self._filtered(values, places)
        light = dr.dot(light, Array3f(1 / 3))
        values |= {"light": light, "squares": light * light}
        if picture.depth is not None:
            values[DEPTH] = picture.depth
        if picture.normal is not None:
            values[NORMAL] = picture.normal
        dr.eval(values)
        self.sums.add(number, {name: self._array(value) for name, value in values.items()})

    def _array(self, value: Any) -> np.ndarray:
        """Return a value of each pixel, (pixels,) or (3, pixels); of a constant, too."""
        array = value.numpy()
        return np.broadcast_to(array, (*array.shape[:-1], self.shape[0] * self.shape[1]))

    def _pixels(self) -> tuple[Any, Any]:
        """Return column and row of each pixel."""
        index, columns = dr.arange(UInt32, self.shape[0] * self.shape[1]), dr.opaque(UInt32, self.shape[1])
        return index % columns, index // columns

    def _filtered(self, values: Mapping[str, Any], places: Array2f) -> dict[str, Any]:
        """Return the pass's values around each pixel, times their weights, and the sum of these as "weight"."""
        (x, y), (height, width) = self._pixels(), (dr.opaque(UInt32, each) for each in self.shape)
        margin, radius = margin_of(self._filter), float(self._filter.radius())
        side = 2 * margin + 1
        pictures, places = [*values.values()], Array2f(places)
        dr.make_opaque(pictures, places)

        def weight(distance: Float) -> Float:
            return dr.select(dr.abs(distance) < radius, Float(self._filter.eval(distance)), 0)

        def further(tap: UInt32, total: Float, sums: list[Any]) -> tuple[Any, ...]:
            right, down = Int32(tap % side) - margin, Int32(tap // side) - margin
            column, row = x + UInt32(right), y + UInt32(down)
            inside = (column < width) & (row < height)  # a number below 0 is a large one
            there = row * width + column
            place = dr.gather(Array2f, places, there, inside)
            own = weight(Float(right) + place.x - 0.5) * weight(Float(down) + place.y - 0.5)
            own = dr.select(inside, own, 0)
            sums = [
                each + own * dr.gather(type(each), picture, there, inside)
                for each, picture in zip(sums, pictures, strict=True)
            ]
            return tap + 1, total + own, sums

        nothing = [dr.zeros(type(each), dr.width(x)) for each in pictures]
        state = (dr.zeros(UInt32, dr.width(x)), dr.zeros(Float, dr.width(x)), nothing)
        _, total, sums = dr.while_loop(state, lambda tap, *_: tap < side * side, further, label="filter")
        return {**dict(zip(values, sums, strict=True)), "weight": total}

    def error(self) -> float:
        """Return the error of the sums so far."""
        return self.sums.error()

    def restore(self, sums: PassSums) -> None:
        """Go on from the sums of another film; SceneError where they are of another picture."""
        total, count = sums.total(), self.shape[0] * self.shape[1]
        complete = {"surface", "alpha", "light", "squares"} <= set(total)
        same = complete and ("weight" in total) is (self._filter is not None)
        if not same or any(each.shape not in ((count,), (3, count)) for each in total.values()):
            raise SceneError("the checkpoint is of another picture")
        self.sums = sums

    def layers(self) -> dict[str, np.ndarray]:
        """Return the layers so far."""
        return develop(self.sums, self.shape, self.groups)


def develop(sums: PassSums, shape: tuple[int, int], groups: Mapping[str, str]) -> dict[str, np.ndarray]:
    """Return the layers of a view, (H, W, C) float32: means over the passes, in the order of `layer_names`.

    Raises
    ------
    SceneError
        The sums are of another picture.
    """
    pictures = {
        name: np.ascontiguousarray(each.reshape(-1, *shape).transpose(1, 2, 0)) for name, each in sums.total().items()
    }
    scale = 1 / pictures["weight"] if "weight" in pictures else np.float32(1 / max(len(sums), 1))
    black = np.zeros((*shape, 3), dtype=np.float32)
    surface = pictures.get("surface", black) * scale
    alpha = pictures.get("alpha", black[..., :1]) * scale
    by_group = {
        name.removeprefix(_BEAMS): pictures[name] * scale for name in sorted(pictures) if name.startswith(_BEAMS)
    }
    beams = sum(by_group.values(), black)
    layers = {"rgba": np.concatenate([surface + beams, alpha], axis=2), "surface": surface, "beams": beams}
    for group, name in groups.items():
        # Black where no beam of the group was in a medium; a group called "default" is one with the unnamed one.
        layers[name] = layers.get(name, 0) + by_group.get(group, black)
    if "transmittance" in pictures:
        layers["transmittance"] = pictures["transmittance"] * scale
    layers[DEPTH] = pictures.get(DEPTH, np.full_like(alpha, np.inf))
    if NORMAL in pictures:
        layers[NORMAL] = pictures[NORMAL]
    return layers


def reconstruction_filter(name: str | None, own: Any = None) -> Any:
    """Return Mitsuba's pixel filter of a name, or `own` where there is none; None for the box."""
    chosen = own if name is None else mi.load_dict({"type": name})
    return None if chosen is None or chosen.is_box_filter() else chosen


def margin_of(reconstruction: Any) -> int:
    """Return how many pixels beyond a crop window a filter reaches."""
    return 0 if reconstruction is None else ceil(float(reconstruction.radius()) - 0.5)


def group_layers(groups: Collection[str]) -> dict[str, str]:
    """Return the layers of light groups; none where all beams are of the unnamed one."""
    return {group: f"beams_{group or 'default'}" for group in sorted(groups)} if set(groups) - {""} else {}


def layer_names(groups: Mapping[str, str]) -> list[str]:
    """Return the names of the layers of a stage with light groups that have these layers, in their order."""
    return ["rgba", "surface", "beams", *dict.fromkeys(groups.values()), "transmittance", "depth"]
