"""Images that nodes make of images: ramps, curves, mixtures and the like, computed at the pixels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ..images import is_missing
from .evaluation import Points, UnknownNodeError, anywhere, evaluated, pixels_of
from .links import source_of

_AT_ONCE = 1 << 18  # pixels
_SAME = 1e-5


def image_behind(source: Any) -> Any:
    """Return the largest of the image nodes of which alone an output is made, and which are placed alike; or None."""
    found = list(_images(source, set()))
    places = [(source_of(each.inputs["Vector"]), each.extension, each.projection) for each in found]
    alike = all(each == places[0] for each in places)
    if not (found and alike) or any(pixels_of(each.image) is None for each in found):
        return None
    even = np.full((len(anywhere()), 4), 0.5)
    try:
        rest = evaluated(source, replace(anywhere(), images={each.as_pointer(): even for each in found}))
    except UnknownNodeError:
        return None
    varies = np.ptp(rest, axis=0).max() > _SAME * max(np.abs(rest).max(), _SAME)
    return None if varies else max(found, key=lambda each: each.image.size[0] * each.image.size[1])


def baked(source: Any) -> Any:
    """Return the scene-linear pixels (H, W, 3) that an output makes of images, from the top row down."""
    pixels = {each.as_pointer(): pixels_of(each.image) for each in _images(source, set())}
    height, width = np.max([each.shape[:2] for each in pixels.values()], axis=0)
    flat = {key: _scaled(each, height, width).reshape(-1, 4) for key, each in pixels.items()}
    parts = []
    for begin in range(0, height * width, _AT_ONCE):
        own = {key: each[begin : begin + _AT_ONCE] for key, each in flat.items()}
        nowhere = np.zeros((len(next(iter(own.values()))), 3))
        found = evaluated(source, Points(nowhere, nowhere, nowhere, nowhere, nowhere[:, 0] + 1, own))
        parts.append(np.asarray(found if found.ndim == 2 else found[:, None], np.float32))
    result = np.concatenate(parts).reshape(height, width, -1)[::-1]
    return np.broadcast_to(result, (height, width, 3))


def _images(source: Any, seen: set[Any]) -> Iterator[Any]:
    """Yield the image nodes behind an output, each once."""
    node = source.node
    key = (node.as_pointer(), tuple(each.own.as_pointer() for each in source.groups))
    if key in seen:
        return
    seen.add(key)
    if node.type == "TEX_IMAGE" and node.image is not None and not is_missing(node.image):
        yield node
        return
    for each in node.inputs:
        if (inner := source_of(each)) is not None:
            yield from _images(inner, seen)


def _scaled(pixels: Any, height: int, width: int) -> Any:
    """Return pixels (H, W, 4) in another size, each the nearest."""
    rows, columns = (np.arange(count) * own // count for count, own in zip((height, width), pixels.shape, strict=False))
    return pixels if pixels.shape[:2] == (height, width) else pixels[np.ix_(rows, columns)]
