"""Looks as prims of the type `PhotonBeamsLook`: what differs from the schema's defaults, ramps and sampled curves."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..looks import ATTRIBUTES, FACTORS, INTERPOLATIONS, curve_of, property_of, ramp_of
from .images import Images
from .prims import Prim, Told, Values

_PREFIX = "photonbeams:"
# Steps of curves and of ramps that Blender alone interpolates; 96 is divisible by most numbers of equal steps.
_STEPS = np.linspace(0.0, 1.0, 97)


def look_prim(tree: Any, path: str, images: Images, told: Told) -> Prim:
    """Return the prim of a look."""
    own, values = tree.photonbeams, Values()
    for attribute, known in ATTRIBUTES.items():
        name = property_of(attribute)
        if not own.is_property_set(name):
            continue
        value = getattr(own, name)
        if value is None:
            continue
        if known["kind"] == "asset":
            value = images.file_of(value)
        elif known["kind"] in ("numbers", "color"):
            value = _array(value) if known["length"] is None else list(value)
        values[_PREFIX + attribute] = value
    if own.across_profile == "tabulated":
        curve = _curve(tree, "across", told)
        if curve is None:
            values.pop(f"{_PREFIX}across:profile")
        else:
            values[f"{_PREFIX}across:values"] = curve[1]
    for factor in FACTORS:
        values |= _ramp(tree, factor, told)
    return Prim(path, "PhotonBeamsLook", values)


def _ramp(tree: Any, factor: str, told: Told) -> Values:
    """Return the attributes of the product of a factor's colour ramp and curve; none if it has neither."""
    own, node = tree.photonbeams, None
    if getattr(own, f"{factor}_use_ramp") and (node := ramp_of(tree, factor)) is None:
        told(f"Look {tree.name}: the colour ramp {factor} the beam is missing: expected the node {factor} ramp")
    curve: Any = _curve(tree, factor, told) if getattr(own, f"{factor}_use_curve", False) else None
    interpolation = "linear"
    if node is None and curve is None:
        return {}
    if node is None:
        knots, colors = curve
    elif curve is None:
        interpolation, knots, colors = _colors(node.color_ramp)
    else:
        knots = _STEPS
        colors = _evaluated(node.color_ramp) * curve[1][:, None]
    colors = np.broadcast_to(colors.reshape(len(knots), -1), (len(knots), 3))
    return {
        f"{_PREFIX}{factor}:ramp:knots": _array(knots),
        f"{_PREFIX}{factor}:ramp:colors": _array(np.maximum(colors, 0.0)),
        f"{_PREFIX}{factor}:ramp:interpolation": interpolation,
    }


def _colors(ramp: Any) -> tuple[str, Any, Any]:
    """Return the interpolation, the ascending positions (N,) and the colours (N, 3) of a colour ramp."""
    elements = list(ramp.elements)
    ours = INTERPOLATIONS.get(ramp.interpolation)
    if ramp.color_mode != "RGB" or (ours is None and len(elements) > 1):
        return "linear", _STEPS, _evaluated(ramp)
    # Positions ascend in Blender; of several elements at one place, each is a little beyond the one before.
    knots = np.array([each.position for each in elements], np.float64)
    for k in range(1, len(knots)):
        knots[k] = max(knots[k], np.nextafter(np.float32(knots[k - 1]), np.float32(2)))
    return ours or "linear", knots, np.array([each.color[:3] for each in elements])


def _evaluated(ramp: Any) -> Any:
    return np.array([ramp.evaluate(x)[:3] for x in _STEPS])


def _curve(tree: Any, factor: str, told: Told) -> Any:
    """Return the positions and the values of a curve, from 0 to 1; None, which is told, if it cannot be used."""
    node = curve_of(tree, factor)
    if node is None:
        told(f"Look {tree.name}: the curve {factor} the beam is missing: expected the node {factor} curve")
        return None
    mapping = node.mapping
    mapping.initialize()
    points = mapping.curves[0].points
    if all(each.handle_type == "VECTOR" for each in points):  # straight: Blender's table would round its corners
        values = np.interp(_STEPS, *np.array([each.location[:] for each in points]).T)
    else:
        values = np.array([mapping.evaluate(mapping.curves[0], x) for x in _STEPS])
    if not np.any(values > 0):
        told(f"Look {tree.name}: the curve {factor} the beam is nowhere above 0: it is not used")
        return None
    return _STEPS, _array(np.maximum(values, 0.0))


def _array(values: Any) -> Any:
    return np.array(values, np.float32)
