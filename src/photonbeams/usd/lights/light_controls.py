"""Read the controls that UsdLux has for all lights: shaping, and light and shadows on surfaces."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...scene import Shaping
from ..common.openusd import Usd, UsdLux
from ..common.reading import INPUTS, Reading
from ..common.visibility import is_seen
from .ies import read_profile


def read_shaping(reading: Reading, prim: Usd.Prim) -> Shaping | None:
    """Return a light's cone, focus and profile; None without ShapingAPI and without any of its attributes.

    The API alone is a cone of 90 degrees, the schema's fallback, as in hdEmbree.
    """
    names = (name.removeprefix(INPUTS) for name in prim.GetAuthoredPropertyNames())
    if not (any(name.startswith("shaping:") for name in names) or prim.HasAPI(UsdLux.ShapingAPI)):
        return None
    result = Shaping(
        cone_angle=reading.number(prim, "inputs:shaping:cone:angle", 90.0, minimum=0.0),
        # hdEmbree turns a cone of negative softness inside out; the schema's text clamps it.
        cone_softness=reading.clipped(prim, "inputs:shaping:cone:softness", 0.0, minimum=0.0),
        focus=reading.clipped(prim, "inputs:shaping:focus", 0.0, minimum=0.0),
        focus_tint=reading.color(prim, "inputs:shaping:focusTint", (0, 0, 0)),
        profile=read_profile(reading, prim),
    )
    if not prim.IsA(UsdLux.NonboundableLightBase):
        return result
    if result.cone_angle < 90 or result.focus > 0 or result.profile is not None:
        reading.warn(prim, "has shaping, which is not rendered on a light that is infinitely far away")
    return None


def on_surfaces(reading: Reading, prim: Usd.Prim, beams: bool) -> dict[str, Any]:
    """Return a light's intensity and shadows on surfaces, as fields; `beams` is whether it makes beams."""
    diffuse, specular = (reading.number(prim, f"inputs:{key}", 1.0, minimum=0.0) for key in ("diffuse", "specular"))
    if diffuse != specular:
        text = f"is {specular:g} but inputs:diffuse is {diffuse:g}: surfaces use the latter for both"
        reading.warn(prim, text, "inputs:specular")
    distance = reading.number(prim, "inputs:shadow:distance", -1.0)
    color = reading.color(prim, "inputs:shadow:color", (0, 0, 0))
    for name, given in (("distance", distance > 0), ("color", max(color) > 0)):
        if given and beams:
            text = "applies to shadows on surfaces only: beams end where a surface stops them"
            reading.warn(prim, text, f"inputs:shadow:{name}")
    return {
        "surface_scale": diffuse,
        "shadow_distance": distance if distance > 0 else np.inf,
        "shadow_color": color,
        "seen": is_seen(reading, prim),
    }


def warn_of_names_and_gaps(reading: Reading, prim: Usd.Prim) -> None:
    """Warn about a light's attributes with old names, which are read, and about those that are not rendered."""
    names = (each.GetName() for each in prim.GetAuthoredAttributes())
    old = [name for name in names if (read := reading.attribute(prim, INPUTS + name)) and read.GetName() == name]
    if old:
        text = f"has {', '.join(old)} without {INPUTS}, as before OpenUSD 21.02"
        reading.warn(prim, f"{text}: read as {INPUTS}{old[0]}{', and so on' if len(old) > 1 else ''}")
    if reading.number(prim, "inputs:shadow:falloff", -1.0) > 0:
        reading.warn(prim, "is not rendered: shadows have the same strength everywhere", "inputs:shadow:falloff")
