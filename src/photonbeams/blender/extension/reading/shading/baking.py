"""Images that nodes make of images: ramps, curves, mixtures and the like, computed at the pixels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ..images import is_missing
from .calls import Points, UnknownNodeError, anywhere
from .evaluation import evaluated, varies
from .links import source_of
from .patterns import pixels_of

_AT_ONCE = 1 << 18  # pixels
_NOWHERE = np.zeros((1, 3))


def image_behind(source: Any) -> Any:
    """Return the largest of the image nodes of which alone an output is made, and which are placed alike; or None."""
    nodes = list(_images(source, set()))
    places = [(source_of(each.inputs["Vector"]), each.extension, each.projection) for each in nodes]
    alike = all(each == places[0] for each in places)
    if not (nodes and alike) or any(pixels_of(each.image) is None for each in nodes):
        return None
    try:
        rest = evaluated(source, replace(anywhere(), images=dict.fromkeys(nodes, np.full((1, 4), 0.5))))
    except UnknownNodeError:
        return None
    return None if varies(rest) else max(nodes, key=lambda each: each.image.size[0] * each.image.size[1])


def baked(source: Any) -> Any:
    """Return the scene-linear pixels (H, W, 3) that an output makes of images, from the top row down."""
    pixels = {each: pixels_of(each.image) for each in _images(source, set())}
    height, width = np.max([each.shape[:2] for each in pixels.values()], axis=0)
    flat = {node: _scaled(each, height, width).reshape(-1, 4) for node, each in pixels.items()}
    made = np.empty((height * width, 3), np.float32)
    for begin in range(0, len(made), _AT_ONCE):
        part = slice(begin, begin + _AT_ONCE)
        images = {node: each[part] for node, each in flat.items()}
        made[part] = evaluated(source, Points(_NOWHERE, _NOWHERE, _NOWHERE, _NOWHERE, images=images))
    return made.reshape(height, width, 3)[::-1]


def _images(source: Any, seen: set[Any]) -> Iterator[Any]:
    """Yield the image nodes behind an output, each once."""
    node = source.node
    if node in seen:
        return
    seen.add(node)
    if node.type == "TEX_IMAGE" and node.image is not None and not is_missing(node.image):
        yield node
        return
    for each in node.inputs:
        if (inner := source_of(each)) is not None:
            yield from _images(inner, seen)


def _scaled(pixels: Any, height: int, width: int) -> Any:
    """Return pixels (H, W, 4) in another size, each the nearest."""
    rows, columns = (np.arange(new) * old // new for new, old in zip((height, width), pixels.shape, strict=False))
    return pixels[np.ix_(rows, columns)]
