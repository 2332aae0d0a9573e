"""The light of traced paths on surfaces: photons, and virtual lights."""

from __future__ import annotations

from typing import NamedTuple

from .photons import PhotonLighting
from .virtual_lights import VirtualLights


class SurfaceLight(NamedTuple):
    """Photons and virtual lights of a pass; None: there are none.

    Camera paths see all `photons` on the surfaces that they meet first, walks those of `caustics` where they come to.
    """

    photons: PhotonLighting | None = None
    caustics: PhotonLighting | None = None
    virtual: VirtualLights | None = None


NO_LIGHT = SurfaceLight()
