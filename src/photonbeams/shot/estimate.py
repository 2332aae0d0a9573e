"""How long a frame takes and how much memory, told before it is rendered, from a few passes.

A frame takes T = B + n · P, with B for what is done once and P for each of n passes. A picture of a sixteenth of the
pixels is begun first, as the frame itself would be: it compiles the kernels, and says how long passes take at most. If
a few passes of the whole picture take little of the time that they can save, they are measured; else those of a picture
with a fourth of its pixels, and P is taken to grow with the pixels as between the two.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from ..images.frame import Frame
from ..render.passes import Statistics
from .request import RenderCall, prepare

#: A frame takes this many times as long as estimated, or the inverse, at most: measured, see docs/performance.md. The
#: second is for estimates from smaller pictures.
WITHIN, WITHIN_SMALLER = 1.3, 1.6

_SCALE = 0.25  # of the sides of the first picture
_LEAST = 64  # pixels of its longer side, so that not all is edges
_STEPS = 3  # batches of passes that are rendered of each: the first does more than the others
# The first passes of a larger picture may take so many seconds or this part of the frame, and so many seconds at most.
_SECONDS, _PART, _LONGEST = 6.0, 0.25, 60.0


@dataclass(frozen=True)
class RenderEstimate:
    """How long a frame takes, and how much memory.

    Attributes
    ----------
    size, passes
        Width and height in pixels, and the number of passes; with a goal for the error the most.
    seconds, once, each
        Seconds of the frame, without reading the stage and writing files; of what is done once; and of a pass.
    within
        The frame takes at most so many times as long as `seconds`, or as short, on a machine as busy as now.
    memory
        Bytes of a pass, as a render checks them; the program and the scene come in addition.
    measured, took
        Size of the largest picture of which passes were rendered for this, and the seconds that all of it took.
    """

    size: tuple[int, int]
    passes: int
    seconds: float
    once: float
    each: float
    within: float
    memory: int
    measured: tuple[int, int]
    took: float


class _Enough(Exception):  # noqa: N818 (no error)
    """Enough passes are rendered."""


@dataclass(frozen=True)
class _FirstPasses:
    """What the first passes of a picture took, in seconds.

    That is what is done before the first pass, by how much that is longer than the others, each other one, and
    developing the picture.
    """

    pixels: int
    before: float
    first: float
    each: float
    developing: float


def estimate(call: RenderCall) -> RenderEstimate:
    """Return the estimate for a call of `Shot.render`; raises what that does before its first pass."""
    start = time.perf_counter()
    ready = prepare(call)
    window, memory, chosen = ready.window, ready.content.memory(ready.window, ready.settings), ready.settings
    size, (left, top, right, bottom) = (window.width, window.height), ready.shown.crop
    crop = (left / size[0], top / size[1], right / size[0], bottom / size[1])
    whole = (right - left) * (bottom - top)
    plates = any(call.given.get(name) is not None for name in ("holdout", "over"))

    def begun(scale: float) -> _FirstPasses:
        width, height = (max(1, round(scale * each)) for each in size)
        smaller = {} if scale == 1 else {"width": width, "height": height, "crop": crop}
        same = call._replace(passes=None, settings=chosen, given={**call.given, **smaller})
        return _begun(same, round(scale * scale * whole))

    def total(found: Sequence[_FirstPasses]) -> float:
        return found[0].before + found[-1].first + chosen.passes * _pass_of(found, whole)

    scales = [1.0 if plates else min(1.0, max(_SCALE, _LEAST / max(size)))]
    found = [begun(scales[0])]
    if chosen.passes < _STEPS:  # too few to tell passes from the compilation of their kernels
        found = [replace(begun(scales[0]), before=found[0].before)]
    for scale in (1.0, 0.5, 1.0):  # after that of a half it may be known to be faster
        few = found[0].before + min(_STEPS, chosen.passes) * _pass_of(found, scale * scale * whole)
        if scale > scales[-1] and few < min(max(_SECONDS, _PART * total(found)), _LONGEST):
            found.append(begun(scale))
            scales.append(scale)
    last, each = found[-1], _pass_of(found, whole)
    # Of the first picture, because a process begins with nothing; the others know the stage and have recorded kernels.
    once = found[0].before + last.first + last.developing * whole / last.pixels
    seconds = once + chosen.passes * each
    if chosen.time_limit is not None:
        seconds = min(seconds, chosen.time_limit + once + each)
    scale = scales[-1]
    return RenderEstimate(
        size=size,
        passes=chosen.passes,
        seconds=seconds,
        once=once,
        each=each,
        within=WITHIN if scale == 1 else WITHIN_SMALLER,
        memory=memory,
        measured=(max(1, round(scale * size[0])), max(1, round(scale * size[1]))),
        took=time.perf_counter() - start,
    )


def _pass_of(found: Sequence[_FirstPasses], pixels: float) -> float:
    """Return about how long a pass with more pixels takes: by the line through the last two, or in proportion."""
    last = found[-1]
    most = last.each * max(pixels / last.pixels, 1.0)
    if len(found) == 1 or pixels <= last.pixels:
        return most
    slope = max(last.each - found[-2].each, 0.0) / (last.pixels - found[-2].pixels)
    return min(last.each + slope * (pixels - last.pixels), most)


def _begun(call: RenderCall, pixels: int) -> _FirstPasses:
    """Render the first passes of a picture, and return what they took."""
    marks: list[tuple[float, int]] = []
    developing = 0.0

    def progress(done: int, _: Statistics) -> None:
        marks.append((time.perf_counter(), done))

    def snapshot(frame: Callable[[], Frame]) -> None:
        nonlocal developing
        if len(marks) > _STEPS:
            begin = time.perf_counter()
            frame()
            developing = time.perf_counter() - begin
            raise _Enough

    start = time.perf_counter()
    # In order, so that the shutter and the samples are planned as for the frame.
    given = {**call.given, "progress": progress, "snapshot": snapshot, "checkpoint": None}
    try:
        begin = time.perf_counter()
        prepare(call._replace(given=given)).frame()
        developing = time.perf_counter() - max(begin, marks[-1][0])
    except _Enough:
        pass
    times = [(then - before) / (later - earlier) for (before, earlier), (then, later) in pairwise(marks)]
    steady = min(times[1:] or times)  # radii shrink: further passes take no longer
    first = marks[1][0] - marks[0][0] - steady * marks[1][1]
    return _FirstPasses(pixels, marks[0][0] - start, max(first, 0.0), steady, developing)
