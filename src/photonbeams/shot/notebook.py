"""Shots in notebooks: a quick picture, or a sentence that says why there is none.

`_repr_mimebundle_` returns either one; an error in `_repr_png_` would be shown as a traceback below the cell.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Collection
from typing import TYPE_CHECKING

from ..scene import SceneError

if TYPE_CHECKING:
    from ..images.frame import Frame
    from .shot import Shot

#: A quick picture's pixels along its longer side; its passes, of which the denoiser needs two to estimate noise; and
#: the seconds after which one pass is enough.
LONGEST, PASSES, SECONDS = 480, 2, 5.0

_PNG, _TEXT = "image/png", "text/plain"


def shown(shot: Shot, include: Collection[str] | None = None, exclude: Collection[str] | None = None) -> dict[str, str]:
    """Return what a notebook shows of a shot, by MIME type: a PNG in base64 and a line of text, or only a sentence."""
    if _PNG in (exclude or ()) or _PNG not in (include or (_PNG,)):
        return {_TEXT: repr(shot)}
    try:
        picture = quick_frame(shot)._repr_png_()
    except SceneError as error:
        return {_TEXT: str(error)}
    except Exception as error:  # of any kind: showing a variable must not stop a notebook
        return {_TEXT: f"the shot could not be rendered: {error}"[:300]}
    return {_PNG: b64encode(picture).decode("ascii"), _TEXT: repr(shot)}


def quick_frame(shot: Shot) -> Frame:
    """Return a small picture of a shot's first frame, denoised if this machine can; raises what `render` does."""
    from ..render.films.denoising import lacking_denoiser

    width, height = shot.resolution()
    scale = min(1.0, LONGEST / max(width, height))
    return shot.render(
        passes=PASSES, time_limit=SECONDS, width=max(1, round(scale * width)), height=max(1, round(scale * height)),
        denoise=lacking_denoiser() is None, pixel_filter="box",
    )  # fmt: skip
