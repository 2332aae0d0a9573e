"""`photonbeams beams`: write the beams of a stage as curves."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from . import options
from .animation import Task, frame_numbers, tasks_of
from .flags import Device, FogFlags, SelectionFlags, check_flags, start_device
from .outputs import Output, checked_path
from .programs import load_function
from .progress import counted, held_signals, messages


def beams(
    scene: Annotated[Path, typer.Argument(help="A .usd, .usda, .usdc or .usdz stage.")],
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", help="The .usd, .usda or .usdc file to write. A run of # stands for the frame number."
        ),
    ],
    frames: options.Frames = None,
    camera: Annotated[
        str | None,
        typer.Option(
            "--camera", "-cam", help="Path or name of the camera; beams are guided to the light that it can see."
        ),
    ] = None,
    beams: Annotated[int, typer.Option(help="Beams of each light that sets no number.")] = 4096,
    scattering: options.Scattering = None,
    absorption: options.Absorption = None,
    anisotropy: options.Anisotropy = None,
    simulate: options.Simulate = None,
    emit: options.Emit = None,
    overrides: options.Overrides = None,
    session_layer: options.SessionLayers = None,
    variant: options.Variants = None,
    mask: options.Mask = None,
    purposes: options.Purposes = None,
    complexity: options.ComplexityName = None,
    seed: Annotated[int, typer.Option(help="Random seed.")] = 0,
    threads: options.Threads = None,
    device: Annotated[Device, typer.Option(help="Processor to trace light on.")] = Device.auto,
    quiet: options.Quiet = False,
    verbose: options.Verbose = False,
) -> None:
    """Write the beams of a frame's first pass as curves, which other programs can show and `render` can read.

    For example:

    photonbeams beams shot.usda -o out/beams.usdc --beams 512
    """
    check_flags(beams=beams, anisotropy=anisotropy, threads=threads)
    fog = FogFlags.parse(scattering, absorption, anisotropy)
    selected = SelectionFlags(mask, purposes, variant or (), complexity)
    target = Output(checked_path("--output", output, (".usd", ".usda", ".usdc")))
    with messages(quiet, verbose), held_signals() as check:
        start_device(device, threads)
        from ..shot import Shot
        from ..usd.authoring.beams import check_path
        from ..usd.layers.frames import check_frames
        from ..usd.stage import check_not_read, open_stage

        numbers = frame_numbers(frames, [target])
        stage = open_stage(scene, session_layer or (), overrides or (), selection=selected.selection())
        check_frames(stage, [each for each in numbers if each is not None])
        shot = Shot(
            stage, camera, medium=fog.over,
            simulate=load_function("--simulate", simulate), emit=load_function("--emit", emit),
        )  # fmt: skip
        tasks = tasks_of(shot, numbers, [target], ())
        for task in tasks:
            task.files[0].parent.mkdir(parents=True, exist_ok=True)
            check_path(task.files[0])
            check_not_read(stage, task.files[0])
        for task in tasks:
            check()
            with check.forced():
                written = shot.write_beams(task.files[0], task.number, beams=beams, seed=seed)
            if not quiet:
                _tell(task, written)


def _tell(task: Task, written: int) -> None:
    print(f"wrote {counted(written, 'beam')} to {task.files[0]}", file=sys.stderr)
