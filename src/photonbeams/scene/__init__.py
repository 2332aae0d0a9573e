"""What a shot contains, in plain numbers: readers produce these classes, and renderers take them.

Nothing here depends on USD, Mitsuba or Dr.Jit. Lengths are in scene units, positions and directions in world space;
colours are scene-linear Rec. 709 unless the stage says otherwise. Every class checks its own numbers, so that what
reaches a kernel is finite and in range. Messages name the field; the reader adds file and prim.
"""

from dataclasses import is_dataclass

from ..constants import DEFAULT_BEAMS, MOST_BEAMS, MOST_PIXELS
from .beam_settings import SCATTERED, BeamSettings
from .beams import DrawnBeams
from .cameras import Camera
from .checks import (
    BLACK,
    ESCAPE,
    FARTHEST,
    WHITE,
    Array,
    Color,
    SceneError,
    at_bounds,
    choice,
    color,
    has_gradients,
    instance,
    number,
    numbers,
    rgb,
    shown,
    whole,
)  # fmt: skip
from .declared import arguments, typed
from .filters import Blocker, DistanceRamp, LightFilter
from .fog_density import FogDensity, FogNoise
from .light import Light
from .lights import (
    CylinderLight,
    DistantLight,
    DomeLight,
    FlatLight,
    MeshLight,
    SphereLight,
)
from .media import DensityGrid, Medium
from .profiles import Profile
from .scene import Scene
from .shaping import Gobo, Shaping
from .surfaces import Material, Mesh, UVTexture, VertexValues

__all__ = [
    "BLACK",
    "DEFAULT_BEAMS",
    "ESCAPE",
    "FARTHEST",
    "MOST_BEAMS",
    "MOST_PIXELS",
    "SCATTERED",
    "WHITE",
    "Array",
    "BeamSettings",
    "Blocker",
    "Camera",
    "Color",
    "CylinderLight",
    "DensityGrid",
    "DistanceRamp",
    "DistantLight",
    "DomeLight",
    "DrawnBeams",
    "FlatLight",
    "FogDensity",
    "FogNoise",
    "Gobo",
    "Light",
    "LightFilter",
    "Material",
    "Medium",
    "Mesh",
    "MeshLight",
    "Profile",
    "Scene",
    "SceneError",
    "Shaping",
    "SphereLight",
    "UVTexture",
    "VertexValues",
    "arguments",
    "at_bounds",
    "choice",
    "color",
    "has_gradients",
    "instance",
    "number",
    "numbers",
    "rgb",
    "shown",
    "whole",
]  # fmt: skip

for _name in __all__:  # so that readers and users alike are told of a field that is of another type
    if is_dataclass(globals()[_name]):
        typed(globals()[_name])
