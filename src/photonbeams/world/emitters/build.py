"""The lamp of each light of a stage."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ... import scene
from .cylinder import CylinderLamp
from .distant import DistantLamp
from .dome import DomeLamp
from .flat import FlatLamp
from .lamp import Lamp
from .mesh import MeshLamp
from .sphere import SphereLamp
from .stretched import EllipsoidLamp, EllipticCylinderLamp

#: The kinds of lamps. Those that are packed come first, and their places here are part of their samples' names.
KINDS: tuple[Any, ...] = (
    SphereLamp, FlatLamp, CylinderLamp, DistantLamp, EllipsoidLamp, EllipticCylinderLamp, MeshLamp, DomeLamp,
)  # fmt: skip


def lamp_of(light: scene.Light, host: Any = None, around: Sequence[Any] = ()) -> Lamp:
    """Return a light's lamp; for mesh lights, `host` is explained in `scene_of`, `around` in `MeshLamp`."""
    for kind in KINDS:
        if kind.describes(light):
            result: Lamp = kind.of(light, host, around)
            return result
    raise scene.SceneError(f"{light.name}: a {type(light).__name__} cannot be sampled")
