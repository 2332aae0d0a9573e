"""`photonbeams render`: a frame of a stage as a layered EXR and as pictures."""

from __future__ import annotations

import math
import shlex
import sys
import time
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .outputs import chosen_layers, parse_outputs, prepare_outputs, write_outputs
from .progress import Progress, bar, held_interrupt, messages, print_summary

if TYPE_CHECKING:
    from ..quadrature import Rule
    from ..render.frame import Statistics
    from ..scene import Color, Scene
    from ..shot import Shot

MOST_THREADS = 1024


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
    layers: Annotated[
        str | None, typer.Option(metavar="NAME,NAME", help="Layers of an .exr, beside rgba; default: all.")
    ] = None,
    frames: Annotated[str | None, typer.Option("--frames", "-f", help="The frame; default: the stage's start.")] = None,
    camera: Annotated[str | None, typer.Option("--camera", "-cam", help="Path or name of the camera.")] = None,
    list_cameras: Annotated[bool, typer.Option("--list-cameras", help="List the cameras and stop.")] = False,
    res: Annotated[
        tuple[int, int], typer.Option(metavar="W H", help="Size in pixels; what is 0 comes from the aperture.")
    ] = (
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
    threads: Annotated[int | None, typer.Option(help="Processor threads.")] = None,
    device: Annotated[Device, typer.Option(help="Where to render.")] = Device.auto,
    progress: Annotated[Progress | None, typer.Option(help="Default: rich on a terminal, else plain.")] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Read everything, render nothing.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print errors alone.")] = False,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Print more.")] = False,
) -> None:
    """Render a frame of a stage.

    For example:

    photonbeams render shot.usda -o out/shot.####.exr -f 1001

    photonbeams render room.usdc -o room.png --scattering 0.05 --res 1920 0 --passes 64
    """
    if not (output or picture or list_cameras or dry_run):
        raise typer.BadParameter("expected at least one output: -o FILE.exr, -o FILE.png or --picture LAYER=FILE.png")
    _check_flags(res, res_scale, crop, passes, time_limit, beams, order, anisotropy, exposure, threads)
    number = _frame_number(frames)
    fog = _Fog(_color("--scattering", scattering), _color("--absorption", absorption), anisotropy)
    outputs = parse_outputs(output or (), picture or ())
    with messages(quiet, verbose), held_interrupt() as check:
        _start(device, threads)
        from ..shot import Shot
        from ..shot.stage import list_cameras as cameras_of
        from ..shot.stage import open_stage

        check()
        if list_cameras:
            for name in cameras_of(open_stage(scene, session_layer or (), overrides or ())):
                typer.echo(name)
            return
        shot = Shot.open(scene, camera, session_layers=session_layer or (), overrides=overrides or ())
        check()
        content, eye = shot.read(number)
        check()
        content = fog.over(content)
        names = shot.check(content)
        outputs = [each.numbered(_moment(shot, number)) for each in outputs]
        kept = chosen_layers(layers, outputs, names)
        width, height = _size(shot, number, res, res_scale)
        prepare_outputs(outputs)
        if dry_run:
            if not quiet:
                files = ", ".join(str(each.path) for each in outputs) or "nothing"
                print(f"All is well: {scene} seen by {eye.name}, {width} x {height} pixels", file=sys.stderr)
                print(f"would write {files}, with the layers {', '.join(kept)}", file=sys.stderr)
            return
        begin = time.perf_counter()
        with bar(progress, quiet, passes) as show:

            def advance(done: int, _: Statistics) -> None:
                check()
                show(done)

            result = shot.render(
                number, passes, width=width, height=height, crop=crop, progress=advance, contents=(content, eye),
                time_limit=time_limit, beams=beams, estimator=estimator.value, rule=_rule(rule, order), seed=seed,
            )  # fmt: skip
        result.metadata["commandLine"] = _command_line()
        write_outputs(result, outputs, kept, exposure)
        if not quiet:
            print_summary(result.statistics, [each.path for each in outputs], time.perf_counter() - begin)


def _check_flags(
    res: tuple[int, int],
    res_scale: float,
    crop: tuple[float, float, float, float],
    passes: int,
    time_limit: float | None,
    beams: int,
    order: int,
    anisotropy: float | None,
    exposure: float,
    threads: int | None,
) -> None:
    """Refuse numbers out of range before anything heavy is imported; a NaN is never in range."""
    from ..quadrature import MOST_POINTS

    x0, y0, x1, y1 = crop
    inside = 0 <= x0 < x1 <= 1 and 0 <= y0 < y1 <= 1
    checks = (
        ("--res", res, min(res) >= 0 and max(res) <= 65536, "two numbers from 0 to 65536, 0 for the aperture's"),
        ("--res-scale", res_scale, 0 < res_scale <= 1000, "more than 0 and no more than 1000"),
        ("--crop", crop, inside, "0 <= x0 < x1 <= 1 and 0 <= y0 < y1 <= 1"),
        ("--passes", passes, 1 <= passes < 2**31, f"1 to {2**31 - 1}"),
        ("--time-limit", time_limit, time_limit is None or time_limit > 0, "a positive number of seconds"),
        ("--beams", beams, 1 <= beams <= 100_000_000, "1 to 100000000 beams a pass and light"),
        ("--order", order, 1 <= order <= MOST_POINTS, f"1 to {MOST_POINTS} points"),
        ("--anisotropy", anisotropy, anisotropy is None or -0.99 <= anisotropy <= 0.99, "-0.99 to 0.99"),
        ("--exposure", exposure, -100 <= exposure <= 100, "-100 to 100 stops"),
        ("--threads", threads, threads is None or 1 <= threads <= MOST_THREADS, f"1 to {MOST_THREADS}"),
    )
    for flag, value, right, expected in checks:
        if not right:
            text = " ".join(f"{each:g}" for each in value) if isinstance(value, tuple) else value
            raise typer.BadParameter(f"{flag} is {text}: expected {expected}")


def _frame_number(text: str | None) -> float | None:
    """Return the one frame that is asked for, or None for the stage's start."""
    if text is None:
        return None
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not abs(number) < 1e9:
        raise typer.BadParameter(f"--frames is {text}: expected one frame number, such as 101; a command renders one")
    return number


def _color(flag: str, text: str | None) -> Color | None:
    """Return the colour that a flag gives as a number, or as three with commas between."""
    from ..scene import color

    if text is None:
        return None
    try:
        return color([float(part) for part in text.split(",")], flag)
    except ValueError:  # a SceneError is one, too
        expected = "one number, or three with commas between, finite and at least 0"
        raise typer.BadParameter(f"{flag} is {text}: expected {expected}") from None


@dataclass(frozen=True)
class _Fog:
    """The fog that flags give."""

    scattering: Color | None
    absorption: Color | None
    anisotropy: float | None

    def over(self, content: Scene) -> Scene:
        """Return the scene in this fog: what the flags leave out comes from the scene's own."""
        from ..scene import BLACK, Medium

        given = {name: value for name, value in vars(self).items() if value is not None}
        if not given:
            return content
        if content.medium is None and self.scattering is None:
            raise typer.BadParameter(
                "--absorption and --anisotropy change a fog, and the stage has none: expected --scattering, too"
            )
        return replace(content, medium=replace(content.medium or Medium(scattering=BLACK), **given))


def _start(device: Device, threads: int | None) -> None:
    """Start the device on so many threads."""
    from .. import device as devices

    devices.select(device.value)
    if threads is not None:
        devices.set_threads(threads)


def _moment(shot: Shot, number: float | None) -> float:
    """Return the frame number that names files."""
    moment = shot.time(number)
    return 0.0 if moment.IsDefault() else float(moment.GetValue())


def _size(shot: Shot, number: float | None, res: tuple[int, int], scale: float) -> tuple[int, int]:
    """Return width and height in pixels."""
    width, height = shot.resolution(res[0] or None, res[1] or None, number)
    return shot.resolution(max(1, round(scale * width)), max(1, round(scale * height)), number)


def _rule(name: RuleName, order: int) -> Rule:
    from ..quadrature import gauss_legendre, riemann

    return (gauss_legendre if name is RuleName.gauss else riemann)(order)


def _command_line() -> str:
    """Return the command for the header of an EXR, whose text is UTF-8 whatever file names are."""
    return shlex.join(["photonbeams", *sys.argv[1:]]).encode("utf-8", "replace").decode("utf-8")
