"""`photonbeams render`: frames of a stage or a Mitsuba scene, as layered EXRs and pictures."""

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
    """Which eye, or both."""

    left = "left"
    right = "right"
    both = "both"


class DepthKind(StrEnum):
    """How a depth is measured: along the camera's axis, or from the camera."""

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
            help="File to write: .exr (layered) or .png (tone-mapped); may be repeated. "
            "A run of # stands for the frame number. Default: the products of the render settings.",
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
            help="RenderSettings prim; flags override it. Default: the one that the stage names.",
        ),
    ] = None,
    render_pass: Annotated[
        str | None,
        typer.Option(metavar="PATH", help="RenderPass prim: take its render settings and its visibility."),
    ] = None,
    allow_paths: Annotated[
        bool,
        typer.Option(
            "--allow-paths", help="Allow render products that the stage names to be written outside the working folder."
        ),
    ] = False,
    camera: Annotated[
        str | None,
        typer.Option("--camera", "-cam", help="Path or name of the camera; for a Mitsuba scene, the id of its sensor."),
    ] = None,
    list_cameras: Annotated[bool, typer.Option("--list-cameras", help="List the cameras and stop.")] = False,
    res: options.Resolution = (
        0,
        0,
    ),
    res_scale: Annotated[float, typer.Option(help="Scale factor for the size.")] = 1.0,
    crop: options.Crop = None,
    tile: Annotated[
        str | None, typer.Option(metavar="I/N", help="Render only tile I of N; `photonbeams merge` joins the tiles.")
    ] = None,
    passes: Annotated[
        int | None,
        typer.Option(
            help="Number of passes that a frame averages; default: 16, or the sampler's count in a Mitsuba scene."
        ),
    ] = None,
    time_limit: Annotated[
        float | None, typer.Option(help="Begin no further pass of a frame after this many seconds.")
    ] = None,
    error: Annotated[
        float | None,
        typer.Option(
            metavar="E", help="Render until the relative error is E, such as 0.01; at most --passes, by default 4096."
        ),
    ] = None,
    denoise: Annotated[
        bool, typer.Option("--denoise", help="Denoise surfaces, and beams where they need it, with Open Image Denoise.")
    ] = False,
    keep_noisy: Annotated[
        bool,
        typer.Option("--keep-noisy", help="Also write the layers before denoising: noisy_surface, noisy_beams, ..."),
    ] = False,
    checkpoint: Annotated[
        float | None,
        typer.Option(metavar="S", help="Save the passes so far to a checkpoint every S seconds and on Ctrl-C."),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue from checkpoints that exist.")] = False,
    snapshot: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            help="Write the picture so far, as *.snapshot.exr, every S seconds and on the signal SIGUSR1.",
        ),
    ] = None,
    pass_range: Annotated[
        str | None,
        typer.Option(
            "--pass-range",
            metavar="A:B|I/N",
            help="Render only passes A to B, or the I-th of N equal parts of all passes, "
            "into a .checkpoint for `photonbeams merge`.",
        ),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(metavar="N", help="Render with N processes on this machine.", min=1, max=1024)
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Render with the workers of a Dask scheduler at tcp://... or tls://..."),
    ] = None,
    tls_ca: Annotated[
        Path | None, typer.Option("--tls-ca-file", help="File with the certificate authority of a tls:// scheduler.")
    ] = None,
    tls_cert: Annotated[
        Path | None, typer.Option("--tls-cert", help="File with the certificate of this client for it.")
    ] = None,
    tls_key: Annotated[Path | None, typer.Option("--tls-key", help="File with the key of that certificate.")] = None,
    beams: Annotated[
        int | None,
        typer.Option(
            help="Beams per pass of each light that sets no number, default: 4096; "
            "for a Mitsuba scene: light paths, default: the integrator's, or 16384."
        ),
    ] = None,
    bounces: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="How often light bounces before its last scattering toward the camera, -1: no limit; "
            "default: 0, or the integrator's max_depth less 2.",
        ),
    ] = None,
    estimator: Annotated[
        Estimator | None,
        typer.Option(
            help="Billboard (Beam x Beam 1D), frustum (2D) or their blend; default: auto, or the Mitsuba integrator's."
        ),
    ] = None,
    rule: Annotated[RuleName | None, typer.Option(help="Quadrature rule of the frustum; default: gauss.")] = None,
    order: Annotated[
        int | None,
        typer.Option(help="Points of the quadrature rule; default: 6, or the Mitsuba integrator's."),
    ] = None,
    gather: Annotated[
        Gather | None,
        typer.Option(
            help="Gather beams along every ray (exact) or, where they look smooth, along fewer (adaptive, the default)."
        ),
    ] = None,
    gather_error: Annotated[
        float | None,
        typer.Option(help="Largest relative error of gathering along fewer rays, 0: exact; default: 0.002."),
    ] = None,
    pixel_filter: Annotated[
        Filter | None,
        typer.Option(
            "--filter",
            help="Pixel filter; default: that of the render settings, or box; for a Mitsuba scene, its film's.",
        ),
    ] = None,
    scattering: options.Scattering = None,
    absorption: options.Absorption = None,
    anisotropy: options.Anisotropy = None,
    beams_only_fog: Annotated[
        bool,
        typer.Option("--beams-only-fog", help="Let the fog affect only beams: surfaces look as if there were none."),
    ] = False,
    dome_beams: Annotated[
        bool, typer.Option("--dome-beams", help="Make beams of dome lights, too, as photonbeams:enabled does.")
    ] = False,
    look: Annotated[
        list[str] | None,
        typer.Option(
            metavar="[PRIM=]FILE.py:NAME",
            help="A look written in Python, for all beams or for those of PRIM; may be repeated.",
        ),
    ] = None,
    group: Annotated[
        list[str] | None,
        typer.Option(metavar="EMITTER=NAME", help="Light group of an emitter in a Mitsuba scene; may be repeated."),
    ] = None,
    simulate: options.Simulate = None,
    emit: options.Emit = None,
    stereo: options.TwoEyes = False,
    interaxial: options.Interaxial = None,
    convergence: options.Convergence = None,
    view: Annotated[ViewName | None, typer.Option(help="Which eye to render; default: both, in one file.")] = None,
    holdout: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="Another renderer's depth: beams end there instead of at the stage's surfaces. "
            "A run of # stands for the frame number, %V for the view.",
        ),
    ] = None,
    holdout_channel: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Channel of the --holdout file; default: the one with a usual name for a depth."
        ),
    ] = None,
    holdout_depth: Annotated[
        DepthKind | None,
        typer.Option(
            help="What the depth measures: along the camera's axis (planar) or from the camera; default: by its name."
        ),
    ] = None,
    holdout_scale: Annotated[float | None, typer.Option(help="Scene units per unit of the depth; default: 1.")] = None,
    over: Annotated[
        str | None,
        typer.Option(metavar="FILE", help="A plate to which beams are added: rgba is their sum. Named like --holdout."),
    ] = None,
    over_fog: Annotated[bool, typer.Option("--over-fog", help="Let the fog dim the plate, too.")] = False,
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="/prim.attr=value",
            help="Override a value of the stage, or NAME=VALUE for a parameter of a Mitsuba scene; may be repeated.",
        ),
    ] = None,
    session_layer: options.SessionLayers = None,
    texture_limit: Annotated[
        int | None,
        typer.Option(
            metavar="PIXELS",
            min=1,
            max=65536,
            help="Scale down textures wider or higher than this, default: 4096; images on lights may be twice that.",
        ),
    ] = None,
    variant: options.Variants = None,
    mask: options.Mask = None,
    purposes: options.Purposes = None,
    complexity: options.ComplexityName = None,
    exposure: options.Exposure = 0.0,
    auto_exposure: Annotated[
        bool,
        typer.Option("--auto-exposure", help="Choose the exposure by the first frame, and print it."),
    ] = False,
    seed: Annotated[
        int | None,
        typer.Option(help="Random seed, the same for all frames, so that beams do not flicker; default: 0."),
    ] = None,
    threads: options.Threads = None,
    device: Annotated[Device, typer.Option(help="Processor to render on.")] = Device.auto,
    progress: Annotated[
        Progress | None, typer.Option(help="How progress is shown; default: rich on a terminal, plain elsewhere.")
    ] = None,
    strict: options.Strict = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Read and check everything, but render nothing.")] = False,
    quiet: options.Quiet = False,
    verbose: options.Verbose = False,
) -> None:
    """Render frames of a USD stage or a Mitsuba scene.

    For example:

    photonbeams render shot.usda -o out/shot.####.exr -f 1001:1048

    photonbeams render room.usdc -o room.png --scattering 0.05 --res 1920 0 --passes 64

    photonbeams render cornell.xml -o cornell.exr --passes 64 --checkpoint 60
    """
    is_xml = scene.suffix.lower() == ".xml"
    check_flags(
        res, res_scale, crop, passes, time_limit, error, beams, order, gather_error, anisotropy, exposure, threads,
        bounces, checkpoint, snapshot, overscan=not is_xml,
    )  # fmt: skip
    _check_plates(holdout, holdout_channel, holdout_depth, holdout_scale, over, over_fog)
    eyes = two_eyes(stereo, interaxial, convergence, view)
    part = PassRange.parse(pass_range)
    farm = _farm(workers, scheduler, threads, {"ca": tls_ca, "cert": tls_cert, "key": tls_key})
    if part is not None and farm is not None:
        raise typer.BadParameter(
            "--pass-range is for one process: a farm divides the passes itself, so leave out --pass-range"
        )
    for flag, value in (("--time-limit", time_limit), ("--error", error)):
        if value is not None and (part is not None or farm is not None):
            raise typer.BadParameter(
                f"{flag} is for frames that one process renders: expected --passes instead for parts and farms"
            )
    if denoise and tile is not None:
        raise typer.BadParameter(
            "--denoise would make the edges of tiles visible: expected --pass-range instead of --tile"
        )
    if keep_noisy and not denoise:
        raise typer.BadParameter("--keep-noisy keeps the layers before denoising: expected --denoise, too")
    outputs = parse_outputs(output or (), picture or ()) if part is None else part_outputs(output or ())
    if is_xml:
        check_given(context)
    elif group:
        raise typer.BadParameter("--group is for Mitsuba scenes: for a stage, set photonbeams:lightGroup on its lights")
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
        raise typer.BadParameter("--auto-exposure chooses the exposure: expected no --exposure with it")
    return PictureExposure(None if auto else stops)


def _tile(text: str | None) -> tuple[int, int] | None:
    """Return the number of a tile, from 1, and the number of tiles."""
    if text is None:
        return None
    number, _, count = text.partition("/")
    if not (number.isdecimal() and count.isdecimal() and 1 <= int(number) <= int(count)):
        raise typer.BadParameter(f"--tile is {text}: expected NUMBER/COUNT, as in 1/4")
    return int(number), int(count)


def _farm(
    workers: int | None, scheduler: str | None, threads: int | None, tls: dict[str, Path | None]
) -> FarmOptions | None:
    """Return where the workers are, or None to render in this process."""
    from ..farm.cluster import FarmOptions

    files = {name: str(path) for name, path in tls.items() if path is not None}
    if files and not (scheduler or "").startswith("tls://"):
        raise typer.BadParameter(
            "--tls-ca-file, --tls-cert and --tls-key need a tls:// scheduler: expected --scheduler tls://ADDRESS, too"
        )
    for path in files.values():
        if not Path(path).is_file():
            raise typer.BadParameter(f"{path}: no such file; expected a certificate or its key")
    if workers is None and scheduler is None:
        return None
    if workers is not None and scheduler is not None:
        raise typer.BadParameter("--workers and --scheduler name two farms: expected only one of them")
    return FarmOptions(workers, scheduler, threads, tls=files)


def _check_replaced(outputs: Sequence[Output], given: dict[str, str | None]) -> None:
    """Refuse outputs that would overwrite an input."""
    for flag, path in given.items():
        if path and any(each.path.absolute() == Path(path).absolute() for each in outputs):
            raise typer.BadParameter(f"{path} is read by {flag} and would be overwritten: expected another output file")


def _check_plates(
    holdout: str | None,
    channel: str | None,
    depth: DepthKind | None,
    scale: float | None,
    over: str | None,
    fog: bool,
) -> None:
    """Refuse flags of a holdout or a plate that is not given, and a scale out of range."""
    of_holdout = {"--holdout-channel": channel, "--holdout-depth": depth, "--holdout-scale": scale}
    for flag, value in of_holdout.items():
        if value is not None and not holdout:
            raise typer.BadParameter(f"{flag} needs a holdout: expected --holdout, too")
    if scale is not None and not 0 < scale <= 1e12:
        raise typer.BadParameter(f"--holdout-scale is {scale}: expected more than 0 and no more than 1e12")
    if fog and not over:
        raise typer.BadParameter("--over-fog needs a plate: expected --over, too")
