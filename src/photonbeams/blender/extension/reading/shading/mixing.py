"""Surfaces between two others, by the inputs of OpenPBR: the light that they send is mixed linearly."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..nodes import Value

#: Values of OpenPBR's inputs; that of its normals is a `Tilt`.
Surface = dict[str, Any]
TILT = "geometry_normal"

_BLACK = (0.0, 0.0, 0.0)
#: What inputs are where nothing is said.
PLAIN: Surface = {
    "base_weight": 1.0, "base_color": (0.8, 0.8, 0.8), "base_metalness": 0.0, "specular_weight": 1.0,
    "specular_color": (1.0, 1.0, 1.0),
    "specular_roughness": 0.3, "specular_ior": 1.5, "transmission_weight": 0.0, "transmission_color": (1.0, 1.0, 1.0),
    "coat_weight": 0.0, "coat_roughness": 0.0, "emission_luminance": 0.0, "emission_color": _BLACK,
    "geometry_opacity": 1.0,
}  # fmt: skip
_EMISSION = ("emission_luminance", "emission_color")


def between(first: Surface, second: Surface, factor: float, told: Callable[[], None], *, add: bool = False) -> Surface:
    """Return the surface between two; with `add`, the light of both is added.

    A colour counts as much as its surface shows of it: clear glass has no base colour, and what does not reflect has
    no roughness.
    """
    whole = [{**PLAIN, **each} for each in (first, second)]
    parts = (1 - factor, factor)
    clear = [_number(each["transmission_weight"]) for each in whole]
    weights = {
        "base_color": [part * (1 - own) for part, own in zip(parts, clear, strict=True)],
        "transmission_color": [part * own for part, own in zip(parts, clear, strict=True)],
    }
    mirrors = [part * _mirrored(each) for part, each in zip(parts, whole, strict=True)]
    weights |= {"specular_roughness": mirrors, "specular_ior": mirrors}
    found: Surface = {}
    for name in sorted((first.keys() | second.keys()) - {*_EMISSION, TILT}):
        found[name] = _mean(whole[0][name], whole[1][name], weights.get(name, list(parts)), told)
    if _EMISSION[0] in first or _EMISSION[0] in second:
        found |= _emitted(whole, parts, told, 2.0 if add else 1.0)
    tilts = [each[TILT] for each in (first, second) if TILT in each]
    if tilts:
        found[TILT] = tilts[0]
        if tilts[-1] != tilts[0]:
            told()
    if add:
        found["base_color"] = _scaled({**PLAIN, **found}["base_color"], 2.0)
    return found


def _emitted(whole: list[Surface], parts: tuple[float, float], told: Callable[[], None], factor: float) -> Surface:
    """Return the emission of a mixture."""
    lights = [_number(each["emission_luminance"]) for each in whole]
    shares = [part * light for part, light in zip(parts, lights, strict=True)]
    if not sum(shares):
        return {"emission_luminance": 0.0}
    color = _mean(whole[0]["emission_color"], whole[1]["emission_color"], shares, told)
    return {"emission_luminance": factor * sum(shares), "emission_color": color}


def _mirrored(surface: Surface) -> float:
    """Return how much of a surface is a mirror, up to 1."""
    return max(_number(surface["specular_weight"]), _number(surface["base_metalness"]))


def _number(value: Value) -> float:
    """Return a number; images and attributes count as 1."""
    return float(np.mean(value)) if isinstance(value, float | tuple) else 1.0


def _scaled(value: Value, factor: float) -> Value:
    return tuple(min(each * factor, 1.0) for each in value) if isinstance(value, tuple) else value


def _mean(first: Value, second: Value, weights: list[float], told: Callable[[], None]) -> Any:
    """Return the weighted mean of two values; an image counts alone, as it has no mean here."""
    total = sum(weights)
    if total <= 0 or first == second:
        return first
    if weights[0] == 0 or weights[1] == 0:
        return second if weights[0] == 0 else first
    plain = [isinstance(each, float | tuple) for each in (first, second)]
    if not all(plain):
        told()
        return first if (weights[0] >= weights[1] if plain[0] == plain[1] else plain[1]) else second
    mean = np.average([first, second], axis=0, weights=weights).tolist()  # type: ignore[arg-type]
    return mean if isinstance(first, float) else tuple(mean)
