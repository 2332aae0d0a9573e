"""A page of pictures side by side, at one pixel of the screen for each of theirs: base, new, and how they differ."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable
from html import escape
from io import BytesIO

import numpy as np
import numpy.typing as npt

from .comparison import Compared, Pictures, Result

# The share of a picture's light values that lies below middle brightness, and that brightness, scene-linear.
JUDGED = 0.95
MIDDLE = 0.5
# How many times differences are amplified.
AMPLIFIED = 8

_STYLE = """
body { background: #222; color: #ddd; font: 14px sans-serif; margin: 2em }
figure { display: inline-block; margin: 0 1em 1em 0 }
img { display: block; image-rendering: pixelated }
.failed { color: #f77 }
"""


def written(results: Iterable[Result], title: str) -> str:
    """Return the page as HTML that holds its pictures."""
    parts = [
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{escape(title)}</title>'
        f"<style>{_STYLE}</style><h1>{escape(title)}</h1>"
        f"<p>The first seed at the base, at this tree, and the difference of the means of all seeds, {AMPLIFIED} times "
        "amplified about grey. Scenes whose bits are equal are shown once.</p>"
    ]
    parts += [_section(result.outcome, result.pictures) for result in results if result.pictures is not None]
    return "\n".join(parts) + "</html>\n"


def _section(outcome: object, pictures: tuple[Pictures, Pictures]) -> str:
    """Return a scene's heading and its pictures."""
    assert isinstance(outcome, Compared)
    base, new = pictures
    gain = _gain(base[0])
    figures = [_figure("base", _encoded(gain * base[0]))]
    if "rgba" in outcome.layers:
        apart = new.mean(axis=0) - base.mean(axis=0)
        figures.append(_figure("new", _encoded(gain * new[0])))
        figures.append(_figure("difference", _encoded(0.2 + AMPLIFIED * gain * apart)))
    moved = outcome.change
    about = "bits equal" if outcome.equal else f"mean {moved.relative:+.3%}, Z {moved.z:+.1f}"
    failed = f' <span class="failed">{escape(", ".join(outcome.failures))}</span>' if outcome.failures else ""
    return f"<h2>{escape(outcome.scene)}</h2><p>{escape(about)}{failed}</p>{''.join(figures)}"


def _gain(picture: Pictures) -> float:
    """Return the factor that brings nearly all of a picture's light below middle brightness."""
    peak = np.nan_to_num(picture).max(axis=-1)
    lit = peak[peak > 0]
    return MIDDLE / float(np.quantile(lit, JUDGED)) if lit.size else 1.0


def _encoded(linear: Pictures) -> npt.NDArray[np.uint8]:
    """Return scene-linear light as sRGB, in 8 bits."""
    light = np.clip(np.nan_to_num(linear, posinf=1.0), 0, 1)
    curve = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.round(255 * curve).astype(np.uint8)


def _figure(caption: str, pixels: npt.NDArray[np.uint8]) -> str:
    from PIL import Image

    file = BytesIO()
    Image.fromarray(pixels).save(file, "png", optimize=True)
    source = f"data:image/png;base64,{b64encode(file.getvalue()).decode()}"
    height, width = pixels.shape[:2]
    return (
        f'<figure><img src="{source}" width="{width}" height="{height}" alt="{caption}">'
        f"<figcaption>{caption}</figcaption></figure>"
    )
