"""Build looks from their description on a stage."""

from __future__ import annotations

from typing import Any

from ... import looks
from ...looks import Factor, Look
from .look import AlongSpec, CurveSpec, LookSpec

_INTERPOLATIONS: dict[str, Any] = {"catmullRom": "catmull-rom"}  # the tokens that are not the names in Python


def build_look(spec: LookSpec) -> Look:
    """Return the look that a LookSpec describes."""
    across = spec.across
    profile = {
        "constant": looks.Uniform,
        "epanechnikov": looks.Epanechnikov,
        "biweight": looks.Biweight,
        "gaussian": lambda: looks.Gaussian(across.width),
        "smoothstep": lambda: looks.Smoothstep(across.hardness),
        "hollow": lambda: looks.Hollow(across.inner, across.softness),
        "tabulated": lambda: looks.Tabulated(across.values),
    }[across.profile]()
    toward = {
        "physical": looks.Attenuation,
        "none": lambda: looks.Constant(1.0),
        "exponential": lambda: looks.Exponential(spec.eye.length),
    }[spec.eye.falloff]
    shading = {
        "physical": looks.Scattering,
        "constant": looks.Isotropic,
        "glow": lambda: looks.Glow(spec.angle.anisotropy, spec.angle.mix, spec.angle.gain),
    }[spec.angle.shading]
    around = [*_curves(across.curve), *_noises(spec)]
    return looks.Look(
        along=looks.Product(tuple(_alongs(spec.along))),
        across=profile * looks.Product(tuple(around)) if around else profile,
        eye=looks.Product((toward(), *_curves(spec.eye.curve))),
        angle=looks.Product((shading(), *_curves(spec.angle.curve))),
    )


def _alongs(along: AlongSpec) -> list[Factor]:
    """Return the factors along the beam."""
    span = along.curve.span
    place: dict[str, Any] = {"space": span.space, "begin": span.begin, "end": span.end}
    falloff = {
        "exponential": lambda: looks.Exponential(along.length),
        "power": lambda: looks.Power(along.exponent, along.length),
        "polynomial": lambda: looks.Polynomial(along.coefficients, **place),
    }.get(along.falloff)
    parts: list[Factor] = [falloff()] if falloff else []
    parts += _curves(along.curve)
    if along.outer > 0:
        parts.append(looks.Fade(along.inner, along.outer, _INTERPOLATIONS.get(along.fade, along.fade)))
    if along.physical:
        parts.append(looks.Attenuation())
    if along.tint != (1.0, 1.0, 1.0) or not parts:
        parts.append(looks.Constant(along.tint))
    return parts


def _curves(curve: CurveSpec) -> list[Factor]:
    """Return the ramp, texture and expression that are set."""
    place: dict[str, Any] = {"space": curve.span.space, "begin": curve.span.begin, "end": curve.span.end}
    parts: list[Factor] = []
    if curve.knots:
        named = _INTERPOLATIONS.get(curve.interpolation, curve.interpolation)
        parts.append(looks.ColorRamp(curve.knots, curve.colors, named, **place))
    if curve.texture is not None:
        parts.append(looks.Texture(curve.texture, **place))
    if curve.expression:
        parts.append(looks.Expression(curve.expression))
    return parts


def _noises(spec: LookSpec) -> list[Factor]:
    """Return the noise and variation that are set."""
    noise = spec.noise
    parts: list[Factor] = []
    if noise.amount > 0:
        parts.append(looks.Noise(**vars(noise)))
    if spec.variation > 0:
        parts.append(looks.Variation(spec.variation))
    return parts
