"""Media, by `PhotonBeamsMediumAPI`: on closed gprims, on volumes of fields, and of the whole space."""

from __future__ import annotations

from pxr import Usd, UsdGeom, UsdVol

from ..scene import Array, Color, Medium, SceneError
from ..world.medium_colors import coefficients
from .meshes import is_closed, is_gprim, read_solid
from .reading import Reading, has_photonbeams
from .volumes import read_grid


def is_medium(prim: Usd.Prim) -> bool:
    """Return whether a prim describes fog."""
    return has_photonbeams(prim, "PhotonBeamsMediumAPI", "scattering", "absorption", "nearColor", "farColor")


def read_medium(reading: Reading, prim: Usd.Prim, to_world: Array, name: str) -> Medium | None:
    """Return the medium of a prim: it fills a closed gprim or a grid, and of any other prim the whole space.

    None, with a warning, where its grid is in a file of a kind that is not read.
    """
    mesh = grid = None
    if prim.IsA(UsdVol.Volume):
        grid = read_grid(reading, prim, to_world)
        if grid is None:
            return None
    elif is_gprim(prim) and is_closed(reading, prim):
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
        name=name,
        grid=grid,
        bounces=read_bounces(reading, prim),
    )


def read_bounces(reading: Reading, prim: Usd.Prim) -> int | None:
    """Return how often light is scattered, as a medium or a light says; None where it does not."""
    value = reading.value(prim, "photonbeams:bounces")
    if value is None:
        return None
    if not isinstance(value, int) or value < 0:
        raise reading.fail(prim, "photonbeams:bounces", f"is {value}: expected a whole number from 0 on")
    return int(value)


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
