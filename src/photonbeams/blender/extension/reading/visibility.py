"""Which rays meet an object: those of the camera, of shadows, of fog; and holdouts."""

from __future__ import annotations

from typing import Any

from .lights import seen_values


def ray_values(thing: Any, owner: Any, layer: Any) -> dict[str, Any]:
    """Return the attributes of an object for other rays than all, as a view layer has it.

    `owner` is the object itself, or that which makes it as a copy.
    """
    own, values = owner.original, seen_values(thing)
    if own.indirect_only_get(view_layer=layer):
        values["visibleInPrimaryRay"] = ["bool", False]
    if thing.type == "LIGHT":
        return values if thing.visible_volume_scatter else {**values, "photonbeams:enabled": ["bool", False]}
    if not thing.visible_shadow:
        values["primvars:arnold:visibility:shadow"] = ["bool", False]
    if own.holdout_get(view_layer=layer):
        values["primvars:arnold:matte"] = ["bool", True]
    return values
