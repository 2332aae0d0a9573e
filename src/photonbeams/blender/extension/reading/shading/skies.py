"""The sky of a world as an image: its nodes, evaluated in all directions, and the suns of Sky Textures beside it."""

from __future__ import annotations

from functools import cache
from math import degrees
from typing import Any

import numpy as np
from mathutils import Vector

from ..nodes import sentence_of_unknown
from ..prims import Prim, Told
from .atmosphere import sky_of
from .calls import Call, Points, UnknownNodeError, own_value
from .evaluation import Evaluation
from .links import node_behind

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
        #: The suns of Sky Textures: prims without a path of their own.
        self.suns: list[Prim] = []

    def radiance(self, source: Any) -> Any:
        """Return the radiance (H, W, 3), from the top row down, that a world's shader emits in all directions."""
        height = _FINE if _has_image(source.node) else _HEIGHT
        directions = _directions(height)
        points = Points(directions, directions, directions, directions, seen=False)
        self._evaluation = Evaluation(points, {"TEX_SKY": self._sky})
        emitted = np.asarray(self._shader(source.node, 1.0), np.float32)
        return np.broadcast_to(emitted, directions.shape).reshape(height, 2 * height, 3)

    def _shader(self, node: Any, factor: float) -> Any:
        """Return what a shader emits; `factor` is its part of the whole."""
        sides: tuple[Any, ...] = (1.0, 1.0)
        match node.type:
            case "BACKGROUND" | "EMISSION":
                strength = self._value(node, "Strength")
                self._part = factor * float(strength.mean())
                return self._value(node, "Color") * strength
            case "MIX_SHADER":
                part = np.clip(self._value(node, node.inputs[0].name), 0, 1)
                sides = 1 - part, part
            case "ADD_SHADER":
                pass
            case _:
                self._told(f"{node.name} is not rendered: it is black")
                sides = ()
        total = np.zeros((1, 3))
        for side, socket in zip(sides, list(node.inputs)[-2:], strict=False):
            if (shader := node_behind(socket)) is not None:
                total = total + side * self._shader(shader, factor * float(np.mean(side)))
        return total

    def _value(self, node: Any, name: str) -> Any:
        socket = node.inputs[name]
        try:
            return self._evaluation.input(socket)
        except UnknownNodeError as unknown:
            self._told(sentence_of_unknown(node, socket, unknown))
            return own_value(socket)

    def _sky(self, call: Call) -> Any:
        """Return the radiance of a Sky Texture, and add its sun."""
        sky = sky_of(call.node, self._told)
        if sky.irradiance is not None:
            values = {
                "inputs:angle": degrees(sky.angle), "inputs:normalize": True,
                "inputs:color": sky.irradiance.tolist(), "inputs:intensity": self._part,
            }  # fmt: skip
            self.suns.append(Prim("/Sun", "DistantLight", values, matrix=_facing(sky.sun)))
        return sky.radiance(call.place())


@cache
def _directions(height: int) -> Any:
    """Return the directions (2 · height², 3) of the pixels of an equirectangular image, as Environment Textures are."""
    around, up = np.meshgrid(
        2 * np.pi * ((np.arange(2 * height) + 0.5) / (2 * height) - 0.5),
        np.pi * (0.5 - (np.arange(height) + 0.5) / height),
    )
    return np.stack([-np.cos(around) * np.cos(up), np.sin(around) * np.cos(up), np.sin(up)], axis=-1).reshape(-1, 3)


def _facing(direction: Any) -> Any:
    """Return the transform (4, 4), of row vectors, of a light that shines from a direction, along its −Z."""
    return np.array(Vector(direction).to_track_quat("Z", "Y").to_matrix().to_4x4()).T


def _has_image(node: Any) -> bool:
    """Return whether an Environment Texture, or another image, is among what a node is made of."""
    nodes = (node_behind(each) for each in node.inputs)
    return node.type in ("TEX_ENVIRONMENT", "TEX_IMAGE") or any(_has_image(each) for each in nodes if each is not None)
