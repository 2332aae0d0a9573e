"""Volume shaders of worlds and materials, as the attributes of `PhotonBeamsMediumAPI`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import bpy
import numpy as np

from .nodes import color_of, number_of, product_of, telling
from .prims import Told, Values
from .shading.calls import Points, UnknownNodeError
from .shading.evaluation import Evaluation
from .shading.links import node_behind, source_at

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


def medium_of(owner: Any, told: Told, density: float | None = None) -> Values | None:
    """Return the attributes of the volume of a material or a world; None if it has none.

    A density replaces that of the volume.
    """
    source = _source(owner)
    if source is None:
        return None
    volume = _Reader(telling(told, owner.name), density=density).volume(source.node)
    if volume is None:
        return None
    colors = {"scattering": volume.scattering, "absorption": volume.absorption, "emission": volume.glow}
    values = {f"photonbeams:{name}": color.tolist() for name, color in colors.items() if color is not None}
    return {**values, "photonbeams:anisotropy": volume.anisotropy}


def world_medium(world: Any, told: Told) -> Values | None:
    """Return the attributes of the fog of a world, and of how it varies; None if it has none."""
    found = medium_of(world, told)
    if found is None:
        return None
    own = world.photonbeams
    if own.fog_falloff > 0:
        found |= {f"photonbeams:height:{name}": getattr(own, f"fog_{name}") for name in ("falloff", "ground")}
    if own.fog_noise > 0:
        numbers = {"amount": own.fog_noise, **{name: getattr(own, f"fog_noise_{name}") for name in _WISPS}}
        found |= {f"photonbeams:noise:{name}": value for name, value in numbers.items()}
        found["photonbeams:noise:drift"] = list(own.fog_noise_drift)
    return found


def volume_of(material: Any, told: Told) -> Volume | None:
    """Return what the volume of the material of an object of grids does; None if it has none."""
    if material is None:
        return Volume(np.full(3, 0.5), np.full(3, 0.5), 0.0, "density")  # Blender's own
    source = _source(material)
    found = None if source is None else _Reader(telling(told, material.name), grids=True).volume(source.node)
    if found is None or found.density:
        return found
    told(f"{material.name}: its density comes from no grid: that of the grid density is used")
    return replace(found, density="density")


def extinction_of(medium: Values) -> Any:
    """Return the extinction (3,) of a medium, by its attributes."""
    return np.array(medium["photonbeams:scattering"]) + medium["photonbeams:absorption"]


def hides_sky(world: Any, medium: Values) -> bool:
    """Return whether no light of a world's sky comes through its medium, as in Cycles, unless its beams are wanted."""
    return bool(np.all(extinction_of(medium) > 0)) and not world.photonbeams.enabled


def has_volume(owner: Any) -> bool:
    """Return whether a material or a world has a volume."""
    return _source(owner) is not None


def _source(owner: Any) -> Any:
    """Return the socket that the volume of a material or a world comes from; None if it has none."""
    if owner is None or owner.node_tree is None:
        return None
    kind = "OUTPUT_WORLD" if isinstance(owner, bpy.types.World) else "OUTPUT_MATERIAL"
    return source_at(owner.node_tree, kind, "Volume")


def density_at(owner: Any, points: Points) -> Any:
    """Return the densities (N,) of the volume of a material at points; None if they are even or not known."""
    source = _source(owner)
    socket = None if source is None else source.node.inputs.get("Density")
    if socket is None or not socket.is_linked:
        return None
    try:
        return Evaluation(points).input(socket)[:, 0]
    except UnknownNodeError:
        return None


@dataclass(frozen=True)
class _Reader:
    """Reads volume shaders.

    Attributes
    ----------
    told
        Called with a sentence about what is not rendered.
    grids
        Whether grids multiply densities, colours and emission.
    density
        What replaces the densities, if it is not None.
    """

    told: Told
    grids: bool = False
    density: float | None = None

    def volume(self, node: Any) -> Volume | None:
        """Return what a volume shader does."""
        match node.type:
            case "PRINCIPLED_VOLUME":
                density, grid = self._density(node)
                color, tint = self._color(node)
                absorbed = np.array(color_of(node, "Absorption Color", self.told))
                # As Cycles: what is not scattered is absorbed, except for the absorption colour.
                kept = np.maximum(1 - color, 0) * np.maximum(1 - np.sqrt(absorbed), 0)
                grid, tint = (grid or _text(node, "Density Attribute"), tint or _text(node, "Color Attribute"))
                return self._glowing(node, Volume(density * color, density * kept, self._mean_cosine(node), grid, tint))
            case "VOLUME_SCATTER":
                density, grid = self._density(node)
                color, tint = self._color(node)
                if node.phase != "HENYEY_GREENSTEIN":
                    self.told(f"{node.name} scatters as Henyey and Greenstein have it: its own phase is not rendered")
                return Volume(density * color, np.zeros(3), self._mean_cosine(node), grid, tint)
            case "VOLUME_ABSORPTION":
                density, grid = self._density(node)
                color = np.array(color_of(node, "Color", self.told))
                return Volume(np.zeros(3), density * np.maximum(1 - color, 0), 0.0, grid)
            case "EMISSION":
                return self._emitting(node, "Strength", "Color", Volume(np.zeros(3), np.zeros(3), 0.0))
            case "ADD_SHADER":
                parts = [self.volume(each) for each in map(node_behind, node.inputs) if each is not None]
                return _added([each for each in parts if each is not None], self.told)
        self.told(f"the volume of {node.name} is not rendered")
        return None

    def _mean_cosine(self, node: Any) -> float:
        return number_of(node, "Anisotropy", self.told)

    def _density(self, node: Any) -> tuple[float, str]:
        """Return the density of a volume shader, and the grid that multiplies it."""
        return self._product(node, "Density") if self.density is None else (self.density, "")

    def _color(self, node: Any) -> tuple[Any, str]:
        """Return the colour of a volume shader, and the grid that multiplies it."""
        grid = product_of(node, node.inputs["Color"], self.told)[1] if self.grids else ""
        return np.array((1.0, 1.0, 1.0) if grid else color_of(node, "Color", self.told)), grid

    def _product(self, node: Any, name: str) -> tuple[float, str]:
        """Return the number and the grid whose product an input is."""
        value, grid = product_of(node, node.inputs[name], self.told) if self.grids else (None, "")
        return (value if isinstance(value, float) else number_of(node, name, self.told)), grid

    def _glowing(self, node: Any, volume: Volume) -> Volume:
        """Return the volume of a Principled Volume with what it emits."""
        hot = number_of(node, "Blackbody Intensity", self.told)
        if self.grids and hot > 0 and (heat := _text(node, "Temperature Attribute")):
            tint = hot * np.array(color_of(node, "Blackbody Tint", self.told))
            return replace(volume, glow=tint, glow_grid=heat, kelvin=number_of(node, "Temperature", self.told))
        if hot > 0:
            self.told(f"the light of the black body in {node.name} is not rendered")
        return self._emitting(node, "Emission Strength", "Emission Color", volume)

    def _emitting(self, node: Any, strength: str, color: str, volume: Volume) -> Volume:
        """Return a volume with the emission of a shader of this strength and colour; in grids, even light is none."""
        number, grid = self._product(node, strength)
        if number <= 0:
            return volume
        if self.grids and not grid:
            self.told(f"the light that {node.name} emits comes from no grid, which is not rendered")
            return volume
        return replace(volume, glow=number * np.array(color_of(node, color, self.told)), glow_grid=grid)


def _added(volumes: list[Volume], told: Told) -> Volume | None:
    """Return what several volumes in the same place do; None if there are none."""
    if not volumes:
        return None
    weights = [each.scattering.sum() for each in volumes]
    mean = float(np.average([each.anisotropy for each in volumes], weights=weights)) if sum(weights) else 0.0
    grids = {each.density for each in volumes if (each.scattering + each.absorption).any()}
    if len(grids) > 1:
        told("volumes of several grids are added: the first grid is used for all of them")
    first = next((each for each in volumes if each.density in grids), volumes[0])
    even = [each.glow for each in volumes if each.glow is not None]
    glowing = next((each for each in volumes if each.glow_grid), replace(first, glow=sum(even) if even else None))
    return replace(
        glowing,
        scattering=sum(each.scattering for each in volumes), absorption=sum(each.absorption for each in volumes),
        anisotropy=mean, density=first.density, color=next((each.color for each in volumes if each.color), ""),
    )  # fmt: skip


def _text(node: Any, name: str) -> str:
    return str(node.inputs[name].default_value)
