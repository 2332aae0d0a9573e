"""Volumetric light as photon beams, with programmable looks and Gaussian quadrature.

The public names are imported on first use, so that `import photonbeams` is quick and the device can still be chosen.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from . import device

if TYPE_CHECKING:
    from .beams import Beams
    from .chains import curved
    from .estimators.estimate import estimate
    from .looks import (
        Across,
        At,
        Attenuation,
        Biweight,
        BoundLook,
        ColorRamp,
        Constant,
        Epanechnikov,
        Exponential,
        Factor,
        Fog,
        Gaussian,
        Glow,
        Isotropic,
        Look,
        Polynomial,
        Power,
        Product,
        Scattering,
        Smoothstep,
        Tabulated,
        Texture,
        Uniform,
    )
    from .quadrature import Rule, gauss_legendre, riemann
    from .scene import Medium, SceneError
    from .shot import Shot, Stereo
    from .simulation.modify import aim, bend, clamp, recolour, thin
    from .simulation.programmed import Context, chain

    __version__: str

__all__ = [
    "Across",
    "At",
    "Attenuation",
    "Beams",
    "Biweight",
    "BoundLook",
    "ColorRamp",
    "Constant",
    "Context",
    "Epanechnikov",
    "Exponential",
    "Factor",
    "Fog",
    "Gaussian",
    "Glow",
    "Isotropic",
    "Look",
    "Medium",
    "Polynomial",
    "Power",
    "Product",
    "Rule",
    "Scattering",
    "SceneError",
    "Shot",
    "Smoothstep",
    "Stereo",
    "Tabulated",
    "Texture",
    "Uniform",
    "__version__",
    "aim",
    "bend",
    "chain",
    "clamp",
    "curved",
    "estimate",
    "gauss_legendre",
    "recolour",
    "riemann",
    "thin",
]

# Dr.Jit loads libLLVM while it is imported, so the library is chosen now: the user's next line may import Mitsuba.
device.prepare()

_HOMES = {
    "beams": ("Beams",),
    "chains": ("curved",),
    "estimators": ("estimate",),
    "quadrature": ("Rule", "gauss_legendre", "riemann"),
    "scene": ("Medium", "SceneError"),
    "shot": ("Shot", "Stereo"),
    "simulation.modify": ("aim", "bend", "clamp", "recolour", "thin"),
    "simulation.programmed": ("Context", "chain"),
}
_HOME = dict.fromkeys(__all__, "looks") | {name: module for module, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Return a public name from the module that defines it."""
    if name == "__version__":
        from importlib.metadata import version

        return version("photonbeams")
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f".{_HOME[name]}", __name__), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
