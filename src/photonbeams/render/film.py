"""A view's film: sums over the passes, through a reconstruction filter, and the layers that are developed from them.

All pixels have the same sub-pixel offset in a pass, so a filter is a convolution. It is one of rows and then one of
columns, by gathers, whose order is always the same.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, floor
from typing import Any

import drjit as dr
import numpy as np

from ..numerics.arrays import to_float
from ..numerics.sampling import z_order
from ..runtime.device import Array3f, Float, UInt32, mitsuba
from ..scene import SceneError
from .sums import DEPTH, NORMAL, PassSums

mi = mitsuba()

_BEAMS = "beams/"  # sums of light groups are called this and the group


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

    def add(self, number: int, picture: PassPicture, offset: tuple[float, float], exposure: Any = 1.0) -> None:
        """Add pass `number`, whose samples lie at `offset` in each pixel; `exposure` multiplies its light."""
        values = {"surface": picture.surface * exposure, "alpha": picture.alpha}
        for group, radiance in picture.beams:
            name = _BEAMS + group
            values[name] = values.get(name, 0) + radiance * exposure
        if picture.transmittance is not None:
            values["transmittance"] = picture.transmittance
        light = sum((each for name, each in values.items() if name.startswith(_BEAMS)), values["surface"])
        if self._filter is not None:
            values = self._filtered(values, offset)
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

    def _filtered(self, values: Mapping[str, Any], offset: tuple[float, float]) -> dict[str, Any]:
        """Return the pass's values around each pixel, times their weights, and the sum of these as "weight"."""
        (x, y), (height, width) = self._pixels(), (dr.opaque(UInt32, each) for each in self.shape)
        rows, columns = (self._taps(each) for each in offset)
        pictures = [*values.values()]
        dr.make_opaque(pictures)
        pictures, across = _convolved(pictures, rows, x, width, lambda column: y * width + column)
        dr.eval(pictures)
        pictures, down = _convolved(pictures, columns, y, height, lambda row: row * width + x)
        return {**dict(zip(values, pictures, strict=True)), "weight": across * down}

    def _taps(self, offset: float) -> tuple[Any, list[Any]]:
        """Return the first neighbour in a row or column whose sample reaches a pixel, and the weights from there on.

        There are as many for every offset, some of them 0: all passes have the same kernel.
        """
        radius = float(self._filter.radius())
        first = floor(0.5 - offset - radius) + 1
        distance = first + np.arange(ceil(2 * radius - 1e-6)) + offset - 0.5
        weight = np.where(np.abs(distance) < radius, np.ravel(self._filter.eval(to_float(distance)).numpy()), 0)
        return dr.opaque(UInt32, first & 0xFFFFFFFF), [dr.opaque(Float, float(each)) for each in weight]

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


def _convolved(
    pictures: Sequence[Any], taps: tuple[Any, list[Any]], place: Any, size: Any, index: Any
) -> tuple[list[Any], Any]:
    """Return pictures convolved along one axis, and the sum of the weights that are inside of the film.

    `place` are the pixels' places on that axis, `size` is its length, and `index` returns the pixels at places on it.
    """
    first, weights = taps
    sums, total = [dr.zeros(type(each), dr.width(each)) for each in pictures], Float(0)
    for number, weight in enumerate(weights):
        there = place + (first + UInt32(number))
        inside = there < size  # a number below 0 is a large one
        sums = [
            own + weight * dr.gather(type(each), each, index(there), inside)
            for own, each in zip(sums, pictures, strict=True)
        ]
        total = total + dr.select(inside, weight, 0)
    return sums, total


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
