"""Volumetric light as photon beams, with programmable looks and Gaussian quadrature.

The public names are imported on first use, so that `import photonbeams` is quick and the device can still be chosen.
The parts of a look (factors and profiles) are in `photonbeams.looks`, and the parts of a scene (lights, meshes, media
and cameras) in `photonbeams.scene`.
"""

from importlib import import_module as _import_module
from typing import TYPE_CHECKING as _TYPE_CHECKING

import wrapt as _wrapt

from . import integrator as _integrator
from .runtime import device as _device

if _TYPE_CHECKING:
    from . import looks, scene
    from .beams import Beams
    from .beams.curves import curved
    from .beams.modify import aim, bend, clamp, recolor, thin
    from .beams.programs import Modifier, PassContext, chain
    from .estimators.estimate import estimate
    from .looks import Look
    from .quadrature import Rule, gauss_legendre, riemann
    from .scene import DrawnBeams, Medium, SceneError
    from .shot import Holdout, Plate, Shot, Stereo
    from .world.media.medium_colors import colors_of_medium, medium_of_colors

    __version__: str

__all__ = [
    "Beams",
    "DrawnBeams",
    "Holdout",
    "Look",
    "Medium",
    "Modifier",
    "PassContext",
    "Plate",
    "Rule",
    "SceneError",
    "Shot",
    "Stereo",
    "__version__",
    "aim",
    "bend",
    "chain",
    "clamp",
    "colors_of_medium",
    "curved",
    "estimate",
    "gauss_legendre",
    "looks",
    "medium_of_colors",
    "recolor",
    "riemann",
    "scene",
    "thin",
]

# Dr.Jit loads libLLVM when it is imported, so the library is chosen now: the user's next line may import Mitsuba.
_device.prepare()

# The plug-in `photon_beams` is registered as soon as Mitsuba is imported.
_wrapt.when_imported("mitsuba")(_integrator.announce)

_HOMES = {
    "beams.beams": ("Beams",),
    "beams.curves": ("curved",),
    "beams.modify": ("aim", "bend", "clamp", "recolor", "thin"),
    "beams.programs": ("Modifier", "PassContext", "chain"),
    "estimators": ("estimate",),
    "images.plates": ("Holdout", "Plate"),
    "looks": ("Look",),
    "quadrature": ("Rule", "gauss_legendre", "riemann"),
    "scene": ("DrawnBeams", "Medium", "SceneError"),
    "shot": ("Shot",),
    "usd.cameras.stereo": ("Stereo",),
    "world.media.medium_colors": ("colors_of_medium", "medium_of_colors"),
}
_HOME = {name: module for module, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> object:
    """Return a public name from the module that defines it."""
    if name == "__version__":
        from importlib.metadata import version

        return version("photonbeams")
    if name in ("looks", "scene"):
        return _import_module(f".{name}", __name__)
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(_import_module(f".{_HOME[name]}", __name__), name)
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
