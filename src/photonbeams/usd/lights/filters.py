"""Read the filters of a light, `light:filters`: ours, and those of other programs as far as they map.

They become `scene.Light.filters`, blockers and ramps. An image that a filter holds before a light becomes the light's
gobo. What does not map is left out, with a warning that names it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ...scene import (
    Array,
    Blocker,
    DistanceRamp,
    DistantLight,
    DomeLight,
    Gobo,
    Light,
    LightFilter,
    SphereLight,
)
from ...scene import color as color_of
from ...scene.vectors import unit
from ..common.definitions import BLOCKER, PREFIX, RAMP, definitions, read_attribute
from ..common.openusd import Sdf, Usd, UsdShade
from ..common.reading import Reading
from ..common.textures import read_image
from .filter_inputs import Inputs, filters_of
from .links import FILTER_LINK, is_linked

#: Reads a filter of a light, which may become several.
Reader = Callable[[Inputs, Light], list[LightFilter]]

# Pieces between two knots of a smooth ramp.
_PIECES = 4
# Doors at a lamp act by the direction of light alone: their opening is so many units before it.
_AHEAD = 1e4


def filtered(reading: Reading, prim: Usd.Prim, light: Light) -> Light:
    """Return a light with its filters; those that are not rendered are named."""
    none: list[Usd.Prim] = []
    targets = reading.attempt(prim, partial(filters_of, reading, prim), none, "it shines without filters")
    without = f"{light.name} shines without it"
    for target in targets:
        light = reading.attempt(target, partial(_with, reading, target, light), light, without)
    return light


def _with(reading: Reading, prim: Usd.Prim, light: Light) -> Light:
    """Return a light with one more filter."""
    inputs = Inputs.of(reading, prim)
    kind = _plain(inputs.kind)
    if kind in _GOBOS:
        result = _gobo(inputs, light)
    elif kind in _READERS:
        result = replace(light, filters=(*light.filters, *_READERS[kind](inputs, light)))
    else:
        name = inputs.kind or "prim without a type"
        reading.warn(prim, f"is a {name}, which is not rendered as a filter: {light.name} shines without it")
        return light
    inputs.warn_of_others()
    if result.gobo is not light.gobo and is_linked(reading, prim, FILTER_LINK):
        warn_of_link(reading, prim)
    return result


def warn_of_link(reading: Reading, prim: Usd.Prim) -> None:
    """Warn that the link of a filter is not rendered."""
    text = "is not rendered: the filter acts on everything that its light shines on"
    reading.warn(prim, text, f"collection:{FILTER_LINK}")


def _plain(kind: str) -> str:
    """Return the name of a kind of filters without the prefixes and the spellings of programs."""
    name = "".join(each for each in kind.lower() if each.isalnum())
    return name.removeprefix("arnold").removeprefix("moonraylightfilter").removeprefix("moonray")


def _scaled(inputs: Inputs, factor: Array) -> list[LightFilter]:
    """Return a filter that multiplies all light, if it changes any."""
    return [] if np.all(factor == 1) else [DistanceRamp(inputs.path, np.zeros(1), factor[None])]


# -- Shapes -----------------------------------------------------------------------------------------------------------


def _shaped(inputs: Inputs, shape: str, sizes: Mapping[str, float], **fields: Any) -> Blocker:
    """Return a sphere, a capsule along Y, a box or a plane, by its radius, width, height and depth."""
    width, height, depth = (sizes[each] for each in ("width", "height", "depth"))
    box = {"sphere": (0, 0, 0), "capsule": (0, height, 0), "box": (width, height, depth), "plane": (width, height, 0)}
    radius = sizes["radius"] if shape in ("sphere", "capsule") else 0.0
    half = 0.5 * np.array(box[shape], dtype=np.float64)
    return Blocker(inputs.path, half, radius, flat=shape == "plane", **{"frame": inputs.frame(), **fields})


def _shape(inputs: Inputs, name: str, shapes: Sequence[str]) -> str:
    """Return a shape, the first of these by default."""
    shape = str(inputs.token(name, shapes[0]))
    if shape not in shapes:
        text = f"is '{shape}', which is not rendered: expected {', '.join(shapes[:-1])} or {shapes[-1]}"
        raise inputs.fail(name, text)
    return shape


def _own_blocker(inputs: Inputs, light: Light) -> list[LightFilter]:
    read = {
        name.removeprefix(PREFIX): own.read(inputs.reading, inputs.shader) for name, own in definitions(BLOCKER).items()
    }
    fields = {name: read[name] for name in ("edge", "color", "where", "invert")}
    return [_shaped(inputs, read["shape"], read, **fields)]


def _karma_blocker(inputs: Inputs, light: Light) -> list[LightFilter]:
    """Read Karma's blocker: tint and exposure change the light, of which the shape takes all, or all but its own."""
    shape = _shape(inputs, "shape", ("sphere", "capsule", "box", "plane"))
    defaults = {"radius": 0.5, "width": 1.0, "height": 1.0, "depth": 1.0}
    sizes = {name: inputs.number(name, default) for name, default in defaults.items()}
    blocker = _shaped(inputs, shape, sizes, edge=inputs.number("edge", 0.0), invert=inputs.flag("invert"))
    return [blocker, *_scaled(inputs, inputs.gain)]


def _arnold_blocker(inputs: Inputs, light: Light) -> list[LightFilter]:
    """Read Arnold's light_blocker: a shape one unit wide, whose place is a matrix."""
    shape = _shape(inputs, "geometry_type", ("box", "sphere", "plane"))
    fields: dict[str, Any] = {"color": (1 - _density(inputs),) * 3}
    matrix = inputs.reading.value(inputs.shader, inputs.name("geometry_matrix"))
    if matrix is not None:
        fields["frame"] = inputs.reading.matrix(inputs.shader, matrix)
    return [_shaped(inputs, shape, {"radius": 0.5, "width": 1.0, "height": 1.0, "depth": 1.0}, **fields)]


def _rod(inputs: Inputs, radius: float, flat: bool = False) -> Blocker:
    """Return the rounded box or rectangle of RenderMan's and MoonRay's rods, blockers and barn doors."""
    half, shift = np.zeros(3), np.eye(4)
    for axis, (name, before, after) in enumerate(_SIDES[: 2 if flat else 3]):
        scale = inputs.number(f"scale{name.title()}", 1.0)
        less, more = (inputs.number(end, 0.0, -np.inf) for end in (before, after))
        half[axis] = 0.5 * max(scale * inputs.number(name, 1.0) + less + more, 0.0)
        shift[axis, 3] = 0.5 * (more - less)
    radius, edge = inputs.number("radius", radius), inputs.number("edge", 0.0)
    return Blocker(inputs.path, half, radius, edge, flat=flat, frame=inputs.frame() @ shift)


_SIDES = (("width", "left", "right"), ("height", "bottom", "top"), ("depth", "back", "front"))


def _density(inputs: Inputs) -> float:
    return inputs.reading.clipped(inputs.shader, inputs.name("density"), 1.0, 0.0, 1.0)


def _pxr_rod(inputs: Inputs, light: Light) -> list[LightFilter]:
    """Read RenderMan's rod or blocker: light in the shape is multiplied, because the lit point alone is asked."""
    return _inside(inputs, _rod(inputs, 0.5), np.full(3, inputs.number("intensity", 0.0)))


def _moonray_rod(inputs: Inputs, light: Light) -> list[LightFilter]:
    return _inside(inputs, _rod(inputs, 0.0), inputs.color("color", 0.0) * inputs.number("intensity", 1.0))


def _inside(inputs: Inputs, rod: Blocker, color: Array) -> list[LightFilter]:
    left = color_of(1 + _density(inputs) * (color - 1), "color")
    return [replace(rod, where="inside", invert=inputs.flag("invert"), color=left)]


def _barn(inputs: Inputs, light: Light) -> list[LightFilter]:
    """Read barn doors with a place of their own: light passes through a rectangle, and is blocked beside it."""
    before = inputs.token("preBarn", "noEffect")
    if before not in ("noEffect", "cone", 0, 1):
        inputs.warn("preBarn", f"is {before}: expected noEffect or cone; noEffect is used")
    if inputs.token("barnMode", "physical") not in ("physical", 0):
        inputs.warn("barnMode", "is not rendered: light passes the barn as through an open window, as with physical")
    doors = replace(
        _rod(inputs, 0.0, flat=True), invert=not inputs.flag("invert"), color=(1 - _density(inputs),) * 3,
        where="along" if before in ("cone", 1) else "behind",
    )  # fmt: skip
    return [doors, *_scaled(inputs, inputs.color("color", 1.0) * inputs.number("intensity", 1.0))]


def _doors(inputs: Inputs, light: Light, sides: Sequence[float], invert: bool = False) -> list[LightFilter]:
    """Return doors at the lamp; `sides` are left, right, bottom and top of the opening, 0 to 1."""
    place = light.slide(Gobo(np.ones((1, 1, 1)))) if isinstance(light, SphereLight) else None
    if place is None or not isinstance(light, SphereLight):
        inputs.reading.warn(inputs.prim, f"is not rendered on {light.name}: expected a sphere light")
        return []
    left, right, bottom, top = sides
    if right <= left or top <= bottom:
        return [] if invert else _scaled(inputs, np.zeros(3))
    far = _AHEAD * max(light.radius, 1e-3)
    frame = np.eye(4)
    frame[:3, :3] = far * np.column_stack([place.right, place.up, unit(place.ahead)])
    offset = (0.5 * (left + right) - 0.5) * place.right + (0.5 * (bottom + top) - 0.5) * place.up + place.ahead
    frame[:3, 3] = light.center + far * offset
    half = 0.5 * np.array([right - left, top - bottom, 0.0])
    edge = _edge(inputs)
    return [Blocker(inputs.path, half, 0.0, edge, where="along", invert=not invert, flat=True, frame=frame)]


def _edge(inputs: Inputs) -> float:
    """Return the edge of doors, the mean of all; in Karma `leftedge`, in Arnold `barndoor_left_edge`."""
    name = "barndoor_{}_edge" if _plain(inputs.kind) == "barndoor" else "{}edge"
    names = [name.format(side) for side in ("left", "right", "bottom", "top")]
    values = [inputs.number(each, 0.0) for each in names]
    if max(values) > min(values):
        inputs.warn(names[0], f"differs from those of the other doors: {np.mean(values):.4g} is used for all")
    return float(np.mean(values))


def _arnold_doors(inputs: Inputs, light: Light) -> list[LightFilter]:
    """Read Arnold's barn doors: each door's edge is at two places of the cone's square, from its left and its top."""

    def place(side: str, ends: Sequence[str], default: float) -> float:
        names = [f"barndoor_{side}_{end}" for end in ends]
        first, second = (inputs.number(name, default) for name in names)
        if first != second:
            inputs.warn(names[0], f"is {first:g} and at the other end {second:g}: doors are straight, at the mean")
        return 0.5 * (first + second)

    left, right = (place(side, ("top", "bottom"), default) for side, default in (("left", 0.0), ("right", 1.0)))
    top, bottom = (place(side, ("left", "right"), default) for side, default in (("top", 0.0), ("bottom", 1.0)))
    return _doors(inputs, light, (left, right, 1 - bottom, 1 - top))


def _karma_doors(inputs: Inputs, light: Light) -> list[LightFilter]:
    """Read Karma's barn doors, each of which covers a fraction of the cone from its side."""
    left, right, bottom, top = (inputs.number(each, 0.0) for each in ("left", "right", "bottom", "top"))
    doors = _doors(inputs, light, (left, 1 - right, bottom, 1 - top), inputs.flag("invert"))
    return [*doors, *_scaled(inputs, inputs.gain)]


# -- Ramps ------------------------------------------------------------------------------------------------------------


def _ramp(inputs: Inputs, light: Light, knots: Array, colors: Array, steps: Any = "linear") -> list[LightFilter]:
    """Return a ramp; `steps` is the interpolation of all knots, or that of each."""
    if isinstance(light, DistantLight | DomeLight):
        inputs.reading.warn(inputs.prim, f"is not rendered on {light.name}, which is infinitely far away")
        return []
    order = np.argsort(knots, kind="stable")
    knots, colors = knots[order], colors[order]
    kinds = np.resize(np.array(steps if isinstance(steps, str) else list(steps), dtype=object), len(knots))
    places, values = [knots[:1]], [colors[:1]]
    for number, kind in enumerate(map(str, kinds[:-1])):
        part = eased = np.array([1.0])
        if kind in ("none", "constant", "0"):
            part, eased = np.array([1.0, 1.0]), np.array([0.0, 1.0])
        elif kind not in ("linear", "1"):
            part = np.arange(1, _PIECES + 1) / _PIECES
            eased = part * part * (3 - 2 * part)
        places.append(knots[number] + part * (knots[number + 1] - knots[number]))
        values.append(colors[number] + eased[:, None] * (colors[number + 1] - colors[number]))
    return [DistanceRamp(inputs.path, np.concatenate(places), np.maximum(np.concatenate(values), 0))]


def _own_ramp(inputs: Inputs, light: Light) -> list[LightFilter]:
    distances, colors, interpolation = (
        read_attribute(inputs.reading, inputs.shader, RAMP, each) for each in ("distances", "colors", "interpolation")
    )
    if len(distances) != len(colors) or not distances:
        text = f"has {len(colors)} colours: expected one for each of {len(distances)} distances"
        raise inputs.reading.fail(inputs.shader, f"{PREFIX}colors", text)
    return _ramp(inputs, light, np.array(distances, dtype=np.float64), np.array(colors), interpolation)


def _color_ramp(inputs: Inputs, light: Light) -> list[LightFilter]:
    """Read PxrRamp and MoonRay's ColorRamp."""
    mode = inputs.token("rampMode", "distanceToLight")
    if mode not in ("distanceToLight", 0) or inputs.flag("use_xform"):
        text = f"has the mode {mode}, which is not rendered: expected the distance to the light; it is left out"
        inputs.reading.warn(inputs.prim, text)
        return []
    begin, end = inputs.number("beginDist", 0.0), inputs.number("endDist", 1.0)
    knots = inputs.array("colorRamp_Knots", [[0.0], [1.0]])
    colors = inputs.array("colorRamp_Colors", [[1.0] * 3, [0.0] * 3])
    if len(knots) == len(colors) + 4 or len(knots) == len(colors) + 2:  # RenderMan repeats the ends of its ramps
        knots = knots[(len(knots) - len(colors)) // 2 :][: len(colors)]
    if len(knots) != len(colors):
        text = f"has {len(colors)} colours: expected {len(knots)}, one for each knot"
        raise inputs.fail("colorRamp_Colors", text)
    colors = 1 + _density(inputs) * (colors * inputs.number("intensity", 1.0) - 1)
    steps = inputs.token("colorRamp_Interpolation", "linear")
    return _ramp(inputs, light, begin + (end - begin) * knots[:, 0], colors, steps)


def _decay(inputs: Inputs, light: Light) -> list[LightFilter]:
    """Read Arnold's light_decay and MoonRay's Decay: light fades in near the lamp, and out far from it."""
    knots: list[float] = []
    factors: list[float] = []
    for end, ramp in (("near", (0.0, 1.0)), ("far", (1.0, 0.0))):
        if inputs.flag(f"use_{end}_atten"):
            knots += [inputs.number(f"{end}_start", 0.0), inputs.number(f"{end}_end", 0.0)]
            factors += ramp
    if not knots:
        return []
    return _ramp(inputs, light, np.maximum.accumulate(knots), np.repeat(np.array(factors)[:, None], 3, axis=1))


def _intensity(inputs: Inputs, light: Light) -> list[LightFilter]:
    """Read filters that change all of a light: PxrIntMult, MoonRay's Intensity, Karma's gel."""
    return _scaled(inputs, inputs.gain * inputs.color("color", 1.0))


# -- Images -----------------------------------------------------------------------------------------------------------


def _gobo(inputs: Inputs, light: Light) -> Light:
    """Return a light with an image before it as its gobo: Arnold's and Karma's gobo, PxrGobo."""
    if light.gobo is not None:
        inputs.reading.warn(inputs.prim, f"is not rendered: {light.name} has another gobo")
        return light
    sources = UsdShade.ConnectableAPI(inputs.shader).GetInputs()
    connected = (source.source.GetPrim() for each in sources for source in each.GetConnectedSources()[0])
    for prim in (inputs.shader, *connected):
        for name in (each.GetName() for each in prim.GetAuthoredAttributes()):
            if isinstance(inputs.reading.value(prim, name), Sdf.AssetPath):
                inputs.used.add(name.rsplit(":", 1)[-1])
                image = read_image(inputs.reading, prim, name)
                return light if image is None else replace(light, gobo=Gobo(image))
    inputs.reading.warn(inputs.prim, f"names no image: {light.name} shines without it")
    return light


_GOBOS = ("gobo", "kmalfiltergobo", "pxrgobolightfilter")
_READERS: dict[str, Reader] = {
    "photonbeamsblockerfilter": _own_blocker,
    "photonbeamsrampfilter": _own_ramp,
    "karmablockerlightfilter": _karma_blocker,
    "lightblocker": _arnold_blocker,
    "pxrblockerlightfilter": _pxr_rod,
    "pxrrodlightfilter": _pxr_rod,
    "rodlightfilter": _moonray_rod,
    "pxrbarnlightfilter": _barn,
    "barndoor": _arnold_doors,
    "kmalfilterbarndoor": _karma_doors,
    "pxrramplightfilter": _color_ramp,
    "colorramplightfilter": _color_ramp,
    "lightdecay": _decay,
    "decaylightfilter": _decay,
    "pxrintmultlightfilter": _intensity,
    "intensitylightfilter": _intensity,
    "kmalfiltergel": _intensity,
}
