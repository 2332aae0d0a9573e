"""Mesh lights: gprims with UsdLuxMeshLightAPI, and glowing gprims that make beams or are a stage's only light."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...scene import Array, Mesh, UVTexture
from ..common.openusd import Usd, UsdLux
from ..common.reading import Reading
from ..geometry.meshes import is_closed, is_gprim

_TINTED, _INDEPENDENT, _ALONE = "materialGlowTintsLight", "independent", "noMaterialResponse"


@dataclass(frozen=True)
class MeshGlow:
    """What a mesh emits as a light: a factor on the light's radiance, and perhaps an image."""

    mesh: Mesh
    tint: Array
    image: UVTexture | None
    surface: bool
    both_sides: bool


def is_asked(prim: Usd.Prim) -> bool:
    """Return whether a gprim without a light API is set to make beams from the light that its material emits."""
    if prim.HasAPI(UsdLux.LightAPI) or not is_gprim(prim):
        return False
    enabled = prim.GetAttribute("photonbeams:enabled")
    told = bool(enabled) and enabled.HasAuthoredValue() and enabled.Get() is not False
    return told or "PhotonBeamsLightAPI" in prim.GetAppliedSchemas()


def read_glow(reading: Reading, prim: Usd.Prim, meshes: Sequence[Mesh]) -> MeshGlow | None:
    """Return what a gprim with these meshes emits, or None, with a warning, if it cannot emit.

    If `light:materialSyncMode` makes the material's glow tint the light, but no material glows, the light is not
    tinted.
    """
    parts = [mesh for mesh in meshes if len(mesh.faces) and mesh.area > 0]
    if not parts:
        reading.warn(prim, "is a light without a surface: it does not shine")
        return None
    glowing = [mesh for mesh in parts if glows(mesh)]
    if is_asked(prim) and not glowing:
        reading.warn(prim, "is to make beams, but its material emits no light: it makes none", "photonbeams:enabled")
        return None
    is_lux, mode = prim.HasAPI(UsdLux.LightAPI), _TINTED
    if is_lux:
        mode = reading.choice(prim, "light:materialSyncMode", _TINTED, (_TINTED, _INDEPENDENT, _ALONE))
    # A glowing surface is seen from both sides, and so shines from both if they are not the inside of a body.
    both_sides = not (is_lux or is_closed(reading, prim))
    if mode != _TINTED or not glowing:
        return MeshGlow(joined(parts, parts[0].name), np.ones(3), None, mode != _ALONE, both_sides)
    emissive = glowing[0].material.emissive
    if len(glowing) == 1 and isinstance(emissive, UVTexture):
        return MeshGlow(glowing[0], np.ones(3), emissive, True, both_sides)
    areas, tints = np.array([mesh.area for mesh in glowing]), np.array([_mean(mesh) for mesh in glowing])
    if np.any(tints != tints[0]):
        reading.warn(prim, "has parts that glow differently: as a light it has their mean colour")
    return MeshGlow(joined(glowing, glowing[0].name), areas @ tints / areas.sum(), None, True, both_sides)


def glows(mesh: Mesh) -> bool:
    """Return whether a mesh's material emits light."""
    emissive = mesh.material.emissive
    return isinstance(emissive, UVTexture) or max(emissive) > 0


def glowing_power(meshes: Sequence[Mesh]) -> float:
    """Return the light that one side of glowing meshes emits, up to a constant."""
    return float(sum(mesh.area * _mean(mesh).mean() for mesh in meshes if glows(mesh)))


def _mean(mesh: Mesh) -> Array:
    """Return the mean colour of a mesh's emission."""
    emissive: Any = mesh.material.emissive
    if isinstance(emissive, UVTexture):
        emissive = emissive.pixels.mean(axis=(0, 1), dtype=np.float64)
    return np.broadcast_to(np.asarray(emissive, dtype=np.float64), 3)


def joined(meshes: Sequence[Mesh], name: str) -> Mesh:
    """Join meshes into one, without what only surfaces need."""
    starts = np.cumsum([0] + [len(mesh.points) for mesh in meshes[:-1]])
    return Mesh(
        name=name,
        points=np.concatenate([mesh.points for mesh in meshes]),
        faces=np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]),
    )
