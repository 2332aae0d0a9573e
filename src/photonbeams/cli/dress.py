"""`photonbeams dress`: write a layer with fog, portals, looks and light groups over an export."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .flags import Camera, DeviceFlags, MessageFlags, SessionLayers, Stage
from .outputs import checked_path
from .progress import held_signals, messages


def dress(
    scene: Stage,
    output: Annotated[Path, typer.Option("--output", "-o", help="The .usda file to write.")],
    shown: MessageFlags,
    camera: Camera = None,
    session_layer: SessionLayers = None,
) -> None:
    """Write a layer over an export with what shafts of light need, and comments on what to change; no file is changed.

    The layer has a fog that suits the scene's size, and for each lamp that makes a shaft a look, a light group, and a
    portal in each opening through which its light comes. What the export already has of these stays. Session layers
    become sublayers of it.

    For example:

    photonbeams dress export.usdc -o shot.usda
    """
    target = checked_path("--output", output, (".usda",))
    with messages(shown), held_signals() as check:
        DeviceFlags().start()
        from ..shot import Shot
        from ..shot.dressing import dress as written

        shot = Shot.open(scene, camera, session_layers=session_layer or ())
        check()
        said = written(shot, target)
        shown.say("\n  ".join([f"wrote {target}, over {scene}:", *said]))
