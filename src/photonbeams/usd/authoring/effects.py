"""Which controls have an effect: those whose switch is on, whose image is chosen, whose kind of falloff uses them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

#: What a value has to be: one of these, or with () anything but nothing, no and 0.
Wanted = tuple[Any, ...]

_SET: Wanted = ()
_UNSET: Wanted = (None,)
_BEAMS = ("count", "intensity", "guides", "look", "scattered")
# For each attribute, what others of its prim have to be, so that it has an effect. Our own
# are without their prefix.
_INPUTS: Mapping[str, Mapping[str, Wanted]] = {
    "inputs:colorTemperature": {"inputs:enableColorTemperature": (True,)},
    "inputs:shaping:focusTint": {"inputs:shaping:focus": _SET},
}
_LIGHT: Mapping[str, Mapping[str, Wanted]] = {
    "portal:gobo": {"portal": _SET}, "gobo:angle": {"gobo": _SET}, "gobo:width": {"gobo": _SET},
    "gobo:wrap": {"gobo": _SET}, **{name: {"enabled": (True,)} for name in _BEAMS},
}  # fmt: skip
_MEDIUM: Mapping[str, Mapping[str, Wanted]] = {
    "scattering": {"nearColor": _UNSET}, "absorption": {"nearColor": _UNSET}, "farColor": {"nearColor": _SET},
    "farDistance": {"nearColor": _SET}, "albedo": {"nearColor": _SET},
}  # fmt: skip
_LOOK: Mapping[str, Mapping[str, Wanted]] = {
    "along:length": {"along:falloff": ("exponential", "power")}, "along:exponent": {"along:falloff": ("power",)},
    "along:coefficients": {"along:falloff": ("polynomial",)},
    "along:inner": {"along:outer": _SET}, "along:fade": {"along:outer": _SET},
    "across:width": {"across:profile": ("gaussian",)}, "across:hardness": {"across:profile": ("smoothstep",)},
    "across:values": {"across:profile": ("tabulated",)}, "across:inner": {"across:profile": ("hollow",)},
    "across:softness": {"across:profile": ("hollow",)}, "eye:length": {"eye:falloff": ("exponential",)},
    **{f"angle:{name}": {"angle:shading": ("glow",)} for name in ("anisotropy", "mix", "gain")},
    **{
        f"noise:{name}": {"noise:amount": _SET}
        for name in ("scale", "octaves", "contrast", "drift", "evolution", "space")
    },
}  # fmt: skip
_PREFIX = "photonbeams:"
_OWN = {"light": _LIGHT, "medium": _MEDIUM, "look": _LOOK}


def needs_of(kind: str, name: str) -> dict[str, Wanted]:
    """Return what other attributes have to be, by their names, so that an attribute has an effect.

    Parameters
    ----------
    kind
        What the attribute belongs to: "light", "medium" or "look".
    name
        The attribute's name.
    """
    found = dict(_INPUTS.get(name, {}))
    own = _OWN[kind].get(name.removeprefix(_PREFIX), {}) if name.startswith(_PREFIX) else {}
    found |= {_PREFIX + other: wanted for other, wanted in own.items()}
    return found
