"""A rendered frame with the metadata of its file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..runtime.files import PathLike
from ..scene import Array, SceneError
from .files import write_frame
from .previews import preview

if TYPE_CHECKING:
    from ..render.passes import Statistics


_EDGE = 1e-4  # of a pixel, which rounding down does not lose


@dataclass(frozen=True)
class Frame:
    """A rendered frame.

    Attributes
    ----------
    layers
        Name to (H, W, C) float32: rgba, surface, beams, beams_<group>, transmittance, depth.
    metadata
        What the EXR's header says.
    statistics
        Passes, beams, seconds by phase, kernels compiled.
    views
        Of a stereo frame, layers and metadata of each eye, "left" before "right"; `layers` and `metadata` are those of
        the first.
    """

    layers: dict[str, Array]
    metadata: dict[str, Any]
    statistics: Statistics
    views: dict[str, tuple[dict[str, Array], dict[str, Any]]] = field(default_factory=dict)

    @classmethod
    def of(cls, views: dict[str, tuple[dict[str, Array], dict[str, Any]]], statistics: Statistics) -> Frame:
        """Return the frame of some views: layers and metadata of each, in their order."""
        layers, metadata = next(iter(views.values()))
        return cls(layers, metadata, statistics, views if len(views) > 1 else {})

    def write(self, path: PathLike, layer: str = "rgba", exposure: float = 0.0) -> None:
        """Write a layered EXR, or one layer as a tone-mapped PNG, by the suffix; whole or not at all."""
        write_frame(path, self.layers, self.metadata, layer=layer, exposure=exposure, views=self.views)

    def __repr__(self) -> str:
        height, width = self.layers["rgba"].shape[:2]
        eyes = "two eyes of " if self.views else ""
        return f"Frame({eyes}{width} x {height} pixels, {self.statistics.passes} passes, {', '.join(self.layers)})"

    def _repr_png_(self) -> bytes:
        """Return the PNG that `write` writes, for notebooks; a large picture is made smaller: see `preview`."""
        return preview(*(layers["rgba"] for layers, _ in self.views.values() or [(self.layers, {})]))


def tile_of(
    crop: Sequence[float] | None, width: int, height: int, tile: tuple[int, int]
) -> tuple[float, float, float, float]:
    """Return the crop window of tile (number from 1, of how many): bands of rows, of a picture or of a crop window.

    Bands begin at tiles of the estimators, in which pixels share places on a lens: they are then the bits of the whole.
    SceneError where there are more tiles than such bands.
    """
    from ..estimators.tiles import TILE

    left, top, right, bottom = pixels_of(crop, width, height)
    number, count = tile
    first, last = top // TILE, -(-bottom // TILE)
    if count > last - first:
        most = f"{bottom - top} rows make {last - first} tiles of {TILE} rows at most"
        raise SceneError(f"the tile is {number}/{count}: {most}")
    edges = [first + (last - first) * each // count for each in (number - 1, number)]
    x0, x1 = fractions_of(left, right, width)
    y0, y1 = fractions_of(max(edges[0] * TILE, top), min(edges[1] * TILE, bottom), height)
    return x0, y0, x1, y1


def fractions_of(first: int, last: int, count: int) -> tuple[float, float]:
    """Return fractions of `count` pixels that `pixels_of` takes for those from `first` to `last`, not included."""
    return (first + _EDGE) / count, min((last + _EDGE) / count, 1.0)


def pixels_of(crop: Sequence[float] | None, width: int, height: int) -> tuple[int, int, int, int]:
    """Return the pixels of a crop window, at least one; raise SceneError where it is outside of the picture."""
    if crop is None:
        return (0, 0, width, height)
    if isinstance(crop, str) or np.shape(crop) != (4,):
        raise SceneError(f"the crop is {crop!r}: expected four numbers, x0, y0, x1, y1")
    x0, y0, x1, y1 = crop
    if not (0 <= x0 < x1 <= 1 and 0 <= y0 < y1 <= 1):
        raise SceneError(f"the crop is {tuple(crop)}: expected 0 <= x0 < x1 <= 1 and 0 <= y0 < y1 <= 1")
    left, top = int(x0 * width), int(y0 * height)
    return (left, top, max(left + 1, round(x1 * width)), max(top + 1, round(y1 * height)))
