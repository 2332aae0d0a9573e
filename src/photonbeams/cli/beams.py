"""`photonbeams beams`: write the beams of a stage as curves."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..constants import DEFAULT_BEAMS, MOST_BEAMS
from ..setting import Setting
from .animation import opened_frames
from .flags import ContentFlags, DeviceFlags, ProgramFlags, Stage
from .groups import checked
from .outputs import Output, checked_path
from .progress import counted, held_signals, messages

CHECK_BEAMS = checked(Setting(kind=int, least=1, most=MOST_BEAMS))


def beams(
    scene: Stage,
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", help="The .usd, .usda or .usdc file to write. A run of # stands for the frame number."
        ),
    ],
    content: ContentFlags,
    programs: ProgramFlags,
    device: DeviceFlags,
    camera: Annotated[
        str | None,
        typer.Option(
            "--camera", "-cam", help="Path or name of the camera; beams are guided to the light that it can see."
        ),
    ] = None,
    beams: Annotated[
        int, typer.Option(help="Beams of each light that sets no number.", callback=CHECK_BEAMS)
    ] = DEFAULT_BEAMS,
    seed: Annotated[int, typer.Option(help="Random seed.")] = 0,
) -> None:
    """Write the beams of a frame's first pass as curves, which other programs can show and `render` can read.

    For example:

    photonbeams beams shot.usda -o out/beams.usdc --beams 512
    """
    target = Output(checked_path("--output", output, (".usd", ".usda", ".usdc")))
    shown = content.shown
    with messages(shown), held_signals() as check:
        device.start()
        from ..usd.authoring.beams import check_path

        shot, tasks = opened_frames(scene, camera, target, content, **programs.loaded())
        for task in tasks:
            task.files[0].parent.mkdir(parents=True, exist_ok=True)
            check_path(task.files[0])
            shot.subject.check_targets(task.files)
        for task in tasks:
            check()
            with check.forced():
                written = shot.write_beams(task.files[0], task.number, beams=beams, seed=seed)
            shown.say(f"wrote {counted(written, 'beam')} to {task.files[0]}")
