"""What is added to Blender, and removed again."""

from __future__ import annotations

import atexit
from contextlib import suppress
from pathlib import Path

import bpy

from . import compositing, panels, settings
from .bundle import Bundle
from .engine import PhotonBeamsEngine
from .process import POOL


def register() -> None:
    """Add properties, engine and panels."""
    settings.register()
    bpy.utils.register_class(PhotonBeamsEngine)
    compositing.register()
    panels.register()
    with suppress(ValueError):  # not installed as an extension, which has a folder
        folder = Path(bpy.utils.extension_path_user(__package__, create=True))
        POOL.bundle = Bundle.within(Path(__file__).parent, folder)
    atexit.register(POOL.close)


def unregister() -> None:
    """Remove what was added, and end the renderers."""
    panels.unregister()
    compositing.unregister()
    bpy.utils.unregister_class(PhotonBeamsEngine)
    settings.unregister()
    atexit.unregister(POOL.close)
    POOL.close()
