"""Fog, by `PhotonBeamsMediumAPI`."""

from __future__ import annotations

from pxr import Usd, UsdGeom

from ..scene import Array, Color, Medium, SceneError
from ..world.medium_colors import coefficients
from .meshes import is_closed, is_gprim, read_solid
from .reading import Reading, has_photonbeams


def is_medium(prim: Usd.Prim) -> bool:
    """Return whether a prim describes fog."""
    return has_photonbeams(prim, "PhotonBeamsMediumAPI", "scattering", "absorption", "nearColor", "farColor")


def read_medium(reading: Reading, prim: Usd.Prim, to_world: Array) -> Medium:
    """Return the fog of a prim: it fills a closed gprim, and of any other prim the whole space."""
    mesh = None
    if is_gprim(prim) and is_closed(reading, prim):
        mesh = read_solid(reading, prim, to_world)
    elif is_gprim(prim):
        reading.warn(prim, "is not closed: its fog fills the whole space")
    elif prim.IsA(UsdGeom.Gprim):
        reading.warn(prim, f"is a {prim.GetTypeName()}, which holds no fog: it fills the whole space")
    scattering, absorption = _coefficients(reading, prim)
    return Medium(
        scattering=scattering,
        absorption=absorption,
        anisotropy=reading.number(prim, "photonbeams:anisotropy", 0.0, -0.99, 0.99),
        mesh=mesh,
        surfaces=reading.flag(prim, "photonbeams:surfaces", True),
    )


def _coefficients(reading: Reading, prim: Usd.Prim) -> tuple[Color, Color]:
    """Return scattering and absorption: as they are given, or those that make the two colours."""
    names = ("photonbeams:nearColor", "photonbeams:farColor")
    given = [reading.value(prim, name) is not None for name in names]
    physical = ("photonbeams:scattering", "photonbeams:absorption")
    if not any(given):
        return reading.color(prim, physical[0], 0.0), reading.color(prim, physical[1], 0.0)
    if not all(given):
        missing, there = names[given.index(False)], names[given.index(True)]
        raise reading.fail(prim, missing, f"is not given: expected a colour, for there is {there}")
    if any(prim.GetAttribute(name).HasAuthoredValue() for name in physical):
        reading.warn(prim, "and farColor make the fog: scattering and absorption are not used", names[0])
    near, far = (reading.color(prim, name, 0.0) for name in names)
    try:
        return coefficients(
            near,
            far,
            reading.color(prim, "photonbeams:albedo", 1.0),
            reading.number(prim, "photonbeams:farDistance", 1.0),
        )
    except SceneError as error:
        raise SceneError(f"{reading.place(prim)}: {error}") from None
