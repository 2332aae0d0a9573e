"""The groups of flags that several commands share, and those of the settings and passes of `render`."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Mapping
from functools import cached_property
from inspect import Parameter
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

import typer

from ..constants import MOST_PIXELS
from ..render.settings import depth_of, flags
from ..setting import Setting
from .groups import Flags, checked, option, usage_errors
from .options.fog import FogFlags
from .programs import load_function

if TYPE_CHECKING:
    from ..quadrature import Rule
    from ..render.settings import Settings
    from ..usd.cameras.stereo import Stereo
    from ..usd.common.selection import Selection

SECONDS: dict[str, Any] = {"above": 0.0, "expected": "a positive number of seconds"}


def _check_size(value: tuple[int, int]) -> tuple[int, int]:
    if not (min(value) >= 0 and max(value) <= MOST_PIXELS):
        text = f"two numbers from 0 to {MOST_PIXELS}, 0 to follow the aperture"
        raise typer.BadParameter(f"--res is {value[0]} {value[1]}: expected {text}")
    return value


Crop = tuple[float, float, float, float]


def check_crop(crop: Crop | None, overscan: bool) -> None:
    """Refuse a crop without pixels or, without `overscan`, one that reaches beyond the picture."""
    if crop is None:
        return
    x0, y0, x1, y1 = crop
    if not (x0 < x1 and y0 < y1 and all(isfinite(each) if overscan else 0 <= each <= 1 for each in crop)):
        bounds = "x0 < x1 and y0 < y1" if overscan else "0 <= x0 < x1 <= 1 and 0 <= y0 < y1 <= 1"
        raise typer.BadParameter(f"--crop is {' '.join(f'{each:g}' for each in crop)}: expected {bounds}")


# -- options of several commands ---------------------------------------------------------------------------------------

Camera = Annotated[str | None, typer.Option("--camera", "-cam", help="Path or name of the camera.")]
CropOption = Annotated[
    Crop | None,
    typer.Option(
        metavar="X0 Y0 X1 Y1",
        help="Render only this part, in fractions of the picture from its top left corner; where a "
        "stage is rendered, numbers beyond 0 to 1 add overscan.",
    ),
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print only errors.")]
Resolution = Annotated[
    tuple[int, int],
    typer.Option(
        metavar="W H", help="Width and height in pixels; a 0 follows from the camera's aperture.", callback=_check_size
    ),
]
SessionLayers = Annotated[
    list[Path] | None,
    typer.Option(metavar="FILE", help="A USD layer over the stage; may be repeated, the first is the strongest."),
]
Stage = Annotated[Path, typer.Argument(help="A .usd, .usda, .usdc or .usdz stage.")]


_FRAMES = "Frames, such as 101, 101:105, 105:101, 101:109x2, or several with commas; default: the stage's start."

# -- groups ----------------------------------------------------------------------------------------------------------


class PictureFlags(Flags):
    """The frames, and the pictures and layers that are written of them."""

    picture: list[str] | None = option(None, "Write one layer as a picture; may be repeated.", metavar="LAYER=FILE.png")
    layers: str | None = option(
        None, "Layers to write into an .exr; default: all except those that are made on request: normal, albedo, "
        "position, motion, crypto_object, crypto_material.", metavar="NAME,NAME",
    )  # fmt: skip
    single_part: bool = option(
        False, "Write all layers of an .exr into one part, for programs that read only the first: R, G, B, A, Z, "
        "beams.R, ...",
    )  # fmt: skip
    deep: Path | None = option(
        None, "Write the beams as a deep .exr: samples of light and opacity along each pixel's ray.", metavar="FILE"
    )
    frames: str | None = option(None, _FRAMES, "--frames", "-f", metavar="FRAMES")
    skip_existing: bool = option(False, "Skip frames whose files all exist.")
    fail_missing: bool = option(
        False, "Fail a frame for which something that the stage names is missing: a file, a value clip, a prim."
    )
    exposure: float = option(
        0.0, "Exposure of .png pictures in stops; an .exr stays as it is.",
        least=-100.0, most=100.0, expected="-100 to 100 stops",
    )  # fmt: skip


class ProgramFlags(Flags):
    """Functions in Python that change or make beams."""

    simulate: str | None = option(
        None, "A Python function that changes the beams of each pass.", metavar="FILE.py:NAME"
    )
    emit: str | None = option(None, "A Python function that makes beams of its own.", metavar="FILE.py:NAME")

    def loaded(self) -> dict[str, Any]:
        """Return the functions, as arguments of `Shot`."""
        return {name: load_function(f"--{name}", getattr(self, name)) for name in ("simulate", "emit")}


class MessageFlags(Flags):
    """Which messages are printed."""

    quiet: Quiet = False
    verbose: bool = option(False, "Print more, such as OpenUSD's own messages.", "--verbose", "-v")

    def say(self, text: str) -> None:
        """Print lines about what was done."""
        from ..scene.checks import printable

        if not self.quiet:
            print(printable(text), file=sys.stderr)


class DeviceFlags(Flags):
    """The processor, and how many of its threads."""

    threads: int | None = option(None, "Number of processor threads; default: all.", kind=int, least=1, most=1024)
    device: Literal["auto", "cpu", "cuda"] = option("auto", "Processor to render on.")

    def start(self) -> None:
        """Start the device."""
        from ..runtime.limits import check_address_space

        check_address_space()
        from ..runtime import device

        device.select(self.device)
        if self.threads is not None:
            device.set_threads(self.threads)


class EyeFlags(Flags):
    """Whether there are two eyes, and how far apart."""

    stereo: bool = option(False, "Render two eyes: a pair of cameras with stereoRole, or the one camera split in two.")
    interaxial: float | None = option(None, "Distance between the eyes in scene units; default: 65 mm.")
    convergence: float | None = option(
        None, "Distance, in scene units, at which both eyes see the same; default: the focus distance, or infinity."
    )

    def __post_init__(self) -> None:
        self.eyes()

    def eyes(self) -> Stereo | None:
        """Return how the camera is split into two eyes, or None for one eye."""
        for name, value in vars(self).items():
            if value is not None and not self.stereo and name != "stereo":
                raise typer.BadParameter(f"--{name} is for two eyes: expected --stereo, too")
        if not self.stereo:
            return None
        from ..usd.cameras.stereo import Stereo

        with usage_errors("--"):
            return Stereo(self.interaxial, self.convergence)


class LayerFlags(Flags):
    """What is changed of a stage."""

    overrides: list[str] | None = option(
        None, "Override a value of the stage; may be repeated.", "--set", metavar="/prim.attr=value"
    )
    session_layer: SessionLayers = None


class SelectionFlags(Flags):
    """What of a stage is read."""

    variant: list[str] | None = option(None, "Select a variant; may be repeated.", metavar="/prim{set=choice}")
    mask: str | None = option(
        None, "Read only these prims, their ancestors and descendants, and what they refer to.", metavar="PATH,PATH"
    )
    purposes: str | None = option(
        None, "Purposes to render, in addition to `default`; default: render.", metavar="NAME,NAME"
    )
    complexity: Literal["low", "medium", "high", "veryhigh"] | None = option(
        None, "How finely subdivision surfaces are refined; default: high for meshes that declare subdivision, else "
        "low.",
    )  # fmt: skip

    def selection(self) -> Selection:
        """Return the selection; raise SceneError where a flag is not valid in USD."""
        from ..usd.common.selection import Selection

        return Selection.of(self.mask, self.purposes, self.variant or (), self.complexity)


class ContentFlags(Flags):
    """What is read of a stage for a file of another kind, and what is printed."""

    frames: str | None = option(None, _FRAMES, "--frames", "-f", metavar="FRAMES")
    fog: FogFlags
    layers: LayerFlags
    selection: SelectionFlags
    shown: MessageFlags


class PassRange(NamedTuple):
    """Some passes of a frame: FIRST:LAST or, with the mark /, part FIRST of LAST equal parts of all."""

    first: int
    mark: str
    last: int

    def __str__(self) -> str:
        return f"{self.first}{self.mark}{self.last}"

    @classmethod
    def parse(cls, text: str) -> PassRange:
        """Return the range that `--pass-range` names."""
        match = re.fullmatch(r"([0-9]{1,9})([:/])([0-9]{1,9})", text)
        least = 1 if "/" in text else 0
        if match is None or not least <= int(match[1]) <= int(match[3]):
            expected = "expected FIRST:LAST, such as 0:15, or PART/PARTS, such as 1/4"
            raise typer.BadParameter(f"--pass-range is {text}: {expected}")
        return cls(int(match[1]), match[2], int(match[3]))

    def of(self, passes: int) -> range:
        """Return this range of a frame with a number of passes."""
        if self.mark == ":":
            numbers = range(self.first, self.last + 1)
        else:
            numbers = range((self.first - 1) * passes // self.last, self.first * passes // self.last)
        if not numbers or numbers.stop > passes:
            raise typer.BadParameter(f"--pass-range is {self}: expected some of the passes from 0 to {passes - 1}")
        return numbers


class PassFlags(Flags):
    """Which passes are rendered, and what is kept of them on the way."""

    checkpoint: float | None = option(
        None, "Save the passes so far to a checkpoint every S seconds and on Ctrl-C.", metavar="S", **SECONDS
    )
    resume: bool = option(False, "Continue from checkpoints that exist.")
    snapshot: float | None = option(
        None, "Write the picture so far, as *.snapshot.exr, every S seconds and on the signal SIGUSR1.", metavar="S",
        **SECONDS,
    )  # fmt: skip
    pass_range: str | None = option(
        None, "Render only passes A to B, or the I-th of N equal parts of all passes, into a .checkpoint for "
        "`photonbeams merge`.", metavar="A:B|I/N",
    )  # fmt: skip

    @cached_property
    def part(self) -> PassRange | None:
        """The range of passes, or None for all."""
        return None if self.pass_range is None else PassRange.parse(self.pass_range)


class SettingsFlags(Flags):
    """The flags of `Settings`; their options are made from what its fields say of themselves."""

    values: Mapping[str, Any]  # of the flags that are given, by the names of their parameters: "bounces" for --bounces

    @classmethod
    def options(cls) -> Iterator[Parameter]:
        """Yield an option for each flag that sets a field."""
        for _, flag in flags():
            kind: Any = Literal[flag.choices] if flag.choices else flag.kind
            made = typer.Option(flag.name, help=flag.help, metavar=flag.metavar, callback=checked(flag))
            boolean = kind is bool
            yield Parameter(
                _name(flag), Parameter.KEYWORD_ONLY, default=False if boolean else None,
                annotation=Annotated[kind if boolean else kind | None, made],
            )  # fmt: skip

    @classmethod
    def of(cls, values: dict[str, Any]) -> SettingsFlags:
        """Return the flags that are given among the `values` of a command line."""
        names = [_name(flag) for _, flag in flags()]
        return cls(values={name: values[name] for name in names if values[name] not in (None, False)})

    def given(self) -> Iterator[str]:
        """Yield the flags that are given."""
        yield from (flag.name for _, flag in flags() if _name(flag) in self.values)

    def over(self, own: Settings) -> Settings:
        """Return a scene's settings with the given flags; without `--order`, a rule keeps their number of points."""
        from ..render.settings import Settings

        found = {field: self.values[_name(flag)] for field, flag in flags() if _name(flag) in self.values}
        if "max_depth" in found:
            found["max_depth"] = depth_of(found["max_depth"])
        if "rule" in found:
            found["rule"] = self._rule(len(own.rule))
        if self.values.get("gather") == "exact":
            found["gather_error"] = 0.0
        elif found.get("gather_error") == "adaptive":
            del found["gather_error"]
        return Settings.of(own, found)

    def _rule(self, points: int) -> Rule:
        from ..quadrature import gauss_legendre, riemann

        kind = riemann if self.values.get("rule") == "riemann" else gauss_legendre
        return kind(self.values.get("order", points))


def _name(flag: Setting) -> str:
    return flag.name.removeprefix("--").replace("-", "_")
