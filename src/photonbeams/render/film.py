"""A view's film: sums over the passes, through a reconstruction filter.

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
from .passes import Statistics

mi = mitsuba()

_MOST_PIXELS = 1 << 18  # whose errors are looked at

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
    depth
        (W · H,) planar depths; of the first pass alone.
    """

    surface: Any
    alpha: Any
    beams: Sequence[tuple[str, Any]] = ()
    transmittance: Any = None
    depth: Any = None


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
    passes
        Passes so far.
    """

    def __init__(
        self,
        shape: tuple[int, int],
        corner: tuple[int, int] = (0, 0),
        reconstruction: Any = None,
        groups: Mapping[str, str] | None = None,
    ) -> None:
        self._shape, self._filter, self._groups = shape, reconstruction, dict(groups or {})
        x, y = self._pixels()
        self.order = z_order(x + dr.opaque(UInt32, corner[0]), y + dr.opaque(UInt32, corner[1]))
        dr.eval(self.order)
        self.passes = 0
        self._sums: dict[str, Any] = {}

    def add(self, picture: PassPicture, offset: tuple[float, float], exposure: Any = 1.0) -> None:
        """Add a pass whose samples lie at `offset` in each pixel; `exposure` multiplies its light."""
        surface = picture.surface * exposure
        beams = [(_BEAMS + group, radiance * exposure) for group, radiance in picture.beams]
        values = [("surface", surface), ("alpha", picture.alpha), *beams]
        if picture.transmittance is not None:
            values.append(("transmittance", picture.transmittance))
        if self._filter is not None:
            values = self._filtered(values, offset)
        light = dr.dot(sum((radiance for _, radiance in beams), surface), Array3f(1 / 3))
        for name, value in [*values, ("light", light), ("squares", light * light)]:
            self._sums[name] = self._sum(name, type(value)) + value
        if picture.depth is not None and "depth" not in self._sums:
            self._sums["depth"] = picture.depth
        dr.eval(self._sums)
        self.passes += 1

    def _sum(self, name: str, kind: Any) -> Any:
        """Return a sum so far; in the first pass it is opaque, for a constant would need another kernel."""
        if name not in self._sums:
            self._sums[name] = dr.zeros(kind, self._shape[0] * self._shape[1])
            dr.make_opaque(self._sums[name])
        return self._sums[name]

    def _pixels(self) -> tuple[Any, Any]:
        """Return column and row of each pixel."""
        index, columns = dr.arange(UInt32, self._shape[0] * self._shape[1]), dr.opaque(UInt32, self._shape[1])
        return index % columns, index // columns

    def _filtered(self, values: Sequence[tuple[str, Any]], offset: tuple[float, float]) -> list[tuple[str, Any]]:
        """Return the pass's values around each pixel, times their weights, and the sum of these as "weight"."""
        (x, y), (height, width) = self._pixels(), (dr.opaque(UInt32, each) for each in self._shape)
        rows, columns = (self._taps(each) for each in offset)
        names, pictures = [name for name, _ in values], [value for _, value in values]
        dr.make_opaque(pictures)
        pictures, across = _convolved(pictures, rows, x, width, lambda column: y * width + column)
        dr.eval(pictures)
        pictures, down = _convolved(pictures, columns, y, height, lambda row: row * width + x)
        return [*zip(names, pictures, strict=True), ("weight", across * down)]

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
        """Return the relative standard error of the mean so far, the median over pixels that have light.

        From the passes' own differences, as if they were independent; they continue low-discrepancy sequences, so it
        tends to be less. NaN before there are two.
        """
        if self.passes < 2:
            return float("nan")
        step = ceil(self._shape[0] * self._shape[1] / _MOST_PIXELS) | 1  # odd: not the same columns of every row
        mean, squares = (self._sums[name].numpy()[::step] / self.passes for name in ("light", "squares"))
        lit = mean > 0
        variance = np.maximum(squares - mean * mean, 0)[lit] / (self.passes - 1)
        return float(np.median(np.sqrt(variance) / mean[lit])) if lit.any() else 0.0

    def state(self) -> dict[str, np.ndarray]:
        """Return the state from which another film of the same view resumes, to the same bits."""
        return {**{name: value.numpy() for name, value in self._sums.items()}, "passes": np.array(self.passes)}

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Resume from the state of another film; raise SceneError where that is of another picture."""
        sums, count = {name: each for name, each in state.items() if name != "passes"}, self._shape[0] * self._shape[1]
        complete = {"passes", "surface", "alpha", "light", "squares"} <= set(state)
        same = complete and ("weight" in sums) is (self._filter is not None)
        if not same or any(each.shape not in ((count,), (3, count)) for each in sums.values()):
            raise SceneError("the checkpoint is of another picture")
        self._sums = {
            name: to_float(each) if each.ndim == 1 else Array3f(*map(to_float, each)) for name, each in sums.items()
        }
        self.passes = int(state["passes"])

    def layers(self) -> dict[str, np.ndarray]:
        """Return the layers, (H, W, C) float32: means over the passes, in the order of `layer_names`."""
        pictures = {name: self._picture(name) for name in self._sums}
        scale = 1 / pictures["weight"] if "weight" in pictures else np.float32(1 / max(self.passes, 1))
        black = np.zeros((*self._shape, 3), dtype=np.float32)
        surface = pictures.get("surface", black) * scale
        alpha = pictures.get("alpha", black[..., :1]) * scale
        groups = {
            name.removeprefix(_BEAMS): pictures[name] * scale for name in sorted(pictures) if name.startswith(_BEAMS)
        }
        beams = sum(groups.values(), black)
        layers = {"rgba": np.concatenate([surface + beams, alpha], axis=2), "surface": surface, "beams": beams}
        for group, name in self._groups.items():
            # Black where no beam of the group was in a medium; a group called "default" is one with the unnamed one.
            layers[name] = layers.get(name, 0) + groups.get(group, black)
        if "transmittance" in pictures:
            layers["transmittance"] = pictures["transmittance"] * scale
        layers["depth"] = pictures.get("depth", np.full_like(alpha, np.inf))
        return layers

    def _picture(self, name: str) -> np.ndarray:
        """Return a sum as (H, W, C)."""
        value = self._sums[name].numpy().reshape(-1, *self._shape).transpose(1, 2, 0)
        return np.ascontiguousarray(value)


def films_state(films: Sequence[Film], statistics: Statistics) -> dict[str, np.ndarray]:
    """Return the state of a frame's films, and of its counts."""
    counts = np.array([statistics.passes, statistics.beams, statistics.tests])
    states = [(f"{view}/{name}", each) for view, film in enumerate(films) for name, each in film.state().items()]
    return {"counts": counts, **dict(states)}


def restore_films(films: Sequence[Film], statistics: Statistics, state: Mapping[str, np.ndarray]) -> None:
    """Resume the films of a frame from a state; raise SceneError where that is of another picture."""
    for view, film in enumerate(films):
        own = f"{view}/"
        film.restore({name.removeprefix(own): each for name, each in state.items() if name.startswith(own)})
    statistics.passes, statistics.beams, statistics.tests = map(int, state["counts"])


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


def group_layers(groups: Collection[str]) -> dict[str, str]:
    """Return the layers of light groups; none where all beams are of the unnamed one."""
    return {group: f"beams_{group or 'default'}" for group in sorted(groups)} if set(groups) - {""} else {}


def layer_names(groups: Mapping[str, str]) -> list[str]:
    """Return the names of the layers of a stage with light groups that have these layers, in their order."""
    return ["rgba", "surface", "beams", *dict.fromkeys(groups.values()), "transmittance", "depth"]
