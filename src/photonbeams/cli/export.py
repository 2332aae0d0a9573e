"""`photonbeams export`: write a stage as a Mitsuba scene."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .animation import opened_frames
from .flags import Camera, ContentFlags, CropOption, DeviceFlags, Resolution, Stage, check_crop
from .outputs import Output, checked_path
from .progress import counted, held_signals, messages


def export(
    scene: Stage,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="The .xml file to write. A run of # stands for the frame number.")
    ],
    content: ContentFlags,
    camera: Camera = None,
    res: Resolution = (0, 0),
    crop: CropOption = None,
) -> None:
    """Write a stage as a Mitsuba scene, with its meshes and images in a folder beside it.

    What a Mitsuba scene cannot express is left out, with a warning.

    For example:

    photonbeams export shot.usda -o out/shot.xml --res 640 0
    """
    check_crop(crop, overscan=False)
    target = Output(checked_path("--output", output, (".xml",)))
    shown = content.shown
    with messages(shown), held_signals() as check:
        DeviceFlags().start()
        from ..export.shot import check_path
        from ..export.shot import export as written

        shot, tasks = opened_frames(scene, camera, target, content)
        for task in tasks:
            check_path(shot, task.files[0])
        for task in tasks:
            check()
            files = written(shot, task.files[0], task.number, width=res[0] or None, height=res[1] or None, crop=crop)
            beside = f", and {counted(len(files) - 1, 'file')} beside it" if files[1:] else ""
            shown.say(f"wrote {files[0]}{beside}")
