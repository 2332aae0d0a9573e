"""`photonbeams beams`: what light tracing makes of a stage, written as curves."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from .animation import Task, frame_numbers, tasks_of
from .flags import Device, FogFlags, check_flags, parse_color, start_device
from .outputs import Output, checked_path
from .programs import load_function
from .progress import counted, held_interrupt, messages


def beams(
    scene: Annotated[Path, typer.Argument(help="A .usd, .usda, .usdc or .usdz stage.")],
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="A .usd, .usda or .usdc file to write. A run of # is the frame number."),
    ],
    frames: Annotated[
        str | None,
        typer.Option("--frames", "-f", metavar="FRAMES", help="As for render; default: the stage's start."),
    ] = None,
    camera: Annotated[
        str | None,
        typer.Option("--camera", "-cam", help="Path or name of the camera: what it can see of a light decides."),
    ] = None,
    beams: Annotated[int, typer.Option(help="Beams of each light that does not say.")] = 4096,
    scattering: Annotated[
        str | None, typer.Option(metavar="S|R,G,B", help="A fog for a stage without, or instead of the stage's.")
    ] = None,
    absorption: Annotated[str | None, typer.Option(metavar="S|R,G,B", help="Its absorption.")] = None,
    anisotropy: Annotated[float | None, typer.Option(help="Its mean cosine, -0.99 to 0.99.")] = None,
    simulate: Annotated[
        str | None, typer.Option(metavar="FILE.py:NAME", help="A Python function that changes the beams.")
    ] = None,
    emit: Annotated[
        str | None, typer.Option(metavar="FILE.py:NAME", help="A Python function that makes beams from nothing.")
    ] = None,
    overrides: Annotated[
        list[str] | None, typer.Option("--set", metavar="/prim.attr=value", help="A value over the stage's.")
    ] = None,
    session_layer: Annotated[list[Path] | None, typer.Option(help="A layer over the stage.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of all samples.")] = 0,
    threads: Annotated[int | None, typer.Option(help="Processor threads.")] = None,
    device: Annotated[Device, typer.Option(help="Where to trace light.")] = Device.auto,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print errors alone.")] = False,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Print more.")] = False,
) -> None:
    """Write the beams of a frame's first pass as curves, which other programs show and `render` reads.

    For example:

    photonbeams beams shot.usda -o out/beams.usdc --beams 512
    """
    check_flags(beams=beams, anisotropy=anisotropy, threads=threads)
    fog = FogFlags(parse_color("--scattering", scattering), parse_color("--absorption", absorption), anisotropy)
    target = Output(checked_path("--output", output, (".usd", ".usda", ".usdc")))
    with messages(quiet, verbose), held_interrupt() as check:
        start_device(device, threads)
        from ..shot import Shot
        from ..usd.export import check_path
        from ..usd.frames import check_frames
        from ..usd.stage import check_not_read, open_stage

        numbers = frame_numbers(frames, [target])
        stage = open_stage(scene, session_layer or (), overrides or ())
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
            written = shot.write_beams(task.files[0], task.number, beams=beams, seed=seed)
            if not quiet:
                _tell(task, written)


def _tell(task: Task, written: int) -> None:
    print(f"wrote {counted(written, 'beam')} to {task.files[0]}", file=sys.stderr)
