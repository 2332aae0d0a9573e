"""Light paths as they leave a lamp: origin, direction, flux and ray differentials.

A lamp maps the 4D unit cube to rays and preserves measure. A sample has two 2D factors: u, on the lamp's extent, and v,
over directions or over the portal. A cell of either factor moves a path by an amount that is linear in its length, from
which `transport.segments.radii` computes the radii of beams. The flux of a path is radiance · area · solid angle, with
the cosines of the geometry, as an estimate of the whole lamp's flux (radiometry; Jarosz et al. 2008 for photons).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from ...runtime.device import Array3f, Bool, Float
from ..differentials import RayDifferentials
from ..warp import perpendicular

# Least cosine for a beam's width: along a surface, a beam would be infinitely wide.
GRAZING = 0.02

#: The attributes that light paths take over from emitted rays.
OF_PATHS = (
    "origin", "direction", "flux", "differentials", "count", "index", "key", "source", "link", "reach", "portal",
    "medium", "counts",
)  # fmt: skip


@dataclass
class EmittedRays:
    """Light paths as they leave a lamp, (N,) each.

    Attributes
    ----------
    origin, direction, flux, differentials
        Their rays; `flux` is one path's estimate of the whole lamp's flux, and its part of the flux once the stratum
        has divided it.
    portal
        The distance at which a path passes its portal, or infinity.
    valid
        Which paths exist at all: of paths through a portal, those that pass it.
    reach, medium
        The length of a path that meets nothing, and the number of the medium where it begins; the world adds them.
    count, index, key, source, link, counts, halvings
        See `transport.segments.records.LightPaths`, and `Stratum`, which adds them.
    """

    origin: Any
    direction: Any
    flux: Any
    differentials: RayDifferentials
    portal: Any
    valid: Any
    reach: Any = None
    medium: Any = None
    count: Any = None
    index: Any = None
    key: Any = None
    source: Any = None
    link: Any = None
    counts: Any = None
    halvings: int = 0

    @classmethod
    def fanned(cls, origin: Array3f, direction: Array3f, flux: Array3f, extent: Float, density: Float) -> EmittedRays:
        """Return rays from positions that stay apart as they are, while directions of this density fan out.

        `extent` is the square root of the area over which positions are spread, across the rays.
        """
        width = dr.width(origin)
        none, one = dr.full(Float, 0, width), dr.full(Float, 1, width)
        differentials = isotropic(direction, (extent, one, none), (dr.rsqrt(density), none, one))
        return cls.whole(origin, direction, flux, differentials)

    @classmethod
    def whole(
        cls, origin: Array3f, direction: Array3f, flux: Array3f, differentials: RayDifferentials
    ) -> EmittedRays:  # fmt: skip
        """Return rays of a whole lamp, which all exist and know no portal."""
        width = dr.width(direction)
        return cls(origin, direction, flux, differentials, dr.full(Float, dr.inf, width), dr.full(Bool, True, width))

    @classmethod
    def of_face(
        cls, origin: Array3f, direction: Array3f, flux: Array3f, area: Float, cosine: Float, density: Float
    ) -> EmittedRays:  # fmt: skip
        """Return rays from a face of this area, at an angle with this cosine to its normal."""
        extent = dr.sqrt(area * dr.maximum(cosine, GRAZING))
        return cls.fanned(origin, direction, flux, extent, dr.maximum(density, GRAZING / np.pi))


def isotropic(direction: Array3f, *shifts: tuple[Float, Float, Float]) -> RayDifferentials:
    """Return the derivatives of rays by the four numbers of the emission sample.

    The maps preserve measure and are nearly isotropic: the two numbers of a pair move a path equally far, at right
    angles to each other. For each pair, `shifts` has its extent (the square root of its measure, 1 / density), and by
    which multiples of it a path is shifted and turned.
    """
    columns = []
    for extent, shift, turn in shifts:
        for side in perpendicular(direction):
            columns.append((side * (extent * shift), side * (extent * turn)))
    return RayDifferentials.of(columns)
