"""The flags of fog: what it is made of, where it is, and how it varies."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import typer

from ..groups import Flags, option, usage_errors

if TYPE_CHECKING:
    from collections.abc import Callable

    from pxr import Usd

    from ...scene import Color, FogDensity, Medium, Mesh

_POSITIVE: dict[str, Any] = {"above": 0.0, "expected": "a positive number of scene units"}


class FogFlags(Flags):
    """The fog that the flags describe; None where they leave a value to the stage's fog."""

    scattering: str | None = option(
        None, "Scattering of the fog per scene unit: adds a fog, or changes the stage's.", metavar="S|R,G,B"
    )
    absorption: str | None = option(None, "Absorption of the fog per scene unit.", metavar="S|R,G,B")
    anisotropy: float | None = option(
        None, "Anisotropy of the fog: its mean cosine, -0.99 to 0.99.", least=-0.99, most=0.99
    )
    fog_box: str | None = option(
        None, "Keep the fog to a box, given by two corners or as the one around a prim.",
        metavar="X,Y,Z,X,Y,Z|PRIM",
    )  # fmt: skip
    fog_falloff: float | None = option(
        None, "Scene units of height over which the fog falls to 1 / e.", metavar="HEIGHT", **_POSITIVE
    )
    fog_ground: float | None = option(
        None, "Height above which the fog falls, with --fog-falloff; default: 0.", metavar="HEIGHT", least=-1e30
    )
    fog_noise: float | None = option(
        None, "How much the fog varies in wisps, 0 to 1.", metavar="AMOUNT", least=0.0, most=1.0
    )
    fog_noise_scale: float | None = option(
        None, "Size of the largest wisps, with --fog-noise; default: 1 scene unit.", metavar="SIZE", **_POSITIVE
    )
    fog_drift: str | None = option(
        None, "How wisps move, in scene units per second, with --fog-noise.", metavar="X,Y,Z"
    )

    def __post_init__(self) -> None:
        self._given()
        self._drift()
        if self.fog_box is not None and not self.fog_box.startswith("/"):
            self._corners(self.fog_box)

    def _given(self) -> dict[str, Any]:
        """Return the fields of a medium that flags set; raise BadParameter where a colour is not valid."""
        colors = {name: parse_color(f"--{name}", getattr(self, name)) for name in ("scattering", "absorption")}
        return _without_none(**colors, anisotropy=self.anisotropy)

    def on(self, stage: Usd.Stage) -> Callable[[Medium | None], Medium | None]:
        """Return a function that changes a stage's fog as these flags say; raise BadParameter for a box without one."""
        from ...usd.media.boxes import box_around
        from ...usd.stage import default_time

        if self.fog_box is None or not self.fog_box.startswith("/"):
            return partial(self._over, None if self.fog_box is None else self._corners(self.fog_box))
        with usage_errors("--fog-box: "):
            return partial(self._over, box_around(stage, [self.fog_box], "", default_time(stage)))

    def _over(self, box: Mesh | None, own: Medium | None) -> Medium | None:
        """Return this fog, with missing values taken from the stage's `own`."""
        from ...scene import BLACK, Medium

        given = self._given()
        density = self._varying(None if own is None else own.density)
        if not given and box is None and density is (None if own is None else own.density):
            return own
        if own is None and self.scattering is None:
            raise typer.BadParameter(
                "--absorption, --anisotropy, --beams-only-fog and --fog-... change a fog, but the stage has none: "
                "expected --scattering, too"
            )
        changed = replace(own or Medium(scattering=BLACK), **given, density=density)
        return changed if box is None else replace(changed, mesh=replace(box, name=f"{changed.name} fog"))

    def _varying(self, own: FogDensity | None) -> FogDensity | None:
        """Return how the fog varies, with missing values taken from the stage's; BadParameter for a flag in vain."""
        height = _without_none(falloff=self.fog_falloff, ground=self.fog_ground)
        wisps = _without_none(amount=self.fog_noise, scale=self.fog_noise_scale, drift=self._drift())
        if not (height or wisps):
            return own
        from ...scene import FogDensity, FogNoise

        found = replace(own or FogDensity(), **height)
        if wisps:
            found = replace(found, noise=replace(found.noise or FogNoise(amount=0.0), **wisps))
        if height and found.falloff is None:
            raise typer.BadParameter("--fog-ground is for fog that falls with height: expected --fog-falloff, too")
        if wisps and found.noise is not None and not found.noise.amount and self.fog_noise is None:
            raise typer.BadParameter("--fog-noise-scale and --fog-drift are for wisps: expected --fog-noise, too")
        return found

    def _drift(self) -> tuple[float, ...] | None:
        return _numbers("--fog-drift", self.fog_drift, 3)

    def _corners(self, text: str) -> Mesh:
        """Return the box between the corners that a text gives."""
        from ...usd.media.boxes import checked_box

        values = _numbers("--fog-box", text, 6, ", or the path of a prim")
        assert values is not None
        with usage_errors(f"--fog-box is {text}: "):
            return checked_box("", values[:3], values[3:], "the box")


def _without_none(**values: Any) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}


def _numbers(flag: str, text: str | None, count: int, more: str = "") -> tuple[float, ...] | None:
    """Return the finite numbers, separated by commas, that a flag gives."""
    if text is None:
        return None
    parts = text.split(",")
    try:
        found = tuple(map(float, parts))
    except ValueError:
        found = ()
    if len(found) != count or not all(abs(each) < float("inf") for each in found):
        raise typer.BadParameter(f"{flag} is {text}: expected {count} numbers separated by commas{more}")
    return found


def parse_color(flag: str, text: str | None) -> Color | None:
    """Return the colour that a flag gives as one number, or as three separated by commas."""
    if text is None:
        return None
    from ...scene import color

    try:
        return color([float(part) for part in text.split(",")], flag)
    except ValueError:  # a SceneError is one, too
        expected = "one number, or three separated by commas, finite and at least 0"
        raise typer.BadParameter(f"{flag} is {text}: expected {expected}") from None
