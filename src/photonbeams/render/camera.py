"""Cameras: pinhole and orthographic, as UsdGeomCamera has them, as rays and as the screen that tiles are laid on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from .. import scene
from ..device import Array3f, Float, UInt32
from ..estimators.tiles import Projection


@dataclass(frozen=True)
class Window:
    """The picture: its full size in pixels, and the part of it (x0, y0, x1, y1) that is rendered."""

    width: int
    height: int
    crop: tuple[int, int, int, int]

    @classmethod
    def full(cls, width: int, height: int) -> Window:
        """Return the window of a whole picture."""
        return cls(width, height, (0, 0, width, height))

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the rendered part."""
        return self.crop[3] - self.crop[1], self.crop[2] - self.crop[0]


class View:
    """A camera that looks at a window: its rays and its projection. All its numbers are opaque to kernels.

    Where the picture's aspect is not the aperture's, the aperture is expanded, as UsdRenderSettings does by default.
    """

    def __init__(self, camera: scene.Camera, window: Window) -> None:
        self.camera, self.window = camera, window
        aspect = window.width / window.height
        apertures = max(camera.horizontal_aperture, camera.vertical_aperture * aspect)
        self.aperture = np.array([apertures, apertures / aspect])
        depth = 1.0 if camera.orthographic else camera.focal_length
        scale = np.array([window.width, window.height]) * depth / self.aperture
        offset = np.array([camera.horizontal_offset, camera.vertical_offset]) / depth * scale
        center = np.array([window.width, window.height]) / 2 + np.array([-1, 1]) * offset
        center = center - np.array(window.crop[:2])
        height, width = window.shape
        matrix = np.asarray(camera.to_world, dtype=np.float64)
        corners = np.abs(np.array([[0, 0], [width, height]]) - center) / scale
        edge_x, edge_y = corners.max(axis=0).tolist()
        self.projection = Projection(
            origin=_opaque(matrix[:3, 3]),
            right=_opaque(matrix[:3, 0]),
            up=_opaque(matrix[:3, 1]),
            forward=_opaque(-matrix[:3, 2]),
            scale=(dr.opaque(Float, scale[0]), dr.opaque(Float, scale[1])),
            center=(dr.opaque(Float, center[0]), dr.opaque(Float, center[1])),
            width=width,
            height=height,
            orthographic=camera.orthographic,
            edge_x=edge_x,
            edge_y=edge_y,
        )

    def rays(self, offset: tuple[float, float]) -> tuple[Any, Any]:
        """Return origins (1 or W · H) and unit directions (W · H) through each pixel at `offset` in [0, 1)²."""
        x, y = self.pixels()
        return self._through(Float(x) + dr.opaque(Float, offset[0]), Float(y) + dr.opaque(Float, offset[1]))

    def pixels(self) -> tuple[Any, Any]:
        """Return column and row of each pixel of the window, row by row."""
        height, width = self.window.shape
        index, columns = dr.arange(UInt32, width * height), dr.opaque(UInt32, width)
        return index % columns, index // columns

    def coarse_rays(self, columns: int, rows: int) -> tuple[Any, Any]:
        """Return rays on a coarse grid over the window."""
        height, width = self.window.shape
        index, across = dr.arange(UInt32, columns * rows), dr.opaque(UInt32, columns)
        x = (Float(index % across) + 0.5) * dr.opaque(Float, width / columns)
        y = (Float(index // across) + 0.5) * dr.opaque(Float, height / rows)
        return self._through(x, y)

    def _through(self, x: Any, y: Any) -> tuple[Any, Any]:
        view = self.projection
        right = (x - view.center[0]) / view.scale[0]
        up = (view.center[1] - y) / view.scale[1]
        if view.orthographic:
            origin = view.origin + view.right * right + view.up * up
            direction = view.forward + 0 * origin
        else:
            origin, direction = view.origin, dr.normalize(view.right * right + view.up * up + view.forward)
        dr.eval(origin, direction)
        return origin, direction

    def planar_depth(self, direction: Any, t: Any) -> Any:
        """Return the distance along the optical axis of the point at ray parameter t."""
        return t * dr.dot(direction, self.projection.forward)

    def matrices(self) -> dict[str, np.ndarray]:
        """Return worldToCamera and worldToNDC for row vectors, as EXR headers have them."""
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
        return {"worldToCamera": world.T, "worldToNDC": (screen @ project @ world).T}


def _opaque(vector: Any) -> Any:
    return dr.opaque(Array3f, [float(x) for x in vector])
