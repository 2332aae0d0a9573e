"""Flags that several commands or both kinds of scenes share: their ranges, and the objects made from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from math import isfinite
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from ..quadrature import Rule
    from ..render.settings import Settings
    from ..scene import Color, Medium
    from ..usd.cameras.stereo import Stereo
    from ..usd.common.selection import Selection

MOST_THREADS = 1024
MOST_BOUNCES = 2**31 - 3  # 2 edges less than `max_depth`


class Estimator(StrEnum):
    """How a beam's light along a ray is estimated."""

    auto = "auto"
    billboard = "billboard"
    frustum = "frustum"


class Gather(StrEnum):
    """Whether beams are gathered along every ray, or along fewer where they look smooth."""

    adaptive = "adaptive"
    exact = "exact"


class RuleName(StrEnum):
    """A quadrature rule."""

    gauss = "gauss"
    riemann = "riemann"


class Filter(StrEnum):
    """A pixel filter, by Mitsuba's name."""

    box = "box"
    tent = "tent"
    gaussian = "gaussian"
    mitchell = "mitchell"
    catmullrom = "catmullrom"
    lanczos = "lanczos"


class Complexity(StrEnum):
    """How finely subdivision surfaces are refined."""

    low = "low"
    medium = "medium"
    high = "high"
    veryhigh = "veryhigh"


class Device(StrEnum):
    """The processor to compute on."""

    auto = "auto"
    cpu = "cpu"
    cuda = "cuda"


def two_eyes(
    stereo: bool, interaxial: float | None, convergence: float | None, view: str | None = None
) -> Stereo | None:  # fmt: skip
    """Return how the camera is split into two eyes, or None for one eye."""
    flags = {"--interaxial": interaxial, "--convergence": convergence, "--view": view}
    for flag, value in flags.items():
        if value is not None and not stereo:
            raise typer.BadParameter(f"{flag} is for two eyes: expected --stereo, too")
    if not stereo:
        return None
    from ..scene import SceneError
    from ..usd.cameras.stereo import Stereo

    try:
        return Stereo(interaxial, convergence)
    except SceneError as error:
        raise typer.BadParameter(f"--{error}") from None


def check_flags(
    res: tuple[int, int] = (0, 0),
    res_scale: float = 1.0,
    crop: tuple[float, float, float, float] | None = None,
    passes: int | None = None,
    time_limit: float | None = None,
    error: float | None = None,
    beams: int | None = None,
    order: int | None = None,
    gather_error: float | None = None,
    anisotropy: float | None = None,
    exposure: float = 0.0,
    threads: int | None = None,
    bounces: int | None = None,
    checkpoint: float | None = None,
    snapshot: float | None = None,
    overscan: bool = False,
) -> None:
    """Refuse numbers out of range, before anything heavy is imported; a NaN is never in range.

    With `overscan`, a crop may reach beyond the picture.
    """
    from ..quadrature import MOST_POINTS
    from ..scene import MOST_BEAMS, MOST_PIXELS

    x0, y0, x1, y1 = sides = crop or (0.0, 0.0, 1.0, 1.0)
    window = x0 < x1 and y0 < y1 and all(isfinite(each) if overscan else 0 <= each <= 1 for each in sides)
    bounds = "x0 < x1 and y0 < y1" if overscan else "0 <= x0 < x1 <= 1 and 0 <= y0 < y1 <= 1"
    checks = (
        (
            "--res",
            res,
            min(res) >= 0 and max(res) <= MOST_PIXELS,
            f"two numbers from 0 to {MOST_PIXELS}, 0 to follow the aperture",
        ),
        ("--res-scale", res_scale, 0 < res_scale <= 1000, "more than 0 and no more than 1000"),
        ("--crop", crop, window, bounds),
        ("--passes", passes, passes is None or 1 <= passes < 2**31, f"1 to {2**31 - 1}"),
        ("--time-limit", time_limit, time_limit is None or time_limit > 0, "a positive number of seconds"),
        ("--error", error, error is None or 0 < error < 1, "more than 0 and less than 1, such as 0.01"),
        (
            "--beams",
            beams,
            beams is None or 1 <= beams <= MOST_BEAMS,
            f"1 to {MOST_BEAMS} beams for each pass and light",
        ),
        ("--order", order, order is None or 1 <= order <= MOST_POINTS, f"1 to {MOST_POINTS} points"),
        ("--gather-error", gather_error, gather_error is None or 0 <= gather_error < 1, "0 (exact) to less than 1"),
        ("--anisotropy", anisotropy, anisotropy is None or -0.99 <= anisotropy <= 0.99, "-0.99 to 0.99"),
        ("--exposure", exposure, -100 <= exposure <= 100, "-100 to 100 stops"),
        (
            "--bounces",
            bounces,
            bounces is None or -1 <= bounces <= MOST_BOUNCES,
            f"0 to {MOST_BOUNCES}, or -1 for no limit",
        ),
        ("--checkpoint", checkpoint, checkpoint is None or checkpoint > 0, "a positive number of seconds"),
        ("--snapshot", snapshot, snapshot is None or snapshot > 0, "a positive number of seconds"),
        ("--threads", threads, threads is None or 1 <= threads <= MOST_THREADS, f"1 to {MOST_THREADS}"),
    )
    for flag, value, right, expected in checks:
        if not right:
            text = " ".join(f"{each:g}" for each in value) if isinstance(value, tuple) else value
            raise typer.BadParameter(f"{flag} is {text}: expected {expected}")


@dataclass(frozen=True, kw_only=True)
class Quality:
    """The flags of quality; None where they leave the choice to the scene, or to its kind."""

    passes: int | None = None
    time_limit: float | None = None
    error: float | None = None
    denoise: bool = False
    keep_noisy: bool = False
    beams: int | None = None
    bounces: int | None = None
    estimator: Estimator | None = None
    rule: RuleName | None = None
    order: int | None = None
    gather: Gather | None = None
    gather_error: float | None = None
    pixel_filter: Filter | None = None
    seed: int | None = None

    def _max_depth(self) -> int | None:
        if self.bounces is None:
            return None
        return -1 if self.bounces < 0 else self.bounces + 2

    def over(self, own: Settings) -> Settings:
        """Return a scene's settings with the given flags; without `--order`, a rule keeps their number of points."""
        from ..render.settings import Settings

        given = {
            "passes": self.passes, "time_limit": self.time_limit, "error": self.error, "denoise": self.denoise or None,
            "keep_noisy": self.keep_noisy or None, "seed": self.seed, "beams": self.beams,
            "max_depth": self._max_depth(),
            "estimator": self.estimator and self.estimator.value, "rule": self._rule(len(own.rule)),
            "gather_error": 0.0 if self.gather is Gather.exact else self.gather_error,
            "pixel_filter": self.pixel_filter and self.pixel_filter.value,
        }  # fmt: skip
        return Settings.of(own, {name: value for name, value in given.items() if value is not None})

    def _rule(self, points: int) -> Rule | None:
        from ..quadrature import gauss_legendre, riemann

        if self.rule is None and self.order is None:
            return None
        return (riemann if self.rule is RuleName.riemann else gauss_legendre)(self.order or points)


@dataclass(frozen=True)
class PassRange:
    """Some passes of a frame: `first` to `last` or, with `parts`, part number `first` of that many equal parts."""

    first: int
    last: int = 0
    parts: int = 0

    @classmethod
    def parse(cls, text: str | None) -> PassRange | None:
        """Return the range that `--pass-range` names, or None without one."""
        if text is None:
            return None
        for mark in ":/":
            first, found, last = text.partition(mark)
            if found and first.isdecimal() and last.isdecimal() and int(first) <= int(last) < 2**31:
                if mark == ":":
                    return cls(int(first), int(last))
                if int(first) > 0:
                    return cls(int(first), parts=int(last))
        raise typer.BadParameter(
            f"--pass-range is {text}: expected FIRST:LAST, such as 0:15, or PART/PARTS, such as 1/4"
        )

    def of(self, passes: int) -> range:
        """Return this range of a frame with a number of passes."""
        if self.parts:
            found = range((self.first - 1) * passes // self.parts, self.first * passes // self.parts)
        else:
            found = range(self.first, self.last + 1)
        if not found or found.stop > passes:
            text = f"{self.first}/{self.parts}" if self.parts else f"{self.first}:{self.last}"
            raise typer.BadParameter(f"--pass-range is {text}: expected some of the passes from 0 to {passes - 1}")
        return found


def parse_color(flag: str, text: str | None) -> Color | None:
    """Return the colour that a flag gives as one number, or as three separated by commas."""
    from ..scene import color

    if text is None:
        return None
    try:
        return color([float(part) for part in text.split(",")], flag)
    except ValueError:  # a SceneError is one, too
        expected = "one number, or three separated by commas, finite and at least 0"
        raise typer.BadParameter(f"{flag} is {text}: expected {expected}") from None


@dataclass(frozen=True)
class SelectionFlags:
    """The flags that say what of a stage is read, as text."""

    mask: str | None = None
    purposes: str | None = None
    variants: Sequence[str] = ()
    complexity: Complexity | None = None

    def selection(self) -> Selection:
        """Return the selection; raise SceneError where a flag is not valid in USD."""
        from ..usd.common.selection import Selection

        return Selection.of(self.mask, self.purposes, self.variants, self.complexity and self.complexity.value)


@dataclass(frozen=True)
class FogFlags:
    """The fog that the flags describe; None where they leave a value to the stage's fog."""

    scattering: Color | None
    absorption: Color | None
    anisotropy: float | None
    surfaces: bool | None

    @classmethod
    def parse(
        cls, scattering: str | None, absorption: str | None, anisotropy: float | None, beams_only: bool = False
    ) -> FogFlags:
        """Return the fog that the flags describe; raise BadParameter where a colour is not valid."""
        colors = parse_color("--scattering", scattering), parse_color("--absorption", absorption)
        return cls(*colors, anisotropy, False if beams_only else None)

    def over(self, own: Medium | None) -> Medium | None:
        """Return this fog, with missing values taken from the stage's `own`."""
        from ..scene import BLACK, Medium

        given = {name: value for name, value in vars(self).items() if value is not None}
        if not given:
            return own
        if own is None and self.scattering is None:
            raise typer.BadParameter(
                "--absorption, --anisotropy and --beams-only-fog change a fog, but the stage has none: "
                "expected --scattering, too"
            )
        return replace(own or Medium(scattering=BLACK), **given)


def start_device(device: Device, threads: int | None) -> None:
    """Start the device with this number of threads, None for its default."""
    from ..runtime.limits import check_address_space

    check_address_space()
    from ..runtime import device as devices

    devices.select(device.value)
    if threads is not None:
        devices.set_threads(threads)
