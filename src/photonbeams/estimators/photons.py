"""Photons on surfaces, and the radiance that they reflect at points (Jensen 1996), each by its own disc.

    L = Σ Φ · f(ω) · k2(r/R, R),   k2 of Epanechnikov's profile (`looks.profiles`), ∫ k2 over the disc = 1

Each photon has a radius of its own: a point looks for the photons in whose discs it lies, not for its nearest photons.
So cells list the discs that touch them, and a point needs only the list of its own cell.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from ..looks.profiles import Epanechnikov
from ..numerics.arrays import packets
from ..numerics.grouped import GroupedLight
from ..numerics.syntax import syntax
from ..runtime.device import Array3f, Array4f, Bool, Float, Int32, UInt32
from .cells import ENTRIES, ROUNDING, CellGrid, CellLists, Entry, Sorting

#: A disc's half thickness, in radii: a point that is farther off belongs to another surface.
THICKNESS = 0.25
#: The least cosine between a disc's normal and that of a point that it lights: what is turned more is another surface.
FACING = 0.7


@dataclass
class Photons:
    """N photons that have met surfaces, each a disc."""

    position: Any  # (N, 3) centres of the discs
    radius: Any  # (N,)
    normal: Any  # (N, 3) unit normals, on the side from which the light came
    direction: Any  # (N, 3) unit vectors in the direction of the light
    power: Any  # (N, 3) flux
    depth: Any = 0  # (N,) scattering events before they met the surface, a UInt32, or one number for all
    group: Any = 0  # (N,) numbers of their light groups, a UInt32, or one number for all

    def __len__(self) -> int:
        """Return the number of photons."""
        return int(dr.width(self.position))


class PhotonMap:
    """Photons of a number of light groups in a grid, for `radiance`."""

    def __init__(self, photons: Photons, groups: int = 1) -> None:
        self._profile, self._groups = Epanechnikov(), groups
        self._lists: CellLists | None = None
        count = len(photons)
        if count == 0:
            return
        self._data = packets(
            (photons.position, photons.radius), (photons.normal, photons.depth),
            (photons.direction, photons.group), (photons.power, 0),
        )  # fmt: skip
        self._grid = _grid(photons)
        sorting = Sorting(self._grid.cells, self._visit, 0, count)
        self._lists = sorting.lists()

    def _visit(self, item: UInt32, lane: UInt32, entry: Entry) -> None:
        _cells_of(item, lane, self._data, self._grid, entry)

    def radiance(
        self, position: Array3f, normal: Array3f, reflect: Callable[[Array3f], Array3f], active: Bool | bool = True,
        most: UInt32 | None = None,
    ) -> GroupedLight:  # fmt: skip
        """Return the radiance that points reflect of the photons in whose discs they lie, (M, 3) by light groups.

        Parameters
        ----------
        position, normal
            (M, 3) the points, and the unit normals of the surface there.
        reflect
            Returns the fraction of light (Array3f) that is reflected, for the direction from which it comes (a unit
            vector away from the surface): a BSDF's value without the cosine. It is traced into the kernel.
        active
            (M,) the points for which radiance is computed.
        most
            (M,) the greatest depth of the photons that light a point, a UInt32; None if all photons do.
        """
        count = dr.width(position)
        if self._lists is None:
            return GroupedLight.dark(self._groups, count)
        active = dr.full(Bool, True, count) & active
        place = self._grid.local(position)
        cell = [self._grid.index(place[axis], axis) for axis in range(3)]
        for axis in range(3):
            active &= (place[axis] >= 0) & (place[axis] <= Float(self._grid.counts[axis]))
        first, stop = self._lists.of(self._grid.number(*cell), active)
        limit = Float(dr.inf) if most is None else Float(most)
        dark = GroupedLight.dark(self._groups, count)
        return _sum(
            first=first,
            stop=stop,
            items=self._lists.items,
            data=self._data,
            profile=self._profile,
            position=position,
            normal=normal,
            reflect=reflect,
            most=limit,
            radiance=dark,
        )


def _grid(photons: Photons) -> CellGrid:
    """Return the grid for the photons.

    With cells of two radii, a disc lies in four to eight cells, and a point tests (2 + 2)² / π discs for each disc in
    which it lies. Half of that size would double the entries and halve the tests; but entries cost more, and there are
    at least as many photons as points.
    """
    low, high = (
        np.array([float(value(axis)[0]) for axis in photons.position + sign * photons.radius])
        for value, sign in ((dr.min, -1), (dr.max, 1))
    )
    rounding = ROUNDING * float(max(np.abs(low).max(), np.abs(high).max()))
    low, high = low - rounding, high + rounding
    sums = [float(dr.sum(photons.radius**power)[0]) for power in range(4)]
    count = len(photons)
    size = max(2 * np.sqrt(sums[2] / count), 8 * rounding)
    # The number of cells that a disc touches follows from its volume, surface and width, as for beams.
    while (
        2 * np.pi * THICKNESS * sums[3] / size**3
        + 1.5 * np.pi * (1 + 2 * THICKNESS) * sums[2] / size**2
        + 1.5 * (np.pi + 2 * THICKNESS) * sums[1] / size
        + count
    ) > max(ENTRIES, 2 * count):
        size *= 1.25
    return CellGrid.of(low, high, size, rounding)


@syntax
def _cells_of(item: UInt32, lane: UInt32, data: Float, grid: CellGrid, entry: Entry) -> None:
    """Visit the cells in which a photon's disc may lie: those around it that are near its centre and its plane."""
    place, normal = dr.gather(Array4f, data, item * 4), dr.gather(Array4f, data, item * 4 + 1).xyz
    centre, radius = grid.local(place.xyz), place.w * grid.inv
    # A disc with this thickness lies in a ball around its centre, and in a box around its rim and its thickness.
    flat = dr.sqrt(dr.maximum(1 - normal * normal, 0)) + THICKNESS * dr.abs(normal)
    half = dr.minimum(flat, 1) * radius + grid.margin
    x0, last_x = grid.span(centre.x - half.x, centre.x + half.x, 0)
    y0, last_y = grid.span(centre.y - half.y, centre.y + half.y, 1)
    z, last_z = grid.span(centre.z - half.z, centre.z + half.z, 2)
    # The last term is half of a cell's extent along the normal.
    above = dr.fma(radius, THICKNESS, grid.margin) + 0.5 * dr.sum(dr.abs(normal))
    reach2 = dr.square(radius + grid.margin)
    while z <= last_z:
        y = Int32(y0)
        while y <= last_y:
            x = Int32(x0)
            while x <= last_x:
                middle = Array3f(Float(x), Float(y), Float(z)) + 0.5 - centre
                nearest = dr.maximum(dr.abs(middle) - 0.5, 0)
                near = (dr.squared_norm(nearest) <= reach2) & (dr.abs(dr.dot(middle, normal)) <= above)
                entry(grid.number(x, y, z), item, lane, near)
                x += 1
            y += 1
        z += 1


@syntax
def _sum(
    first: UInt32, stop: UInt32, items: UInt32, data: Float, profile: Epanechnikov, position: Array3f, normal: Array3f,
    reflect: Callable[[Array3f], Array3f], most: Float, radiance: GroupedLight,
) -> GroupedLight:  # fmt: skip
    """Add to the radiance that of the photons of each lane's list in whose discs the lane's point lies."""
    i = UInt32(first)
    while i < stop:
        base = dr.gather(UInt32, items, i) * 4
        place, facing = dr.gather(Array4f, data, base), dr.gather(Array4f, data, base + 1)
        offset, up = position - place.xyz, facing.xyz
        inv_radius = dr.rcp(place.w)
        rho2 = dr.squared_norm(offset) * dr.square(inv_radius)
        flat = dr.abs(dr.dot(offset, up)) < THICKNESS * place.w
        if (rho2 < 1) & flat & (dr.dot(normal, up) > FACING) & (facing.w <= most):
            turned, power = dr.gather(Array4f, data, base + 2), dr.gather(Array4f, data, base + 3).xyz
            light = power * reflect(-turned.xyz) * (profile.density(rho2) * dr.square(inv_radius))
            radiance = radiance + GroupedLight.of(light, UInt32(turned.w), len(radiance.parts))
        i += 1
    return radiance
