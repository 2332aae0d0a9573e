"""Shading: the four programmable factors of a beam, along, across, eye and angle, and their presets."""

from ..numerics.given import Number, Numbers
from .across import (
    Across,
    AcrossLike,
    Biweight,
    Epanechnikov,
    Gaussian,
    Hollow,
    Modulated,
    Smoothstep,
    Tabulated,
    Uniform,
)
from .along import Attenuation, ColorRamp, Exponential, Fade, Polynomial, Power, Space, Texture
from .angle import Glow, Isotropic, Scattering
from .context import INPUTS, Fog, LightContext, ShadingContext
from .factors import Clamp, Constant, Factor, FactorLike, Function, Mix, Product, Sum, Value
from .look import BoundLook, Look
from .patterns import Expression, Noise, NoiseSpace, Variation
from .ramp import Interpolation
from .syntax import ExpressionError

__all__ = [
    "INPUTS",
    "Across",
    "AcrossLike",
    "Attenuation",
    "Biweight",
    "BoundLook",
    "Clamp",
    "ColorRamp",
    "Constant",
    "Epanechnikov",
    "Exponential",
    "Expression",
    "ExpressionError",
    "Factor",
    "FactorLike",
    "Fade",
    "Fog",
    "Function",
    "Gaussian",
    "Glow",
    "Hollow",
    "Interpolation",
    "Isotropic",
    "LightContext",
    "Look",
    "Mix",
    "Modulated",
    "Noise",
    "NoiseSpace",
    "Number",
    "Numbers",
    "Polynomial",
    "Power",
    "Product",
    "Scattering",
    "ShadingContext",
    "Smoothstep",
    "Space",
    "Sum",
    "Tabulated",
    "Texture",
    "Uniform",
    "Value",
    "Variation",
]
