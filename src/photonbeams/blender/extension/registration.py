"""What is added to Blender, and removed again."""

from __future__ import annotations

import atexit

import bpy

from . import adding, beams, export, light_panels, looks, panels, settings
from .engine import PhotonBeamsEngine
from .process import POOL


def register() -> None:
    """Add properties, engine and panels."""
    for each in (settings, looks, beams):
        each.register()
    bpy.utils.register_class(PhotonBeamsEngine)
    for each in (panels, light_panels, adding, export):
        each.register()
    atexit.register(POOL.close)


def unregister() -> None:
    """Remove what was added, and end the renderers."""
    for each in (export, adding, light_panels, panels):
        each.unregister()
    bpy.utils.unregister_class(PhotonBeamsEngine)
    for each in (beams, looks, settings):
        each.unregister()
    atexit.unregister(POOL.close)
    POOL.close()
