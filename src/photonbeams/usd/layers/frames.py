"""Frame specifications in the notation of usdrecord, and the range of frames of a stage.

The grammar is that of `UsdUtils.TimeCodeRange` (FIRST, FIRST:LAST, FIRST:LASTxSTRIDE), several separated by commas, as
in usdrecord's `UsdAppUtils.framesArgs`, which usd-core does not have.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from ...scene import SceneError
from ...scene.checks import shortened
from ..common.openusd import Tf, Usd, UsdUtils, sentences_of
from ..common.reading import LOG, file_of, varying_attributes

MOST_FRAMES = 100_000
LARGEST = 1e9
_DIGITS = 9  # after the point: sums of strides such as 0.1 are rounded, so that files and duplicates are found
_NUMBER = r"[+-]?(\d+\.?\d*|\.\d+)"
_RANGE = re.compile(f"{_NUMBER}(:{_NUMBER}(x{_NUMBER})?)?", re.ASCII)
_EXPECTED = "expected frames such as 101, 101:105, 105:101 or 101:109x2, or several separated by commas"


def parse_frames(text: str) -> list[float]:
    """Return the frames of a specification, in its order, each once.

    Raises
    ------
    SceneError
        The specification is wrong; the message does not repeat the text.
    """
    frames: dict[float, None] = {}
    for part in text.split(","):
        frames |= dict.fromkeys(_frames(part.strip()))
        if len(frames) > MOST_FRAMES:
            raise SceneError(f"expected no more than {MOST_FRAMES:,} frames")
    return list(frames)


def _frames(part: str) -> list[float]:
    if not _RANGE.fullmatch(part):  # OpenUSD 26.11 crashes on some wrong ones, such as "1:"
        raise SceneError(_EXPECTED)
    try:
        codes = UsdUtils.TimeCodeRange.CreateFromFrameSpec(part)
    except Tf.ErrorException as error:
        reason = "".join(sentences_of(error)[-1:])
        raise SceneError(f"{shortened(reason, len(_EXPECTED) + 2)}: {_EXPECTED}") from None
    first, last = codes.startTimeCode.GetValue(), codes.endTimeCode.GetValue()
    if not (codes.IsValid() and max(abs(first), abs(last)) < LARGEST):
        raise SceneError(f"expected frames between -{LARGEST:g} and {LARGEST:g}")
    # OpenUSD 26.11 itself would end 0:0.5x0.1 at 0.4.
    steps = (last - first) / codes.stride + 1e-6
    if steps >= MOST_FRAMES:
        raise SceneError(f"expected no more than {MOST_FRAMES:,} frames")
    return [round(first + step * codes.stride, _DIGITS) + 0.0 for step in range(int(steps) + 1)]  # no frame is -0


def decimals(frame: float) -> int:
    """Return how many digits after the point a frame number has."""
    return next(digits for digits in range(_DIGITS + 1) if round(frame, digits) == frame or digits == _DIGITS)


def time_range(stage: Usd.Stage) -> tuple[float, float] | None:
    """Return a stage's first and last frame; None if it has no range."""
    return (stage.GetStartTimeCode(), stage.GetEndTimeCode()) if stage.HasAuthoredTimeCodeRange() else None


def check_frames(stage: Usd.Stage, frames: Sequence[float]) -> None:
    """Raise SceneError for frames outside the stage's range; a stage without a range has any frame.

    Warn about several frames of a stage on which nothing changes.
    """
    if len(frames) > 1 and not any(True for _ in varying_attributes(stage)):
        LOG.warning("%s has no time samples: all %d frames are the same", file_of(stage), len(frames))
    ends = time_range(stage)
    if ends is None:
        return
    first, last = ends
    outside = [frame for frame in frames if not first <= frame <= last]
    if outside:
        more = f" and {len(outside) - 1:,} more of those asked for" if len(outside) > 1 else ""
        text = f"{file_of(stage)} has no frame {outside[0]:.10g}{more}: expected frames from {first:g} to {last:g}"
        raise SceneError(text)
