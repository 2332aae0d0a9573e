"""Shading: the four programmable factors of a beam, along, across, eye and angle, and their presets."""

from .across import Across, Biweight, Epanechnikov, Gaussian, Smoothstep, Tabulated, Uniform
from .along import Attenuation, ColorRamp, Exponential, Polynomial, Power, Texture
from .angle import Glow, Isotropic, Scattering
from .factors import At, Constant, Factor, Fog, Product
from .look import BoundLook, Look

__all__ = [
    "Across",
    "At",
    "Attenuation",
    "Biweight",
    "BoundLook",
    "ColorRamp",
    "Constant",
    "Epanechnikov",
    "Exponential",
    "Factor",
    "Fog",
    "Gaussian",
    "Glow",
    "Isotropic",
    "Look",
    "Polynomial",
    "Power",
    "Product",
    "Scattering",
    "Smoothstep",
    "Tabulated",
    "Texture",
    "Uniform",
]
