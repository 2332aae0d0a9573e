"""Build looks from their description on a stage."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ... import looks
from ...looks import Factor, Look
from .look import LookSpec

_INTERPOLATIONS: dict[str, Any] = {"catmullRom": "catmull-rom"}  # the tokens that are not the names in Python
# Where the ramp, the texture and the polynomial of each factor begin and end, if the schema has no attribute for it.
_PLACES: dict[str, dict[str, Any]] = {
    "along": {"space": "fraction", "begin": 0.0, "end": 1.0},
    "across": {"space": "radius", "begin": 0.0, "end": 1.0},
    "eye": {"space": "distance", "begin": 0.0, "end": 1.0},
    "angle": {"space": "angle", "begin": 0.0, "end": 180.0},
}


def build_look(spec: LookSpec) -> Look:
    """Return the look that a LookSpec describes."""
    own = spec.values
    profile = {
        "constant": looks.Uniform,
        "epanechnikov": looks.Epanechnikov,
        "biweight": looks.Biweight,
        "gaussian": lambda: looks.Gaussian(own["across:width"]),
        "smoothstep": lambda: looks.Smoothstep(own["across:hardness"]),
        "hollow": lambda: looks.Hollow(own["across:inner"], own["across:softness"]),
        "tabulated": lambda: looks.Tabulated(own["across:values"]),
    }[own["across:profile"]]()
    toward = {
        "physical": looks.Attenuation,
        "none": lambda: looks.Constant(1.0),
        "exponential": lambda: looks.Exponential(own["eye:length"]),
    }[own["eye:falloff"]]
    shading = {
        "physical": looks.Scattering,
        "constant": looks.Isotropic,
        "glow": lambda: looks.Glow(own["angle:anisotropy"], own["angle:mix"], own["angle:gain"]),
    }[own["angle:shading"]]
    around = [*_curves(own, "across"), *_noises(own)]
    return looks.Look(
        along=looks.Product(tuple(_alongs(own))),
        across=profile * looks.Product(tuple(around)) if around else profile,
        eye=looks.Product((toward(), *_curves(own, "eye"))),
        angle=looks.Product((shading(), *_curves(own, "angle"))),
        surfaces=own["surfaces"],
    )


def _alongs(own: Mapping[str, Any]) -> list[Factor]:
    """Return the factors along the beam."""
    falloff = {
        "exponential": lambda: looks.Exponential(own["along:length"]),
        "power": lambda: looks.Power(own["along:exponent"], own["along:length"]),
        "polynomial": lambda: looks.Polynomial(own["along:coefficients"], **_place(own, "along")),
    }.get(own["along:falloff"])
    parts: list[Factor] = [falloff()] if falloff else []
    parts += _curves(own, "along")
    if own["along:outer"] > 0:
        fade = own["along:fade"]
        parts.append(looks.Fade(own["along:inner"], own["along:outer"], _INTERPOLATIONS.get(fade, fade)))
    if own["along:physical"]:
        parts.append(looks.Attenuation())
    if own["along:tint"] != (1.0, 1.0, 1.0) or not parts:
        parts.append(looks.Constant(own["along:tint"]))
    return parts


def _curves(own: Mapping[str, Any], factor: str) -> list[Factor]:
    """Return the ramp, texture and expression of a factor that are set."""
    knots, colors, named, texture, expression = (
        own[f"{factor}:{name}"] for name in ("ramp:knots", "ramp:colors", "ramp:interpolation", "texture", "expression")
    )
    place = _place(own, factor)
    parts: list[Factor] = []
    if knots:
        parts.append(looks.ColorRamp(knots, colors, _INTERPOLATIONS.get(named, named), **place))
    if texture is not None:
        parts.append(looks.Texture(texture, **place))
    if expression:
        parts.append(looks.Expression(expression))
    return parts


def _place(own: Mapping[str, Any], factor: str) -> dict[str, Any]:
    return {name: own.get(f"{factor}:{name}", usual) for name, usual in _PLACES[factor].items()}


def _noises(own: Mapping[str, Any]) -> list[Factor]:
    """Return the noise and variation that are set."""
    parts: list[Factor] = []
    if own["noise:amount"] > 0:
        noise = {name.removeprefix("noise:"): value for name, value in own.items() if name.startswith("noise:")}
        parts.append(looks.Noise(**noise))
    if own["variation"] > 0:
        parts.append(looks.Variation(own["variation"]))
    return parts
