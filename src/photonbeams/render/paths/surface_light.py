"""The light of traced paths on surfaces: photons, and virtual lights."""

from __future__ import annotations

from typing import NamedTuple

from .photons import PhotonLighting
from .virtual_lights import VirtualLights


class SurfaceLight(NamedTuple):
    """Photons and virtual lights of a pass; None: there are none."""

    photons: PhotonLighting | None = None
    virtual: VirtualLights | None = None


NO_LIGHT = SurfaceLight()
