"""`photonbeams export`: write a stage as a Mitsuba scene."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from . import options
from .animation import frame_numbers, tasks_of
from .flags import Device, FogFlags, SelectionFlags, check_flags, start_device
from .outputs import Output, checked_path
from .progress import counted, held_signals, messages


def export(
    scene: Annotated[Path, typer.Argument(help="A .usd, .usda, .usdc or .usdz stage.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="The .xml file to write. A run of # stands for the frame number.")
    ],
    frames: options.Frames = None,
    camera: Annotated[str | None, typer.Option("--camera", "-cam", help="Path or name of the camera.")] = None,
    res: options.Resolution = (0, 0),
    crop: options.Crop = None,
    scattering: options.Scattering = None,
    absorption: options.Absorption = None,
    anisotropy: options.Anisotropy = None,
    overrides: options.Overrides = None,
    session_layer: options.SessionLayers = None,
    variant: options.Variants = None,
    mask: options.Mask = None,
    purposes: options.Purposes = None,
    complexity: options.ComplexityName = None,
    quiet: options.Quiet = False,
    verbose: options.Verbose = False,
) -> None:
    """Write a stage as a Mitsuba scene, with its meshes and images in a folder beside it.

    What a Mitsuba scene cannot express is left out, with a warning.

    For example:

    photonbeams export shot.usda -o out/shot.xml --res 640 0
    """
    check_flags(res, crop=crop, anisotropy=anisotropy)
    fog = FogFlags.parse(scattering, absorption, anisotropy)
    selected = SelectionFlags(mask, purposes, variant or (), complexity)
    target = Output(checked_path("--output", output, (".xml",)))
    with messages(quiet, verbose), held_signals() as check:
        start_device(Device.auto, None)
        from ..export.shot import check_path
        from ..export.shot import export as written
        from ..shot import Shot
        from ..usd.layers.frames import check_frames
        from ..usd.stage import open_stage

        numbers = frame_numbers(frames, [target])
        stage = open_stage(scene, session_layer or (), overrides or (), selection=selected.selection())
        check_frames(stage, [each for each in numbers if each is not None])
        shot = Shot(stage, camera, medium=fog.over)
        tasks = tasks_of(shot, numbers, [target], ())
        for task in tasks:
            check_path(shot, task.files[0])
        for task in tasks:
            check()
            files = written(shot, task.files[0], task.number, width=res[0] or None, height=res[1] or None, crop=crop)
            if not quiet:
                beside = f", and {counted(len(files) - 1, 'file')} beside it" if files[1:] else ""
                print(f"wrote {files[0]}{beside}", file=sys.stderr)
