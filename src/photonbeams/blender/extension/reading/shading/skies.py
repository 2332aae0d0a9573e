"""The sky of a world as an image: its nodes, evaluated in all directions, and the suns of Sky Textures beside it."""

from __future__ import annotations

from functools import cache
from math import degrees
from typing import Any

import numpy as np

from ..nodes import Told, sentence_of_unknown
from . import atmosphere
from .evaluation import NODES, Evaluation, UnknownNodeError, sky_points
from .links import source_of

_HEIGHT = 128
_FINE = 512  # with an image


class SkyReader:
    """Reads what a world emits.

    Parameters
    ----------
    told
        Called with a sentence about what is not rendered.
    """

    def __init__(self, told: Told) -> None:
        self._told = told
        #: The suns of Sky Textures: prims without a path.
        self.suns: list[dict[str, Any]] = []

    def radiance(self, source: Any) -> Any:
        """Return the radiance (H, W, 3), from the top row down, that a world's shader emits in all directions."""
        height = _FINE if _has_image(source.node) else _HEIGHT
        self._evaluation = Evaluation(sky_points(_directions(height)), {**NODES, "TEX_SKY": self._sky})
        found = np.asarray(self._shader(source.node, 1.0), np.float32)
        return np.broadcast_to(found, (2 * height * height, 3)).reshape(height, 2 * height, 3)

    def _shader(self, node: Any, factor: float) -> Any:
        """Return what a shader emits; `factor` is its part of the whole."""
        match node.type:
            case "BACKGROUND" | "EMISSION":
                strength = self._value(node, "Strength")
                self._part = factor * float(strength.mean())
                return self._value(node, "Color") * strength[:, None]
            case "MIX_SHADER":
                part = np.clip(self._value(node, node.inputs[0].name), 0, 1)
                sides = (1 - part, part)
                shaders = [source_of(each) for each in node.inputs[1:3]]
                return sum(
                    (side[:, None] * self._shader(each.node, factor * float(side.mean()))
                     for side, each in zip(sides, shaders, strict=True) if each is not None), start=np.zeros((1, 3))
                )  # fmt: skip
            case "ADD_SHADER":
                shaders = [source_of(each) for each in node.inputs]
                return sum((self._shader(each.node, factor) for each in shaders if each), start=np.zeros((1, 3)))
        self._told(f"{node.name} is not rendered: it is black")
        return np.zeros((1, 3))

    def _value(self, node: Any, name: str) -> Any:
        socket = node.inputs[name]
        try:
            return self._evaluation.input(socket)
        except UnknownNodeError as unknown:
            self._told(sentence_of_unknown(node, socket, unknown))
            return self._evaluation.own(socket)

    def _sky(self, run: Evaluation, node: Any, _source: Any) -> Any:
        """Return the radiance of a Sky Texture, and add its sun."""
        directions = run.place(node)
        sky = atmosphere.Sky.of(node, self._told)
        if sky.disc is not None:
            color, angle = sky.disc
            self.suns.append({
                "type": "DistantLight", "matrix": _facing(sky.sun),
                "values": {
                    "inputs:angle": ["float", degrees(angle)], "inputs:normalize": ["bool", True],
                    "inputs:color": ["color3f", color.tolist()], "inputs:intensity": ["float", self._part],
                },
            })  # fmt: skip
        return sky.radiance(directions)


@cache
def _directions(height: int) -> Any:
    """Return the directions (2 · height², 3) of the pixels of an equirectangular image, as Environment Textures are."""
    around, up = np.meshgrid(
        2 * np.pi * ((np.arange(2 * height) + 0.5) / (2 * height) - 0.5),
        np.pi * (0.5 - (np.arange(height) + 0.5) / height),
    )
    found = np.stack([-np.cos(around) * np.cos(up), np.sin(around) * np.cos(up), np.sin(up)], axis=-1)
    return found.reshape(-1, 3)


def _facing(direction: Any) -> Any:
    """Return the transform (4, 4), of row vectors, of a light that shines from a direction, along its −Z."""
    side = np.cross([0.0, 1.0, 0.0] if abs(direction[1]) < 0.9 else [1.0, 0.0, 0.0], direction)
    side /= np.linalg.norm(side)
    found = np.eye(4)
    found[:3, :3] = side, np.cross(direction, side), direction
    return found


def _has_image(node: Any) -> bool:
    """Return whether an Environment Texture, or another image, is among what a node is made of."""
    if node.type in ("TEX_ENVIRONMENT", "TEX_IMAGE"):
        return True
    sources = (source_of(each) for each in node.inputs)
    return any(_has_image(each.node) for each in sources if each is not None)
