"""Photon Beams, a render engine for Blender. It imports Blender's modules only once it is registered."""


def register() -> None:
    """Add the engine to Blender."""
    from . import registration

    registration.register()


def unregister() -> None:
    """Remove the engine from Blender, with its processes."""
    from . import registration

    registration.unregister()
