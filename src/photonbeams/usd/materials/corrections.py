"""Nodes that correct colours (hue, saturation, gamma, contrast, exposure) in MaterialX, Arnold and RenderMan."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ...scene import Array, rgb

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of Rec.709


def luminance(colors: Array) -> Array:
    """Return luminances, (…, 1)."""
    return (rgb(colors) @ _LUMINANCE)[..., None]


def saturated(colors: Array, amount: Array) -> Array:
    """Return colours with their saturation multiplied: 0 gives their grey, 1 the colours themselves."""
    grey = luminance(colors)
    return grey + amount * (rgb(colors) - grey)


def contrasted(colors: Array, amount: Array, pivot: Array) -> Array:
    """Return colours with their distance from the pivot multiplied."""
    return (colors - pivot) * amount + pivot


def gamma_corrected(colors: Array, gamma: Array) -> Array:
    """Return colours to the power of 1 / gamma; negative numbers do not change."""
    return np.where(colors > 0, np.maximum(colors, 1e-30) ** (1 / np.maximum(gamma, 1e-3)), colors)


def to_hsv(colors: Array) -> Array:
    """Return hue, as a fraction of a turn, saturation and value (Smith 1978)."""
    colors = rgb(colors)
    value, least = colors.max(axis=-1), colors.min(axis=-1)
    chroma = value - least
    safe = np.where(chroma > 0, chroma, 1)
    red, green, blue = np.moveaxis(colors, -1, 0)
    hue = np.where(
        value == red, (green - blue) / safe, np.where(value == green, 2 + (blue - red) / safe, 4 + (red - green) / safe)
    )
    return np.stack([hue / 6 % 1, np.where(value > 0, chroma / np.where(value > 0, value, 1), 0), value], axis=-1)


def from_hsv(colors: Array) -> Array:
    """Return colours of hue, saturation and value."""
    hue, saturation, value = (colors[..., i, None] for i in range(3))
    place = (np.array([5.0, 3.0, 1.0]) + hue * 6) % 6
    return value - value * saturation * np.clip(np.minimum(place, 4 - place), 0, 1)


def hue_shifted(colors: Array, amount: Array) -> Array:
    """Return colours with their hues turned by `amount`, where 1 is a full turn."""
    return from_hsv(to_hsv(colors) + np.asarray(amount)[..., :1] * np.array([1.0, 0.0, 0.0]))


def hsv_adjusted(colors: Array, amount: Array) -> Array:
    """Return the result of MaterialX's `hsvadjust`: hues are turned, saturations and values multiplied."""
    hsv = to_hsv(colors)
    return from_hsv(np.concatenate([hsv[..., :1] + amount[..., :1], hsv[..., 1:] * amount[..., 1:3]], axis=-1))


def arnold_corrected(
    colors: Array, gamma: Array, hue: Array, saturation: Array, contrast: Array, pivot: Array, exposure: Array,
    factor: Array, added: Array, mask: Array,
) -> Array:  # fmt: skip
    """Return the result of Arnold's `color_correct`, whose steps follow the order of its inputs."""
    found = saturated(hue_shifted(gamma_corrected(rgb(colors), gamma), hue), saturation)
    found = contrasted(found, contrast, pivot) * 2.0**exposure * factor + added
    return rgb(colors) + mask * (found - rgb(colors))


def materialx_corrected(
    colors: Array, hue: Array, saturation: Array, gamma: Array, lift: Array, gain: Array, contrast: Array, pivot: Array,
    exposure: Array,
) -> Array:  # fmt: skip
    """Return the result of MaterialX's `colorcorrect`, computed as in the graph that defines it."""
    found = gamma_corrected(saturated(hue_shifted(colors, hue), saturation), gamma)
    return contrasted((found * (1 - lift) + lift) * gain, contrast, pivot) * 2.0**exposure


#: Functions by the names of their nodes, with the inputs of each and their defaults.
CORRECTIONS: dict[str, tuple[Callable[..., Array], dict[str, Any]]] = {
    "colorcorrect": (materialx_corrected, {
        "in": 1.0, "hue": 0.0, "saturation": 1.0, "gamma": 1.0, "lift": 0.0, "gain": 1.0, "contrast": 1.0,
        "contrastpivot": 0.5, "exposure": 0.0,
    }),
    "arnold:color_correct": (arnold_corrected, {
        "input": 0.0, "gamma": 1.0, "hue_shift": 0.0, "saturation": 1.0, "contrast": 1.0, "contrast_pivot": 0.18,
        "exposure": 0.0, "multiply": 1.0, "add": 0.0, "mask": 1.0,
    }),
    "hsvadjust": (hsv_adjusted, {"in": 0.0, "amount": (0.0, 1.0, 1.0)}),
    "saturate": (saturated, {"in": 0.0, "amount": 1.0}),
    "contrast": (contrasted, {"in": 0.0, "amount": 1.0, "pivot": 0.5}),
    "rgbtohsv": (to_hsv, {"in": 0.0}),
    "hsvtorgb": (from_hsv, {"in": 0.0}),
    "luminance": (lambda colors: np.repeat(luminance(colors), 3, axis=-1), {"in": 0.0}),
}  # fmt: skip
