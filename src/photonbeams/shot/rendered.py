"""A rendered frame, and what its file says of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pxr import Usd

from ..files import PathLike
from ..scene import Array, SceneError
from .images import write_frame

if TYPE_CHECKING:
    from ..render.passes import Statistics


_NTSC_ROUNDING = 2e-4  # of a rate of frames with two digits; the next whole number is five times as far
_FASTEST_NTSC = 250.0


@dataclass(frozen=True)
class Frame:
    """A rendered frame.

    Attributes
    ----------
    layers
        Name to (H, W, C) float32: rgba, surface, beams, beams_<group>, transmittance, depth.
    metadata
        What the EXR's header says.
    statistics
        Passes, beams, seconds by phase, kernels compiled.
    views
        Of a stereo frame, layers and metadata of each eye, "left" before "right"; `layers` and `metadata` are those of
        the first.
    """

    layers: dict[str, Array]
    metadata: dict[str, Any]
    statistics: Statistics
    views: dict[str, tuple[dict[str, Array], dict[str, Any]]] = field(default_factory=dict)

    def write(self, path: PathLike, layer: str = "rgba", exposure: float = 0.0) -> None:
        """Write a layered EXR, or one layer as a tone-mapped PNG, by the suffix; whole or not at all."""
        write_frame(path, self.layers, self.metadata, layer=layer, exposure=exposure, views=self.views)


def header(stage: Usd.Stage, time: Usd.TimeCode, duration: float) -> dict[str, Any]:
    """Return what an EXR's header says of a frame's time; the shutter is open for `duration` time codes."""
    about: dict[str, Any] = {
        "software": f"photonbeams {version('photonbeams')}",
        "framesPerSecond": frame_rate(stage.GetFramesPerSecond()),
        "expTime": duration / stage.GetTimeCodesPerSecond(),
        "scene": Path(stage.GetRootLayer().identifier).name,
    }
    if not time.IsDefault():
        about["frame"] = float(time.GetValue())
    return about


def frame_rate(rate: float) -> Fraction:
    """Return a number of frames a second as a header has it, a fraction of two 32-bit integers.

    Those of NTSC are multiples of 1000/1001, whatever they were rounded to: 23.976 and 23.98 are 24000/1001.
    """
    rate = min(max(rate, 0.0), 1e6)
    ntsc = Fraction(1000 * round(rate * 1.001), 1001)
    if rate < _FASTEST_NTSC and rate != round(rate) and abs(rate - ntsc) < _NTSC_ROUNDING * rate:
        return ntsc
    return Fraction(rate).limit_denominator(1001)


def pixels_of(crop: Sequence[float] | None, width: int, height: int) -> tuple[int, int, int, int]:
    """Return the pixels of a crop window, at least one; SceneError where it is no part of the picture."""
    if crop is None:
        return (0, 0, width, height)
    if isinstance(crop, str) or np.shape(crop) != (4,):
        raise SceneError(f"the crop is {crop!r}: expected four numbers, x0, y0, x1, y1")
    x0, y0, x1, y1 = crop
    if not (0 <= x0 < x1 <= 1 and 0 <= y0 < y1 <= 1):
        raise SceneError(f"the crop is {tuple(crop)}: expected 0 <= x0 < x1 <= 1 and 0 <= y0 < y1 <= 1")
    left, top = int(x0 * width), int(y0 * height)
    return (left, top, max(left + 1, round(x1 * width)), max(top + 1, round(y1 * height)))
