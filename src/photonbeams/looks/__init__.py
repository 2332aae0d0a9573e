"""Shading: the four programmable factors of a beam, along, across, eye and angle, and their presets."""

from .across import Across, Biweight, Epanechnikov, Gaussian, Hollow, Modulated, Smoothstep, Tabulated, Uniform
from .along import Attenuation, ColorRamp, Exponential, Fade, Polynomial, Power, Texture
from .angle import Glow, Isotropic, Scattering
from .at import At, Context, Fog
from .factors import Clamp, Constant, Factor, Function, Mix, Product, Sum
from .look import BoundLook, Look
from .patterns import Expression, Noise, Variation

__all__ = [
    "Across",
    "At",
    "Attenuation",
    "Biweight",
    "BoundLook",
    "Clamp",
    "ColorRamp",
    "Constant",
    "Context",
    "Epanechnikov",
    "Exponential",
    "Expression",
    "Factor",
    "Fade",
    "Fog",
    "Function",
    "Gaussian",
    "Glow",
    "Hollow",
    "Isotropic",
    "Look",
    "Mix",
    "Modulated",
    "Noise",
    "Polynomial",
    "Power",
    "Product",
    "Scattering",
    "Smoothstep",
    "Sum",
    "Tabulated",
    "Texture",
    "Uniform",
    "Variation",
]
