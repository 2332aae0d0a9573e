"""`photonbeams render`: frames of a stage as layered EXRs and as pictures."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from . import options
from .asked import Asked, Plates
from .flags import (
    Device,
    Estimator,
    Filter,
    FogFlags,
    Gather,
    PassRange,
    Quality,
    RuleName,
    SelectionFlags,
    check_flags,
    two_eyes,
)
from .job import run
from .outputs import Output, PictureExposure, parse_outputs, part_outputs
from .progress import Progress
from .xml import check_given

if TYPE_CHECKING:
    from ..farm.cluster import FarmOptions


class ViewName(StrEnum):
    """Which of two eyes."""

    left = "left"
    right = "right"
    both = "both"


class DepthKind(StrEnum):
    """What a depth is."""

    auto = "auto"
    planar = "planar"
    distance = "distance"


def render(
    context: typer.Context,
    scene: Annotated[Path, typer.Argument(help="A .usd, .usda, .usdc or .usdz stage, or a Mitsuba .xml.")],
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "--output",
            "-o",
            help="Where to write: .exr (layered) or .png (tone-mapped); may be repeated. "
            "A run of # is the frame number. Default: the products of the render settings.",
        ),
    ] = None,
    picture: options.Picture = None,
    layers: options.Layers = None,
    frames: options.Frames = None,
    skip_existing: options.SkipExisting = False,
    render_settings: Annotated[
        str | None,
        typer.Option(
            "--render-settings",
            "-rs",
            metavar="PATH",
            help="RenderSettings prim; flags win over it. Default: the one that the stage names.",
        ),
    ] = None,
    render_pass: Annotated[
        str | None,
        typer.Option(metavar="PATH", help="RenderPass prim: its settings, and what of the stage it renders."),
    ] = None,
    allow_paths: Annotated[
        bool, typer.Option("--allow-paths", help="Write render products that a stage names outside of this folder.")
    ] = False,
    camera: Annotated[
        str | None,
        typer.Option("--camera", "-cam", help="Path or name of the camera (of a Mitsuba scene: its sensor's id)."),
    ] = None,
    list_cameras: Annotated[bool, typer.Option("--list-cameras", help="List the cameras and stop.")] = False,
    res: options.Resolution = (
        0,
        0,
    ),
    res_scale: Annotated[float, typer.Option(help="Factor on the size.")] = 1.0,
    crop: options.Crop = None,
    tile: Annotated[
        str | None, typer.Option(metavar="I/N", help="Render tile I of N alone; `photonbeams merge` joins the tiles.")
    ] = None,
    passes: Annotated[
        int | None,
        typer.Option(help="Passes that a frame is the mean of; default: 16, or the sampler's of a Mitsuba scene."),
    ] = None,
    time_limit: Annotated[float | None, typer.Option(help="Begin no pass after so many seconds of a frame.")] = None,
    error: Annotated[
        float | None,
        typer.Option(
            metavar="E", help="Passes until the relative error is E, such as 0.01: at most --passes, default: 4096."
        ),
    ] = None,
    denoise: Annotated[
        bool, typer.Option("--denoise", help="Denoise surfaces, and beams where they need it, by Open Image Denoise.")
    ] = False,
    keep_noisy: Annotated[
        bool, typer.Option("--keep-noisy", help="Layers noisy_surface, noisy_beams, ... as they were, beside those.")
    ] = False,
    checkpoint: Annotated[
        float | None,
        typer.Option(metavar="S", help="Keep what is done of a frame every S seconds and on Ctrl-C."),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on from checkpoints, where there are any.")] = False,
    snapshot: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            help="Write the picture so far every S seconds, as *.snapshot.exr, and on the signal SIGUSR1.",
        ),
    ] = None,
    pass_range: Annotated[
        str | None,
        typer.Option(
            "--pass-range",
            metavar="A:B|I/N",
            help="Render passes A to B alone, or the I-th of N equal parts of all passes, "
            "into a .checkpoint for `photonbeams merge`.",
        ),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(metavar="N", help="Render with N processes of this machine.", min=1, max=1024)
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Render with the workers of a Dask scheduler, tcp:// or tls://."),
    ] = None,
    tls_ca: Annotated[
        Path | None, typer.Option("--tls-ca-file", help="Certificate authority of a tls:// scheduler.")
    ] = None,
    tls_cert: Annotated[Path | None, typer.Option("--tls-cert", help="Our own certificate for it.")] = None,
    tls_key: Annotated[Path | None, typer.Option("--tls-key", help="The key of that.")] = None,
    beams: Annotated[
        int | None,
        typer.Option(
            help="Beams a pass, for lights that do not say, default: 4096; "
            "of a Mitsuba scene: light paths, default: the integrator's, or 16384."
        ),
    ] = None,
    bounces: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="How often light is scattered or reflected before it is scattered once toward the camera, -1: any; "
            "default: 0, or the integrator's max_depth less 2.",
        ),
    ] = None,
    estimator: Annotated[
        Estimator | None,
        typer.Option(help="Beam x Beam 1D, 2D, or their blend; default: auto, or the integrator's of a Mitsuba scene."),
    ] = None,
    rule: Annotated[RuleName | None, typer.Option(help="Quadrature of the frustum; default: gauss.")] = None,
    order: Annotated[
        int | None,
        typer.Option(help="Points of the quadrature; default: 6, or the integrator's of a Mitsuba scene."),
    ] = None,
    gather: Annotated[
        Gather | None,
        typer.Option(
            help="Whether beams are seen along every ray (exact) or, where that does, along fewer (adaptive)."
        ),
    ] = None,
    gather_error: Annotated[
        float | None,
        typer.Option(help="Relative error that fewer rays may have, 0: exact; default: 0.002."),
    ] = None,
    pixel_filter: Annotated[
        Filter | None,
        typer.Option("--filter", help="Pixel filter; default: the render settings', or box; a Mitsuba film's own."),
    ] = None,
    scattering: options.Scattering = None,
    absorption: options.Absorption = None,
    anisotropy: options.Anisotropy = None,
    beams_only_fog: Annotated[
        bool, typer.Option("--beams-only-fog", help="A fog that beams alone feel: surfaces are as if without it.")
    ] = False,
    dome_beams: Annotated[
        bool, typer.Option("--dome-beams", help="Dome lights make beams, too, as by photonbeams:enabled.")
    ] = False,
    look: Annotated[
        list[str] | None,
        typer.Option(
            metavar="[PRIM=]FILE.py:NAME",
            help="A look of your own in Python, for all beams or those of PRIM; repeatable.",
        ),
    ] = None,
    group: Annotated[
        list[str] | None,
        typer.Option(metavar="EMITTER=NAME", help="Light group of an emitter of a Mitsuba scene; repeatable."),
    ] = None,
    simulate: options.Simulate = None,
    emit: options.Emit = None,
    stereo: options.TwoEyes = False,
    interaxial: options.Interaxial = None,
    convergence: options.Convergence = None,
    view: Annotated[ViewName | None, typer.Option(help="One of the two eyes; default: both, in one file.")] = None,
    holdout: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="Another renderer's depth, at which beams end instead of at the stage's surfaces. "
            "A run of # is the frame number, %V the view.",
        ),
    ] = None,
    holdout_channel: Annotated[
        str | None, typer.Option(metavar="NAME", help="Its channel; default: what is called a depth.")
    ] = None,
    holdout_depth: Annotated[
        DepthKind | None, typer.Option(help="Along the camera's axis, or from the camera; default: by the name.")
    ] = None,
    holdout_scale: Annotated[float | None, typer.Option(help="Scene units in one unit of it; default: 1.")] = None,
    over: Annotated[
        str | None, typer.Option(metavar="FILE", help="A plate: rgba is that plus beams. Named as --holdout.")
    ] = None,
    over_fog: Annotated[bool, typer.Option("--over-fog", help="The fog dims the plate, too.")] = False,
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="/prim.attr=value", help="A value over the stage's; NAME=VALUE of a Mitsuba scene."
        ),
    ] = None,
    session_layer: options.SessionLayers = None,
    texture_limit: Annotated[
        int | None,
        typer.Option(
            metavar="PIXELS",
            min=1,
            max=65536,
            help="Scale textures down that are larger a side, default: 4096; images of lights: twice as large.",
        ),
    ] = None,
    variant: options.Variants = None,
    mask: options.Mask = None,
    purposes: options.Purposes = None,
    complexity: options.ComplexityName = None,
    exposure: options.Exposure = 0.0,
    auto_exposure: Annotated[
        bool,
        typer.Option("--auto-exposure", help="Choose it by the first frame and print it; an .exr stays as is."),
    ] = False,
    seed: Annotated[
        int | None,
        typer.Option(help="Seed of all samples, the same for all frames: beams stay where they are; default: 0."),
    ] = None,
    threads: options.Threads = None,
    device: Annotated[Device, typer.Option(help="Where to render.")] = Device.auto,
    progress: Annotated[Progress | None, typer.Option(help="Default: rich on a terminal, else plain.")] = None,
    strict: options.Strict = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Read everything, render nothing.")] = False,
    quiet: options.Quiet = False,
    verbose: options.Verbose = False,
) -> None:
    """Render frames of a stage, or a Mitsuba scene.

    For example:

    photonbeams render shot.usda -o out/shot.####.exr -f 1001:1048

    photonbeams render room.usdc -o room.png --scattering 0.05 --res 1920 0 --passes 64

    photonbeams render cornell.xml -o cornell.exr --passes 64 --checkpoint 60
    """
    check_flags(
        res, res_scale, crop, passes, time_limit, error, beams, order, gather_error, anisotropy, exposure, threads,
        bounces, checkpoint, snapshot,
    )  # fmt: skip
    _check_plates(holdout, holdout_channel, holdout_depth, holdout_scale, over, over_fog)
    eyes = two_eyes(stereo, interaxial, convergence, view)
    part = PassRange.parse(pass_range)
    farm = _farm(workers, scheduler, threads, {"ca": tls_ca, "cert": tls_cert, "key": tls_key})
    if part is not None and farm is not None:
        raise typer.BadParameter("--pass-range is of one process: a farm shares the passes out itself")
    for flag, value in (("--time-limit", time_limit), ("--error", error)):
        if value is not None and (part is not None or farm is not None):
            raise typer.BadParameter(f"{flag} is of a frame in one process: expected --passes alone for parts of it")
    if denoise and tile is not None:
        raise typer.BadParameter("--denoise would show the edges of tiles: expected --pass-range instead of --tile")
    if keep_noisy and not denoise:
        raise typer.BadParameter("--keep-noisy is of layers that are denoised: expected --denoise, too")
    outputs = parse_outputs(output or (), picture or ()) if part is None else part_outputs(output or ())
    is_xml = scene.suffix.lower() == ".xml"
    if is_xml:
        check_given(context)
    elif group:
        raise typer.BadParameter("--group is for Mitsuba scenes: expected photonbeams:lightGroup on a stage's lights")
    _check_replaced(outputs, {"--holdout": holdout, "--over": over})
    asked = Asked(
        path=scene, outputs=outputs, layers=layers, frames=frames, skip_existing=skip_existing,
        checkpoint=checkpoint, resume=resume, snapshot=snapshot, part=part, farm=farm,
        quality=Quality(
            passes=passes, time_limit=time_limit, error=error, denoise=denoise, keep_noisy=keep_noisy, beams=beams,
            bounces=bounces, estimator=estimator, rule=rule, order=order, gather=gather, gather_error=gather_error,
            pixel_filter=pixel_filter, seed=seed,
        ),
        camera=camera or None, list_cameras=list_cameras, res=res, res_scale=res_scale, crop=crop, tile=_tile(tile),
        render_settings=render_settings, render_pass=render_pass, allow_paths=allow_paths,
        overrides=overrides or (), session_layers=session_layer or (), texture_limit=texture_limit,
        exposure=_exposure(exposure, auto_exposure),
        selection=SelectionFlags(mask, purposes, variant or (), complexity),
        fog=FogFlags.parse(scattering, absorption, anisotropy, beams_only_fog), dome_beams=dome_beams,
        strict=strict, looks=look or (), groups=group or (), simulate=simulate, emit=emit, stereo=eyes,
        view=None if view in (None, ViewName.both) else view.value,
        plates=Plates(
            holdout=holdout, channel=holdout_channel, depth=holdout_depth or "auto", scale=holdout_scale or 1.0,
            over=over, fog=over_fog,
        ),
        device=device, threads=threads, progress=progress, dry_run=dry_run, quiet=quiet, verbose=verbose,
        command=options.command_line(),
    )  # fmt: skip
    run(asked)


def _exposure(stops: float, auto: bool) -> PictureExposure:
    if auto and stops:
        raise typer.BadParameter("--auto-exposure chooses the exposure: expected no --exposure beside it")
    return PictureExposure(None if auto else stops)


def _tile(text: str | None) -> tuple[int, int] | None:
    """Return the number of a tile, from 1, and how many there are."""
    if text is None:
        return None
    number, _, count = text.partition("/")
    if not (number.isdecimal() and count.isdecimal() and 1 <= int(number) <= int(count)):
        raise typer.BadParameter(f"--tile is {text}: expected NUMBER/COUNT, as in 1/4")
    return int(number), int(count)


def _farm(
    workers: int | None, scheduler: str | None, threads: int | None, tls: dict[str, Path | None]
) -> FarmOptions | None:
    """Return where the workers are, or None for this process alone."""
    from ..farm.cluster import FarmOptions

    files = {name: str(path) for name, path in tls.items() if path is not None}
    if files and not (scheduler or "").startswith("tls://"):
        raise typer.BadParameter("--tls-... are of a tls:// scheduler: expected --scheduler tls://ADDRESS, too")
    for path in files.values():
        if not Path(path).is_file():
            raise typer.BadParameter(f"{path}: no such file: expected a certificate, or its key")
    if workers is None and scheduler is None:
        return None
    if workers is not None and scheduler is not None:
        raise typer.BadParameter("--workers and --scheduler are two farms: expected one of them")
    return FarmOptions(workers, scheduler, threads, tls=files)


def _check_replaced(outputs: Sequence[Output], given: dict[str, str | None]) -> None:
    """Refuse outputs that would replace what is read."""
    for flag, path in given.items():
        if path and any(each.path.absolute() == Path(path).absolute() for each in outputs):
            raise typer.BadParameter(f"{path} is read by {flag}: expected another file to write to")


def _check_plates(
    holdout: str | None,
    channel: str | None,
    depth: DepthKind | None,
    scale: float | None,
    over: str | None,
    fog: bool,
) -> None:
    """Refuse flags that change what is not given, and a scale out of range."""
    of_holdout = {"--holdout-channel": channel, "--holdout-depth": depth, "--holdout-scale": scale}
    for flag, value in of_holdout.items():
        if value is not None and not holdout:
            raise typer.BadParameter(f"{flag} is of a holdout: expected --holdout, too")
    if scale is not None and not 0 < scale <= 1e12:
        raise typer.BadParameter(f"--holdout-scale is {scale}: expected more than 0 and no more than 1e12")
    if fog and not over:
        raise typer.BadParameter("--over-fog is of a plate: expected --over, too")
