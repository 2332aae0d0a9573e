"""Read UsdLux lights: radiance, size and place, and the settings of `PhotonBeamsLightAPI` for their beams.

The formulas are those of UsdLuxLightAPI's documentation: radiance = intensity · 2^exposure · color · temperature,
divided by the light's size in world space where `normalize` is on. Blender's power needs no factor, in metres: a point,
spot or area light of W watts is exported with intensity W/π and normalize on, so that an emitter of area A has radiance
W/(π A) and flux W. A sphere has the radiant intensity W/(4π), also as its radius goes to 0.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ...images.color_spaces import REC709
from ...scene import (
    Array,
    CylinderLight,
    DistantLight,
    DomeLight,
    FlatLight,
    Light,
    Mesh,
    MeshLight,
    SphereLight,
    rgb,
)
from ...scene.vectors import ellipse_perimeter, ellipsoid_area, unit
from ..common import blender
from ..common.color_spaces import to_working
from ..common.openusd import Usd, UsdGeom, UsdLux
from ..common.reading import Reading
from ..common.textures import read_image
from ..geometry.meshes import is_gprim
from .beam_settings import read_beam_settings, read_portal
from .filters import filtered
from .gobos import read_texture
from .light_controls import on_surfaces, read_shaping, warn_of_names_and_gaps
from .mesh_lights import is_asked, read_glow

# UsdLux normalizes its black body to luminance, but documents 6500 K as white. Without a division by its colour at
# 6500 K, every light from Blender, which writes 6500 K on all of them, would be slightly magenta.
_WHITE_KELVIN = 6500.0
_COLDEST, _HOTTEST = 1e3, 1e4  # kelvin: the range of UsdLux, beyond which it takes the ends' colours
# A normalized sphere of a smaller radius is treated as a point, because its radiance would exceed single precision.
_POINT = 1e-12
# Lengths that differ by less than this fraction are equal: transforms are often products of rounded matrices.
_UNEVEN = 1e-4
_NO_AREA = "is 0: without inputs:normalize there would be no light; it shines as if that were on"
_FLATTEST = 1e3  # largest ratio of a stretched light's widths: single precision cannot resolve much more
# A line is rendered as a cylinder of this radius per length; its light is that of the limit to one part in 10^4.
_LINE = 1e-4


def is_light(prim: Usd.Prim) -> bool:
    """Return whether a prim is a light, supported or not."""
    return bool(prim.HasAPI(UsdLux.LightAPI)) or is_asked(prim) or _is_foreign(prim)


def is_dome(prim: Usd.Prim) -> bool:
    """Return whether a light is a dome light, of either version of the schema."""
    return str(prim.GetTypeName()) in _DOMES


def _is_foreign(prim: Usd.Prim) -> bool:
    """Return whether a prim has a type that is not installed here and whose name ends in Light."""
    return prim.GetTypeName().endswith("Light") and not prim.GetPrimTypeInfo().GetSchemaType()


def read_light(
    reading: Reading, prim: Usd.Prim, to_world: Array, name: str, meshes: Sequence[Mesh] = ()
) -> Light | None:
    """Return a light, or None, with a warning, if its kind or its size cannot be rendered.

    `meshes` are the surfaces of a gprim that is a mesh light.
    """
    kind = str(prim.GetTypeName())
    if not (kind in _READERS or is_gprim(prim)):
        why = _UNRENDERED.get(kind, f"is a light of kind {kind}, which is not rendered: it is skipped")
        reading.warn(prim, why)
        return None
    if kind not in _DOMES and abs(np.linalg.det(to_world[:3, :3])) < 1e-30:
        reading.warn(prim, "is scaled to zero: it is skipped")
        return None
    warn_of_names_and_gaps(reading, prim)
    portal = reading.attempt(prim, partial(read_portal, reading, prim), None, "the light has no portal")
    shared = {"name": name, **read_beam_settings(reading, prim, portal)}
    shared |= {"emits_beams": makes_beams(reading, prim), "shaping": read_shaping(reading, prim)}
    shared |= on_surfaces(reading, prim, shared["emits_beams"])
    shared |= {} if kind in _DOMES else {"axis": unit(to_world[:3, :3] @ [0.0, 0.0, -1.0])}
    if kind in _READERS:
        light: Light | None = _READERS[kind](reading, prim, to_world, shared)
    else:
        light = _mesh(reading, prim, meshes, shared)
    if light is None:
        return None
    return filtered(reading, prim, replace(light, frame=_frame(to_world, getattr(light, "axis", None))))


def makes_beams(reading: Reading, prim: Usd.Prim) -> bool:
    """Return whether a light's own settings let it make beams: its kind can, and it is switched on.

    A dome light is off unless it is switched on: fog lit from everywhere is haze without shafts, and costs the most
    beams.
    """
    kind = str(prim.GetTypeName())
    authored = prim.GetAttribute("photonbeams:enabled").HasAuthoredValue()
    can = (kind in _READERS or is_gprim(prim)) and (kind not in _DOMES or authored)
    return can and reading.flag(prim, "photonbeams:enabled", True)


def is_sky(prim: Usd.Prim) -> bool:
    """Return whether a light is a dome that does not set whether it makes beams; it then lights fog without."""
    return is_dome(prim) and not prim.GetAttribute("photonbeams:enabled").HasAuthoredValue()


def _value(reading: Reading, prim: Usd.Prim) -> Any:
    """Return intensity · 2^exposure · color · temperature, (3,)."""
    intensity = reading.number(prim, "inputs:intensity", 1.0, minimum=0.0)
    if _normalized(reading, prim) and not prim.IsA(UsdLux.NonboundableLightBase):
        intensity *= blender.unit(reading, prim) ** 2  # whoever sets it, so that an edit does not change its unit
    exposure = reading.number(prim, "inputs:exposure", 0.0, -100.0, 100.0)
    result = intensity * 2.0**exposure * np.asarray(reading.color(prim, "inputs:color", (1, 1, 1)))
    if reading.flag(prim, "inputs:enableColorTemperature", False):
        kelvin = reading.clipped(prim, "inputs:colorTemperature", _WHITE_KELVIN, _COLDEST, _HOTTEST)
        black_body, white = (np.array(UsdLux.BlackbodyTemperatureAsRgb(k)) for k in (kelvin, _WHITE_KELVIN))
        result = result * np.maximum(to_working(black_body / white, REC709, reading.spaces), 0)
    return result


def _normalized(reading: Reading, prim: Usd.Prim) -> bool:
    return reading.flag(prim, "inputs:normalize", False)


def _sphere(reading: Reading, prim: Usd.Prim, to_world: Array, shared: dict[str, Any]) -> Light:
    linear = to_world[:3, :3]
    size = reading.number(prim, "inputs:radius", 0.5, minimum=0.0)
    axes = size * np.linalg.svd(linear, compute_uv=False)
    reading.within_reach(prim, axes)
    uneven = axes[0] > axes[2] * (1 + _UNEVEN)
    radius = float(np.sqrt(ellipsoid_area(axes) / (4 * np.pi))) if uneven else size * _mean_scale(linear)
    area = 4 * np.pi * radius**2
    normalized = _normalized(reading, prim) or radius == 0
    as_point = reading.flag(prim, "treatAsPoint", False)
    if radius == 0 and not (as_point or _normalized(reading, prim)):
        reading.warn(prim, _NO_AREA, "inputs:radius")
    radiance = _value(reading, prim)
    if as_point or radius == 0 or (normalized and radius < _POINT):
        # A convex body of area A shows A/4 on average, so that a point of its power has the intensity L A/4.
        radiance *= 0.25 if normalized else 0.25 * area
        radius = 0.0
    elif normalized:
        radiance /= area
    shape = size * linear if uneven and radius > 0 else None
    if shape is not None and axes[0] > _FLATTEST * axes[2]:
        text = " x ".join(f"{2 * each:.4g}" for each in axes)
        reading.warn(prim, f"is scaled to {text}: it is rendered as a sphere of the same power, {2 * radius:.4g} wide")
        shape = None
    return SphereLight(**shared, radiance=radiance, center=to_world[:3, 3], radius=radius, shape=shape)


def _mean_scale(linear: Array) -> float:
    """Return the mean length of the columns of a matrix."""
    return float(np.linalg.norm(linear, axis=0).mean())


def _flat(reading: Reading, prim: Usd.Prim, to_world: Array, shared: dict[str, Any]) -> Light:
    disk = prim.GetTypeName() == "DiskLight"
    sides = (("radius", 0.5, 1.0),) * 2 if disk else (("width", 1.0, 0.5), ("height", 1.0, 0.5))
    half = [scale * reading.positive(prim, f"inputs:{key}", default) for key, default, scale in sides]
    if not disk and shared["gobo"] is None:
        shared["gobo"] = reading.attempt(prim, partial(read_texture, reading, prim), None, "the light has one colour")
    linear = to_world[:3, :3]
    half_x, half_y = linear[:, 0] * half[0], linear[:, 1] * half[1]
    reading.within_reach(prim, [half_x, half_y])
    # Normals transform by the inverse transpose, and so stay perpendicular to a sheared light.
    axis = unit(np.linalg.solve(linear.T, [0.0, 0.0, -1.0]))
    if np.cross(half_x, half_y) @ axis > 0:  # mirrored: the rectangle is the same with half_x reversed
        half_x = -half_x
    shared |= {"axis": axis, "radiance": _value(reading, prim)}
    light = FlatLight(**shared, center=to_world[:3, 3], half_x=half_x, half_y=half_y, disk=disk)
    return _of_area(light, light.area) if _normalized(reading, prim) else light


def _of_area(light: Light, area: float) -> Light:
    """Return a light with its power divided by its area."""
    radiance: Any = np.array(light.radiance) / area
    return replace(light, radiance=radiance)


def _cylinder(reading: Reading, prim: Usd.Prim, to_world: Array, shared: dict[str, Any]) -> Light:
    linear = to_world[:3, :3]
    half = 0.5 * reading.positive(prim, "inputs:length", 1.0) * linear[:, 0]
    whole = 2 * float(np.linalg.norm(half))
    size = reading.number(prim, "inputs:radius", 0.5, minimum=0.0)
    columns = linear[:, 1:]
    oblique = float(np.abs(unit(half) @ columns).max()) > _UNEVEN * _mean_scale(columns)
    # What is seen along the axis: a circle, or an ellipse if the cylinder is sheared, or scaled unevenly across.
    ring = columns - np.outer(half, half @ columns) / (half @ half) if oblique else columns
    wide, narrow = size * np.linalg.svd(ring, compute_uv=False)
    uneven = wide > narrow * (1 + _UNEVEN)
    radius = ellipse_perimeter(wide, narrow) / (2 * np.pi) if uneven else size * _mean_scale(ring)
    reading.within_reach(prim, [*half, radius])
    shape = np.column_stack([half, size * columns]) if (uneven or oblique) and radius > _LINE * whole else None
    if shape is not None and wide > _FLATTEST * narrow:
        text = f"is {2 * wide:.4g} x {2 * narrow:.4g} across: it is rendered as a round cylinder of the same power"
        reading.warn(prim, f"{text}, {2 * radius:.4g} wide")
        shape = None
    normalized = _normalized(reading, prim)
    if radius == 0 and not (reading.flag(prim, "treatAsLine", False) or normalized):
        reading.warn(prim, _NO_AREA, "inputs:radius")
    if normalized or radius == 0:
        normalized, radius = True, max(radius, _LINE * whole)
    shared["radiance"] = _value(reading, prim)
    light = CylinderLight(**shared, center=to_world[:3, 3], half=half, radius=radius, shape=shape)
    return _of_area(light, light.area) if normalized else light


def _mesh(reading: Reading, prim: Usd.Prim, meshes: Sequence[Mesh], shared: dict[str, Any]) -> Light | None:
    glow = read_glow(reading, prim, meshes)
    if glow is None:
        return None
    own = prim.HasAPI(UsdLux.LightAPI)
    shared["radiance"] = glow.tint * (_value(reading, prim) if own else 1.0)
    light = MeshLight(**shared, mesh=glow.mesh, image=glow.image, surface=glow.surface, both_sides=glow.both_sides)
    return _of_area(light, glow.mesh.area) if own and _normalized(reading, prim) else light


def _distant(reading: Reading, prim: Usd.Prim, to_world: Array, shared: dict[str, Any]) -> Light:
    angle = reading.clipped(prim, "inputs:angle", 0.53, 0.0, 360.0)
    value = _value(reading, prim)
    if blender.wrote(prim):
        angle, value = blender.sun(angle, value)
    half = np.radians(angle / 2)
    if angle > 0 and _normalized(reading, prim):
        square = np.sin(half) ** 2
        value = value / (np.pi * (square if half <= np.pi / 2 else 2 - square))
    return DistantLight(**shared, radiance=value, angle=angle)


def _dome(reading: Reading, prim: Usd.Prim, to_world: Array, shared: dict[str, Any]) -> Light:
    form = str(reading.value(prim, "inputs:texture:format", "automatic"))
    image = None
    if form in ("automatic", "latlong"):
        read = partial(read_image, reading, prim, "inputs:texture:file")
        image = reading.attempt(prim, read, None, "the light has one colour")
    else:
        reading.warn(prim, f"is '{form}', which is not rendered: the light has one colour", "inputs:texture:format")
    if image is not None:
        image = rgb(image)
    left, _, right = np.linalg.svd(to_world[:3, :3])  # their product is the nearest rotation, perhaps mirrored
    shared |= {"to_world": left @ right @ _pole(reading, prim), "lights_media": is_sky(prim)}
    return DomeLight(**shared, radiance=_value(reading, prim), image=image)


def _pole(reading: Reading, prim: Usd.Prim) -> Array:
    """Return the rotation from the image's pole, +Y, to the pole of the light's kind."""
    # UsdLuxDomeLight_1: with the pole on Z, the image's middle looks along −Y.
    y_to_z = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    if prim.GetTypeName() == "DomeLight_1":
        axis = str(reading.value(prim, "poleAxis", "scene"))
        axis = str(UsdGeom.GetStageUpAxis(reading.stage)) if axis == "scene" else axis
        return y_to_z if axis == "Z" else np.eye(3)
    return blender.world() if blender.lost_world_rotation(prim, reading.time) else np.eye(3)


def _frame(to_world: Array, axis: Array | None) -> Array:
    """Return a light's frame: −Z is `axis`, where it shines (None: local −Z), and +Y is close to the light's +Y."""
    linear = to_world[:3, :3]
    if abs(np.linalg.det(linear)) < 1e-30:  # only for a dome: other lights are skipped
        return np.eye(4)
    back = -unit(linear @ [0.0, 0.0, -1.0] if axis is None else axis)
    up = unit(linear[:, 1] - (linear[:, 1] @ back) * back)
    side = np.cross(up, back) * np.sign(np.linalg.det(linear))
    result = np.eye(4)
    result[:3] = np.column_stack([side, up, back, to_world[:3, 3]])
    return result


_DOMES = ("DomeLight", "DomeLight_1")
_UNRENDERED = {
    "PortalLight": "is skipped: the light of a dome is sampled by its brightness, without portals",
    "PluginLight": "is a light of one renderer only, which is not rendered: it is skipped",
    "GeometryLight": "is deprecated and not rendered: expected MeshLightAPI on the geometry; it is skipped",
    "Volume": "is a volume light (VolumeLightAPI), which is not rendered: it does not shine",
}
_READERS: dict[str, Callable[[Reading, Usd.Prim, Array, dict[str, Any]], Light]] = {
    "SphereLight": _sphere,
    "DiskLight": _flat,
    "RectLight": _flat,
    "CylinderLight": _cylinder,
    "DistantLight": _distant,
    "DomeLight": _dome,
    "DomeLight_1": _dome,
}
