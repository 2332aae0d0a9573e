"""Requests for frames: the arguments of `Shot.render`, checked, for both kinds of shots."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..images.plates import Depth, Holdout, Plate, part_of
from ..scene import Array

if TYPE_CHECKING:
    from ..render.checkpoint import Checkpoint
    from ..render.passes import Progress
    from ..render.settings import Settings
    from ..world.cameras import Window


@dataclass(frozen=True, kw_only=True)
class FrameRequest:
    """The arguments of `Shot.render`, checked as far as they do not depend on the shot."""

    frame: float | None
    settings: Settings
    width: int | None
    height: int | None
    crop: Sequence[float] | None
    progress: Progress | None
    checkpoint: Checkpoint | None
    blur: bool
    lens: bool
    view: str | None
    holdout: Holdout | None
    over: Plate | None

    def read_plates(
        self, number: float, views: Sequence[str], size: tuple[int, int], warn: Callable[[str], None]
    ) -> tuple[list[Depth], list[Array]]:
        """Return the holdout's depths and the plate's pixels of each view; none where there is no file."""
        depths = [] if self.holdout is None else self.holdout.read(number, views, size, warn)
        return depths, [] if self.over is None else self.over.read_whole(number, views, size, warn)

    def composite(self, pictures: Sequence[dict[str, Array]], pixels: Sequence[Array], window: Window) -> None:
        """Put the layers `rgba` of each view over the plate's pixels, if there are any."""
        if self.over is not None and pixels:
            for layers, each in zip(pictures, pixels, strict=True):
                layers["rgba"] = self.over.composite(layers, part_of(each, window))
