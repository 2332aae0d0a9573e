"""Shading: the four programmable factors of a beam, along, across, eye and angle, and their presets."""

from ..numerics.given import Number, Numbers
from .across import Across, Modulated
from .along import Attenuation, ColorRamp, Exponential, Fade, Polynomial, Power, Space, Texture
from .angle import Glow, Isotropic, Scattering
from .bound_look import BoundLook
from .context import INPUTS, Fog, LightContext, ShadingContext
from .factors import Clamp, Constant, Factor, FactorLike, Mix, Product, Sum, Value
from .functions import Function
from .look import Look
from .patterns import Expression, Noise, NoiseSpace, Variation
from .profiles import (
    AcrossLike,
    Biweight,
    Epanechnikov,
    Gaussian,
    Hollow,
    Smoothstep,
    Tabulated,
    Uniform,
)
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
