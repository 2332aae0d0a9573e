"""What is added to Blender, and removed again."""

from __future__ import annotations

import atexit
from contextlib import suppress
from pathlib import Path

import bpy
from bpy.props import PointerProperty

from . import adding, beams, compositing, export, light_panels, looks, panels, settings
from .bundle import Bundle
from .engine import ENGINE, PhotonBeamsEngine
from .process import POOL
from .thumbnails import THUMBNAILS

_CLASSES = (
    *settings.CLASSES, *looks.CLASSES, *beams.CLASSES, PhotonBeamsEngine, *compositing.CLASSES, *panels.CLASSES,
    *light_panels.CLASSES, *adding.CLASSES, *export.CLASSES,
)  # fmt: skip
#: What has settings, which a .blend saves, and their kind.
_SETTINGS = {
    bpy.types.Scene: settings.PhotonBeamsRenderSettings, bpy.types.NodeTree: looks.PhotonBeamsLook,
    bpy.types.Light: beams.PhotonBeamsLightSettings, bpy.types.World: beams.PhotonBeamsWorldSettings,
    bpy.types.Curve: beams.PhotonBeamsCurveSettings,
}  # fmt: skip


def register() -> None:
    """Add properties, engine, panels and menus."""
    for each in _CLASSES:
        bpy.utils.register_class(each)
    for owner, kind in _SETTINGS.items():
        owner.photonbeams = PointerProperty(type=kind)
    for panel in panels.shared_panels():
        panel.COMPAT_ENGINES.add(ENGINE)
    bpy.types.VIEW3D_MT_add.append(adding.draw_entry)
    with suppress(ValueError):  # not installed as an extension, which has a folder
        folder = Path(bpy.utils.extension_path_user(__package__, create=True))
        POOL.bundle = Bundle.within(Path(__file__).parent, folder)
    atexit.register(POOL.close)


def unregister() -> None:
    """Remove what was added, and end the renderers."""
    bpy.types.VIEW3D_MT_add.remove(adding.draw_entry)
    for panel in panels.shared_panels():
        panel.COMPAT_ENGINES.discard(ENGINE)
    for owner in _SETTINGS:
        del owner.photonbeams
    for each in reversed(_CLASSES):
        bpy.utils.unregister_class(each)
    THUMBNAILS.close()
    atexit.unregister(POOL.close)
    POOL.close()
