"""Films that do not boil: averages of a frame and of its neighbours, as the camera moves over them.

What denoising leaves of the noise is smooth, and other in each frame: a still wall seems to boil. A pixel of a frame is
averaged with those pixels of the frames before and after that show the same point. The header's matrices and the depth
tell where that is. Three things tell whether it is the same: its depth; that it is in the picture; and, because lights
and things move, the mean light around, which may differ by little more than what denoising leaves. A neighbour before
and one after count alike, so that light which rises or falls evenly stays as it is.

Beams have no depth of their own. They are followed at that one of some depths in front of the surface where the
neighbours agree best (a plane sweep, Collins 1996).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import OpenEXR
from scipy.ndimage import map_coordinates, uniform_filter

from ..runtime.files import write_bytes
from ..scene import Array, SceneError
from .channels import COLORS
from .color_spaces import COLOR_SPACE, REC709
from .exr import exr_parts
from .writing import EXACT, encoded_parts, png_of

# By how much depths of the same point may differ, relative to the depth: it is known at the centres of pixels.
_DEPTHS = 0.02
# By how much the mean light around a point may differ, relative to it: then a neighbour counts 1 / e.
_LIGHT = 0.1
# The side of the square of pixels for that mean. Light below this fraction of the picture's mean is as good as black.
_AROUND, _DARK = 7, 0.02
# Depths at which beams may be, in units of the depth of the surface behind them.
_PLACES = (1.0, 0.7, 0.5, 0.35, 0.25)
# Nothing is seen of beams that are farther than this, in medians of depths.
_FARTHEST = 10.0
_FAR = 1e6  # the depth of what is infinitely far, in medians of depths


@dataclass(frozen=True)
class FilmView:
    """A view of a frame of a film.

    Attributes
    ----------
    layers
        `rgba`, (H, W, 4), `surface`, (H, W, 3), `depth`, (H, W, 1), those of beams, whose names begin with `beams`, and
        those of surfaces by light groups, whose names begin with `surface_`.
    to_camera, to_ndc
        (4, 4) matrices for column vectors, from the world to the camera, which looks along −z, and to fractions of the
        display window from its bottom left.
    place
        x0, y0, width, height of the pixels in fractions of the display window, from the top left.
    """

    layers: Mapping[str, Array]
    to_camera: Array
    to_ndc: Array
    place: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0)

    @cached_property
    def usual_depth(self) -> float:
        """The median of depths that are not infinite."""
        depth = self.layers["depth"]
        finite = depth[np.isfinite(depth) & (depth > 0)]
        return float(np.median(finite)) if finite.size else 1.0

    @cached_property
    def depth(self) -> Array:
        """Depths, (H, W) float64; what is infinitely far has a finite one."""
        depth = self.layers["depth"][..., 0].astype(np.float64)
        return np.where(np.isfinite(depth) & (depth > 0), depth, _FAR * self.usual_depth)

    def light(self, names: Sequence[str]) -> Array:
        """Return the colours of layers side by side, (H, W, 3 × len(names))."""
        return np.concatenate([self.layers[name][..., :3] for name in names], axis=2)

    @property
    def surfaces(self) -> list[str]:
        """The names of the layers of which the light of surfaces is the sum."""
        return [name for name in self.layers if name.startswith("surface_")] or ["surface"]

    @property
    def beams(self) -> list[str]:
        """The names of the layers of beams."""
        return [name for name in self.layers if name == "beams" or name.startswith("beams_")]

    def points(self, depth: Array) -> Array:
        """Return the points of the world that pixels show at a depth, (4, H, W)."""
        height, width = depth.shape
        x0, y0, across, down = self.place
        x = x0 + across * (np.arange(width) + 0.5) / width
        y = 1 - (y0 + down * (np.arange(height)[:, None] + 0.5) / height)
        to_world = np.linalg.inv(self.to_camera)
        lens = self.to_ndc @ to_world
        # In the camera's space a point is (X, Y, −depth), and its fractions are (x, y) = ((lens X)₀, (lens X)₁) / w.
        w = lens[3, 3] - lens[3, 2] * depth
        seen = np.stack([
            (x * w + lens[0, 2] * depth - lens[0, 3]) / lens[0, 0],
            (y * w + lens[1, 2] * depth - lens[1, 3]) / lens[1, 1],
            -depth,
            np.ones_like(depth),
        ])  # fmt: skip
        return np.tensordot(to_world, seen, 1)

    def pixels(self, points: Array) -> tuple[Array, Array]:
        """Return where points are in the picture, (2, H, W) in rows and columns, and their depths."""
        height, width = self.depth.shape
        x0, y0, across, down = self.place
        x, y, _, w = np.tensordot(self.to_ndc, points, 1)
        depth = -np.tensordot(self.to_camera[2], points, 1)
        w = np.where(np.abs(w) > 0, w, np.inf)
        row, column = ((1 - y / w) - y0) / down * height - 0.5, (x / w - x0) / across * width - 0.5
        # The same pixels of a still camera are to be the same to the bit.
        row, column = (np.where(np.abs(each - np.round(each)) < 1e-3, np.round(each), each) for each in (row, column))
        return np.stack([row, column]), depth


@np.errstate(all="ignore")  # pixels and matrices of a file may be no numbers
def steadied(frames: Sequence[FilmView], own: int) -> dict[str, Array]:
    """Return the layers of one of successive frames, with its light averaged over all of them.

    Raises
    ------
    SceneError
        If frames differ in size or layers.
    """
    frame = frames[own]
    if any(each.depth.shape != frame.depth.shape or each.layers.keys() != frame.layers.keys() for each in frames):
        raise SceneError("the frames differ in size or layers: expected those of one film")
    pairs = [[frames[at] for at in (own - step, own + step) if 0 <= at < len(frames)] for step in range(1, len(frames))]
    pairs = [pair for pair in pairs if pair]
    solid = _averaged(frame, pairs, frame.surfaces, frame.depth)
    first, *others = solid.values()
    result = {**frame.layers, **solid, "surface": sum(others, first)}
    if frame.beams:
        result |= _averaged(frame, pairs, frame.beams, _depth_of_beams(frame, pairs))
    light = result["surface"] + result["beams"] if frame.beams else result["surface"]
    return result | {"rgba": np.concatenate([light, result["rgba"][..., 3:]], axis=2)}


def _averaged(
    frame: FilmView, pairs: Sequence[Sequence[FilmView]], names: Sequence[str], depth: Array
) -> dict[str, Array]:  # fmt: skip
    """Return layers of a frame, averaged with what pairs of neighbours show of its points at a depth."""
    points, own = frame.points(depth), frame.light(names)
    total, weight = own.astype(np.float64), np.ones(own.shape[:2])
    for pair in pairs:
        seen = [_seen(each, points, names) for each in pair]
        alike = np.minimum.reduce([valid * _alike(own, light, valid) for light, valid in seen])
        for light, _ in seen:
            total += alike[..., None] * light
            weight += alike
    mean = (total / weight[..., None]).astype(np.float32)
    return dict(zip(names, np.split(mean, len(names), axis=2), strict=True))


def _seen(frame: FilmView, points: Array, names: Sequence[str]) -> tuple[Array, Array]:
    """Return the light of layers where a frame shows points, (H, W, C), and which of them it shows, (H, W).

    The layers are those of surfaces, or those of beams, which are in front of them.
    """
    solid = names[0].startswith("surface")
    place, depth = frame.pixels(points)
    height, width = frame.depth.shape
    size = np.array([height, width]).reshape(2, 1, 1)
    valid = (depth > 0) & np.all((place >= -0.5) & (place <= size - 0.5), axis=0)
    # Of a plane, one over the depth is linear over the picture.
    expected, nearness = 1 / np.where(depth > 0, depth, np.inf), _at(1 / frame.depth, place, 1)
    less = nearness - expected
    tolerance = _DEPTHS * expected + 10 / (_FAR * frame.usual_depth)
    valid &= less <= tolerance
    if solid:
        valid &= less >= -tolerance
    order, light = 3 if solid else 1, frame.light(names)
    seen = np.stack([_at(light[..., each], place, order) for each in range(light.shape[2])], axis=2)
    return np.maximum(seen, 0) if solid else seen, valid  # layers of beams have to add up


def _at(picture: Array, place: Array, order: int) -> Array:
    """Return the values of a picture, (H, W), at rows and columns, (2, H, W), by splines of an order."""
    if np.array_equal(place, np.indices(picture.shape)):
        return picture
    return map_coordinates(picture, place, order=order, mode="nearest")


def _alike(own: Array, other: Array, valid: Array) -> Array:
    """Return how much alike the mean light of the `valid` pixels around each pixel is, from 0 to 1."""
    shown = valid[..., None].astype(np.float64)
    one, two = (uniform_filter(each * shown, (_AROUND, _AROUND, 0), mode="nearest") for each in (own, other))
    part = uniform_filter(shown, (_AROUND, _AROUND, 0), mode="nearest")
    one, two = (each / np.maximum(part, _AROUND**-2) for each in (one, two))
    usual = np.maximum(one, two) + _DARK * float(own.mean()) + np.finfo(np.float32).tiny
    return np.exp(-np.square(np.max(np.abs(one - two) / usual, axis=2) / _LIGHT))


def _depth_of_beams(frame: FilmView, pairs: Sequence[Sequence[FilmView]]) -> Array:
    """Return the depth of some at which the nearest neighbours agree best on the light of beams."""
    nearest = pairs[0] if pairs else ()
    if all(np.array_equal(each.to_ndc, frame.to_ndc) for each in nearest):
        return frame.depth
    own = frame.light(["beams"])
    best, chosen = np.full(own.shape[:2], np.inf), frame.depth
    for place in _PLACES:
        depth = place * np.minimum(frame.depth, _FARTHEST * frame.usual_depth)
        points, differs = frame.points(depth), np.zeros(own.shape[:2])
        for each in nearest:
            light, _ = _seen(each, points, ["beams"])
            differs += np.square(light - own).mean(axis=2)
        differs = uniform_filter(differs, _AROUND, mode="nearest")
        chosen, best = np.where(differs < best, depth, chosen), np.minimum(differs, best)
    return chosen


@dataclass(frozen=True)
class FilmFrame:
    """The EXR of a frame: its parts, and its views by their names, "" for a single one."""

    parts: Sequence[OpenEXR.Part]
    views: Mapping[str, FilmView]

    @classmethod
    def read(cls, path: Path) -> FilmFrame:
        """Return the frame in a file.

        Raises
        ------
        SceneError
            A file that is no EXR, or that lacks layers or matrices.
        OSError
            A file that cannot be read.
        """
        parts = exr_parts(path)
        views = dict.fromkeys(_view(part) for part in parts)
        return cls(parts, {view: _film_view(path, [each for each in parts if _view(each) == view]) for view in views})

    def averaged(self, before: Sequence[FilmFrame], after: Sequence[FilmFrame]) -> FilmFrame:
        """Return the frame averaged with those before and after it, in their order; SceneError if they do not fit."""
        frames = [*before, self, *after]
        if any(each.views.keys() != self.views.keys() for each in frames):
            raise SceneError("the frames differ in views: expected those of one film")
        views = {
            name: replace(view, layers=steadied([each.views[name] for each in frames], len(before)))
            for name, view in self.views.items()
        }
        return replace(self, views=views)

    def write(self, path: Path, exposure: float = 0.0) -> None:
        """Write the frame with the headers that it was read with, or its `rgba` as a picture, by the file's name."""
        if path.suffix.lower() == ".exr":
            write_bytes(path, encoded_parts(path, [self._part(each) for each in self.parts]))
            return
        eyes = [view.layers["rgba"] for view in self.views.values()]
        header = self.parts[0].header
        space = str(header.get(COLOR_SPACE, REC709))
        picture = png_of(*eyes, exposure=exposure, pixel_aspect=header["pixelAspectRatio"], space=space)
        write_bytes(path, picture)

    def _part(self, part: OpenEXR.Part) -> OpenEXR.Part:
        """Return a part with the present pixels of its layer."""
        layer = self.views[_view(part)].layers[_layer(part)]
        channels = {name: each.pixels for name, each in part.channels.items()}
        # A compositor may have added channels that nothing averages, such as an alpha: they stay as they are.
        for name, pixels in zip(_names(part), np.moveaxis(layer, 2, 0), strict=False):
            channels[name] = np.ascontiguousarray(pixels, channels[name].dtype)
        return OpenEXR.Part(part.header, channels, part.name())


def _view(part: OpenEXR.Part) -> str:
    return str(part.header.get("view", ""))


def _layer(part: OpenEXR.Part) -> str:
    """Return the name of a part's layer, without its view."""
    return str(part.name()).removesuffix(f".{_view(part)}")


@np.errstate(all="ignore")
def _film_view(path: Path, parts: Sequence[OpenEXR.Part]) -> FilmView:
    layers, header = {_layer(part): _pixels(part) for part in parts}, parts[0].header
    lacking = [name for name in ("rgba", "surface", "depth") if name not in layers]
    lacking += [name for name in ("worldToCamera", "worldToNDC") if name not in header]
    if lacking:
        expected = "expected a frame by `photonbeams render` from a perspective or orthographic camera"
        if any(name.split(".")[0] in lacking for each in parts for name in each.channels):
            expected = "expected each layer in a part of its own, as without --single-part"
        raise SceneError(f"{path}: has no {' and no '.join(lacking)}: {expected}")
    for name, each in layers.items():
        if name.split("_")[0] in ("rgba", "surface", "beams") and each.shape[2] < 3:
            raise SceneError(f"{path}: its layer {name} has {each.shape[2]} channels: expected red, green and blue")
    (x0, y0), (x1, y1) = header["dataWindow"]
    (left, top), (right, bottom) = header["displayWindow"]
    across, down = right + 1 - left, bottom + 1 - top
    place = (x0 - left) / across, (y0 - top) / down, (x1 + 1 - x0) / across, (y1 + 1 - y0) / down
    found = (header.get(f"{name}{EXACT}", header[name]) for name in ("worldToCamera", "worldToNDC"))
    try:
        world, film = (np.asarray(each, np.float64).reshape(4, 4).T for each in found)
        lens = film @ np.linalg.inv(world)
        is_camera = bool(np.all(np.isfinite(lens)) and lens[0, 0] * lens[1, 1])
    except (TypeError, ValueError, np.linalg.LinAlgError):
        is_camera = False
    if not is_camera:
        text = "worldToCamera and worldToNDC in its header are no matrices of a camera"
        raise SceneError(f"{path}: {text}: expected a frame by `photonbeams render`")
    return FilmView(layers, world, film, place)


def _names(part: OpenEXR.Part) -> list[str]:
    """Return the names of a part's channels: red, green, blue, alpha, others."""

    def place(name: str) -> tuple[int, str]:
        return COLORS.get(name.lower().rpartition(".")[2], len(COLORS)), name

    return sorted(part.channels, key=place)


def _pixels(part: OpenEXR.Part) -> Array:
    """Return the pixels of a part, (H, W, C) float32, its channels side by side as `_names`."""
    return np.stack([part.channels[name].pixels for name in _names(part)], axis=2, dtype=np.float32)
