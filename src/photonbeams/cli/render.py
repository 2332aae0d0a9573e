"""`photonbeams render`: a frame of a stage as a layered EXR and as pictures."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from ..render.frame import Statistics
    from ..scene import Medium
    from ..shot import Shot


class Estimator(StrEnum):
    """Which estimate."""

    auto = "auto"
    billboard = "billboard"
    frustum = "frustum"


class RuleName(StrEnum):
    """Which quadrature."""

    gauss = "gauss"
    riemann = "riemann"


class Device(StrEnum):
    """Which processor."""

    auto = "auto"
    cpu = "cpu"
    cuda = "cuda"


class Progress(StrEnum):
    """How progress is shown."""

    rich = "rich"
    plain = "plain"
    none = "none"


def render(
    scene: Annotated[Path, typer.Argument(help="A .usd, .usda, .usdc or .usdz stage.")],
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "--output",
            "-o",
            help="Where to write: .exr (layered) or .png (tone-mapped); may be repeated. "
            "A run of # is the frame number.",
        ),
    ] = None,
    picture: Annotated[
        list[str] | None, typer.Option(metavar="LAYER=FILE.png", help="Write one layer as a picture; may be repeated.")
    ] = None,
    frame: Annotated[
        float | None, typer.Option("--frames", "-f", help="The frame; default: the stage's start.")
    ] = None,
    camera: Annotated[str | None, typer.Option("--camera", "-cam", help="Path or name of the camera.")] = None,
    list_cameras: Annotated[bool, typer.Option("--list-cameras", help="List the cameras and stop.")] = False,
    res: Annotated[tuple[int, int], typer.Option(metavar="W H", help="Size in pixels; H 0: from the aperture.")] = (
        0,
        0,
    ),
    res_scale: Annotated[float, typer.Option(help="Factor on the size.")] = 1.0,
    crop: Annotated[
        tuple[float, float, float, float], typer.Option(metavar="X0 Y0 X1 Y1", help="Part to render, in fractions.")
    ] = (0.0, 0.0, 1.0, 1.0),
    passes: Annotated[int, typer.Option(help="Passes that the frame is the mean of.")] = 16,
    time_limit: Annotated[float | None, typer.Option(help="Begin no pass after so many seconds.")] = None,
    beams: Annotated[int, typer.Option(help="Beams a pass, for lights that do not say.")] = 4096,
    estimator: Annotated[Estimator, typer.Option(help="Beam x Beam 1D, 2D, or their blend.")] = Estimator.auto,
    rule: Annotated[RuleName, typer.Option(help="Quadrature of the frustum.")] = RuleName.gauss,
    order: Annotated[int, typer.Option(help="Points of the quadrature.")] = 6,
    scattering: Annotated[
        str | None, typer.Option(metavar="S|R,G,B", help="A fog for a stage without, or instead of the stage's.")
    ] = None,
    absorption: Annotated[str | None, typer.Option(metavar="S|R,G,B", help="Its absorption.")] = None,
    anisotropy: Annotated[float | None, typer.Option(help="Its mean cosine, -0.99 to 0.99.")] = None,
    overrides: Annotated[
        list[str] | None, typer.Option("--set", metavar="/prim.attr=value", help="A value over the stage's.")
    ] = None,
    session_layer: Annotated[list[Path] | None, typer.Option(help="A layer over the stage.")] = None,
    exposure: Annotated[float, typer.Option(help="Stops, for pictures alone.")] = 0.0,
    seed: Annotated[int, typer.Option(help="Seed of all samples.")] = 0,
    threads: Annotated[int | None, typer.Option(help="Processor threads.", min=1)] = None,
    device: Annotated[Device, typer.Option(help="Where to render.")] = Device.auto,
    progress: Annotated[Progress | None, typer.Option(help="Default: rich on a terminal, else plain.")] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Read everything, render nothing.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print errors alone.")] = False,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Print more.")] = False,
) -> None:
    """Render a frame of a stage.

    Examples
    --------
    photonbeams render shot.usda -o out/shot.####.exr -f 1001

    photonbeams render room.usdc -o room.png --scattering 0.05 --res 1920 0 --passes 64
    """
    from .. import device as devices

    if not list_cameras and not dry_run and not output and not picture:
        raise typer.BadParameter("expected at least one output: -o FILE.exr, -o FILE.png or --picture LAYER=FILE.png")
    devices.select(device.value)
    if threads is not None:
        devices.set_threads(threads)
    _log(quiet, verbose)
    from ..quadrature import gauss_legendre, riemann
    from ..shot import Shot
    from ..shot.images import prepare_output
    from ..shot.stage import list_cameras as cameras_of
    from ..shot.stage import open_stage

    if list_cameras:
        for name in cameras_of(open_stage(scene)):
            typer.echo(name)
        return
    shot = Shot.open(scene, camera, session_layers=session_layer or (), overrides=overrides or ())
    shot.medium = _fog(shot, frame, scattering, absorption, anisotropy)
    targets = [(path, "rgba") for path in output or []] + [_picture(each) for each in picture or []]
    targets = [(_numbered(path, shot, frame), layer) for path, layer in targets]
    size = shot.resolution(res[0] or None, res[1] or None, frame)
    width, height = (max(1, round(value * res_scale)) for value in size)
    for path, _ in targets:
        prepare_output(path)
    if dry_run:
        from ..render.frame import check

        check(shot.read(frame)[0])
        return
    begin = time.perf_counter()
    with _bar(progress, quiet, passes) as advance:
        result = shot.render(
            frame, passes, width=width, height=height, crop=crop if crop != (0, 0, 1, 1) else None, progress=advance,
            time_limit=time_limit, beams=beams, estimator=estimator.value, seed=seed,
            rule=(gauss_legendre if rule is RuleName.gauss else riemann)(order),
        )  # fmt: skip
    result.metadata["commandLine"] = " ".join(["photonbeams", *sys.argv[1:]])
    unknown = [layer for _, layer in targets if layer not in result.layers]
    if unknown:
        raise typer.BadParameter(f"--picture {unknown[0]}: expected one of the layers {', '.join(result.layers)}")
    for path, layer in targets:
        result.write(path, layer=layer, exposure=exposure)
    if not quiet:
        _summary(result.statistics, [path for path, _ in targets], time.perf_counter() - begin)


def _picture(text: str) -> tuple[Path, str]:
    layer, found, path = text.partition("=")
    if not found or not layer or not path:
        raise typer.BadParameter(f"--picture {text}: expected LAYER=FILE.png, such as beams=beams.png")
    return Path(path), layer


def _numbered(path: Path, shot: Shot, frame: float | None) -> Path:
    """Return the path with its run of # replaced by the frame number."""
    runs = re.findall("#+", path.name)
    if not runs:
        return path
    moment = shot.time(frame)
    value = 0.0 if moment.IsDefault() else float(moment.GetValue())
    if len(runs) > 1:
        raise typer.BadParameter(f"{path}: expected one run of # for the frame number")
    text = f"{int(value):0{len(runs[0])}d}" if value == int(value) else f"{value:g}"
    return path.with_name(path.name.replace(runs[0], text))


def _fog(
    shot: Shot, frame: float | None, scattering: str | None, absorption: str | None, anisotropy: float | None
) -> Medium | None:
    """Return the fog that flags give: what they leave out comes from the stage's."""
    if scattering is None and absorption is None and anisotropy is None:
        return None
    from ..scene import BLACK, Medium, SceneError

    own = shot.read(frame)[0].medium
    if own is None and scattering is None:
        raise SceneError("--absorption and --anisotropy change a fog, and the stage has none: give --scattering too")
    return Medium(
        scattering=_color(scattering, "--scattering") if scattering is not None else own.scattering,  # type: ignore[union-attr]
        absorption=_color(absorption, "--absorption") if absorption is not None else (own.absorption if own else BLACK),
        anisotropy=anisotropy if anisotropy is not None else (own.anisotropy if own else 0.0),
        mesh=own.mesh if own else None,
    )


def _color(text: str, flag: str) -> Any:
    from ..scene import color

    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        raise typer.BadParameter(f"{flag} {text}: expected one number, or three with commas between") from None
    return color(numbers if len(numbers) != 1 else numbers[0], flag)


def _log(quiet: bool, verbose: bool) -> None:
    import logging

    logging.basicConfig(format="%(levelname)s: %(message)s", stream=sys.stderr)
    level = logging.ERROR if quiet else logging.DEBUG if verbose else logging.WARNING
    logging.getLogger("photonbeams").setLevel(level)


@contextmanager
def _bar(kind: Progress | None, quiet: bool, passes: int) -> Iterator[Callable[[int, Statistics], None] | None]:
    """Yield what is called with each pass done, to show it on standard error."""
    if quiet or kind is Progress.none:
        yield None
        return
    from rich.console import Console

    console = Console(stderr=True, highlight=False)
    if kind is Progress.plain or (kind is None and not console.is_terminal):
        yield lambda done, statistics: print(f"pass {done} of {passes}", file=sys.stderr, flush=True)
        return
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
               TextColumn("left"), TimeRemainingColumn())  # fmt: skip
    with Bar(*columns, console=console, transient=True) as bar:
        task = bar.add_task("passes", total=passes)
        yield lambda done, statistics: bar.update(task, completed=done)


def _summary(statistics: Statistics, files: list[Path], seconds: float) -> None:
    """Print what was done."""
    phases = ", ".join(f"{name} {value:.1f}" for name, value in statistics.seconds.items())
    lines = [
        f"{statistics.passes} passes, {statistics.beams:,} beams, {statistics.tests / 1e6:,.0f} million ray-beam tests",
        f"{seconds:.1f} s ({phases}; compiling {statistics.compile_seconds:.1f} of it, "
        f"{statistics.kernels_compiled} kernels)",
        *(f"wrote {path}" for path in files),
    ]
    print("\n".join(lines), file=sys.stderr)
