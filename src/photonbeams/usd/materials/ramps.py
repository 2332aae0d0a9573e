"""Read ramps over UVs or over another value, and UVs as values: nodes that are functions of u and v."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...scene import Array
from .images import affine, coordinates, rotation
from .network import NodeReader, ShaderNode
from .values import Image, Value, mix

#: Interpolations between the knots of a ramp, by Arnold's numbers.
CONSTANT, LINEAR, CATMULL_ROM, MONOTONE, SMOOTH = range(5)
_JOINED = {"none": CONSTANT, "constant": CONSTANT, "catmull-rom": CATMULL_ROM, "bspline": CATMULL_ROM}

_WIDE = 256  # pixels a side of an image of a function of both coordinates
_SIZES = {"u": (1, 4 * _WIDE), "v": (4 * _WIDE, 1)}  # sizes of an image of a function of one coordinate


def _angle(u: Array, v: Array) -> Array:
    return np.arctan2(v - 0.5, u - 0.5) / (2 * np.pi) + 0.5


def _distance(u: Array, v: Array) -> Array:
    return np.minimum(np.hypot(u - 0.5, v - 0.5) * np.sqrt(2), 1)


def _box(u: Array, v: Array) -> Array:
    return np.maximum(np.abs(2 * u - 1), np.abs(2 * v - 1))


_DIRECTIONS: dict[str, Callable[[Array, Array], Array]] = {
    "u": lambda u, v: u, "v": lambda u, v: v, "diagonal": lambda u, v: (u + v) / 2, "radial": _angle,
    "circular": _distance, "box": _box,
}  # fmt: skip


def over_uvs(
    function: Callable[[Array, Array], Array], placed: tuple[str, Array], wrap: str = "repeat",
    size: tuple[int, int] = (_WIDE, _WIDE),
) -> Image:  # fmt: skip
    """Return an image of a function of u (1, W, 1) and v (H, 1, 1) in the pixels of the unit square."""
    height, width = size
    u, v = (np.arange(width)[None, :, None] + 0.5) / width, 1 - (np.arange(height)[:, None, None] + 0.5) / height
    pixels = np.asarray(function(u, v), dtype=np.float32)
    uv_name, transform = placed
    return Image(np.broadcast_to(pixels, (height, width, pixels.shape[-1])), (wrap, wrap), transform, uv_name or "st")


def _direction(name: str, placed: tuple[str, Array], wrap: str = "repeat") -> Image:
    """Return an image of one of the coordinates of ramps, from 0 to 1."""
    return over_uvs(_DIRECTIONS[name], placed, wrap, _SIZES.get(name, (_WIDE, _WIDE)))


def ramp(x: Array, positions: Sequence[float], kinds: Sequence[int], values: Sequence[Array]) -> Array:
    """Evaluate a ramp of values (…, C) at x (…, 1); positions are sorted, and each kind applies up to the next.

    Cubic ramps are Hermite curves with slopes from finite differences (Catmull–Rom), or from Fritsch and Carlson
    (1980), which do not overshoot.
    """
    result = values[0] + 0 * x
    for i in range(len(values) - 1):
        length = positions[i + 1] - positions[i]
        t = np.clip((x - positions[i]) / (length or 1), 0, 1)
        one, other, kind = values[i], values[i + 1], kinds[i]
        if kind == CONSTANT:
            between = one + 0 * t
        elif kind in (CATMULL_ROM, MONOTONE):
            begin, end = (_slope(positions, values, each, kind == MONOTONE) * length for each in (i, i + 1))
            between = one * (1 + 2 * t) * (1 - t) ** 2 + other * t**2 * (3 - 2 * t)
            between = between + begin * t * (1 - t) ** 2 + end * t**2 * (t - 1)
        else:
            between = one + (other - one) * (t * t * (3 - 2 * t) if kind == SMOOTH else t)
        result = np.where(x >= positions[i], between, result)
    return np.where(x >= positions[-1], values[-1], result)


def _slope(positions: Sequence[float], values: Sequence[Array], at: int, monotone: bool) -> Array:
    """Return the slope of a cubic ramp at one of its positions; 0 at the ends."""
    if not 0 < at < len(values) - 1:
        return np.zeros(1)
    before, after = positions[at] - positions[at - 1], positions[at + 1] - positions[at]
    if not (before and after):
        return np.zeros(1)
    if not monotone:
        return (values[at + 1] - values[at - 1]) / (before + after)
    first, second = (values[at] - values[at - 1]) / before, (values[at + 1] - values[at]) / after
    weight, other = 2 * after + before, after + 2 * before
    safe = np.where(first * second > 0, weight * second + other * first, 1)
    return np.where(first * second > 0, (weight + other) * first * second / safe, 0)


@dataclass(frozen=True)
class _Knots:
    """The knots of a ramp: their positions in order, the interpolation after each, and their values."""

    positions: Sequence[float]
    kinds: Sequence[int]
    values: Sequence[Value]

    def at(self, node: ShaderNode, x: Value) -> Value:
        """Return the ramp at a value's first channel."""

        def on_ramp(x: Array, *values: Array) -> Array:
            return ramp(x[..., :1], self.positions, self.kinds, values)

        return node.combined(on_ramp, x, *self.values)


def _knots(node: ShaderNode, at: str, color: str, join: str) -> _Knots:
    """Return the knots of a ramp from inputs of lists; a value may be connected, such as `inputs:color:i1`."""
    places, colors, joined = (node.plain(name) for name in (at, color, join))
    values = np.asarray([0.0, 1.0] if colors is None else colors, dtype=np.float64)
    values = node.colors(color, values.reshape(len(values), -1) if values.ndim else values.reshape(1, 1))
    even = np.linspace(0, 1, len(values)) if len(values) > 1 else np.zeros(1)
    positions = even if places is None else np.atleast_1d(np.asarray(places, dtype=np.float64))
    joins = [LINEAR] if joined is None else [joined] if isinstance(joined, str | int) else list(joined)
    kinds = [_JOINED.get(each, LINEAR) if isinstance(each, str) else int(each) for each in joins] or [LINEAR]
    count = min(len(values), len(positions))
    if not count or not (np.all(np.isfinite(values)) and np.all(np.isfinite(positions))):
        node.lose("has no finite knots: it is black", at)
        return _Knots([0.0], [LINEAR], [np.zeros(1)])
    if len(values) != len(positions):
        node.lose(f"has {len(positions)} values: expected {len(values)}, as many as {color}", at)
    kinds += [kinds[-1]] * (count - len(kinds))
    order = np.argsort(positions[:count], kind="stable").tolist()
    connected = (node.value(f"{color}:i{i}") for i in order)
    knots = [values[i] if value is None else value for i, value in zip(order, connected, strict=True)]
    return _Knots(positions[order].tolist(), [kinds[i] for i in order], knots)


def _arnold_ramp(node: ShaderNode) -> Value:
    """Read Arnold's ramps of colours or numbers."""
    kind, x = node.text("type", "custom"), node.value("input")
    if kind in _DIRECTIONS:
        x = _direction(kind, (node.text("uvset"), np.eye(3)), "repeat" if node.flag("wrap_uvs", True) else "clamp")
    elif kind != "custom":
        node.lose(f"is '{kind}': expected custom or one of {', '.join(_DIRECTIONS)}; its input is used", "type")
    values = "color" if node.category == "arnold:ramp_rgb" else "value"
    return _knots(node, "position", values, "interpolation").at(node, np.zeros(1) if x is None else x)


def _renderman_ramp(node: ShaderNode) -> Value:
    """Read a PxrRamp, whose knots have one name in RenderMan 22 and another one since."""
    x = node.value("splineMap")
    if x is None:
        kind = list(_DIRECTIONS)[_whole(node, "rampType", 0, (0, len(_DIRECTIONS) - 1))]
        x = _direction(kind, coordinates(node, "manifold"), "repeat" if node.flag("tile") else "clamp")
    if node.flag("reverse"):
        x = node.combined(lambda values: 1 - values, x)
    old = ("positions", "colors", "basis")
    new = ("colorRamp_Knots", "colorRamp_Colors", "colorRamp_Interpolation")
    return _knots(node, *(new if node.has(new[1]) else old)).at(node, x)


def _materialx_ramp(node: ShaderNode) -> Value:
    """Read MaterialX's `ramp`: up to ten colours."""
    kind = ("u", "radial", "circular", "box")[_whole(node, "type", 0, (0, 3))]
    join = (LINEAR, SMOOTH, CONSTANT)[_whole(node, "interpolation", 1, (0, 2))]
    numbers = range(1, 1 + _whole(node, "num_intervals", 2, (2, 10)))
    positions = [node.scalar(f"interval{number}", float(number > 1)) for number in numbers]
    values = [node.color_or(float(number > 1), f"color{number}") for number in numbers]
    x = _direction(kind, coordinates(node, "texcoord"), "clamp")
    return _Knots(positions, [join] * len(values), values).at(node, x)


def _whole(node: ShaderNode, name: str, default: int, ends: tuple[int, int]) -> int:
    """Return a whole number, which is at least and at most the ends."""
    value = int(node.plain(name, default))
    nearest = min(max(value, ends[0]), ends[1])
    if value != nearest:
        node.lose(f"is {value}: expected {ends[0]} to {ends[1]}; {nearest} is used", name)
    return nearest


def _corners(axes: str, mixed: Callable[..., Array], *names: str) -> NodeReader:
    """Return a reader of MaterialX's simple ramps and splits: functions of u, v or both, and of values."""

    def read(node: ShaderNode) -> Value:
        placed = coordinates(node, "texcoord")
        along = [_direction(axis, placed, "clamp") for axis in axes]
        values = (node.first(name) for name in names)
        defaults = (np.full(1, 0.5 if name == "center" else 0.0) for name in names)
        filled = (default if value is None else value for value, default in zip(values, defaults, strict=True))
        return node.combined(mixed, *along, *filled)

    return read


def _texcoord(node: ShaderNode) -> Value:
    def both(u: Array, v: Array) -> Array:
        return np.concatenate(np.broadcast_arrays(u, v), axis=-1)

    return over_uvs(both, ("", np.eye(3)), size=(2 * _WIDE, 2 * _WIDE))


def _state(node: ShaderNode) -> Value:
    """Read Arnold's state variables: u and v."""
    name = node.text("variable")
    if name in ("u", "v"):
        return _direction(name, ("", np.eye(3)))
    node.lose(f"is '{name}', which is not rendered: 0 is used", "variable")
    return np.zeros(1)


def _uv_transform(node: ShaderNode) -> Value | None:
    """Read Arnold's `uv_transform`, which repeats an image, turns it about a pivot, and offsets it."""
    value = node.value("passthrough")
    if not isinstance(value, Image):
        return value
    turn = node.scalar("rotate", 0.0)
    turned = rotation(float(np.degrees(turn)) if node.text("unit") == "radians" else turn)
    pivot = node.vector("pivot", (0.5, 0.5))
    placed = affine(np.diag(node.vector("repeat", (1.0, 1.0))), node.vector("offset", (0.0, 0.0)))
    for name, neutral in (("scale_frame", (1.0, 1.0)), ("translate_frame", (0.0, 0.0)), ("rotate_frame", (0.0,))):
        if np.any(node.vector(name, neutral) != neutral):
            node.lose("is not rendered: it is ignored", name)
    return value.moved(placed @ affine(turned, pivot - turned @ pivot))


RAMPS: dict[str, NodeReader] = {
    "arnold:ramp_rgb": _arnold_ramp,
    "arnold:ramp_float": _arnold_ramp,
    "arnold:state_float": _state,
    "arnold:uv_transform": _uv_transform,
    "PxrRamp": _renderman_ramp,
    "ramp": _materialx_ramp,
    "texcoord": _texcoord,
    "ramplr": _corners("u", lambda u, left, right: mix(left, right, u), "valuel", "valuer"),
    "ramptb": _corners("v", lambda v, top, bottom: mix(bottom, top, v), "valuet", "valueb"),
    "ramp4": _corners(
        "uv", lambda u, v, tl, tr, bl, br: mix(mix(bl, br, u), mix(tl, tr, u), v),
        "valuetl", "valuetr", "valuebl", "valuebr",
    ),
    "splitlr": _corners(
        "u", lambda u, left, right, center: mix(left, right, u >= center), "valuel", "valuer", "center"
    ),
    "splittb": _corners(
        "v", lambda v, top, bottom, center: mix(bottom, top, v >= center), "valuet", "valueb", "center"
    ),
}  # fmt: skip
