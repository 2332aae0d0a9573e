"""Read ramps over UVs or over another value, and UVs as values: nodes that are functions of u and v."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ...scene import Array
from ..common.openusd import UsdShade
from .images import affine, coordinates, rotation
from .network import Network, Node
from .values import Image, Value, mix

#: Interpolations between the knots of a ramp, by Arnold's numbers.
CONSTANT, LINEAR, CATMULL_ROM, MONOTONE, SMOOTH = range(5)
_JOINED = {"none": CONSTANT, "constant": CONSTANT, "linear": LINEAR, "catmull-rom": CATMULL_ROM, "bspline": CATMULL_ROM}

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


def _knots(
    network: Network, node: UsdShade.Shader, names: tuple[str, str, str]
) -> tuple[list[float], list[int], list[Value]]:
    """Return the sorted positions of a ramp, the interpolation after each, and the values.

    A value may be connected, such as `inputs:color:i1`.
    """
    given, colors, joined = (network.plain(node, name) for name in names)
    values = np.asarray([0.0, 1.0] if colors is None else colors, dtype=np.float64)
    values = values.reshape(len(values), -1) if values.ndim else values.reshape(1, 1)
    values = network.colors(node, names[1], values)
    even = np.linspace(0, 1, len(values)) if len(values) > 1 else np.zeros(1)
    positions = even if given is None else np.atleast_1d(np.asarray(given, dtype=np.float64))
    joins = [LINEAR] if joined is None else [joined] if isinstance(joined, str | int) else list(joined)
    kinds = [_JOINED.get(each, LINEAR) if isinstance(each, str) else int(each) for each in joins] or [LINEAR]
    count = min(len(values), len(positions))
    if not count or not (np.all(np.isfinite(values)) and np.all(np.isfinite(positions))):
        network.lose(node, "has no finite knots: it is black", names[0])
        return [0.0], [LINEAR], [np.zeros(1)]
    if len(values) != len(positions):
        network.lose(node, f"has {len(positions)} values: expected {len(values)}, as many as {names[1]}", names[0])
    knots: list[Value] = [values[i] for i in range(count)]
    for i in range(count):
        connected = network.value(node, f"{names[1]}:i{i}")
        knots[i] = knots[i] if connected is None else connected
    order = np.argsort(positions[:count], kind="stable")
    kinds += [kinds[-1]] * (count - len(kinds))
    return [float(positions[i]) for i in order], [kinds[i] for i in order], [knots[i] for i in order]


def _on_ramp(network: Network, node: UsdShade.Shader, x: Value, names: tuple[str, str, str]) -> Value:
    positions, kinds, knots = _knots(network, node, names)
    return network.combined(node, lambda x, *values: ramp(x[..., :1], positions, kinds, values), x, *knots)


def _arnold_ramp(values: str) -> Node:
    """Return a reader of Arnold's ramps of colours or numbers."""

    def read(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
        kind = str(network.plain(node, "type", "custom"))
        x = network.value(node, "input")
        if kind in _DIRECTIONS:
            wrap = "repeat" if network.plain(node, "wrap_uvs", True) else "clamp"
            x = _direction(kind, (str(network.plain(node, "uvset", "")), np.eye(3)), wrap)
        elif kind != "custom":
            network.lose(
                node, f"is '{kind}': expected custom or one of {', '.join(_DIRECTIONS)}; its input is used", "type"
            )
        return _on_ramp(network, node, np.zeros(1) if x is None else x, ("position", values, "interpolation"))

    return read


def _renderman_ramp(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
    """Read a PxrRamp, whose knots have one name in RenderMan 22 and another one since."""
    x = network.value(node, "splineMap")
    if x is None:
        number, names = int(network.plain(node, "rampType", 0)), list(_DIRECTIONS)
        if number >= len(names):
            network.lose(node, f"is {number}: expected 0 to {len(names) - 1}; 0 is used", "rampType")
        wrap = "repeat" if network.plain(node, "tile", 0) else "clamp"
        x = _direction(names[number if number < len(names) else 0], coordinates(network, node, "manifold"), wrap)
    if network.plain(node, "reverse", 0):
        x = network.combined(node, lambda values: 1 - values, x)
    old = ("positions", "colors", "basis")
    new = ("colorRamp_Knots", "colorRamp_Colors", "colorRamp_Interpolation")
    return _on_ramp(network, node, x, new if node.GetInput(new[1]) else old)


def _materialx_ramp(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
    """Read MaterialX's `ramp`: up to ten colours."""
    names = ["u", "radial", "circular", "box"]
    kind, joined = int(network.plain(node, "type", 0)), int(network.plain(node, "interpolation", 1))
    x = _direction(names[kind if 0 <= kind < 4 else 0], coordinates(network, node, "texcoord"), "clamp")
    defaults = [(0.0, [0.0, 0.0, 0.0, 1.0]), *[(1.0, [1.0] * 4)] * 9]
    positions, knots = [], list[Value]()
    count = int(network.plain(node, "num_intervals", 2))
    bounds = {"num_intervals": (count, 2, 10), "type": (kind, 0, 3), "interpolation": (joined, 0, 2)}
    for name, (value, least, most) in bounds.items():
        if not least <= value <= most:
            network.lose(node, f"is {value}: expected {least} to {most}", name)
    for i in range(min(max(count, 2), 10)):
        positions.append(float(network.vector(node, f"interval{i + 1}", (defaults[i][0],))[0]))
        color = network.value(node, f"color{i + 1}")
        knots.append(np.array(defaults[i][1]) if color is None else color)
    kinds = [(LINEAR, SMOOTH, CONSTANT)[joined if 0 <= joined < 3 else 1]] * len(knots)
    return network.combined(node, lambda x, *values: ramp(x, positions, kinds, values), x, *knots)


def _corners(axes: str, mixed: Callable[..., Array], *names: str) -> Node:
    """Return a reader of MaterialX's simple ramps and splits: functions of u, v or both, and of values."""

    def read(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
        def found(name: str) -> Value:
            value = network.value(node, name)
            return np.full(1, 0.5 if name == "center" else 0.0) if value is None else value

        placed = coordinates(network, node, "texcoord")
        along = [over_uvs(_DIRECTIONS[axis], placed, "clamp", _SIZES[axis]) for axis in axes]
        return network.combined(node, mixed, *along, *(found(name) for name in names))

    return read


def _texcoord(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
    def both(u: Array, v: Array) -> Array:
        return np.concatenate(np.broadcast_arrays(u, v), axis=-1)

    return over_uvs(both, ("", np.eye(3)), size=(2 * _WIDE, 2 * _WIDE))


def _state(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
    """Read Arnold's state variables: u and v."""
    name = str(network.plain(node, "variable", ""))
    if name in ("u", "v"):
        return _direction(name, ("", np.eye(3)))
    network.lose(node, f"is '{name}', which is not rendered: 0 is used", "variable")
    return np.zeros(1)


def _uv_transform(network: Network, node: UsdShade.Shader, output: str) -> Value | None:
    """Read Arnold's `uv_transform`, which repeats an image, turns it about a pivot, and offsets it."""
    value = network.value(node, "passthrough")
    if not isinstance(value, Image):
        return value
    unit = np.degrees if str(network.plain(node, "unit", "degrees")) == "radians" else np.asarray
    turned = rotation(float(unit(network.vector(node, "rotate", (0.0,))[0])))
    pivot = network.vector(node, "pivot", (0.5, 0.5))
    moved = affine(turned, pivot - turned @ pivot)
    moved = (
        affine(np.diag(network.vector(node, "repeat", (1.0, 1.0))), network.vector(node, "offset", (0.0, 0.0))) @ moved
    )
    for name, neutral in (("scale_frame", (1.0, 1.0)), ("translate_frame", (0.0, 0.0)), ("rotate_frame", (0.0,))):
        if np.any(network.vector(node, name, neutral) != neutral):
            network.lose(node, "is not rendered: it is ignored", name)
    return value.moved(moved)


RAMPS: dict[str, Node] = {
    "arnold:ramp_rgb": _arnold_ramp("color"),
    "arnold:ramp_float": _arnold_ramp("value"),
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
