"""Read the filters of a light, `light:filters`: ours, and those of other programs as far as they map.

They become `scene.Light.filters`, blockers and ramps. An image that a filter holds before a light becomes the light's
gobo. What does not map is left out, with a warning that names it.
"""

from __future__ import annotations

from collections.abc import Callable
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
from ..common.definitions import BLOCKER, PREFIX, RAMP, definitions
from ..common.openusd import Sdf, Usd, UsdShade
from ..common.reading import Reading
from ..common.textures import read_image
from .filter_inputs import Inputs, filters_of
from .links import FILTER_LINK, is_linked

#: Reads a filter; returns the light with it.
Reader = Callable[[Inputs, Light], Light]

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
    reader = _READERS.get(_plain(inputs.kind))
    if reader is None:
        kind = inputs.kind or "prim without a type"
        reading.warn(prim, f"is a {kind}, which is not rendered as a filter: {light.name} shines without it")
        return light
    result = reader(inputs, light)
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


def _added(light: Light, *filters: LightFilter) -> Light:
    return replace(light, filters=(*light.filters, *filters))


def _scaled(inputs: Inputs, light: Light, factor: Array) -> Light:
    """Return a light with a filter that multiplies all of its light."""
    if np.all(factor == 1):
        return light
    return _added(light, DistanceRamp(inputs.path, np.zeros(1), factor[None]))


# -- Shapes -----------------------------------------------------------------------------------------------------------


def _own_blocker(inputs: Inputs, light: Light) -> Light:
    read = {
        name.removeprefix(PREFIX): own.read(inputs.reading, inputs.shader) for name, own in definitions(BLOCKER).items()
    }
    shape, edge, color = read["shape"], read["edge"], read["color"]
    box, radius = _sizes(shape, read["radius"], read["width"], read["height"], read["depth"])
    return _added(light, Blocker(
        inputs.path, box, radius, edge, color, read["where"], read["invert"], shape == "plane",
        inputs.frame(),
    ))  # fmt: skip


def _sizes(shape: str, radius: float, width: float, height: float, depth: float) -> tuple[Array, float]:
    """Return half of the box, and the radius around it, of a sphere, a capsule along Y, a box or a plane."""
    sizes = {
        "sphere": (0, 0, 0), "capsule": (0, height, 0), "box": (width, height, depth), "plane": (width, height, 0),
    }  # fmt: skip
    return 0.5 * np.array(sizes[shape], dtype=np.float64), radius if shape in ("sphere", "capsule") else 0.0


def _karma_blocker(inputs: Inputs, light: Light) -> Light:
    """Read Karma's blocker: tint and exposure change the light, of which the shape takes all, or all but its own."""
    shape = inputs.token("shape", default="sphere")
    if shape not in ("sphere", "capsule", "box", "plane"):
        raise inputs.fail("shape", f"is '{shape}': expected sphere, capsule, box or plane")
    radius = inputs.number("radius", default=0.5)
    box, radius = _sizes(shape, radius, *(inputs.number(each, default=1.0) for each in ("width", "height", "depth")))
    blocker = Blocker(
        inputs.path, box, radius, inputs.number("edge", "edgeSoftness", default=0.0),
        invert=inputs.flag("invert"), flat=shape == "plane", frame=inputs.frame(),
    )  # fmt: skip
    return _scaled(inputs, _added(light, blocker), inputs.gain)


def _rod(inputs: Inputs, radius: float, flat: bool = False) -> Blocker:
    """Return the rounded box or rectangle of RenderMan's and MoonRay's rods, blockers and barn doors."""
    sizes, centers = [], []
    for name, ends in (("width", "left right"), ("height", "bottom top"), ("depth", "back front"))[: 2 if flat else 3]:
        scale = inputs.number(f"scale{name.title()}", f"scale:{name}", default=1.0)
        less, more = (
            inputs.number(end, f"refine:{end}", default=0.0, minimum=-np.inf) for end in ends.split()
        )  # fmt: skip
        sizes.append(max(scale * inputs.number(name, default=1.0) + less + more, 0.0))
        centers.append(0.5 * (more - less))
    shift = np.eye(4)
    shift[: len(centers), 3] = centers
    return Blocker(
        inputs.path, 0.5 * np.array([*sizes, 0.0][:3]),
        inputs.number("radius", default=radius), inputs.number("edge", "edgeThickness", default=0.0), flat=flat,
        frame=inputs.frame() @ shift,
    )  # fmt: skip


def _density(inputs: Inputs) -> float:
    return inputs.reading.clipped(inputs.shader, inputs.name("density"), 1.0, 0.0, 1.0)


def _pxr_rod(inputs: Inputs, light: Light) -> Light:
    """Read RenderMan's rod or blocker: light in the shape is multiplied, because the lit point alone is asked."""
    return _inside(inputs, light, _rod(inputs, 0.5), np.full(3, inputs.number("intensity", default=0.0)))


def _moonray_rod(inputs: Inputs, light: Light) -> Light:
    color = np.array(inputs.color("color", default=(0, 0, 0))) * inputs.number("intensity", default=1.0)
    return _inside(inputs, light, _rod(inputs, 0.0), color)


def _inside(inputs: Inputs, light: Light, rod: Blocker, color: Array) -> Light:
    left = color_of(1 + _density(inputs) * (color - 1), "color")
    return _added(light, replace(rod, where="inside", invert=inputs.flag("invert"), color=left))


def _arnold_blocker(inputs: Inputs, light: Light) -> Light:
    """Read Arnold's light_blocker: a shape one unit wide, whose place is a matrix."""
    shape = str(inputs.token("geometry_type", default="box"))
    if shape not in ("box", "sphere", "plane"):
        raise inputs.fail("geometry_type", f"is '{shape}', which is not rendered: expected box, sphere or plane")
    box, radius = _sizes(shape, 0.5, 1.0, 1.0, 1.0)
    name = inputs.name("geometry_matrix")
    matrix = inputs.reading.value(inputs.shader, name)
    frame = inputs.frame() if matrix is None else inputs.reading.matrix(inputs.shader, matrix)
    color = (1 - _density(inputs),) * 3
    blocker = Blocker(inputs.path, box, radius, color=color, flat=shape == "plane", frame=frame)
    return _added(light, blocker)


def _barn(inputs: Inputs, light: Light) -> Light:
    """Read barn doors with a place of their own: light passes through a rectangle, and is blocked beside it."""
    before = inputs.token("preBarn", "preBarnEffect", default="noEffect")
    if before not in ("noEffect", "cone", 0, 1):
        inputs.warn("preBarn", f"is {before}: expected noEffect or cone; noEffect is used")
    if inputs.token("barnMode", default="physical") not in ("physical", 0):
        inputs.warn("barnMode", "is not rendered: light passes the barn as through an open window, as with physical")
    doors = replace(
        _rod(inputs, 0.0, flat=True), invert=not inputs.flag("invert"), color=(1 - _density(inputs),) * 3,
        where="along" if before in ("cone", 1) else "behind",
    )  # fmt: skip
    color = np.array(inputs.color("color", default=(1, 1, 1))) * inputs.number("intensity", default=1.0)
    return _scaled(inputs, _added(light, doors), color)


def _doors(inputs: Inputs, light: Light, sides: Array, edge: float, invert: bool = False) -> Light:
    """Return a light with doors at the lamp; `sides` are left, right, bottom and top of the opening, 0 to 1."""
    place = light.slide(Gobo(np.ones((1, 1, 1)))) if isinstance(light, SphereLight) else None
    if place is None:
        inputs.reading.warn(inputs.prim, f"is not rendered on {light.name}: expected a sphere light")
        return light
    left, right, bottom, top = sides
    if right <= left or top <= bottom:
        return light if invert else _scaled(inputs, light, np.zeros(3))
    assert isinstance(light, SphereLight)
    far = _AHEAD * max(light.radius, 1e-3)
    frame = np.eye(4)
    frame[:3, :3] = np.column_stack([place.right, place.up, place.ahead])
    frame[:3, :3] *= far * np.array([1, 1, 1 / np.linalg.norm(place.ahead)])
    offset = (0.5 * (left + right) - 0.5) * place.right + (0.5 * (bottom + top) - 0.5) * place.up + place.ahead
    frame[:3, 3] = light.center + far * offset
    half = 0.5 * np.array([right - left, top - bottom, 0.0])
    name = inputs.path
    return _added(light, Blocker(name, half, 0.0, edge, where="along", invert=not invert, flat=True, frame=frame))


def _one(inputs: Inputs, names: list[str]) -> float:
    """Return the mean of numbers that are expected to be equal."""
    values = [inputs.number(each, default=0.0) for each in names]
    if max(values) > min(values):
        inputs.warn(names[0], f"differs from those of the other doors: {np.mean(values):.4g} is used for all")
    return float(np.mean(values))


def _arnold_doors(inputs: Inputs, light: Light) -> Light:
    """Read Arnold's barn doors: each door's edge is at two places of the cone's square, from its left and its top."""

    def place(side: str, ends: str, default: float) -> float:
        values = [inputs.number(f"barndoor_{side}_{end}", default=default) for end in ends.split()]
        if values[0] != values[1]:
            text = f"is {values[0]:g} and at the other end {values[1]:g}: doors are straight, at the mean"
            inputs.warn(f"barndoor_{side}_{ends.split()[0]}", text)
        return 0.5 * sum(values)

    left, right = place("left", "top bottom", 0.0), place("right", "top bottom", 1.0)
    top, bottom = place("top", "left right", 0.0), place("bottom", "left right", 1.0)
    edge = _one(inputs, [f"barndoor_{side}_edge" for side in ("left", "right", "top", "bottom")])
    return _doors(inputs, light, np.array([left, right, 1 - bottom, 1 - top]), edge)


def _karma_doors(inputs: Inputs, light: Light) -> Light:
    """Read Karma's barn doors, each of which covers a fraction of the cone from its side."""
    left, right, bottom, top = (inputs.number(each, default=0.0) for each in ("left", "right", "bottom", "top"))
    edge = _one(inputs, [f"{each}edge" for each in ("left", "right", "bottom", "top")])
    light = _doors(inputs, light, np.array([left, 1 - right, bottom, 1 - top]), edge, inputs.flag("invert"))
    return _scaled(inputs, light, inputs.gain)


# -- Ramps ------------------------------------------------------------------------------------------------------------


def _ramp(inputs: Inputs, light: Light, knots: Array, colors: Array, steps: Any = "linear") -> Light:
    """Return a light with a ramp; `steps` is the interpolation of all knots, or that of each."""
    if isinstance(light, DistantLight | DomeLight):
        inputs.reading.warn(inputs.prim, f"is not rendered on {light.name}, which is infinitely far away")
        return light
    order = np.argsort(knots, kind="stable")
    knots, colors = knots[order], colors[order]
    kinds = np.resize(np.array(steps if isinstance(steps, str) else list(steps), dtype=object), len(knots))
    places, values = [knots[:1]], [colors[:1]]
    for number, kind in enumerate(kinds[:-1]):
        part = np.array([1.0])
        if str(kind) in ("none", "constant", "0"):
            part, eased = np.array([1.0, 1.0]), np.array([0.0, 1.0])
        elif str(kind) in ("linear", "1"):
            eased = part
        else:
            part = np.arange(1, _PIECES + 1) / _PIECES
            eased = part * part * (3 - 2 * part)
        places.append(knots[number] + part * (knots[number + 1] - knots[number]))
        values.append(colors[number] + eased[:, None] * (colors[number + 1] - colors[number]))
    name = inputs.path
    return _added(light, DistanceRamp(name, np.concatenate(places), np.maximum(np.concatenate(values), 0)))


def _own_ramp(inputs: Inputs, light: Light) -> Light:
    known = definitions(RAMP)
    distances, colors, interpolation = (
        known[PREFIX + each].read(inputs.reading, inputs.shader) for each in ("distances", "colors", "interpolation")
    )
    if len(distances) != len(colors) or not distances:
        text = f"has {len(colors)} colours: expected one for each of {len(distances)} distances"
        raise inputs.reading.fail(inputs.shader, f"{PREFIX}colors", text)
    return _ramp(inputs, light, np.array(distances, dtype=np.float64), np.array(colors), interpolation)


def _color_ramp(inputs: Inputs, light: Light) -> Light:
    """Read PxrRamp and MoonRay's ColorRamp."""
    mode = inputs.token("rampMode", "mode", default="distanceToLight")
    if mode not in ("distanceToLight", 0) or inputs.flag("use_xform"):
        text = f"has the mode {mode}, which is not rendered: expected the distance to the light; it is left out"
        inputs.reading.warn(inputs.prim, text)
        return light
    begin = inputs.number("beginDist", "beginDistance", "begin_distance", default=0.0)
    end = inputs.number("endDist", "endDistance", "end_distance", default=1.0)
    knots = inputs.array("colorRamp_Knots", "colorRamp:knots", "distances")
    colors = inputs.array("colorRamp_Colors", "colorRamp:colors", "colors", columns=3)
    knots = np.array([[0.0], [1.0]]) if knots is None else knots
    colors = np.array([[1.0] * 3, [0.0] * 3]) if colors is None else colors
    steps = inputs.token("colorRamp_Interpolation", "colorRamp:interpolation", "interpolation_types", default="linear")
    if len(knots) == len(colors) + 4 or len(knots) == len(colors) + 2:  # RenderMan repeats the ends of its ramps
        knots = knots[(len(knots) - len(colors)) // 2 :][: len(colors)]
    if len(knots) != len(colors):
        raise inputs.fail("colors", f"has {len(colors)} colours: expected {len(knots)}, one for each knot")
    colors = 1 + _density(inputs) * (colors * inputs.number("intensity", default=1.0) - 1)
    return _ramp(inputs, light, begin + (end - begin) * knots[:, 0], colors, steps)


def _decay(inputs: Inputs, light: Light) -> Light:
    """Read Arnold's light_decay and MoonRay's Decay: light fades in near the lamp, and out far from it."""
    knots: list[float] = []
    if inputs.flag("use_near_atten") or inputs.flag("falloff_near"):
        knots += [inputs.number("near_start", default=0.0), inputs.number("near_end", default=0.0)]
    near = len(knots)
    if inputs.flag("use_far_atten") or inputs.flag("falloff_far"):
        knots += [inputs.number("far_start", default=0.0), inputs.number("far_end", default=0.0)]
    if not knots:
        return light
    factors = ([0.0, 1.0] if near else []) + ([1.0, 0.0] if len(knots) > near else [])
    return _ramp(inputs, light, np.maximum.accumulate(knots), np.repeat(np.array(factors)[:, None], 3, axis=1))


def _intensity(inputs: Inputs, light: Light) -> Light:
    """Read filters that change all of a light: PxrIntMult, MoonRay's Intensity, Karma's gel."""
    return _scaled(inputs, light, inputs.gain * np.array(inputs.color("color", default=(1, 1, 1))))


# -- Images -----------------------------------------------------------------------------------------------------------


def _gobo(inputs: Inputs, light: Light) -> Light:
    """Read an image before the light, which becomes its gobo: Arnold's and Karma's gobo, PxrGobo."""
    if light.gobo is not None:
        inputs.reading.warn(inputs.prim, f"is not rendered: {light.name} has another gobo")
        return light
    for prim in (inputs.shader, *_sources(inputs.shader)):
        for attribute in prim.GetAuthoredAttributes():
            if isinstance(inputs.reading.value(prim, attribute.GetName()), Sdf.AssetPath):
                inputs.used.add(attribute.GetName().rsplit(":", 1)[-1])
                image = read_image(inputs.reading, prim, attribute.GetName())
                return light if image is None else replace(light, gobo=Gobo(image))
    inputs.reading.warn(inputs.prim, f"names no image: {light.name} shines without it")
    return light


def _sources(prim: Usd.Prim) -> list[Usd.Prim]:
    """Return the shaders that are connected to a shader's inputs."""
    inputs = UsdShade.ConnectableAPI(prim).GetInputs()
    return [source.source.GetPrim() for each in inputs for source in each.GetConnectedSources()[0]]


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
    "gobo": _gobo,
    "kmalfiltergobo": _gobo,
    "pxrgobolightfilter": _gobo,
}
