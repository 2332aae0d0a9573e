"""What directions a lamp shines in, as an IES file: its IES Texture, and the spread of an area light, as in Cycles.

Cycles and UsdLux count the angles around a lamp from other sides, in other senses, and Cycles' values are watts; so the
texture is written anew, with the angles and the values of a stage.
"""

from __future__ import annotations

from functools import lru_cache
from math import degrees, pi, radians, tan
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..images import Images
from ..nodes import telling
from ..prims import Told, Values
from .links import node_behind, source_at

_WATT_PER_CANDELA = 4 * pi / 177.83  # Cycles', of a lamp that has the spectrum of D65
_UNREADABLE = 100.0  # what a texture without a profile is in Cycles, everywhere
_ROWS, _COLUMNS = 361, 121
_TYPE_C = 1


def emission_of(light: Any) -> Any:
    """Return the node that a light's nodes end in; None if nothing does."""
    source = source_at(light.node_tree, "OUTPUT_LIGHT", "Surface")
    return None if source is None else source.node


def emission_node(light: Any) -> Any:
    """Return the Emission node that a light's nodes end in; None if it uses none, or if they end in another one."""
    node = emission_of(light) if light.use_nodes and light.node_tree is not None else None
    return node if node is not None and node.type == "EMISSION" else None


def ies_node(node: Any, socket: Any = None) -> tuple[Any, list[tuple[Any, Any]]]:
    """Return the IES Texture in the strength of an Emission node, None if there is none, and the factors beside it.

    The factors are sockets, each after its node; the search begins at another socket if one is given.
    """
    made = node_behind(node.inputs["Strength"] if socket is None else socket)
    if made is not None and made.type == "TEX_IES":
        return made, [(made, made.inputs["Strength"])]
    if made is not None and made.type == "MATH" and made.operation == "MULTIPLY" and not made.use_clamp:
        first, second = made.inputs[:2]
        for one, other in ((first, second), (second, first)):
            found, factors = ies_node(made, one)
            if found is not None:
                return found, [*factors, (made, other)]
    return None, []


def constant_of(light: Any, node: Any) -> float:
    """Return the factor that a texture is beside its profile: on a sun, which has one direction, its value there."""
    table = _table_of(node, lambda _: None)
    if table is None:
        return _UNREADABLE
    return float(table.at(np.zeros(1), np.zeros(1))[0, 0]) * _WATT_PER_CANDELA if light.type == "SUN" else 1.0


def profile_values(light: Any, images: Images, told: Told) -> Values:
    """Return the attributes of a lamp's profile; none of a sun, whose light has one direction."""
    emission = emission_node(light)
    node = None if emission is None else ies_node(emission)[0]
    table = None if node is None else _table_of(node, telling(told, light.name))
    spread = light.spread / 2 if light.type == "AREA" and light.spread < pi - 1e-4 else None
    if light.type == "SUN" or (table is None and spread is None):
        return {}
    if node is not None and node_behind(node.inputs["Vector"]) is not None:
        told(f"{light.name}: the coordinates of {node.name} are not rendered: it is turned as the lamp is")
    low, high = (0.0, 180.0) if table is None else (table.vertical[0], table.vertical[-1])
    values: Values = {}
    if spread is not None:
        # The stage's table has steps of a quarter of a degree: the scale makes them as fine as the spread needs.
        half = max(spread, radians(0.05))
        low, high = 0.0, degrees(half)
        values["inputs:shaping:ies:angleScale"] = high / 180
    theta = np.linspace(low, high, _ROWS)
    # Around the axis, a stage's angle is 90° less Cycles'.
    phi = np.linspace(0, 360, 1 if table is None or table.is_round else _COLUMNS)
    found = np.ones((1, _ROWS)) if table is None else table.at(theta, np.mod(90 - phi, 360)) * _WATT_PER_CANDELA
    if spread is not None:
        found = found * np.maximum(tan(half) - np.tan(np.radians(theta)), 0) * _whole(half)
        theta = np.linspace(0, 180, _ROWS)
    if light.type == "POINT":
        values["inputs:shaping:cone:angle"] = 180.0  # the schema's own is a cone of 90
    values["inputs:shaping:ies:file"] = images.stored(_text(theta, phi, found), "profile", ".ies")
    return values


def _whole(half: float) -> float:
    """Return the factor with which tan `half` − tan x leaves an area light its power; of narrow ones, the series."""
    return 1 / (tan(half) - half) if half > 0.05 else 3 / half**3


class _Table:
    """An IES profile of type C: angles in degrees, and candela (horizontal, vertical)."""

    def __init__(self, vertical: Any, horizontal: Any, candela: Any) -> None:
        self.vertical, self._horizontal, self._candela = vertical, horizontal, candela
        self.is_round = bool(np.all(candela == candela[0]))

    def at(self, theta: Any, phi: Any) -> Any:
        """Return the candela (P, T) at angles from the axis and around it, with Cycles' cubic interpolation."""
        rows = self._candela.T
        down = _cubic(self.vertical, rows, rows[1 if self.vertical[0] == 0 else 0], rows[-1], theta)
        # Rounding keeps Cycles from going on beyond 0 and 360 degrees; there, it has these instead.
        found = _cubic(self._horizontal, down.T, down.T[0], down.T[-2], phi)
        there = (theta >= self.vertical[0]) & (theta <= self.vertical[-1])
        return np.maximum(np.where(there, found, 0), 0)


def _cubic(knots: Any, values: Any, before: Any, after: Any, at: Any) -> Any:
    """Return Catmull and Rom's interpolation of values (K, …) as if the knots were even, as Cycles has it."""
    padded = np.concatenate([before[None], values, after[None]])
    index = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, len(knots) - 2)
    x = np.clip((at - knots[index]) / (knots[index + 1] - knots[index]), 0, 1)[:, None]
    a, b, c, d = (padded[index + k] for k in range(4))
    return b + x / 2 * (c - a + x * (2 * a - 5 * b + 4 * c - d + x * (3 * (b - c) + d - a)))


def _table_of(node: Any, told: Told) -> _Table | None:
    """Return the profile of an IES Texture; None, which is told, if there is none, or none that Cycles reads."""
    if node.mode == "INTERNAL":
        name, text = ("its text", "") if node.ies is None else (node.ies.name, node.ies.as_string())
    else:
        path = Path(bpy.path.abspath(node.filepath, library=node.id_data.library))
        name, text = path.name or "its file", _content(path)
    try:
        return _parsed(text)
    except ValueError as error:
        told(f"{name} of {node.name} is no IES profile of type C ({error}): it counts as {_UNREADABLE:g}, as in Cycles")
        return None


def _content(path: Path) -> str:
    try:
        return path.read_text("latin-1")
    except OSError:
        return ""


@lru_cache(maxsize=64)
def _parsed(text: str) -> _Table:
    """Return the profile in a text, all around the axis."""
    _, found, tail = ("\n" + text.replace("\r", "\n")).partition("\nTILT=")
    if not found:
        raise ValueError("it has no line TILT=")
    kind, _, rest = tail.partition("\n")
    numbers = np.array([float(each) for each in rest.replace(",", " ").split()])
    if kind.strip().upper() == "INCLUDE":
        numbers = numbers[2 + 2 * int(numbers[1]) :] if len(numbers) > 1 else numbers[:0]
    if len(numbers) < 13:
        raise ValueError("it ends too early")
    rows, columns, photometric = (int(each) for each in numbers[3:6])
    angles, count = numbers[13:], rows + columns
    if photometric != _TYPE_C or rows < 2 or columns < 1 or len(angles) < count + rows * columns:
        raise ValueError("it is of another type" if photometric != _TYPE_C else "it ends too early")
    candela = angles[count : count + rows * columns].reshape(columns, rows) * np.prod(numbers[[2, 10, 11]])
    around, candela = _all_around(angles[rows:count], candela)
    if np.any(np.diff(angles[:rows]) <= 0) or np.any(np.diff(around) <= 0) or not np.all(np.isfinite(candela)):
        raise ValueError("its angles do not ascend")
    return _Table(angles[:rows], around, candela)


def _all_around(angles: Any, candela: Any) -> tuple[Any, Any]:
    """Return a profile from 0 to 360 degrees, of which a file may have one angle, a quarter or a half."""
    if angles[0] == 90:  # a half that is turned, as in Cycles
        angles = angles - 90
    if len(angles) == 1:
        return np.array([0.0, 360.0]), np.repeat(candela, 2, axis=0)
    for part in (90, 180):
        if angles[-1] == part:
            angles = np.append(angles, 2 * part - angles[-2::-1])
            candela = np.concatenate([candela, candela[-2::-1]])
    if angles[-1] != 360 and 360 - angles[-1] in np.diff(angles)[[0, -1]]:
        angles, candela = np.append(angles, 360), np.concatenate([candela, candela[:1]])
    if angles[0] != 0 or angles[-1] != 360:
        raise ValueError(f"its horizontal angles go from {angles[0]:g} to {angles[-1]:g}")
    return angles, candela


def _text(vertical: Any, horizontal: Any, values: Any) -> bytes:
    """Return an IES file of type C."""
    rows = [vertical, horizontal, *values]
    head = f"IESNA:LM-63-2002\nTILT=NONE\n1 -1 1 {len(vertical)} {len(horizontal)} {_TYPE_C} 2 0 0 0\n1 1 0\n"
    return (head + "\n".join(" ".join(f"{each:.7g}" for each in row) for row in rows) + "\n").encode()
