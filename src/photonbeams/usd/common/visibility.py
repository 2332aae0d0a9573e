"""Which rays meet a prim: attributes of Arnold, RenderMan, Karma, hdEmbree and Omniverse, for which USD has none."""

from __future__ import annotations

from typing import Any

from .openusd import Usd
from .reading import Reading

# Attributes that are false where the camera does not see a light or a surface, or where a surface casts no shadow; and
# those that are true for holdouts.
CAMERA, MATTE = "primvars:arnold:visibility:camera", "primvars:arnold:matte"
_CAMERA = (
    "inputs:visibility:camera", "visibleInPrimaryRay", "primvars:arnold:camera", CAMERA,
    "primvars:ri:attributes:visibility:camera",
)  # fmt: skip
_SHADOW = ("primvars:arnold:visibility:shadow", "primvars:ri:attributes:visibility:transmission")
_MATTE = (MATTE, "primvars:ri:attributes:trace:holdout", "primvars:karma:object:holdoutmode")
_KARMA = "primvars:karma:object:rendervisibility"  # "-primary&-shadow"


def is_seen(reading: Reading, prim: Usd.Prim) -> bool:
    """Return whether the camera sees a light or a surface, by its own attributes."""
    return _is_on(reading, prim, _CAMERA) and "-primary" not in str(reading.value(prim, _KARMA, ""))


def rays_of(reading: Reading, prim: Usd.Prim) -> dict[str, Any]:
    """Return `seen`, `blocks` and `holdout` of a surface, by fields of `scene.Mesh`; what its parents have counts."""
    key = ("rays", prim.GetPath())
    if key not in reading.cache:
        above = rays_of(reading, parent) if (parent := prim.GetParent()) and not parent.IsPseudoRoot() else {}
        shadow = _is_on(reading, prim, _SHADOW) and "-shadow" not in str(reading.value(prim, _KARMA, ""))
        reading.cache[key] = {
            "seen": above.get("seen", True) and is_seen(reading, prim),
            "blocks": above.get("blocks", True) and shadow,
            "holdout": above.get("holdout", False) or any(reading.value(prim, name, False) for name in _MATTE),
        }
    found: dict[str, Any] = reading.cache[key]
    return found


def _is_on(reading: Reading, prim: Usd.Prim, names: tuple[str, ...]) -> bool:
    return not any(reading.value(prim, name, True) in (False, 0) for name in names)
