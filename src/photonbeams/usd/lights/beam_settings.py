"""Read the settings of `PhotonBeamsLightAPI` for a light's beams: what they are aimed at, their look and group."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from ...scene import Gobo, Mesh
from ..common.definitions import LIGHT, PREFIX, definitions
from ..common.openusd import Usd
from ..common.reading import Reading
from ..geometry.meshes import is_gprim, read_solid
from ..looks.look import LookSpec, read_look
from .gobos import read_gobo, read_portal_gobo
from .mesh_lights import joined

#: What warnings say about a light or drawn beams whose look cannot be read.
PHYSICAL = "its beams have the physical look"

#: Fields of `BeamSettings` that are single attributes.
_FIELDS = {"beam_count": "count", "beam_scale": "intensity", "seed": "seed", "scattered": "scattered",
           "bounces": "bounces"}  # fmt: skip


def read_beam_settings(reading: Reading, prim: Usd.Prim, portal: Mesh | str | None) -> dict[str, Any]:
    """Return the fields of `BeamSettings` that PhotonBeamsLightAPI sets, with looks as specs.

    The API need not be applied. A value that cannot be used is replaced by its default, with a warning.
    """

    def attempt(read: Callable[[], object], instead: str, default: object = None) -> Any:
        return reading.attempt(prim, read, default, instead)

    known = {field: definitions(LIGHT)[PREFIX + name] for field, name in _FIELDS.items()}
    return {
        "group": attempt(partial(read_group, reading, prim), "the light is in no group", ""),
        "emits_beams": reading.flag(prim, "photonbeams:enabled", True),
        "portal": portal,
        "gobo": attempt(partial(read_gobo, reading, prim), "the light has no gobo"),
        "portal_gobo": attempt(partial(_read_portal_gobo, reading, prim, portal), "the portal has no gobo"),
        "look": attempt(partial(bound_look, reading, prim), PHYSICAL),
        **{
            field: attempt(partial(own.read, reading, prim), "its default is used", own.default)
            for field, own in known.items()
        },
    }


def bound_look(reading: Reading, prim: Usd.Prim) -> LookSpec | None:
    """Return the look that a light or a curves prim names, or None."""
    looks = reading.targets(prim, "photonbeams:look")
    return read_look(reading, prim, looks[0]) if looks else None


def read_group(reading: Reading, prim: Usd.Prim) -> str:
    """Return the light group of a light or a curves prim, whose name has to be that of a layer."""
    group = str(reading.value(prim, "photonbeams:lightGroup", ""))
    if not re.fullmatch(r"[A-Za-z0-9_-]*", group):
        raise reading.fail(prim, "photonbeams:lightGroup", f"is '{group}': expected letters, digits, _ and - alone")
    return group


def read_portal(reading: Reading, prim: Usd.Prim) -> Mesh | None:
    """Return the gprims through which the light reaches the shot, as one mesh."""
    meshes = _openings(reading, prim)
    if len(meshes) < 2:
        return meshes[0] if meshes else None
    return joined(meshes, " ".join(mesh.name for mesh in meshes))


def _read_portal_gobo(
    reading: Reading, prim: Usd.Prim, portal: Mesh | str | None
) -> Gobo | tuple[Gobo, ...] | None:  # fmt: skip
    """Return the image on a light's portal, or one for each of several gprims."""
    if not isinstance(portal, Mesh) or len(reading.targets(prim, "photonbeams:portal")) < 2:
        return read_portal_gobo(reading, prim, portal)
    openings = _openings(reading, prim)
    gobos = [read_portal_gobo(reading, prim, each) for each in openings]
    return tuple(replace(gobo, over=mesh) for gobo, mesh in zip(gobos, openings, strict=True) if gobo) or None


def _openings(reading: Reading, prim: Usd.Prim) -> list[Mesh]:
    """Return the gprims that a light names as its portal."""
    name = "photonbeams:portal"
    meshes = []
    for target in reading.targets(prim, name):
        if not is_gprim(target):
            kind = target.GetTypeName() or "prim without a type"
            raise reading.fail(prim, name, f"names {target.GetPath()}, a {kind}: expected a mesh or another gprim")
        mesh = read_solid(reading, target, reading.to_world(target))
        if mesh.area <= 0:
            raise reading.fail(prim, name, f"names {target.GetPath()}, which has no area: expected a surface")
        meshes.append(mesh)
    return meshes
