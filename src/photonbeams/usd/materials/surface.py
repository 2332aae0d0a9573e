"""A surface as read from a network: the inputs of a UsdPreviewSurface as values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...scene import Array
from ..common.openusd import UsdShade
from .network import Network
from .values import Value


@dataclass
class Surface:
    """The inputs of a surface, None if nothing is authored; see `scene.Material`."""

    diffuse: Value | None = None
    emissive: Value | None = None
    roughness: Value | None = None
    metallic: Value | None = None
    ior: Value | None = None
    clearcoat: Value | None = None
    clearcoat_roughness: Value | None = None
    opacity: Value | None = None
    presence: bool = False
    tint: Value | None = None
    normal: Value | None = None
    bump: Value | None = None


Reader = Callable[[Network, UsdShade.Shader], Surface]


def ior_of(reflectance: float) -> Array:
    """Return the index of refraction for a reflectance at normal incidence."""
    root = np.sqrt(np.clip(reflectance, 0, 0.99))
    return np.full(1, (1 + root) / (1 - root))


def mix(first: Array, second: Array, part: Array) -> Array:
    """Return the linear mix of two values."""
    return first + part * (second - first)
