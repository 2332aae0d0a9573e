"""Which rays meet an object: those of the camera, of shadows, of fog; and holdouts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def ray_values(thing: Any, owner: Any, layer: Any, told: Callable[[str], None]) -> dict[str, Any]:
    """Return the attributes of an object for other rays than all, as a view layer has it.

    `owner` is the object itself, or that which makes it as a copy.
    """
    own, values = owner.original, dict[str, Any]()
    if not thing.visible_camera:
        values["visibleInPrimaryRay"] = ["bool", False]
    if own.indirect_only_get(view_layer=layer):
        values["visibleInPrimaryRay"] = ["bool", False]
    if thing.type == "LIGHT":
        return values | _of_lamp(thing, told)
    if not thing.visible_shadow:
        values["primvars:arnold:visibility:shadow"] = ["bool", False]
    if own.holdout_get(view_layer=layer):
        values["primvars:arnold:matte"] = ["bool", True]
    return values


def _of_lamp(thing: Any, told: Callable[[str], None]) -> dict[str, Any]:
    """Return what hides a lamp's light from fog, or from surfaces."""
    values: dict[str, Any] = {} if thing.visible_volume_scatter else {"photonbeams:enabled": ["bool", False]}
    if not thing.visible_diffuse:
        values |= {f"inputs:{name}": ["float", 0.0] for name in ("diffuse", "specular")}
    if thing.visible_glossy != thing.visible_diffuse or thing.visible_transmission != thing.visible_diffuse:
        told(f"{thing.name} is hidden from some surfaces, which is not rendered: all are as Diffuse says")
    return values
