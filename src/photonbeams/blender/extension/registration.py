"""What is added to Blender, and removed again."""

from __future__ import annotations

import atexit

import bpy

from . import panels, settings
from .engine import PhotonBeamsEngine
from .process import POOL


def register() -> None:
    """Add properties, engine and panels."""
    settings.register()
    bpy.utils.register_class(PhotonBeamsEngine)
    panels.register()
    atexit.register(POOL.close)


def unregister() -> None:
    """Remove what was added, and end the renderers."""
    panels.unregister()
    bpy.utils.unregister_class(PhotonBeamsEngine)
    settings.unregister()
    atexit.unregister(POOL.close)
    POOL.close()
