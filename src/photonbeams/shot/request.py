"""Requests for frames: the arguments of `Shot.render`, checked, for all kinds of shots."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..images.frame import Frame
from ..images.plates import Depth, Holdout, Plate
from ..render.checkpoint import Checkpoint
from ..render.passes import PlannedPasses, Progress, RunOptions
from ..render.settings import Settings
from ..runtime.files import PathLike
from ..scene import Array, SceneError, real
from ..scene.cameras import CONFORM_POLICIES
from .development import Development

if TYPE_CHECKING:
    from ..render.films.frame_sums import FrameSums
    from ..render.holdouts import HoldoutDepth
    from ..world.cameras.cameras import Window
    from ..world.shutter import Shutter

#: Called after each pass with a function that returns the frame so far.
Snapshot = Callable[[Callable[[], Frame]], None]


@dataclass(frozen=True)
class Prepared:
    """What the passes of a stage's frame need.

    Attributes
    ----------
    shutter, window, settings, holdouts
        As `render.stage_frame.render` takes them.
    development
        How the sums of the passes become a picture.
    """

    shutter: Shutter
    window: Window
    settings: Settings
    holdouts: Sequence[HoldoutDepth]
    development: Development


@dataclass(frozen=True, kw_only=True)
class FrameRequest:
    """The arguments of `Shot.render`, checked as far as they do not depend on the shot.

    `part` are the passes to render, None: all; `kept` is what `RunOptions` caches for further parts.
    """

    frame: float | None
    settings: Settings
    width: int | None = None
    height: int | None = None
    crop: Sequence[float] | None = None
    pixel_aspect: float = 1.0
    conform: str = CONFORM_POLICIES[0]
    progress: Progress | None = None
    checkpoint: Checkpoint | None = None
    snapshot: Snapshot | None = None
    blur: bool = True
    lens: bool = True
    view: str | None = None
    holdout: Holdout | None = None
    over: Plate | None = None
    part: PlannedPasses | None = None
    kept: dict[Any, Any] | None = None

    @classmethod
    def of(
        cls,
        frame: float | None,
        settings: Settings,
        *,
        checkpoint: PathLike | Checkpoint | None = None,
        holdout: PathLike | Array | Holdout | None = None,
        over: PathLike | Array | Plate | None = None,
        **given: Any,
    ) -> FrameRequest:
        """Return the request for these arguments of `Shot.render`."""
        return cls(
            frame=frame, settings=settings, checkpoint=Checkpoint.of(checkpoint), holdout=Holdout.of(holdout),
            over=Plate.of(over), **given,
        )  # fmt: skip

    def __post_init__(self) -> None:
        if not 1e-3 <= real(self.pixel_aspect, "pixel_aspect") <= 1e3:
            raise SceneError(f"pixel_aspect is {self.pixel_aspect}: expected a number from 0.001 to 1000")
        if self.conform not in CONFORM_POLICIES:
            raise SceneError(f"conform is {self.conform!r}: expected one of {', '.join(CONFORM_POLICIES)}")

    def read_plates(
        self, number: float, views: Sequence[str], window: Window, grown: Window, warn: Callable[[str], None]
    ) -> tuple[list[Depth], list[Array]]:
        """Return the holdout's depths and the plate's pixels of each view; empty lists where there is none.

        `window` and `grown` are what is shown, and what is rendered.
        """
        size, (shown, rendered) = (window.width, window.height), (window.crop, grown.crop)
        depths = [] if self.holdout is None else self.holdout.read(number, views, size, warn, rendered)
        return depths, [] if self.over is None else self.over.read_whole(number, views, size, warn, shown)

    def development(
        self, groups: Mapping[str, str], views: Mapping[str, Mapping[str, Any]], pixels: Sequence[Array],
        window: Window, grown: Window,
    ) -> Development:  # fmt: skip
        """Return how the frame's sums become a picture.

        Parameters
        ----------
        groups, views
            As in `Development`.
        pixels
            The pixels of the plate for each view, as far as they are shown; empty without a plate.
        window, grown
            What is shown, and what is rendered: the pixel filter needs more around it.
        """
        (x0, y0), (x1, y1) = grown.crop[:2], window.crop[:2]
        shown = (y1 - y0, x1 - x0, *window.shape)
        own = self.settings
        return Development(
            grown.shape, groups, views, pixels, self.over is not None and self.over.fog, shown, own.albedo, own.denoise,
            own.keep_noisy,
        )  # fmt: skip

    def run_options(self, development: Development) -> RunOptions:
        """Return how the frame's passes are rendered."""
        snapshot = self.snapshot

        def told(sums: Callable[[], FrameSums]) -> None:
            assert snapshot is not None
            snapshot(lambda: development.frame(sums()))

        state = {} if self.checkpoint is None else development.state()
        return RunOptions(self.progress, self.checkpoint, told if snapshot else None, self.part, state, self.kept)
