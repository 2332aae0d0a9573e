"""Meshes and their materials."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .checks import BLACK, WHITE, Array, Color, SceneError
from .vectors import Plane, plane_of


@dataclass(frozen=True)
class UVTexture:
    """An image over the UV square: `pixels` (H, W, 1 or 3), scene-linear float32, first row at v = 1."""

    pixels: Array
    wrap: str = "repeat"  # repeat | clamp | mirror
    uv_transform: Array = field(default_factory=lambda: np.eye(3))  # (3, 3), applied to (u, v, 1)

    def slopes(self) -> UVTexture:
        """Return the derivatives of heights (H, W, 1) by u and v, (H, W, 3) with zeros last: central differences."""
        pixels, wrap, to_image = np.asarray(self.pixels[..., 0], dtype=np.float64), self.wrap, self.uv_transform
        if wrap == "mirror":  # where slopes change their sign in every other square
            pixels = np.block([[pixels[::-1], pixels[::-1, ::-1]], [pixels, pixels[:, ::-1]]])
            wrap, to_image = "repeat", np.diag([0.5, 0.5, 1.0]) @ to_image
        padded = np.pad(pixels, 1, "wrap" if wrap == "repeat" else "edge")
        rows, columns = pixels.shape
        along_u = (padded[1:-1, 2:] - padded[1:-1, :-2]) * columns / 2
        along_v = (padded[:-2, 1:-1] - padded[2:, 1:-1]) * rows / 2  # the first row is at v = 1
        slopes = np.stack([along_u, along_v], axis=-1) @ to_image[:2, :2]
        result = np.concatenate([slopes, np.zeros((rows, columns, 1))], axis=-1)
        return UVTexture(result.astype(np.float32), wrap, to_image)


@dataclass(frozen=True)
class VertexValues:
    """A number or a colour at each vertex of one mesh, (V, 1 or 3), linear in between."""

    values: Array


@dataclass(frozen=True)
class Material:
    """The inputs of a UsdPreviewSurface that the renderer uses.

    Attributes
    ----------
    presence
        Whether opacity says where the surface is, instead of how clear it is.
    tint
        What a clear surface multiplies light by that it lets through.
    normal
        Normals in tangent space, n / 2 + 1 / 2 in three channels; None: the mesh's own.
    bump
        Heights in scene units, one channel, which tilt the normals; None, or where there is `normal`: flat.
    """

    diffuse: Color | UVTexture | VertexValues = (0.18, 0.18, 0.18)
    emissive: Color | UVTexture = BLACK
    roughness: float | UVTexture = 0.5
    metallic: float | UVTexture = 0.0
    ior: float = 1.5
    clearcoat: float = 0.0
    clearcoat_roughness: float = 0.01
    opacity: float | UVTexture | VertexValues = 1.0
    presence: bool = False
    tint: Color = WHITE
    normal: UVTexture | None = None
    bump: UVTexture | None = None

    @property
    def perturbed(self) -> bool:
        """Whether a normal or bump map tilts the mesh's normals."""
        return self.normal is not None or self.bump is not None


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh in world space; vertices are split wherever their normal or UV is not shared.

    Attributes
    ----------
    name
        Prim path.
    points, faces
        (V, 3) float64 and (F, 3) int; faces wind counter-clockwise around the outward normal.
    normals, uvs
        (V, 3) and (V, 2), or None: faceted, no texture coordinates.

    Raises
    ------
    SceneError
        Arrays of another shape, points that are not finite, faces of points that are not there.
    """

    name: str
    points: Array
    faces: Array
    normals: Array | None = None
    uvs: Array | None = None
    material: Material = Material()

    def __post_init__(self) -> None:
        for name, columns in (("points", 3), ("faces", 3), ("normals", 3), ("uvs", 2)):
            value = getattr(self, name)
            if value is None and name in ("normals", "uvs"):
                continue
            numbers = np.asarray(value) if np.size(value) else np.empty((0, columns), np.int64)
            rows = len(numbers) if name == "faces" else len(self.points)
            if numbers.shape != (rows, columns) or numbers.dtype.kind not in ("iu" if name == "faces" else "fiu"):
                expected = (
                    f"({'F' if name == 'faces' else rows}, {columns}) {'whole ' if name == 'faces' else ''}numbers"
                )
                raise SceneError(f"mesh {self.name}: {name} have the shape {numbers.shape}: expected {expected}")
            if not np.all(np.isfinite(numbers)):
                raise SceneError(f"mesh {self.name}: {name} are not finite: expected finite numbers")
            object.__setattr__(self, name, numbers)
        wrong = self.faces[(self.faces < 0) | (self.faces >= len(self.points))]
        if len(wrong):
            text = f"expected 0 to {len(self.points) - 1}"
            raise SceneError(f"mesh {self.name}: faces name the point {wrong[0]}: {text}")

    @property
    def area(self) -> float:
        """Area in square scene units."""
        corners = self.corners
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return 0.5 * float(np.linalg.norm(normals, axis=1).sum())

    @property
    def used_points(self) -> Array:
        """The points that a triangle has, (P, 3) float64, each once."""
        return np.asarray(self.points, dtype=np.float64)[np.unique(self.faces)]

    @property
    def corners(self) -> Array:
        """The triangles' corners, (F, 3, 3) float64."""
        return np.asarray(self.points, dtype=np.float64)[np.asarray(self.faces).reshape(-1, 3)]

    @property
    def volume(self) -> float:
        """Volume of a closed mesh in cubic scene units, negative where its faces wind around the inward normal."""
        a, b, c = np.moveaxis(self.corners, 1, 0)
        return float(np.einsum("ij,ij->", a - a[0], np.cross(b - a[0], c - a[0]))) / 6

    def outward(self) -> Mesh:
        """Return the shape of a closed mesh with its faces wound around the outward normal."""
        faces = np.asarray(self.faces)
        return Mesh(self.name, self.points, faces if self.volume >= 0 else faces[:, ::-1])

    def winding(self, point: Array) -> float:
        """Return the winding number of a closed mesh around a point, ±1 inside (van Oosterom and Strackee 1983)."""
        a, b, c = np.moveaxis(self.corners - point, 1, 0)
        la, lb, lc = (np.linalg.norm(each, axis=1) for each in (a, b, c))
        top = np.einsum("ij,ij->i", a, np.cross(b, c))
        dots = [np.einsum("ij,ij->i", *pair) for pair in ((a, b), (b, c), (c, a))]
        return float(np.arctan2(top, la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb).sum() / (2 * np.pi))

    def plane(self) -> Plane | None:
        """Return the plane that the mesh lies in, or None where it is not flat."""
        return plane_of(self.used_points)
