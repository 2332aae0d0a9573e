"""`photonbeams swatch`: draw pictures of looks."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .flags import LayerFlags, MessageFlags
from .progress import messages


def swatch(
    scene: Annotated[Path, typer.Argument(metavar="STAGE", help="A stage or a layer with looks.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE.png", help="The picture to write.")],
    layers: LayerFlags,
    look: Annotated[
        list[str] | None,
        typer.Option(metavar="PATH|NAME", help="A look to draw; may be repeated. Default: all of them."),
    ] = None,
    frame: Annotated[
        float | None,
        typer.Option(
            "--frame", "-f", metavar="N", help="The frame, for looks that change over time; default: the stage's start."
        ),
    ] = None,
    length: Annotated[float, typer.Option(min=1e-6, metavar="UNITS", help="Length of the beam in scene units.")] = 4.0,
    radius: Annotated[
        tuple[float, float], typer.Option(metavar="START END", help="Radii at the beam's ends, in scene units.")
    ] = (
        0.15,
        0.4,
    ),
) -> None:
    """Draw looks: a beam from the side, its cross-section, and the curves of its factors.

    The beam lies in the stage's fog, or in a grey one. The red, green and blue curves are the colour channels. The
    dashed curve across the beam is the profile as the billboard estimate sees it.

    Examples: photonbeams swatch look.usda -o look.png, or photonbeams swatch shot.usda --look Ember -o ember.png
    """
    from ..runtime.files import atomic_file, check_kept, try_path
    from ..runtime.limits import check_address_space

    if output.suffix.lower() != ".png":
        raise typer.BadParameter(f"{output} is not the name of a picture: expected FILE.png")
    if not (min(radius) >= 0 and max(radius) > 0):
        raise typer.BadParameter(
            f"--radius is {radius[0]:g} {radius[1]:g}: expected radii of at least 0 that are not both 0"
        )
    try_path(output)
    check_address_space()
    with messages(MessageFlags()):
        from ..images.color_spaces import REC709
        from ..usd.look_library import find_looks
        from ..usd.stage import files_of, open_stage

        stage = open_stage(scene, layers.session_layer or (), layers.overrides or (), working_space=REC709)
        check_kept([output], files_of(stage))
        found, medium, seconds = find_looks(stage, look or (), frame)
    from ..images.swatches import FOG, Specimen, sheet
    from ..looks import LightContext
    from ..usd.looks.shading import build_look

    specimen = Specimen(medium or FOG, length, *radius, context=LightContext(frame or 0.0, seconds))
    figure = sheet([(spec.name, build_look(spec), specimen) for spec in found])
    with atomic_file(output) as file:
        figure.savefig(file)
    print(f"Wrote {output}")
