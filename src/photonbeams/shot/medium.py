"""Fog, by `PhotonBeamsMediumAPI`."""

from __future__ import annotations

from pxr import Usd, UsdGeom

from ..scene import Array, Medium
from .meshes import is_closed, is_gprim, read_solid
from .reading import Reading, has_photonbeams


def is_medium(prim: Usd.Prim) -> bool:
    """Return whether a prim describes fog."""
    return has_photonbeams(prim, "PhotonBeamsMediumAPI", "scattering", "absorption")


def read_medium(reading: Reading, prim: Usd.Prim, to_world: Array) -> Medium:
    """Return the fog of a prim: it fills a closed gprim, and of any other prim the whole space."""
    mesh = None
    if is_gprim(prim) and is_closed(reading, prim):
        mesh = read_solid(reading, prim, to_world)
    elif is_gprim(prim):
        reading.warn(prim, "is not closed: its fog fills the whole space")
    elif prim.IsA(UsdGeom.Gprim):
        reading.warn(prim, f"is a {prim.GetTypeName()}, which holds no fog: it fills the whole space")
    return Medium(
        scattering=reading.color(prim, "photonbeams:scattering", 0.0),
        absorption=reading.color(prim, "photonbeams:absorption", 0.0),
        anisotropy=reading.number(prim, "photonbeams:anisotropy", 0.0, -0.99, 0.99),
        mesh=mesh,
    )
