"""What is added to Blender, and removed again."""

from __future__ import annotations

import atexit
from contextlib import suppress
from pathlib import Path

import bpy

from . import adding, beams, compositing, export, light_panels, looks, panels, settings
from .bundle import Bundle
from .engine import PhotonBeamsEngine
from .process import POOL


def register() -> None:
    """Add properties, engine and panels."""
    for each in (settings, looks, beams):
        each.register()
    bpy.utils.register_class(PhotonBeamsEngine)
    for each in (compositing, panels, light_panels, adding, export):
        each.register()
    with suppress(ValueError):  # not installed as an extension, which has a folder
        folder = Path(bpy.utils.extension_path_user(__package__, create=True))
        POOL.bundle = Bundle.within(Path(__file__).parent, folder)
    atexit.register(POOL.close)


def unregister() -> None:
    """Remove what was added, and end the renderers."""
    for each in (export, adding, light_panels, panels, compositing):
        each.unregister()
    bpy.utils.unregister_class(PhotonBeamsEngine)
    for each in (beams, looks, settings):
        each.unregister()
    atexit.unregister(POOL.close)
    POOL.close()
