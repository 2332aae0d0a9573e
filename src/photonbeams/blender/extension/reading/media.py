"""Volume shaders of worlds and materials, as the attributes of `PhotonBeamsMediumAPI`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .nodes import Told, color_of, number_of, output_of, product_of, source_of
from .shading.evaluation import Evaluation, Points, UnknownNodeError

APIS = ["PhotonBeamsMediumAPI"]


@dataclass(frozen=True)
class Volume:
    """What a volume shader does.

    Attributes
    ----------
    scattering, absorption, anisotropy
        Coefficients per metre, (3,), and the mean cosine of what is scattered.
    density, color
        Grids by which the coefficients, and the scattering alone, are multiplied; "" for none.
    glow, glow_grid, kelvin
        What it emits per metre, (3,), where the grid is 1, or everywhere without one; or a factor on the light of a
        black body, whose temperature is the grid times so many kelvin.
    """

    scattering: Any
    absorption: Any
    anisotropy: float
    density: str = ""
    color: str = ""
    glow: Any = None
    glow_grid: str = ""
    kelvin: float = 0.0


_WISPS = ("scale", "contrast", "evolution")
_NOTHING = Volume(np.zeros(3), np.zeros(3), 0.0)


def medium_of(owner: Any, told: Told, density: float | None = None) -> dict[str, Any] | None:
    """Return the attributes of the volume of a material or a world; None if it has none.

    A density replaces that of the volume.
    """
    source = _source(owner)
    if source is None:
        return None
    found = _volume(source.node, lambda text: told(f"{owner.name}: {text}"), given=density)
    if found is None:
        return None
    return {
        "photonbeams:scattering": ["color3f", found.scattering.tolist()],
        "photonbeams:absorption": ["color3f", found.absorption.tolist()],
        "photonbeams:anisotropy": ["float", found.anisotropy],
        **({"photonbeams:emission": ["color3f", found.glow.tolist()]} if found.glow is not None else {}),
    }


def world_medium(world: Any, told: Told) -> dict[str, Any] | None:
    """Return the attributes of the fog of a world, and of how it varies; None if it has none."""
    found = medium_of(world, told)
    if found is None:
        return None
    own = world.photonbeams
    if own.fog_falloff > 0:
        found |= {
            f"photonbeams:height:{name}": ["float", getattr(own, f"fog_{name}")] for name in ("falloff", "ground")
        }
    if own.fog_noise > 0:
        numbers = {"amount": own.fog_noise, **{name: getattr(own, f"fog_noise_{name}") for name in _WISPS}}
        found |= {f"photonbeams:noise:{name}": ["float", value] for name, value in numbers.items()}
        found["photonbeams:noise:drift"] = ["float3", list(own.fog_noise_drift)]
    return found


def volume_of(material: Any, told: Told) -> Volume | None:
    """Return what the volume of the material of an object of grids does; None if it has none."""
    if material is None:
        return Volume(np.full(3, 0.5), np.full(3, 0.5), 0.0, "density")  # Blender's own
    source = _source(material)
    found = None if source is None else _volume(source.node, lambda text: told(f"{material.name}: {text}"), True)
    if found is None or found.density:
        return found
    told(f"{material.name}: its density comes from no grid: that of the grid density is used")
    return replace(found, density="density")


def hides_sky(world: Any, medium: dict[str, Any]) -> bool:
    """Return whether no light of a world's sky comes through its medium, as in Cycles, unless its beams are wanted."""
    scattering, absorption = (np.array(medium[f"photonbeams:{name}"][1]) for name in ("scattering", "absorption"))
    return bool(np.all(scattering + absorption > 0)) and not world.photonbeams.enabled


def has_volume(owner: Any) -> bool:
    """Return whether a material or a world has a volume."""
    return _source(owner) is not None


def _source(owner: Any) -> Any:
    """Return the socket that the volume of a material or a world comes from; None if it has none."""
    if owner is None or owner.node_tree is None:
        return None
    output = output_of(owner.node_tree, "OUTPUT_MATERIAL") or output_of(owner.node_tree, "OUTPUT_WORLD")
    return None if output is None else source_of(output.inputs["Volume"])


def density_at(owner: Any, points: Points) -> Any:
    """Return the densities (N,) of the volume of a material at points; None if they are even or not known."""
    source = _source(owner)
    socket = None if source is None else source.node.inputs.get("Density")
    if socket is None or not socket.is_linked:
        return None
    try:
        return Evaluation(points).input(socket)
    except UnknownNodeError:
        return None


def _volume(node: Any, told: Told, grids: bool = False, given: float | None = None) -> Volume | None:
    """Return what a volume shader does; with `grids`, also those that it reads; a density may be `given` instead."""
    match node.type:
        case "PRINCIPLED_VOLUME":
            density, grid = _density(node, told, grids, given)
            color, tint = _color(node, told, grids)
            absorbed = np.array(color_of(node, "Absorption Color", told))
            # As Cycles: what is not scattered is absorbed, except for the absorption colour.
            kept = np.maximum(1 - color, 0) * np.maximum(1 - np.sqrt(absorbed), 0)
            grid, tint = (grid or _text(node, "Density Attribute"), tint or _text(node, "Color Attribute"))
            found = Volume(density * color, density * kept, number_of(node, "Anisotropy", told), grid, tint)
            return _glowing(node, found, told, grids)
        case "VOLUME_SCATTER":
            density, grid = _density(node, told, grids, given)
            color, tint = _color(node, told, grids)
            if node.phase != "HENYEY_GREENSTEIN":
                told(f"{node.name} scatters as Henyey and Greenstein have it: its own phase is not rendered")
            return Volume(density * color, np.zeros(3), number_of(node, "Anisotropy", told), grid, tint)
        case "VOLUME_ABSORPTION":
            density, grid = _density(node, told, grids, given)
            color = np.array(color_of(node, "Color", told))
            return Volume(np.zeros(3), density * np.maximum(1 - color, 0), 0.0, grid)
        case "EMISSION":
            return _emitting(node, "Strength", "Color", _NOTHING, told, grids)
        case "ADD_SHADER":
            parts = [source_of(each) for each in node.inputs]
            return _added([_volume(each.node, told, grids, given) for each in parts if each is not None], told)
    told(f"the volume of {node.name} is not rendered")
    return None


def _added(parts: list[Volume | None], told: Told) -> Volume | None:
    """Return what several volumes in the same place do; None if there are none."""
    found = [each for each in parts if each is not None]
    if not found:
        return None
    weights = [each.scattering.sum() for each in found]
    mean = float(np.average([each.anisotropy for each in found], weights=weights)) if sum(weights) else 0.0
    grids = {each.density for each in found if (each.scattering + each.absorption).any()}
    if len(grids) > 1:
        told("volumes of several grids are added: the first grid is used for all of them")
    first = next((each for each in found if each.density in grids), found[0])
    even = [each.glow for each in found if each.glow is not None]
    glowing = next((each for each in found if each.glow_grid), replace(first, glow=sum(even) if even else None))
    return Volume(
        sum(each.scattering for each in found), sum(each.absorption for each in found), mean,
        first.density, next((each.color for each in found if each.color), ""),
        glowing.glow, glowing.glow_grid, glowing.kelvin,
    )  # fmt: skip


def _density(node: Any, told: Told, grids: bool, given: float | None) -> tuple[float, str]:
    """Return the density of a volume shader, and the grid that multiplies it."""
    if given is not None:
        return given, ""
    return _product(node, "Density", told) if grids else (number_of(node, "Density", told), "")


def _color(node: Any, told: Told, grids: bool) -> tuple[Any, str]:
    """Return the colour of a volume shader, and the grid that multiplies it."""
    grid = product_of(node, node.inputs["Color"], told)[1] if grids else ""
    return np.array((1.0, 1.0, 1.0) if grid else color_of(node, "Color", told)), grid


def _product(node: Any, name: str, told: Told) -> tuple[float, str]:
    """Return the number and the grid whose product an input is."""
    value, grid = product_of(node, node.inputs[name], told)
    return (value, grid) if isinstance(value, float) else (number_of(node, name, told), grid)


def _glowing(node: Any, volume: Volume, told: Told, grids: bool) -> Volume:
    """Return the volume of a Principled Volume with what it emits."""
    hot = number_of(node, "Blackbody Intensity", told)
    if grids and hot > 0 and (heat := _text(node, "Temperature Attribute")):
        tint = hot * np.array(color_of(node, "Blackbody Tint", told))
        return replace(volume, glow=tint, glow_grid=heat, kelvin=number_of(node, "Temperature", told))
    if hot > 0:
        told(f"the light of the black body in {node.name} is not rendered")
    return _emitting(node, "Emission Strength", "Emission Color", volume, told, grids)


def _emitting(node: Any, strength: str, color: str, volume: Volume, told: Told, grids: bool) -> Volume:
    """Return a volume with the emission of a shader of this strength and colour; in grids, even light is none."""
    number, grid = _product(node, strength, told) if grids else (number_of(node, strength, told), "")
    if number <= 0:
        return volume
    if grids and not grid:
        told(f"the light that {node.name} emits comes from no grid, which is not rendered")
        return volume
    return replace(volume, glow=number * np.array(color_of(node, color, told)), glow_grid=grid)


def _text(node: Any, name: str) -> str:
    return str(node.inputs[name].default_value)
