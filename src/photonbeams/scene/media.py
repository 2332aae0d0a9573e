"""Media."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Annotated

import numpy as np

from .checks import BLACK, IDENTITY, Array, Color, ColorLike, Count, SceneError, Tint, color, number, numbers, shown
from .fog_density import FogDensity
from .surfaces import Mesh

# Mean free paths across a medium on a grid, at its greatest extinction. Paths take a step for each of them, also where
# the grid is empty; dense clouds have a thousand.
_MOST_DEPTH = 1e4


# Falloffs above the ground at which fog ends: there it has 1e-6 of its density.
_THINNEST = 14.0


def check_depth(extinction: float, to_world: Array, name: str) -> None:
    """Raise SceneError if a medium's box, the unit cube under `to_world`, is too deep at its greatest extinction."""
    depth = extinction * float(np.linalg.norm(np.asarray(to_world)[:3, :3], axis=0).max())
    if not depth <= _MOST_DEPTH:
        text = f"has an extinction of up to {extinction:.3g}, which is {depth:.3g} mean free paths across its grid"
        raise SceneError(f"{name} {text}: expected up to {_MOST_DEPTH:g}")


@dataclass(frozen=True)
class DensityGrid:
    """A density, or another quantity of a medium, on a grid of cells.

    Attributes
    ----------
    values
        (Z, Y, X), or (Z, Y, X, 3) with a value per channel, float32, 0 or more: the density at the centres of the
        cells, interpolated linearly between them. Outside of the grid it is 0.
    to_world
        (4, 4) transform from the unit cube, which the grid fills, to world space, for column vectors. Default: the
        identity.

    Raises
    ------
    SceneError
        Values of another shape, negative or not finite; a transform that is not finite, or cannot be inverted.

    Examples
    --------
    >>> z, y, x = np.meshgrid(*3 * [np.linspace(-1, 1, 16)], indexing="ij")
    >>> puff = pb.scene.DensityGrid(np.maximum(1 - x**2 - y**2 - z**2, 0), np.diag([4, 4, 4, 1]))
    >>> smoke = pb.Medium(scattering=0.5, grid=puff)  # 4 scene units wide
    >>> smoke.grid.values.dtype
    dtype('float32')
    """

    values: Array
    to_world: Array = IDENTITY

    def __post_init__(self) -> None:
        with np.errstate(over="ignore"):  # what is too large for single precision is infinite, and refused below
            values = numbers(self.values, "grid", "finite numbers of 0 or more").astype(np.float32, copy=False)
        if not (values.ndim == 3 or (values.ndim == 4 and values.shape[3] == 3)) or not values.size:
            raise SceneError(f"grid has the shape {values.shape}: expected (Z, Y, X) or (Z, Y, X, 3), none of them 0")
        if not np.all(np.isfinite(values)) or values.min() < 0:
            raise SceneError("grid has values that are negative or not finite: expected finite numbers of 0 or more")
        to_world = numbers(self.to_world, "a grid's to_world", "an invertible (4, 4) matrix").astype(np.float64)
        if to_world.shape != (4, 4) or not np.all(np.isfinite(to_world)) or abs(np.linalg.det(to_world)) < 1e-30:
            raise SceneError("grid has a transform that is flat or not finite: expected an invertible (4, 4) matrix")
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "to_world", to_world)


@dataclass(frozen=True)
class Medium:
    """A participating medium (fog): homogeneous, or with its density on a grid.

    Attributes
    ----------
    scattering
        Scattering coefficient σs per scene unit, one number or one for each channel; on a grid, at density 1.
    absorption
        Absorption coefficient σa per scene unit, one number or one for each channel; on a grid, at density 1.
        Default: 0.
    anisotropy
        Mean cosine g of the Henyey–Greenstein phase function, −0.99 to 0.99. Default: 0.
    mesh
        The closed surface that the medium fills. Default: None, it fills the whole space, or its grid.
    surfaces
        Whether the medium dims surfaces that are seen through it, and light on its way to them. If not, it affects
        beams alone. Default: True.
    name
        Prim path, for messages. Default: "".
    grid
        The density. Default: None, density 1 everywhere.
    bounces
        Number of times that light is scattered in the medium before it is scattered toward the camera. Default: None,
        the renderer's choice.
    scattering_color
        For a medium on a grid: factors of its scattering, from 0 to 1; light that they take away is absorbed.
        Default: None, 1 everywhere.
    emission
        The radiance that it emits per scene unit, which only cameras see: on a grid a grid, else a colour. Default:
        None, no emission.
    density
        A factor on the coefficients that falls with height, or has wisps: a `scene.FogDensity`. A medium without a
        mesh then ends at a box around the scene. Default: None, 1 everywhere.

    Raises
    ------
    SceneError
        If a coefficient is negative, not finite, or neither one number nor three; if the anisotropy is beyond ±0.99; if
        the number of bounces is negative; if there is a grid and a mesh or a density, too; if there are colours or
        emission without a grid, or a colour of emission on one; if an endless medium emits what it does not absorb or
        scatter; or if numbers have gradients enabled: use `looks.Fog` for those.

    Notes
    -----
    The extinction coefficient is σt = σs + σa: light falls by exp(−σt s) over s scene units.

    References
    ----------
    Henyey, Greenstein, "Diffuse Radiation in the Galaxy" (1941).

    Examples
    --------
    A fog that swallows blue light first:

    >>> fog = pb.Medium(scattering=0.05, absorption=(0.0, 0.01, 0.03), anisotropy=0.4)
    >>> [round(channel, 3) for channel in fog.extinction]
    [0.05, 0.06, 0.08]
    """

    scattering: Tint
    absorption: Tint = BLACK
    anisotropy: Annotated[float, partial(number, minimum=-0.99, maximum=0.99)] = 0.0
    mesh: Mesh | None = None
    surfaces: bool = True
    name: str = ""
    grid: DensityGrid | None = None
    bounces: Count | None = None
    scattering_color: DensityGrid | None = None
    emission: Color | DensityGrid | None = None
    density: FogDensity | None = None

    if TYPE_CHECKING:  # the generated one would take only what the fields hold

        def __init__(
            self,
            scattering: ColorLike,
            absorption: ColorLike = BLACK,
            anisotropy: float = 0.0,
            mesh: Mesh | None = None,
            surfaces: bool = True,
            name: str = "",
            grid: DensityGrid | None = None,
            bounces: int | None = None,
            scattering_color: DensityGrid | None = None,
            emission: ColorLike | DensityGrid | None = None,
            density: FogDensity | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        if self.mesh is not None and self.grid is not None:
            raise SceneError(f"medium {self.name}: has a mesh and a grid: expected one of them")
        if self.density is not None and not isinstance(self.density, FogDensity):
            raise SceneError(f"density is {shown(self.density)}: expected a FogDensity, or None")
        if self.density is not None and self.grid is not None:
            raise SceneError(f"medium {self.name}: has a grid and a density: expected one of them")
        if self.grid is not None:
            check_depth(max(self.extinction) * float(self.grid.values.max()), self.grid.to_world, f"medium {self.name}")
        if self.grid is None and (self.scattering_color is not None or isinstance(self.emission, DensityGrid)):
            raise SceneError(f"medium {self.name}: has colours or emission on a grid: expected a density grid, too")
        if self.emission is not None and not isinstance(self.emission, DensityGrid):
            self._check_emission()

    def _check_emission(self) -> None:
        """Make emission that is even a colour, None if it is black; raise SceneError if it cannot be rendered."""
        emitted = color(self.emission, "emission")  # type: ignore[arg-type]
        object.__setattr__(self, "emission", emitted if any(emitted) else None)
        if any(emitted) and self.grid is not None:
            raise SceneError(f"medium {self.name}: emits a colour on a grid: expected a DensityGrid of what it emits")
        endless = any(light > 0 and not stopped for light, stopped in zip(emitted, self.extinction, strict=True))
        if not self.bounded and endless:
            text = "expected absorption in each channel that it emits, or a mesh that it fills"
            raise SceneError(f"medium {self.name}: emits light without end: {text}")

    @property
    def extinction(self) -> Color:
        """σt = σs + σa, per channel and scene unit."""
        return tuple(s + a for s, a in zip(self.scattering, self.absorption, strict=True))  # type: ignore[return-value]

    @property
    def bounded(self) -> bool:
        """Whether the medium fills a mesh or a grid, not the whole space."""
        return self.mesh is not None or self.grid is not None

    @cached_property
    def boundary(self) -> Mesh | None:
        """The closed mesh around the medium, with its faces outward; None if the medium fills the whole space."""
        if self.mesh is not None:
            return self.mesh.outward()
        if self.grid is None:
            return None
        return Mesh.box(self.name, to_world=self.grid.to_world).outward()

    @property
    def varies(self) -> bool:
        """Whether the medium has a density that is not the same everywhere."""
        return self.density is not None and not self.density.even

    def at(self, up: str, seconds: float) -> Medium:
        """Return the medium whose density has an axis `up`, and a time in `seconds`, where it had none."""
        density = None if self.density is None else self.density.at(up, seconds)
        return self if density is self.density else replace(self, density=density)

    def within(self, center: Array, radius: float) -> Medium:
        """Return the medium; one of the whole space whose density varies gets a box around a sphere.

        The sphere has a `center` (3,) and a `radius`.
        """
        if self.bounded or not self.varies:
            return self
        assert self.density is not None
        low, high = (np.asarray(center, dtype=np.float64) + sign * radius for sign in (-1, 1))
        axis, falloff = self.density.axis, self.density.falloff
        if falloff is not None:  # there is no more of it above, and paths need not look for it there
            top = max(self.density.ground + self.density.zero[axis], low[axis]) + _THINNEST * falloff
            high[axis] = min(high[axis], top)
        return replace(self, mesh=Mesh.box(f"{self.name} fog", low, high))
