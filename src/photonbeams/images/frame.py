"""Rendered frames with the metadata of their files, and parts of pictures: crop windows and tiles."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from math import floor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..constants import is_number
from ..runtime.files import PathLike, check_kept, write_bytes
from ..scene import MOST_PIXELS, Array, SceneError, arguments, numbers, shown
from .color_spaces import COLOR_SPACE, REC709
from .deep import encoded_deep
from .textures import resized
from .writing import encoded_exr, png_of

if TYPE_CHECKING:
    from ..render.films.deep import DeepPicture
    from ..render.passes import Statistics

# A notebook stores pictures as text: a few large ones make it slow to open and to compare.
MOST_BYTES = 1_000_000
MOST_PREVIEWED = 1 << 21  # pixels, about 1920 x 1080

_EDGE = 1e-4  # of a pixel: added to edges, so that rounding down gives the right pixel


@dataclass(frozen=True)
class Frame:
    """A rendered frame, as `Shot.render` returns it; notebooks show it as a picture.

    Attributes
    ----------
    layers
        (H, W, C) float32 by name: rgba, surface, beams, beams_<group>, transmittance, depth, and others if settings
        ask for them. Colours are scene-linear; the depth is planar, in scene units.
    metadata
        What the EXR's header holds: the camera's matrices, seed, passes, frame number.
    statistics
        Passes, beams, seconds by phase, kernels compiled.
    views
        For a stereo frame the layers and metadata of each eye, "left" before "right"; `layers` and `metadata` are then
        those of the left eye. Empty for a single camera.
    deep
        With `deep=True`, the beams of each view as a deep picture, by its name, which is "" for a single camera.
    sources
        Returns the files from which the frame was rendered, which are not written over. Default: none.

    Examples
    --------
    >>> content = pb.scene.Scene(lights=pb.scene.SphereLight("/Lamp", 50.0), media=pb.Medium(scattering=0.1))
    >>> camera = pb.scene.Camera.look_at(origin=(0, 0, 4), target=(0, 0, 0))
    >>> frame = pb.Shot(content, camera).render(passes=1, width=32)
    >>> frame
    Frame(32 x 18 pixels, 1 pass, rgba, surface, beams, ...)
    >>> frame.write("shot.exr")
    """

    layers: dict[str, Array]
    metadata: dict[str, Any]
    statistics: Statistics
    views: dict[str, tuple[dict[str, Array], dict[str, Any]]] = field(default_factory=dict)
    deep: dict[str, DeepPicture] = field(default_factory=dict)
    sources: Callable[[], Iterable[PathLike]] = field(default=list, repr=False, compare=False)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "sources": list}  # a stage cannot be pickled

    @classmethod
    def of(cls, views: dict[str, tuple[dict[str, Array], dict[str, Any]]], statistics: Statistics) -> Frame:
        """Return the frame of `views`, the layers and metadata of each by its name, with `statistics`."""
        layers, metadata = next(iter(views.values()))
        return cls(layers, metadata, statistics, views if len(views) > 1 else {})

    @arguments
    def write(
        self, path: PathLike, layer: str = "rgba", exposure: float = 0.0, *, single_part: bool = False
    ) -> None:  # fmt: skip
        """Write a layered EXR, or one layer as a tone-mapped PNG, whole or not at all.

        Parameters
        ----------
        path
            A name that ends in .exr or .png. The folder is made if it does not exist.
        layer
            For a PNG: the layer to show.
        exposure
            For a PNG: in stops, the colours are multiplied by 2^exposure.
        single_part
            For an EXR: whether all layers are in one part, for programs that read only the first: R, G, B, A, Z, and
            others with their layers' names, such as beams.R.

        Raises
        ------
        SceneError
            Another suffix, no such layer, or one that is not a picture, such as `depth`; a file that the shot reads.
        OSError
            The file cannot be written.
        """
        check_kept([path], self.sources())
        write_bytes(path, self.encoded(path, layer, exposure, single_part=single_part))

    @arguments
    def encoded(
        self, path: PathLike, layer: str = "rgba", exposure: float = 0.0, *, single_part: bool = False
    ) -> bytes | memoryview:  # fmt: skip
        """Return the file that `write` writes to `path`, which decides the kind and is named in messages.

        `layer`, `exposure` and `single_part` are as for `write`.
        """
        path, views = Path(path), self.views or {"": (self.layers, self.metadata)}
        if path.suffix.lower() == ".exr":
            return encoded_exr(path, views, single_part=single_part)
        if path.suffix.lower() != ".png":
            raise SceneError(f"cannot write {path}: expected a name that ends in .exr (layers) or .png (a picture)")
        for layers, _ in views.values():
            if layer not in layers:
                raise SceneError(f"cannot write {path}: there is no layer '{layer}', only {', '.join(layers)}")
            if is_number(layer) or layers[layer].shape[2] < 3:
                raise SceneError(f"cannot write {path}: '{layer}' has no colours: expected another layer, or an .exr")
        eyes, ratio = [layers[layer] for layers, _ in views.values()], self.metadata.get("pixelAspectRatio", 1.0)
        return png_of(*eyes, exposure=exposure, pixel_aspect=ratio, space=self.color_space)

    @property
    def color_space(self) -> str:
        """The colour space of the layers, as OpenImageIO names it: linear, usually lin_rec709_scene."""
        return str(self.metadata.get(COLOR_SPACE, REC709))

    def write_deep(self, path: PathLike) -> None:
        """Write the beams as a deep EXR, which is the layer `beams` when it is flattened; whole or not at all.

        Parameters
        ----------
        path
            A name that ends in .exr. The folder is made if it does not exist.

        Raises
        ------
        SceneError
            Another suffix, a file that the shot reads, or a frame that was rendered without `deep=True`.
        OSError
            The file cannot be written.
        """
        check_kept([path], self.sources())
        write_bytes(path, self.encoded_deep(path))

    def encoded_deep(self, path: PathLike) -> memoryview:
        """Return the file that `write_deep` writes to `path`."""
        if Path(path).suffix.lower() != ".exr":
            raise SceneError(f"cannot write {path}: expected a name that ends in .exr for a deep picture")
        if not self.deep:
            raise SceneError(
                f"cannot write {path}: the frame has no deep picture: expected one rendered with --deep, or deep=True"
            )
        metadata = {view: about for view, (_, about) in self.views.items()} or dict.fromkeys(self.deep, self.metadata)
        return encoded_deep(path, {view: (each, metadata[view]) for view, each in self.deep.items()})

    def __repr__(self) -> str:
        height, width = self.layers["rgba"].shape[:2]
        eyes = "two eyes of " if self.views else ""
        passes = "1 pass" if self.statistics.passes == 1 else f"{self.statistics.passes} passes"
        return f"Frame({eyes}{width} x {height} pixels, {passes}, {', '.join(self.layers)})"

    def _repr_png_(self) -> bytes:
        """Return the PNG that `write` writes, for notebooks; large pictures are scaled down: see `preview`."""
        shown = [layers["rgba"] for layers, _ in self.views.values() or [(self.layers, {})]]
        return preview(*shown, space=self.color_space)


def preview(*eyes: Array, space: str = REC709) -> bytes:
    """Return the PNG that `png_of` returns for eyes, scaled down if it has many pixels or bytes."""
    scale = min(1.0, (MOST_PREVIEWED / sum(np.shape(each)[0] * np.shape(each)[1] for each in eyes)) ** 0.5)
    while len(data := png_of(*(_smaller(each, scale) for each in eyes), space=space)) > MOST_BYTES:
        scale *= min(0.9, (MOST_BYTES / len(data)) ** 0.5)
    return data


def _smaller(pixels: Array, scale: float) -> Array:
    """Return a scene-linear picture scaled by up to 1; each pixel is the mean of those that it covers."""
    if scale == 1.0:
        return pixels
    height, width = (max(1, round(scale * count)) for count in np.shape(pixels)[:2])
    # One infinite pixel or NaN would spoil its neighbours.
    finite = np.nan_to_num(np.asarray(pixels, dtype=np.float32)[..., :3], nan=0.0, posinf=1e30, neginf=0.0)
    return resized(finite, height, width)


def tile_of(
    crop: Sequence[float] | None, width: int, height: int, tile: tuple[int, int]
) -> tuple[float, float, float, float]:
    """Return the crop window of one of several tiles, which are bands of rows of a picture or of a crop window.

    Bands begin where tiles of the estimators do, in which pixels share their places on the lens. So a band has the bits
    that the whole picture would have. `tile` is the number of the tile, from 1, and the number of tiles; SceneError if
    these are more than bands.
    """
    from ..estimators.projection import TILE

    left, top, right, bottom = pixels_of(crop, width, height, overscan=True)
    number, count = tile
    first, last = top // TILE, -(-bottom // TILE)
    if count > last - first:
        most = f"{bottom - top} rows make up to {last - first}, of {TILE} rows each"
        raise SceneError(f"the tile is {number}/{count}: {most}")
    edges = [first + (last - first) * each // count for each in (number - 1, number)]
    x0, x1 = fractions_of(left, right, width)
    y0, y1 = fractions_of(max(edges[0] * TILE, top), min(edges[1] * TILE, bottom), height)
    return x0, y0, x1, y1


def fractions_of(first: int, last: int, count: int) -> tuple[float, float]:
    """Return the fractions of `count` pixels for which `pixels_of` returns `first` and, not included, `last`."""
    return (first + _EDGE) / count, last / count


def within(pixels: Array, area: Sequence[float]) -> Array:
    """Return a picture, (H, W, C), that is black and transparent outside of an area; see `pixels_of`."""
    height, width = pixels.shape[:2]
    x0, y0, x1, y1 = pixels_of(area, width, height)
    result = np.zeros_like(pixels)
    result[y0:y1, x0:x1] = pixels[y0:y1, x0:x1]
    return result


def pixels_of(
    crop: Sequence[float] | None, width: int, height: int, *, overscan: bool = False
) -> tuple[int, int, int, int]:
    """Return the pixels of a crop window, at least one: left, top, right, bottom, the last two not included.

    With `overscan`, the window may reach beyond the picture. SceneError for one that is not four numbers, is empty,
    leaves the picture, or has too many pixels with overscan.
    """
    if crop is None:
        return (0, 0, width, height)
    expected = "four numbers, x0, y0, x1, y1"
    found = numbers(crop, "the crop", expected)
    if found.shape != (4,):
        raise SceneError(f"the crop is {shown(crop)}: expected {expected}")
    x0, y0, x1, y1 = crop = tuple(float(each) for each in found)
    if overscan:
        if not (x0 < x1 and y0 < y1 and np.all(np.isfinite(crop))):
            raise SceneError(f"the crop is {crop}: expected finite numbers, x0 < x1 and y0 < y1")
        if problem := overscan_problem(crop, width, height):
            raise SceneError(f"the crop is {crop}: {problem}")
    elif not (0 <= x0 < x1 <= 1 and 0 <= y0 < y1 <= 1):
        raise SceneError(f"the crop is {crop}: expected 0 <= x0 < x1 <= 1 and 0 <= y0 < y1 <= 1")
    left, top = floor(x0 * width), floor(y0 * height)
    return (left, top, max(left + 1, round(x1 * width)), max(top + 1, round(y1 * height)))


def overscan_problem(crop: Sequence[float], width: int, height: int) -> str:
    """Return which edge has more pixels beyond it than samples have numbers for (`render.films.film.Film`), or ""."""
    x0, y0, x1, y1 = crop
    for size, most in ((width, max(-x0, x1 - 1)), (height, max(-y0, y1 - 1))):
        if size * (1 + 2 * most) > MOST_PIXELS:
            expected = f"expected no more than {(MOST_PIXELS - size) // 2:,}"
            return f"{size * most:,.0f} pixels beyond an edge of {size}, {expected}"
    return ""
