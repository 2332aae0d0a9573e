"""The header of an EXR for a frame of a stage."""

from __future__ import annotations

from fractions import Fraction
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ..common.openusd import Usd

_NTSC_ROUNDING = 2e-4  # relative error of a frame rate of two decimals; the next whole number is five times as far away


_FASTEST_NTSC = 250.0


def header(stage: Usd.Stage, time: Usd.TimeCode, duration: float) -> dict[str, Any]:
    """Return the header's entries about a frame's time; the shutter is open for `duration` time codes."""
    return {
        **origin(Path(stage.GetRootLayer().identifier).name, None if time.IsDefault() else time.GetValue()),
        "framesPerSecond": frame_rate(stage.GetFramesPerSecond()),
        "expTime": duration / stage.GetTimeCodesPerSecond(),
    }


def origin(scene: str, frame: float | None) -> dict[str, Any]:
    """Return the header's entries for the program, the scene's file and the frame's number, if it has one."""
    about: dict[str, Any] = {"software": f"photonbeams {version('photonbeams')}", "scene": scene}
    return about if frame is None else {**about, "frame": float(frame)}


def frame_rate(rate: float) -> Fraction:
    """Return a frame rate as a header stores it, a fraction of two 32-bit integers.

    NTSC rates are multiples of 1000/1001, however they were rounded: 23.976 and 23.98 are 24000/1001.
    """
    rate = min(max(rate, 0.0), 1e6)
    ntsc = Fraction(1000 * round(rate * 1.001), 1001)
    if rate < _FASTEST_NTSC and rate != round(rate) and abs(rate - ntsc) < _NTSC_ROUNDING * rate:
        return ntsc
    return Fraction(rate).limit_denominator(1001)
