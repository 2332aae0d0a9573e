"""Cameras after UsdGeomCamera, and panoramic ones: their rays, and the screen on which tiles lie.

Tiles need lines that stay straight, so the beams that rays of panoramic cameras meet are found by a grid.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import drjit as dr
import numpy as np

from ... import scene
from ...estimators.lanes import lane_of, lanes, whole_group
from ...estimators.projection import TILE, Pose, Projection
from ...numerics.arrays import opaque
from ...runtime.device import Array2f, Array3f, Bool, Float, Int32, UInt32
from ...scene.cameras import CONFORM_POLICIES
from ..warp import disk
from . import panoramas


@dataclass(frozen=True)
class Window:
    """The picture: its full size in pixels, and the part (x0, y0, x1, y1) of it that is rendered.

    The part may reach beyond the picture, which is overscan. `pixel_aspect` is a pixel's width over its height, and
    `conform` one of `scene.cameras.CONFORM_POLICIES`.
    """

    width: int
    height: int
    crop: tuple[int, int, int, int]
    pixel_aspect: float = 1.0
    conform: str = CONFORM_POLICIES[0]

    @classmethod
    def full(cls, width: int, height: int) -> Window:
        """Return the window of a whole picture."""
        return cls(width, height, (0, 0, width, height))

    def whole(self) -> Window:
        """Return the window of the whole picture, without overscan."""
        return replace(self, crop=(0, 0, self.width, self.height))

    def grown(self, margin: int) -> Window:
        """Return the window with `margin` more pixels on each side, as far as the picture goes; overscan has no end.

        The result begins at a corner of one of the picture's tiles. Pixels of a tile share places on the lens and
        times, so the window then has the pixels of the whole picture.
        """
        first = [each - margin if each < 0 else max(each - margin, 0) for each in self.crop[:2]]
        last = [
            each + margin if each > size else min(each + margin, size)
            for each, size in zip(self.crop[2:], (self.width, self.height), strict=True)
        ]
        return replace(self, crop=(first[0] // TILE * TILE, first[1] // TILE * TILE, last[0], last[1]))

    def inside(self) -> tuple[int, int, int, int]:
        """Return the part of the window that is inside the picture, in pixels of the window."""
        x0, y0, x1, y1 = self.crop
        return max(-x0, 0), max(-y0, 0), min(x1, self.width) - x0, min(y1, self.height) - y0

    def aperture(self, camera: scene.Camera) -> tuple[float, float]:
        """Return the width and height of the film that the picture shows, in scene units."""
        width, height = camera.horizontal_aperture, camera.vertical_aperture
        aspect = self.pixel_aspect * self.width / self.height
        if self.conform == "adjustPixelAspectRatio":
            return width, height
        conformed = {
            "expandAperture": max(width, height * aspect), "cropAperture": min(width, height * aspect),
            "adjustApertureWidth": height * aspect, "adjustApertureHeight": width,
        }[self.conform]  # fmt: skip
        return conformed, conformed / aspect

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the rendered part."""
        return self.crop[3] - self.crop[1], self.crop[2] - self.crop[0]

    def header(self) -> dict[str, Any]:
        """Return displayWindow and dataWindow as in EXR headers, with the last pixels included."""
        x0, y0, x1, y1 = self.crop
        return {"displayWindow": (0, 0, self.width - 1, self.height - 1), "dataWindow": (x0, y0, x1 - 1, y1 - 1)}


class CameraRays(NamedTuple):
    """One ray for each pixel: origins (1 or W · H), unit directions, and planar depth per unit of distance.

    With a lens or a moving camera, `origins` are those that groups of pixels share (`estimators.lanes.lane_of`). If
    anything moves, `times` are those of the groups, or of each ray of a panoramic camera. `seen` says which rays the
    camera has; None: all.
    """

    origin: Any
    direction: Any
    facing: Any
    origins: Any = None
    times: Any = None
    seen: Any = None


class View:
    """A camera and its window: rays and projection. All its numbers are opaque to kernels.

    Parameters
    ----------
    camera, window
        The camera, and the picture's size.
    close
        A moving camera at the end of the pass's time slice; its lens is that of `camera`. In between, the transform
        from world to camera space is interpolated linearly, so that objects at rest move linearly in the picture's
        space, where tiles can bound them.
    """

    def __init__(self, camera: scene.Camera, window: Window, close: scene.Camera | None = None) -> None:
        self.camera, self.window = camera, window
        self.aperture = np.array(window.aperture(camera))
        depth, scale = 1.0 if camera.orthographic else camera.focal_length, self.pixels_per_tangent
        offset = np.array([camera.horizontal_offset, camera.vertical_offset]) / depth * scale
        center = np.array([window.width, window.height]) / 2 + np.array([-1, 1]) * offset
        # Rays are made in the whole picture. In single precision, those of a crop window would round differently.
        self._center = [dr.opaque(Float, each) for each in center]
        self._corner = [dr.opaque(Int32, each) for each in window.crop[:2]]
        center = center - np.array(window.crop[:2])
        height, width = window.shape
        corners = np.abs(np.array([[0, 0], [width, height]]) - center) / scale
        edge_x, edge_y = corners.max(axis=0).tolist()
        self.projection = Projection(
            poses=tuple(_pose(each) for each in (camera, close) if each is not None),
            scale=(dr.opaque(Float, scale[0]), dr.opaque(Float, scale[1])),
            center=(dr.opaque(Float, center[0]), dr.opaque(Float, center[1])),
            width=width,
            height=height,
            orthographic=camera.orthographic,
            edge_x=dr.opaque(Float, edge_x),
            edge_y=dr.opaque(Float, edge_y),
            lens=_lens(camera),
        )

    @property
    def tiled(self) -> Projection | None:
        """The projection by which tiles bound what rays meet; None for a panoramic camera."""
        return None if self.camera.panoramic else self.projection

    @property
    def projections(self) -> list[Projection]:
        """Projections that together show all that the camera sees at shutter open: its own, or faces of a cube."""
        return [each.projection for each in self.flat()]

    def flat(self, wider: float = 1.0) -> list[View]:
        """Return views that keep lines straight and together show all that this one does at shutter open.

        The faces of a panoramic camera's cube are `wider` by a factor, so that they overlap.
        """
        if not self.camera.panoramic:
            return [self]
        side = round(wider * self.window.height)
        window = Window.full(side, side)
        return [View(each, window) for each in panoramas.faces(self.camera, wider)]

    def part(self, corners: tuple[int, int, int, int], finer: int) -> View:
        """Return a part (x0, y0, x1, y1) of the whole picture, in pixels that are smaller by a factor."""
        own = self.window
        return View(self.camera, replace(own, width=finer * own.width, height=finer * own.height, crop=corners))

    def whole(self) -> View:
        """Return the same camera with a window of the whole picture."""
        return View(self.camera, self.window.whole())

    @property
    def pixels_per_tangent(self) -> np.ndarray:
        """The numbers of pixels across and down for a tangent of 1, or for a scene unit of a parallel projection."""
        depth = 1.0 if self.camera.orthographic else self.camera.focal_length
        result: np.ndarray = np.array([self.window.width, self.window.height]) * depth / self.aperture
        return result

    @property
    def film(self) -> bool:
        """Whether rays have their own origins, on a lens or along the camera's path."""
        return self.projection.lens is not None or len(self.projection.poses) > 1

    def rays(
        self, places: Array2f | tuple[float, float], sample: Callable[[UInt32], tuple[Array2f, Float]] | None = None,
        some: UInt32 | None = None,
    ) -> CameraRays:  # fmt: skip
        """Return a ray through each pixel, or through `some`, at its place in [0, 1)², or at one place (x, y) for all.

        `sample` returns, for the numbers of groups of pixels, places in the unit square for the lens and times in
        [0, 1]. It is given where there is a lens or motion, of the camera or of anything else. The rays of a pinhole at
        rest are the same with and without it. What groups share is only told of all pixels.
        """
        x, y = self._on_film(places, some)
        square: Any = None
        time: Any = None
        own: Any = None
        seen, count = self._seen(x, y), lanes(self.projection)
        if self.camera.panoramic and sample is not None:
            square, time = sample(self._group(some))
            origin, direction, facing = self._film(x, y, square, time)
            dr.eval(origin, direction, facing, time)
            return CameraRays(origin, direction, facing, times=time, seen=seen)
        if sample is not None and some is None:
            square, time = sample(self._whole(dr.arange(UInt32, count)))
        if sample is None or not self.film:
            origin, direction = self._through(x, y)
            dr.eval(time)
            return CameraRays(origin, direction, self._facing(direction), times=time, seen=seen)
        if some is None:
            own, _, _ = self._film(Float(self._center[0]), Float(self._center[1]), square, time)
            own, time = own + dr.zeros(Array3f, count), time + dr.zeros(Float, count)
        origin, direction, facing = self._film(x, y, *sample(self._group(some)))
        dr.eval(own, time, origin, direction, facing)
        return CameraRays(origin, direction, facing, own, time)

    def _group(self, some: UInt32 | None) -> UInt32:
        """Return the numbers in the whole picture of the groups of each pixel of the window, or of `some`."""
        return self._whole(lane_of(*self.pixels(some), self.projection.counts.columns))

    def _whole(self, group: UInt32) -> UInt32:
        """Return the numbers in the whole picture of groups of pixels, by which samples are drawn."""
        # Numbers below 0 wrap, so that groups beyond an edge have the numbers of groups at the opposite edge.
        (left, top), whole = self.window.crop[:2], -(-self.window.width // TILE)
        return whole_group(group, *(dr.opaque(UInt32, each & 0xFFFFFFFF) for each in
                                    (self.projection.columns, left // TILE, top // TILE, whole)))  # fmt: skip

    def _film(self, x: Float, y: Float, square: Array2f, time: Float) -> tuple[Array3f, Array3f, Float]:
        """Return origin, direction and planar depth per unit of distance of rays at places on the lens and at times."""
        view = self.projection
        right, up = self._from_middle(x, y)
        place, toward = Array3f(0), panoramas.toward(self.camera.projection, right, up)
        if view.orthographic:
            place, toward = Array3f(right, up, 0), Array3f(0, 0, 1)
        elif view.lens is not None:
            radius, focus = view.lens
            on_lens = disk(Array2f(square)) * radius
            place = Array3f(on_lens.x, on_lens.y, 0)
            toward -= place / focus
        origin, columns = _inverse(view.poses, time)
        origin = origin + columns[0] * place.x + columns[1] * place.y + columns[2] * place.z
        direction = columns[0] * toward.x + columns[1] * toward.y + columns[2] * toward.z
        inv = dr.rsqrt(dr.squared_norm(direction))
        return origin, direction * inv, dr.full(Float, 1, dr.width(inv)) if self.camera.panoramic else inv

    def _seen(self, x: Float, y: Float) -> Bool | None:
        """Return which places in the picture a panoramic camera sees; None: all."""
        if not self.camera.panoramic:
            return None
        found = panoramas.seen(self.camera, *self._from_middle(x, y))
        dr.eval(found)
        return found

    def _from_middle(self, x: Float, y: Float) -> tuple[Float, Float]:
        """Return places in the picture as places right and up on the film, in focal lengths."""
        scale = self.projection.scale
        return (x - self._center[0]) / scale[0], (self._center[1] - y) / scale[1]

    def on_lens(
        self, sample: Callable[[UInt32], tuple[Array2f, Float]] | None, some: UInt32 | None = None
    ) -> tuple[Float, Float, Float] | None:
        """Return where on the lens the rays of `rays` begin, right and up, and the focus distance; None: no lens."""
        lens = self.projection.lens
        if lens is None or sample is None:
            return None
        place = disk(Array2f(sample(self._group(some))[0])) * lens[0]
        return place.x, place.y, lens[1]

    def pixels(self, some: UInt32 | None = None) -> tuple[UInt32, UInt32]:
        """Return column and row of each pixel of the window, row by row, or of those with `some` numbers."""
        height, width = self.window.shape
        index, columns = dr.arange(UInt32, width * height) if some is None else some, dr.opaque(UInt32, width)
        return index % columns, index // columns

    def _on_film(self, places: Array2f | tuple[float, float], some: UInt32 | None = None) -> tuple[Float, Float]:
        """Return where rays through `places` in the window's pixels cross the whole picture, in pixels."""
        (column, row), (left, top) = self.pixels(some), self._corner
        across, down = (dr.opaque(Float, each) if isinstance(each, float) else each for each in places)
        return Float(Int32(column) + left) + across, Float(Int32(row) + top) + down

    def coarse_rays(self, columns: int, rows: int) -> tuple[Array3f, Array3f]:
        """Return a coarse grid of rays over the whole picture; crop windows have the same one, so the same beams."""
        left, top, right, bottom = self.window.whole().crop
        index, across = dr.arange(UInt32, columns * rows), dr.opaque(UInt32, columns)
        x = (Float(index % across) + 0.5) * dr.opaque(Float, (right - left) / columns) + dr.opaque(Float, left)
        y = (Float(index // across) + 0.5) * dr.opaque(Float, (bottom - top) / rows) + dr.opaque(Float, top)
        return self._through(x, y)

    def ray(self, at: tuple[float, float]) -> CameraRays:
        """Return the ray through a place in the whole picture, from 0 to 1 right and down."""
        origin, direction = self._through(
            dr.opaque(Float, at[0] * self.window.width), dr.opaque(Float, at[1] * self.window.height)
        )
        return CameraRays(origin, direction, self._facing(direction))

    def _through(self, x: Float, y: Float) -> tuple[Array3f, Array3f]:
        view, pose = self.projection, self.projection.poses[0]
        right, up = self._from_middle(x, y)
        if view.orthographic:
            origin = pose.origin + pose.right * right + pose.up * up
            direction = pose.forward + 0 * origin
        else:
            x, y, z = panoramas.toward(self.camera.projection, right, up)
            origin, direction = pose.origin, dr.normalize(pose.right * x + pose.up * y + pose.forward * z)
        dr.eval(origin, direction)
        return origin, direction

    def _facing(self, direction: Array3f) -> Float:
        if self.camera.panoramic:
            return dr.ones(Float, dr.width(direction))
        facing = dr.dot(direction, self.projection.poses[0].forward)
        dr.eval(facing)
        return facing

    def cosines(self, place: tuple[float, float]) -> np.ndarray:
        """Return planar depth per unit of distance from the camera, (H, W), at a `place` in [0, 1)² of each pixel.

        The depths of a panoramic camera are distances.
        """
        _, direction = self._through(*self._on_film(place))
        result: np.ndarray = self._facing(direction).numpy().reshape(self.window.shape)
        return result

    def header(self) -> dict[str, Any]:
        """Return what EXR headers say of a camera: pixelAspectRatio, and worldToCamera and worldToNDC for row vectors.

        For a perspective camera also screenWindowCenter and screenWindowWidth, at the depth 1; x is to the left. A
        panoramic camera has no worldToNDC, which keeps lines straight.
        """
        world = np.linalg.inv(np.asarray(self.camera.to_world, dtype=np.float64))
        near, far = self.camera.clipping
        (w, h), camera = self.aperture, self.camera
        depth = 1.0 if camera.orthographic else camera.focal_length
        shift = 2 * np.array([camera.horizontal_offset, camera.vertical_offset]) / np.array([w, h])
        project = np.zeros((4, 4))
        project[0, 0], project[1, 1] = 2 * depth / w, 2 * depth / h
        if camera.orthographic:
            project[2, 2], project[2, 3], project[3, 3] = -2 / (far - near), -(far + near) / (far - near), 1
            project[0, 3], project[1, 3] = -shift
        else:
            project[0, 2], project[1, 2] = shift
            project[2, 2], project[2, 3] = -(far + near) / (far - near), -2 * far * near / (far - near)
            project[3, 2] = -1
        screen = np.array([[0.5, 0, 0, 0.5], [0, 0.5, 0, 0.5], [0, 0, 1, 0], [0, 0, 0, 1]])
        ratio = self.window.pixel_aspect
        if self.window.conform == "adjustPixelAspectRatio":
            ratio = w / h * self.window.height / self.window.width
        result = {"worldToCamera": world.T, "pixelAspectRatio": float(ratio)}
        if not camera.panoramic:
            result["worldToNDC"] = (screen @ project @ world).T
        if camera.projection == "perspective":
            center = np.array([-camera.horizontal_offset, camera.vertical_offset]) / depth
            result |= {"screenWindowCenter": center, "screenWindowWidth": float(w / depth)}
        return result

    def in_picture(self, places: np.ndarray) -> np.ndarray:
        """Return where homogeneous places, (N, 4), are in the picture, from 0 to 1 to the right and upward; NaN behind.

        A panoramic camera has nothing behind it.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            if not self.camera.panoramic:
                found = places @ np.asarray(self.header()["worldToNDC"], np.float64)
                result: np.ndarray = np.where(found[:, 3:] > 0, found[:, :2] / found[:, 3:], np.nan)
                return result
            local = (places @ np.asarray(self.header()["worldToCamera"], np.float64))[:, :3] * [1, 1, -1]
            film = panoramas.on_film(self.camera.projection, local) * self.pixels_per_tangent
        size, (x, y) = np.array([self.window.width, self.window.height]), (each.numpy()[0] for each in self._center)
        result = (film + np.array([x, size[1] - y])) / size
        return result


class Pinhole(NamedTuple):
    """A pinhole on a camera's lens: a camera, and where it is, right and up of the centre, with the focus distance."""

    camera: scene.Camera
    place: tuple[float, float, float] | None  # None: the camera has no lens


def on_lens(camera: scene.Camera, place: Sequence[float]) -> Pinhole:
    """Return the pinhole at a place on a camera's lens, in the unit disc: it sees the plane of focus as all others."""
    if camera.lens_radius == 0 or camera.orthographic:
        return Pinhole(replace(camera, lens_radius=0.0), None)
    x, y = (camera.lens_radius * each for each in place)
    to_world = np.array(camera.to_world, dtype=np.float64)
    to_world[:3, 3] += to_world[:3, :2] @ (x, y)
    shift = camera.focal_length / camera.focus_distance
    moved = replace(
        camera, lens_radius=0.0, to_world=to_world, horizontal_offset=camera.horizontal_offset - shift * x,
        vertical_offset=camera.vertical_offset - shift * y,
    )  # fmt: skip
    return Pinhole(moved, (x, y, camera.focus_distance))


def _pose(camera: scene.Camera) -> Pose:
    matrix = np.asarray(camera.to_world, dtype=np.float64)
    return Pose(opaque(matrix[:3, 3]), opaque(matrix[:3, 0]), opaque(matrix[:3, 1]), opaque(-matrix[:3, 2]))


def _lens(camera: scene.Camera) -> tuple[Float, Float] | None:
    if camera.orthographic or camera.lens_radius == 0:
        return None
    return dr.opaque(Float, camera.lens_radius), dr.opaque(Float, camera.focus_distance)


def _inverse(poses: tuple[Pose, ...], time: Float) -> tuple[Array3f, list[Array3f]]:
    """Return the position of the camera at a time, and the columns of its transform from camera to world space."""
    first = poses[0]
    if len(poses) == 1:
        return first.origin, [first.right, first.up, first.forward]
    last = poses[1]
    rows = [
        dr.lerp(a, b, time) for a, b in ((first.right, last.right), (first.up, last.up), (first.forward, last.forward))
    ]
    # Camera space of a world point p is rows · (p − first origin) − shift.
    shift = last.origin - first.origin
    moved = [dr.dot(row, shift) * time for row in (last.right, last.up, last.forward)]
    crossed = [dr.cross(rows[1], rows[2]), dr.cross(rows[2], rows[0]), dr.cross(rows[0], rows[1])]
    inv = dr.rcp(dr.dot(rows[0], crossed[0]))
    columns = [column * inv for column in crossed]
    return first.origin + columns[0] * moved[0] + columns[1] * moved[1] + columns[2] * moved[2], columns
