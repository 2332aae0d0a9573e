"""Volumetric light as photon beams, with programmable looks and Gaussian quadrature.

The public names are imported on first use, so that `import photonbeams` is quick and the device can still be chosen.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

import wrapt

from . import integrator
from .runtime import device

if TYPE_CHECKING:
    from .beams import Beams
    from .beams.curves import curved
    from .beams.modify import aim, bend, clamp, recolour, thin
    from .beams.programs import PassContext, chain
    from .estimators.estimate import estimate
    from .looks import (
        Across,
        At,
        Attenuation,
        Biweight,
        BoundLook,
        Clamp,
        ColorRamp,
        Constant,
        Context,
        Epanechnikov,
        Exponential,
        Expression,
        Factor,
        Fade,
        Fog,
        Function,
        Gaussian,
        Glow,
        Hollow,
        Isotropic,
        Look,
        Mix,
        Modulated,
        Noise,
        Polynomial,
        Power,
        Product,
        Scattering,
        Smoothstep,
        Sum,
        Tabulated,
        Texture,
        Uniform,
        Variation,
    )
    from .quadrature import Rule, gauss_legendre, riemann
    from .scene import DrawnBeams, Medium, SceneError
    from .shot import Holdout, Plate, Shot, Stereo
    from .world.medium_colors import colors_of_medium, medium_of_colors

    __version__: str

__all__ = [
    "Across",
    "At",
    "Attenuation",
    "Beams",
    "Biweight",
    "BoundLook",
    "Clamp",
    "ColorRamp",
    "Constant",
    "Context",
    "DrawnBeams",
    "Epanechnikov",
    "Exponential",
    "Expression",
    "Factor",
    "Fade",
    "Fog",
    "Function",
    "Gaussian",
    "Glow",
    "Holdout",
    "Hollow",
    "Isotropic",
    "Look",
    "Medium",
    "Mix",
    "Modulated",
    "Noise",
    "PassContext",
    "Plate",
    "Polynomial",
    "Power",
    "Product",
    "Rule",
    "Scattering",
    "SceneError",
    "Shot",
    "Smoothstep",
    "Stereo",
    "Sum",
    "Tabulated",
    "Texture",
    "Uniform",
    "Variation",
    "__version__",
    "aim",
    "bend",
    "chain",
    "clamp",
    "colors_of_medium",
    "curved",
    "estimate",
    "gauss_legendre",
    "medium_of_colors",
    "recolour",
    "riemann",
    "thin",
]

# Dr.Jit loads libLLVM while it is imported, so the library is chosen now: the user's next line may import Mitsuba.
device.prepare()

# Mitsuba is told of the plug-in `photon_beams` as soon as it is there.
wrapt.when_imported("mitsuba")(integrator.announce)

_HOMES = {
    "beams.beams": ("Beams",),
    "beams.curves": ("curved",),
    "beams.modify": ("aim", "bend", "clamp", "recolour", "thin"),
    "beams.programs": ("PassContext", "chain"),
    "estimators": ("estimate",),
    "images.plates": ("Holdout", "Plate"),
    "quadrature": ("Rule", "gauss_legendre", "riemann"),
    "scene": ("DrawnBeams", "Medium", "SceneError"),
    "shot": ("Shot",),
    "usd.stereo": ("Stereo",),
    "world.medium_colors": ("colors_of_medium", "medium_of_colors"),
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
