"""Requests for frames, the checked arguments of `Shot.render`, and what the passes of a frame need."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from ..images.channels import image_paths
from ..images.frame import Frame
from ..images.plates import Holdout, Plate
from ..render.checkpoint import Checkpoint
from ..render.films.denoising import check_denoiser
from ..render.films.mattes import MATERIAL, OBJECT, header_of
from ..render.passes import PlannedPasses, Progress, RunOptions
from ..render.settings import Settings
from ..runtime.files import PathLike
from ..scene import SceneError, choice
from ..scene.cameras import CONFORM_POLICIES
from ..scene.declared import typed
from ..usd.cameras.stereo import views_of
from .development import Development
from .subject import FrameContent, Subject, Viewpoint

if TYPE_CHECKING:
    from ..render.films.frame_sums import FrameSums
    from ..render.frame import FrameRenderer
    from ..render.holdouts import HoldoutDepth
    from ..render.reuse import FilmMemory
    from ..world.cameras.cameras import View, Window

# That a shot was asked for what is hardly meant so; and pixels of a side below which it is not: too few to show it.
_ASKED, _THUMBNAIL = "asked for doubts", 64

#: Called after each pass with a function that returns the frame so far.
Snapshot = Callable[[Callable[[], Frame]], None]


class RenderCall(NamedTuple):
    """A call of `Shot.render`: of which subject and viewpoint, and its arguments, of which `given` are the rest."""

    subject: Subject
    viewpoint: Viewpoint
    frame: float | None
    passes: int | None
    settings: Settings | None
    given: Mapping[str, Any]


@typed
@dataclass(frozen=True, kw_only=True)
class FrameRequest:
    """The arguments of `Shot.render`, checked as far as they do not depend on the shot.

    `part` are the passes to render, None: all; `kept` and `film` are what `RunOptions` caches for further parts and
    frames.
    """

    frame: float | None
    settings: Settings
    width: int | None = None
    height: int | None = None
    crop: Any = None  # checked with the size of the picture
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
    film: FilmMemory | None = None

    @classmethod
    def of(cls, call: RenderCall) -> FrameRequest:
        """Return the request of a call, whose `given` has fields of this class and of `Settings`."""
        subject, names = call.subject, {each.name for each in fields(cls)}
        own = {name: value for name, value in call.given.items() if name in names}
        by_name = {name: value for name, value in call.given.items() if name not in names}
        if call.passes is not None:
            by_name["passes"] = call.passes
        settings = subject.settings(call.viewpoint, call.frame) if call.settings is None else call.settings
        chosen = Settings.of(settings, by_name)
        if chosen.denoise:  # checked before hours of rendering
            check_denoiser()
            if chosen.filter_name != "box":
                text = f"the pixel filter {chosen.filter_name} makes noise alike in neighbouring pixels, and much stays"
                subject.warnings.give(f"denoise: {text}: expected box")
        own["checkpoint"] = Checkpoint.of(own.get("checkpoint"))
        own["holdout"], own["over"] = Holdout.of(own.get("holdout")), Plate.of(own.get("over"))
        return cls(frame=call.frame, settings=chosen, **own)

    def __post_init__(self) -> None:
        choice(self.conform, "conform", CONFORM_POLICIES)


@dataclass(frozen=True)
class Prepared:
    """What the passes of a frame need."""

    content: FrameContent
    shown: Window
    window: Window  # what is rendered, more than is shown
    settings: Settings
    holdouts: Sequence[HoldoutDepth]  # the depth at which beams end, for each view
    run: RunOptions
    digest: str  # a hash of the content, where passes are saved
    development: Development

    def render(self) -> FrameRenderer:
        """Return the frame with its passes."""
        return self.content.render(self)

    def frame(self) -> Frame:
        """Return the picture of the frame with its passes."""
        rendered = self.render()
        return self.development.frame(rendered.sums(), rendered.statistics)


def prepare(call: RenderCall) -> Prepared:
    """Return everything that the passes of a frame need; raises what `Shot.render` does."""
    request, subject, viewpoint = FrameRequest.of(call), call.subject, call.viewpoint
    names, number, warn = views_of(viewpoint.stereo, request.view), subject.number(call.frame), subject.warnings.give
    window, grown = subject.windows(viewpoint, request)
    size, holdout, over = (window.width, window.height), request.holdout, request.over
    depths = [] if holdout is None else holdout.read(number, names, size, warn, grown.crop)
    pixels = [] if over is None else over.read_whole(number, names, size, warn, window.crop, subject.spaces)
    content = subject.content(viewpoint, request, grown, names)
    chosen = request.settings
    if chosen.program is None:
        chosen = replace(chosen, program=content.program)
    facts = {"seed": chosen.seed, **subject.spaces.header, **window.header(), **_mattes(content, chosen)}
    headers = {
        name: {**({} if view is None else view.header()), **about, **facts}
        for name, view, about in zip(names, content.views, content.headers, strict=True)
    }
    top, left = (window.crop[k] - grown.crop[k] for k in (1, 0))
    development = Development(
        grown.shape, content.groups, headers, chosen, pixels, over is not None and over.fog,
        (top, left, *window.shape), missing=partial(subject.warnings.missing_at, number),
        sources=partial(_sources, subject, request, names),
    )  # fmt: skip
    run = replace(_run_options(request, development), warn=_warns(subject, grown))
    holdouts = [depth.seen_by(_camera(view)) for depth, view in zip(depths, content.views, strict=False)]
    digest = subject.digest(viewpoint, call.frame) if run.named else ""
    return Prepared(
        content=content,
        shown=window,
        window=grown,
        settings=chosen,
        holdouts=holdouts,
        run=run,
        digest=digest,
        development=development,
    )


def _sources(subject: Subject, request: FrameRequest, views: Sequence[str]) -> Iterator[PathLike]:
    """Yield the files from which a frame is rendered."""
    yield from subject.files([request.frame])
    for each in (request.holdout, request.over):
        if each is not None:
            yield from (path for path, _ in image_paths(each.file, subject.number(request.frame), views))


def _mattes(content: FrameContent, settings: Settings) -> dict[str, str]:
    """Return what headers say of cryptomattes."""
    asked = [layer for layer in (OBJECT, MATERIAL) if getattr(settings, layer)]
    names = content.names() if asked else {}
    return {key: value for layer in asked for key, value in header_of(layer, names[layer]).items()}


def _run_options(request: FrameRequest, development: Development) -> RunOptions:
    """Return how the passes of a frame are rendered."""
    snapshot = request.snapshot

    def report(sums: Callable[[], FrameSums]) -> None:
        assert snapshot is not None
        snapshot(lambda: development.frame(sums()))

    return RunOptions(
        request.progress,
        request.checkpoint,
        report if snapshot else None,
        request.part,
        development.state,
        request.kept,
        request.film,
    )


def _warns(subject: Subject, window: Window) -> Callable[[str], None] | None:
    """Return what is told of what is hardly meant so, once for all frames; None where it is not asked."""
    given = subject.warnings.given
    if _ASKED in given or max(window.width, window.height) < _THUMBNAIL:
        return None
    given.add(_ASKED)
    name = subject.name
    return lambda text: subject.warnings.advise(f"{name}: {text}" if name else text)


def _camera(view: View | None) -> View:
    if view is None:
        raise SceneError("the sensor is no camera: expected a perspective or an orthographic one for a holdout")
    return view
