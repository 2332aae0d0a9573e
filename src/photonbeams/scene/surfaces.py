"""Meshes and their materials."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from .checks import BLACK, WHITE, Array, Color, SceneError, numbers
from .declared import arguments
from .vectors import Plane, Sides, plane_of

# The unit cube; its faces wind around the outward normals.
_CORNERS = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=np.float64)
_FACES = np.array(
    [[0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4], [2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6],
     [1, 3, 5], [3, 7, 5]]
)  # fmt: skip


@dataclass(frozen=True)
class UVTexture:
    """An image over the UV square.

    Attributes
    ----------
    pixels
        (H, W, 1) numbers or (H, W, 3) colours, scene-linear float32; the first row is at v = 1.
    wrap
        What lies outside of the square: "repeat" (the default), "clamp" or "mirror".
    uv_transform
        (3, 3) transform that is applied to (u, v, 1) before the lookup. Default: the identity.

    Examples
    --------
    >>> checker = np.array([[[0.1], [0.8]], [[0.8], [0.1]]], dtype=np.float32)
    >>> tiles = pb.scene.UVTexture(checker, uv_transform=np.diag([8, 8, 1]))
    >>> pb.scene.Material(diffuse=tiles).diffuse.wrap
    'repeat'
    """

    called = "{field} of a texture"

    pixels: Annotated[Array, partial(numbers, expected="(H, W, 1) or (H, W, 3) numbers")]
    wrap: str = "repeat"  # repeat | clamp | mirror
    uv_transform: Array = field(default_factory=lambda: np.eye(3))  # (3, 3), applied to (u, v, 1)

    def slopes(self) -> UVTexture:
        """Return a texture (H, W, 3) of the heights' derivatives by u and v, by central differences; the last is 0."""
        pixels, wrap, to_image = np.asarray(self.pixels[..., 0], dtype=np.float64), self.wrap, self.uv_transform
        if wrap == "mirror":  # slopes change their sign in every other square
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
    """Numbers or colours at the vertices of one mesh, interpolated linearly over its triangles.

    Attributes
    ----------
    values
        (V, 1) numbers or (V, 3) colours, one for each vertex.

    Examples
    --------
    >>> colors = pb.scene.VertexValues(np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1]]))
    >>> paint = pb.scene.Material(diffuse=colors)
    >>> mesh = pb.scene.Mesh("/Kite", [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], material=paint)
    >>> len(mesh.points) == len(mesh.material.diffuse.values)
    True
    """

    called = "{field} at vertices"

    values: Annotated[Array, partial(numbers, expected="(V, 1) or (V, 3) numbers")]


@dataclass(frozen=True)
class Material:
    """A material with the inputs of a UsdPreviewSurface that the renderer uses.

    Attributes
    ----------
    diffuse
        Diffuse reflectance, scene-linear, from 0 to 1: a colour, a `UVTexture` or `VertexValues`. Default 0.18.
    emissive
        Emitted radiance, a colour or a `UVTexture`. Default black.
    roughness
        From 0 (a mirror) to 1: a number or a `UVTexture`. Default 0.5.
    metallic
        From 0 (plastic, glass) to 1 (metal): a number or a `UVTexture`. Default 0.
    ior
        Index of refraction. Default 1.5.
    clearcoat, clearcoat_roughness
        Weight of a clear coat, and its roughness. Default 0 and 0.01.
    opacity
        From 0 to 1: a number, a `UVTexture` or `VertexValues`. Default 1.
    presence
        Whether opacity says where the surface is, as for a leaf that is cut out, and not how clear it is, as for
        glass. Default False.
    thin
        Whether a clear surface is a whole wall of glass, both of its sides in one, which does not bend light. So are
        flat sheets in any case. Default False.
    tint
        Colour that light is multiplied by where it passes through a clear surface: a colour, a `UVTexture` or
        `VertexValues`. Default white.
    normal
        Normals in tangent space, stored as (n + 1) / 2 in three channels. None, the default: the mesh's own normals.
    bump
        Heights in scene units, one channel, which tilt the normals; not used where there is `normal`. Default: none.
    name
        Prim path, by which cryptomattes name the material. Default: "", none.

    References
    ----------
    UsdPreviewSurface Specification, https://openusd.org/release/spec_usdpreviewsurface.html

    Examples
    --------
    >>> glass = pb.scene.Material(roughness=0.0, opacity=0.0, ior=1.5, tint=(0.9, 1.0, 0.95))
    >>> glass.presence, glass.perturbed
    (False, False)
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
    thin: bool = False
    tint: Color | UVTexture | VertexValues = WHITE
    normal: UVTexture | None = None
    bump: UVTexture | None = None
    name: str = ""

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
        Prim path, by which messages and lights refer to the mesh.
    points
        (V, 3) positions, scene units.
    faces
        (F, 3) whole numbers, which index points; faces wind counter-clockwise around the outward normal.
    normals
        (V, 3) shading normals. None, the default: the mesh is faceted.
    uvs
        (V, 2) texture coordinates. None, the default: the mesh has none.
    material
        Its `Material`. Default: 18 % grey.
    seen
        Whether the camera sees it where nothing reflects or refracts in between. Default True.
    blocks
        Whether it blocks the light of lights, and is met by their beams. Default True.
    holdout
        Whether the camera sees black of no opacity in its place, and the fog in front of that. Default False.

    Raises
    ------
    SceneError
        Arrays of another shape, numbers that are not finite, faces that index points that do not exist.

    Examples
    --------
    >>> floor = pb.scene.Mesh("/Floor", [[0, 0, 0], [0, 0, 2], [2, 0, 2], [2, 0, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> floor.area
    4.0
    >>> floor.plane().normal.round(3).tolist() in ([0, 1, 0], [0, -1, 0])  # a plane has two
    True
    """

    name: str
    points: Array
    faces: Array
    normals: Array | None = None
    uvs: Array | None = None
    material: Material = Material()
    seen: bool = True
    blocks: bool = True
    holdout: bool = False

    def __post_init__(self) -> None:
        for name, columns in (("points", 3), ("faces", 3), ("normals", 3), ("uvs", 2)):
            value = getattr(self, name)
            if value is None and name in ("normals", "uvs"):
                continue
            found = numbers(value, f"mesh {self.name}: {name}", "numbers")
            found = found if found.size else np.empty((0, columns), np.int64)
            rows = len(self.points) if name in ("normals", "uvs") else (*found.shape, 0)[0]
            if found.shape != (rows, columns) or found.dtype.kind not in ("iu" if name == "faces" else "fiu"):
                expected = (
                    f"({'F' if name == 'faces' else rows}, {columns}) {'whole ' if name == 'faces' else ''}numbers"
                )
                raise SceneError(f"mesh {self.name}: {name} have the shape {found.shape}: expected {expected}")
            if not np.all(np.isfinite(found)):
                raise SceneError(f"mesh {self.name}: {name} are not finite: expected finite numbers")
            object.__setattr__(self, name, found)
        wrong = self.faces[(self.faces < 0) | (self.faces >= len(self.points))]
        if len(wrong):
            text = f"expected 0 to {len(self.points) - 1}"
            raise SceneError(f"mesh {self.name}: faces name the point {wrong[0]}: {text}")

    @classmethod
    @arguments
    def box(
        cls, name: str, low: ArrayLike = (0, 0, 0), high: ArrayLike = (1, 1, 1), to_world: Array | None = None
    ) -> Mesh:  # fmt: skip
        """Return a box called `name` from `low` to `high`, (3,) each, under a (4, 4) transform for columns, `to_world`.

        Examples
        --------
        >>> mist = pb.Medium(scattering=0.1, mesh=pb.scene.Mesh.box("/Mist", (-2, 0, -2), (2, 3, 2)))
        >>> mist.mesh.volume
        48.0
        """
        ends = numbers([low, high], f"mesh {name}: [low, high]", "two corners of 3 numbers").astype(np.float64)
        matrix = numbers(np.eye(4) if to_world is None else to_world, f"mesh {name}: to_world", "4 x 4 numbers")
        if ends.shape != (2, 3) or matrix.shape != (4, 4):
            shapes = f"low and high have the shape {ends.shape[1:]}, to_world {matrix.shape}"
            raise SceneError(f"mesh {name}: {shapes}: expected (3,) and (4, 4)")
        points = ends[0] + _CORNERS * (ends[1] - ends[0])
        return cls(name, points @ matrix[:3, :3].T + matrix[:3, 3], _FACES)

    @property
    def area(self) -> float:
        """Area in square scene units."""
        corners = self.corners
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return 0.5 * float(np.linalg.norm(normals, axis=1).sum())

    @property
    def used_points(self) -> Array:
        """The points that belong to a triangle, (P, 3) float64, each once."""
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
        """Return a closed mesh with its faces wound around the outward normal, without normals, UVs and material."""
        faces = np.asarray(self.faces)
        return Mesh(self.name, self.points, faces if self.volume >= 0 else faces[:, ::-1])

    @cached_property
    def closed(self) -> bool:
        """Whether every edge has a face on each side; vertices at the same place count as one."""
        return is_closed(self.points, self.faces)

    def solid(self) -> Mesh:
        """Return a closed mesh with its faces and its normals outward."""
        faces, corners = np.asarray(self.faces), self.corners
        if self.volume < 0:
            faces, corners = faces[:, ::-1], corners[:, ::-1]
        outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        against = self.normals is not None and np.einsum("fi,fvi->", outward, self.normals[faces]) < 0
        if faces is self.faces and not against:
            return self
        return replace(self, faces=faces, normals=-self.normals if against else self.normals)  # type: ignore[operator]

    def winding(self, point: Array) -> float:
        """Return the winding number of a closed mesh around a `point` (3,): ±1 inside, 0 outside.

        References
        ----------
        A. van Oosterom and J. Strackee, "The Solid Angle of a Plane Triangle", IEEE TBME 30 (2), 1983.
        """
        a, b, c = np.moveaxis(self.corners - point, 1, 0)
        la, lb, lc = (np.linalg.norm(each, axis=1) for each in (a, b, c))
        top = np.einsum("ij,ij->i", a, np.cross(b, c))
        dots = [np.einsum("ij,ij->i", *pair) for pair in ((a, b), (b, c), (c, a))]
        return float(np.arctan2(top, la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb).sum() / (2 * np.pi))

    def plane(self) -> Plane | None:
        """Return the plane that the mesh lies in, or None if it is not flat."""
        return plane_of(self.used_points)

    def rectangle(self) -> Sides | None:
        """Return the smallest rectangle around a flat mesh that is parallel to one of its edges, or None."""
        plane = self.plane()
        if plane is None:
            return None
        edges = (self.corners - np.roll(self.corners, 1, axis=1)).reshape(-1, 3)
        edges = edges[np.linalg.norm(edges, axis=1) > 1e-9 * plane.extent]
        edges /= np.linalg.norm(edges, axis=1, keepdims=True)
        best: tuple[float, Sides] | None = None
        for x in edges:
            y = np.cross(plane.normal, x)
            local = (self.used_points - plane.center) @ np.array([x, y]).T
            low, size = local.min(axis=0), np.ptp(local, axis=0)
            if best is None or size[0] * size[1] < best[0] * (1 - 1e-9):
                best = float(size[0] * size[1]), (plane.center + low[0] * x + low[1] * y, size[0] * x, size[1] * y)
        assert best is not None
        return best[1]


def is_closed(points: Array, faces: Array) -> bool:
    """Return whether every edge of triangles, (F, 3), has one on each side; vertices at the same place are one."""
    _, place = np.unique(points, axis=0, return_inverse=True)
    corners = place.reshape(-1)[faces]
    edges = np.concatenate([corners[:, [i, (i + 1) % 3]] for i in range(3)])
    count = int(place.max(initial=0)) + 1
    there, back = np.sort(edges @ [count, 1]), np.sort(edges @ [1, count])
    return len(there) > 0 and bool(np.array_equal(there, back))
