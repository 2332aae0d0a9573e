"""Projections: where a camera is, and what it sees of camera space, in pixels and tiles."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import drjit as dr

from ..runtime.device import Array2f, Array3f, Float, UInt32

#: Width and height of a tile in pixels.
TILE = 16


@dataclass
class Pose:
    """Where a camera is: its position and its unit vectors in world space (Dr.Jit, opaque)."""

    origin: Any
    right: Any
    up: Any
    forward: Any

    def to_camera(self, point: Array3f) -> Array3f:
        """Return a world point in camera space: x right, y up, z forward."""
        q = point - self.origin
        return Array3f(dr.dot(q, self.right), dr.dot(q, self.up), dr.dot(q, self.forward))


class _PixelCounts(NamedTuple):
    """Numbers of pixels of a projection, and of tiles in a row, for kernels (opaque)."""

    across: Any
    down: Any
    left: Any
    top: Any
    columns: Any


@dataclass(frozen=True)
class SeenPlace:
    """How a view sees places: where in the picture, in pixels, how deep and how far, and the way to the camera.

    Places behind the camera have no positive depth.
    """

    at: Array2f
    depth: Float
    distance: Float
    toward: Array3f


@dataclass
class Projection:
    """Camera space and screen of one view.

    Attributes
    ----------
    poses
        Where the camera is: once, or at shutter open and at shutter close. In between, objects at rest move linearly
        through camera space.
    scale
        Pixels per unit of slope (perspective), or per scene unit (orthographic), along x and along y.
    center
        Pixel position of the optical axis.
    width, height
        Image size in pixels.
    edge_x, edge_y
        Greatest |x/z| and |y/z| in the picture (perspective); opaque, because each lens and crop has its own.
    lens
        Radius of the lens and the distance at which it is in focus (opaque); None for a pinhole.
    margin
        Numbers of pixels without rays at the left and at the top; with them, tiles are those of a larger picture.
    """

    poses: tuple[Pose, ...]
    scale: tuple[Any, Any]
    center: tuple[Any, Any]
    width: int
    height: int
    orthographic: bool
    edge_x: Any
    edge_y: Any
    lens: tuple[Any, Any] | None = None
    margin: tuple[int, int] = (0, 0)

    @property
    def across(self) -> int:
        """Number of pixels with rays in a row."""
        return self.width - self.margin[0]

    @property
    def down(self) -> int:
        """Number of rows with rays."""
        return self.height - self.margin[1]

    @property
    def origin(self) -> Any:
        """Position of the camera, at shutter open where it moves."""
        return self.poses[0].origin

    @property
    def columns(self) -> int:
        """Number of tiles in a row."""
        return -(-self.width // TILE)

    @property
    def rows(self) -> int:
        """Number of rows of tiles."""
        return -(-self.height // TILE)

    @property
    def tiles(self) -> int:
        """Number of tiles."""
        return self.columns * self.rows

    def seen(self, place: Array3f) -> SeenPlace:
        """Return how the view sees places, from where the camera is at first."""
        pose, (sx, sy), (cx, cy) = self.poses[0], self.scale, self.center
        q, offset = pose.to_camera(place), place - pose.origin
        if self.orthographic:
            return SeenPlace(Array2f(cx + sx * q.x, cy - sy * q.y), q.z, q.z, -pose.forward + 0 * offset)
        inverse, distance = dr.rcp(dr.maximum(q.z, 1e-30)), dr.norm(offset)
        toward = -offset * dr.rcp(dr.maximum(distance, 1e-30))
        return SeenPlace(Array2f(cx + sx * q.x * inverse, cy - sy * q.y * inverse), q.z, distance, toward)

    @cached_property
    def counts(self) -> _PixelCounts:
        """Its numbers of pixels and tiles, made once for all kernels."""
        return _PixelCounts(*(dr.opaque(UInt32, each) for each in (self.across, self.down, *self.margin, self.columns)))

    def reduced(self, level: int, margin: tuple[int, int]) -> Projection:
        """Return the projection with pixels 2^`level` as wide, after adding a `margin` of pixels at left and top."""
        factor = dr.opaque(Float, 1 / (1 << level))
        (sx, sy), (cx, cy) = self.scale, self.center
        width, height = (-(-(size + own) >> level) for size, own in zip((self.width, self.height), margin, strict=True))
        center = cx + dr.opaque(Float, margin[0]), cy + dr.opaque(Float, margin[1])
        return replace(
            self, scale=(sx * factor, sy * factor), center=(center[0] * factor, center[1] * factor),
            width=width, height=height,
        )  # fmt: skip
