"""Deep EXRs: samples of a pixel from front to back, each with light and opacity, between two depths."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import OpenEXR

from ..runtime.files import PathLike
from ..scene import Array
from .color_spaces import USUAL_SPACES
from .exr import exr_parts
from .writing import attributes_of, encoded_parts, part_metadata

if TYPE_CHECKING:
    from ..render.films.deep import DeepPicture

Metadata = Mapping[str, Any]


def encoded_deep(path: PathLike, views: Mapping[str, tuple[DeepPicture, Metadata]]) -> memoryview:
    """Return a deep EXR: half for light and opacity, float for the depths Z and ZBack, ZIPS.

    `views` are as for `encoded_exr`. A single one is the part `rgba`, several have names such as rgba.left.
    """
    parts = []
    for view, (picture, metadata) in views.items():
        about = {**USUAL_SPACES.header, **metadata, **({"view": view} if view else {})}
        kind = {"type": OpenEXR.deepscanline, "compression": OpenEXR.ZIPS_COMPRESSION}
        header = {**attributes_of(part_metadata(about, "rgba")), **kind}
        parts.append(OpenEXR.Part(header, _channels(picture), f"rgba.{view}" if len(views) > 1 else "rgba"))
    return encoded_parts(path, parts)


def read_deep(path: PathLike, part: int, names: list[str]) -> tuple[Array, list[Array]]:
    """Return how many samples each pixel of a deep part has, (H, W), and the values of channels, (N,) float32 each."""
    channels = exr_parts(path, deep=True)[part].channels
    pixels = [channels[name].pixels for name in names]
    none = np.zeros(0, np.float32)
    counts = np.array([0 if each is None else len(each) for each in pixels[0].ravel()], np.int64)
    values = [np.concatenate([none, *(each for each in own.ravel() if each is not None)]) for own in pixels]
    return counts.reshape(pixels[0].shape), values


def _channels(picture: DeepPicture) -> dict[str, Array]:
    """Return the samples by channels, an array for each pixel."""
    color = picture.color.astype(np.float16)
    values = {name: np.ascontiguousarray(color[:, k]) for k, name in enumerate("RGBA")}
    values |= {"Z": picture.front.astype(np.float32), "ZBack": picture.back.astype(np.float32)}
    ends = np.cumsum(picture.counts.ravel()).tolist()
    begins = [0, *ends[:-1]]
    result = {}
    for name, each in values.items():
        pixels = np.empty(picture.counts.size, object)
        pixels[:] = [each[begin:end] for begin, end in zip(begins, ends, strict=True)] if len(ends) else []
        result[name] = pixels.reshape(picture.counts.shape)
    return result
