"""Lights of a stage as Mitsuba's emitters.

Lights of a stage cast no shadows. Emitters with an extent are shapes, so they get a BSDF that lets all light through.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from .. import scene
from ..numerics.arrays import to_vectors
from ..world.emitters.build import lamp_of
from ..world.emitters.gobos import projected
from ..world.emitters.lamp import unit
from ..world.surfaces.shapes import radiance_of
from .scene import Twin, matrix, mi, ply, rgb, scaled

if TYPE_CHECKING:
    from .scene import TwinMedia

# Widest cone, in degrees from the axis, of a spot whose light is an image; and the image's width in pixels.
_WIDEST, _PIXELS = 75.0, 512

_NO_IMAGE = "{}.photonbeams:gobo is left out: Mitsuba has images only on rectangles and before spots"

# Fraction of the scene's radius. A larger lamp is visibly a light without a body in Mitsuba, so a warning says so.
_LARGE = 0.1


def add_lights(twin: Twin, lights: Sequence[scene.Light], exposure: float, radius: float, media: TwinMedia) -> None:
    """Add lights, brighter by the factor `exposure`; `radius` is the scene's."""
    domes = []
    for light in lights:
        if max(light.radiance) <= 0:
            continue
        light = replace(light, radiance=scaled(light.radiance, exposure))
        _warn(twin, light, media.endless)
        if isinstance(light, scene.DomeLight):
            domes.append(light)
            continue
        if isinstance(light, scene.MeshLight) and light.surface:
            twin.lost.append(f"{light.name} is left out: in Mitsuba its light is what its material emits")
            continue
        name = twin.id_of(light.name)
        if getattr(light, "shape", None) is not None:
            twin.lost.append(f"{light.name} is stretched: in Mitsuba it is a round light of the same power")
        size, part = _EMITTERS[type(light)](twin, light, name)
        twin.parts[f"{name}-shape" if size > 0 else name] = part
        if size > _LARGE * radius:
            twin.lost.append(f"{light.name}: what is behind the lamp is seen through it, because it casts no shadow")
        if size == 0 and not isinstance(light, scene.DistantLight):
            part |= media.named("medium", media.at(_place(light)))
    _add_domes(twin, domes)


def _sphere(twin: Twin, light: scene.SphereLight, name: str) -> tuple[float, dict[str, Any]]:
    """Return the size of a sphere or a point, and its description."""
    cone = _cone(light)
    if light.gobo is not None:
        cone = min(cone, float(np.degrees(light.spread)))
    if light.radius == 0:
        return 0.0, _point(twin, light, cone, name)
    spot = _as_spot(twin, light, cone, name)
    if spot is not None:
        return 0.0, spot
    if light.gobo is not None:
        twin.lost.append(_NO_IMAGE.format(light.name))
    ball = {"type": "sphere", "center": _place(light).tolist(), "radius": light.radius}
    return light.radius, {**ball, **_shining(rgb(light.radiance), name)}


def _face(twin: Twin, light: scene.FlatLight, name: str) -> tuple[float, dict[str, Any]]:
    """Return the size of a rectangle or an ellipse, and its description."""
    spot = _as_spot(twin, light, _cone(light), name)
    if spot is not None:
        return 0.0, spot
    size = float(max(np.linalg.norm(light.half_x), np.linalg.norm(light.half_y)))
    return size, {**_flat(twin, light), **_shining(_face_radiance(twin, light, name), name)}


def _as_spot(
    twin: Twin, light: scene.SphereLight | scene.FlatLight, cone: float, name: str
) -> dict[str, Any] | None:  # fmt: skip
    """Describe a light with an extent as a point if it has a narrow cone; else return None, and warn of its shaping."""
    if cone <= _WIDEST:
        twin.lost.append(
            f"{light.name} shines from a point: Mitsuba has no cone for an emitter with an extent, and its cone is kept"
        )
        return _spot(twin, light, cone, name)
    _warn_of_shaping(twin, light, 90.0 if isinstance(light, scene.FlatLight) else 180.0)
    return None


def _warn_of_shaping(twin: Twin, light: scene.Light, widest: float = 180.0) -> None:
    """Warn about a cone below `widest` degrees or a focus, which Mitsuba has only for points."""
    if _varies(light) or _cone(light) < widest:
        twin.lost.append(f"{light.name}.inputs:shaping is left out: Mitsuba has none for an emitter with an extent")


def _tube(twin: Twin, light: scene.CylinderLight, name: str) -> tuple[float, dict[str, Any]]:
    """Return the size of a cylinder, and its description."""
    _warn_of_shaping(twin, light)
    ends = {key: (light.center + sign * light.half).tolist() for key, sign in (("p0", -1), ("p1", 1))}
    tube = {"type": "cylinder", **ends, "radius": light.radius}
    return light.radius + float(np.linalg.norm(light.half)), {**tube, **_shining(rgb(light.radiance), name)}


def _mesh(twin: Twin, light: scene.MeshLight, name: str) -> tuple[float, dict[str, Any]]:
    """Return the size of a mesh light, and its description."""
    _warn_of_shaping(twin, light)
    assert light.mesh is not None
    size = 0.5 * float(np.linalg.norm(np.ptp(light.mesh.used_points, axis=0)))
    radiance = twin.with_images(radiance_of(light.radiance, light.image), f"{name}-radiance")
    return size, {**ply(twin, light.mesh, name), **_shining(radiance, name)}


def _shining(radiance: dict[str, Any], name: str) -> dict[str, Any]:
    """Return the emitter that makes a shape a lamp, and the BSDF that lets the light of others through."""
    return {name: {"type": "area", "radiance": radiance}, "bsdf": {"type": "null"}}


def _place(light: Any) -> np.ndarray:
    return np.asarray(light.center, dtype=np.float64)


def _flat(twin: Twin, light: scene.FlatLight) -> dict[str, Any]:
    """Describe a rectangle or an ellipse; in Mitsuba its front is along +Z."""
    to_world = np.eye(4)
    axis = unit(light.axis)
    x, y = np.asarray(light.half_x, dtype=np.float64), np.asarray(light.half_y, dtype=np.float64)
    turn = np.sign(np.cross(x, y) @ axis) or 1.0
    if abs(x @ y) > 1e-6 * np.linalg.norm(x) * np.linalg.norm(y):
        x, y = _squared(x, y) if light.disk else (x, y - (y @ x) / (x @ x) * x)
        if not light.disk:
            twin.lost.append(f"{light.name} is sheared: in Mitsuba it is a rectangle of the same area")
    to_world[:3] = np.column_stack([turn * x, y, axis, _place(light)])
    return {"type": "disk" if light.disk else "rectangle", "to_world": matrix(to_world)}


def _squared(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return perpendicular half axes of the same ellipse, with the handedness of `x` and `y`."""
    axes, lengths, turned = np.linalg.svd(np.column_stack([x, y]), full_matrices=False)
    first, second = (axes * lengths).T
    return first, second * np.sign(np.linalg.det(turned))


def _point(twin: Twin, light: scene.SphereLight, cone: float, name: str) -> dict[str, Any]:
    """Describe a point."""
    if cone > _WIDEST and (_varies(light) or light.gobo is not None):
        twin.lost.append(
            f"{light.name}.inputs:shaping is a hard cone: beyond {_WIDEST:g} degrees, there is no soft one and no image"
        )
    if cone <= _WIDEST or cone < 180:
        return _spot(twin, light, cone, name)
    return {"type": "point", "position": _place(light).tolist(), "intensity": rgb(light.radiance)}


def _spot(twin: Twin, light: scene.SphereLight | scene.FlatLight, cone: float, name: str) -> dict[str, Any]:
    """Describe a point that shines into a cone; if its light varies over directions, an image before it says how."""
    flat = isinstance(light, scene.FlatLight)
    to_world = _aimed(light)
    part = {"type": "spot", "to_world": matrix(to_world), "cutoff_angle": cone, "beam_width": cone}
    area = light.area if isinstance(light, scene.FlatLight) else np.pi * light.radius**2 or 1.0
    if cone > _WIDEST or not (_varies(light) or light.gobo is not None or flat):
        return part | {"intensity": rgb([area * each for each in light.radiance])}
    peak = area * max(light.radiance)
    image = mi.Bitmap(np.ascontiguousarray(area / peak * _image(light, cone, to_world), dtype=np.float32))
    return part | {
        "intensity": rgb([peak] * 3),
        **twin.with_images({"texture": {"type": "bitmap", "bitmap": image, "raw": True}}, name),
    }


def _image(light: scene.SphereLight | scene.FlatLight, cone: float, to_world: np.ndarray) -> np.ndarray:
    """Return the radiance of a light (of a point: the intensity) within a cone, projected on a square around it."""
    across = np.linspace(-1, 1, _PIXELS, endpoint=False) + 1 / _PIXELS
    x, y = np.meshgrid(across, across)
    inner = np.tan(np.radians(cone)) / np.maximum(1.001 * np.hypot(x, y), 1)  # no hard edge on the image itself
    local = np.stack([x * inner, y * inner, np.ones_like(x)], axis=-1).reshape(-1, 3)
    local /= np.linalg.norm(local, axis=-1, keepdims=True)
    direction = to_vectors(local @ to_world[:3, :3].T)
    bare: Any = lamp_of(light)
    value = bare.emitted(direction)
    if isinstance(light, scene.FlatLight):
        value *= dr.dot(direction, bare.axis)
    elif light.gobo is not None:
        value *= projected(bare, light, None, {}).tint(to_vectors(_place(light)[None]), direction)
    return np.array(value).T.reshape(_PIXELS, _PIXELS, 3)


def _face_radiance(twin: Twin, light: scene.FlatLight, name: str) -> dict[str, Any]:
    """Describe the radiance of a rectangle or an ellipse; only on a rectangle can it be an image."""
    if light.gobo is None:
        return rgb(light.radiance)
    if light.disk:
        twin.lost.append(_NO_IMAGE.format(light.name))
        return rgb(light.radiance)
    rows, columns = light.gobo.image.shape[:2]
    u, v = np.meshgrid((np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5) / rows)
    to_world = np.array(_flat(twin, light)["to_world"].matrix, dtype=np.float64)
    local = np.stack([2 * u - 1, 2 * v - 1, 0 * u, 1 + 0 * u], axis=-1).reshape(-1, 4)
    places = to_vectors((local @ to_world.T)[:, :3])
    color = projected(lamp_of(light), light, None, {}).tint(places, to_vectors(unit(light.axis)[None]))
    pixels = np.array(color).T.reshape(rows, columns, 3) * np.array(light.radiance)
    image = mi.Bitmap(np.ascontiguousarray(pixels, dtype=np.float32))
    radiance = {"type": "bitmap", "bitmap": image, "raw": True, "wrap_mode": "clamp"}
    return twin.with_images(radiance, f"{name}-radiance")


def _aimed(light: scene.SphereLight | scene.FlatLight) -> np.ndarray:
    """Return the (4, 4) transform of a light, with +Z along its axis."""
    axis = unit(light.axis)
    side = unit(np.cross(np.eye(3)[int(np.argmin(np.abs(axis)))], axis))
    result = np.eye(4)
    result[:3] = np.column_stack([side, np.cross(axis, side), axis, _place(light)])
    return result


def _cone(light: scene.Light) -> float:
    """Return the angle of a light's cone from its axis, in degrees."""
    return 180.0 if light.shaping is None else light.shaping.cone_angle


def _varies(light: scene.Light) -> bool:
    """Return whether a light varies within its cone."""
    return light.shaping is not None and (light.shaping.cone_softness > 0 or light.shaping.focus > 0)


def _directional(twin: Twin, light: scene.DistantLight, name: str) -> tuple[float, dict[str, Any]]:
    """Return the size of a distant light, 0, and its description by the irradiance on a plane that faces it."""
    irradiance = np.array(light.radiance)
    if light.angle > 0:
        half = np.radians(min(light.angle / 2, 90.0))
        irradiance = irradiance * np.pi * np.sin(half) ** 2
        twin.lost.append(
            f"{light.name}.inputs:angle is left out: Mitsuba's directional light is invisible and casts sharp shadows"
        )
    return 0.0, {"type": "directional", "direction": unit(light.axis).tolist(), "irradiance": rgb(irradiance)}


#: The size and the description of a light, by its class; domes are added together.
_EMITTERS: dict[type, Callable[..., tuple[float, dict[str, Any]]]] = {
    scene.SphereLight: _sphere,
    scene.FlatLight: _face,
    scene.CylinderLight: _tube,
    scene.MeshLight: _mesh,
    scene.DistantLight: _directional,
}


def _add_domes(twin: Twin, domes: Sequence[scene.DomeLight]) -> None:
    """Add the environment; Mitsuba allows only one."""
    if domes and all(dome.image is None for dome in domes):
        total = np.sum([dome.radiance for dome in domes], axis=0)
        twin.parts[twin.id_of(domes[0].name)] = {"type": "constant", "radiance": rgb(total)}
        return
    for number, dome in enumerate(domes):
        if number:
            twin.lost.append(f"{dome.name} is left out: Mitsuba has a single environment, which is {domes[0].name}")
            continue
        name = twin.id_of(dome.name)
        twin.parts[name] = environment(twin, dome, name)


def environment(twin: Twin, dome: scene.DomeLight, name: str) -> dict[str, Any]:
    """Describe an environment."""
    if dome.image is None:
        return {"type": "constant", "radiance": rgb(dome.radiance)}
    to_world = np.eye(4)
    to_world[:3, :3] = dome.to_world
    pixels = np.ascontiguousarray(np.asarray(dome.image)[..., :3] * np.array(dome.radiance), dtype=np.float32)
    return twin.with_images({"type": "envmap", "bitmap": mi.Bitmap(pixels), "to_world": matrix(to_world)}, name)


def _warn(twin: Twin, light: scene.Light, endless: bool) -> None:
    """Warn about attributes of a light that Mitsuba cannot describe."""
    own = "photonbeams:"
    off = not (light.emits_beams or (isinstance(light, scene.DomeLight) and light.lights_media))
    lost = {
        "inputs:shaping:ies:file is left out: Mitsuba has no light profiles": light.profile is not None,
        f"{own}portal is left out: photon_beams itself finds where light comes in": light.portal is not None,
        f"{own}portal:gobo is left out: Mitsuba's emitters shine through no image": light.portal_gobo is not None,
        "light:filters is left out: Mitsuba has no light filters": any(each.in_media for each in light.filters),
        f"{own}look is left out: beams are physical in Mitsuba": light.look is not None,
        f"{own}lightGroup is left out: Mitsuba's pictures have no layers for lights": bool(light.group),
        f"{own}guides is left out: light travels straight in Mitsuba": bool(light.guides),
        f"{own}intensity is left out: it changes beams alone": light.emits_beams and light.beam_scale != 1,
        f"{own}enabled is off, but in Mitsuba its light is scattered by fog": off,
        f"inputs:diffuse is {light.surface_scale:g}, but in Mitsuba it is 1": light.surface_scale != 1,
        "inputs:shadow:distance is left out: Mitsuba's shadows have no end": light.shadow_distance < np.inf,
        "collection:lightLink is left out: in Mitsuba the light shines on everything": any(
            (light.unlit, light.unlit_media)
        ),
        "collection:shadowLink is left out: in Mitsuba all surfaces block the light": bool(light.unshadowed),
    }  # fmt: skip
    if isinstance(light, scene.DistantLight) and light.gobo is not None:
        lost[f"{own}gobo is left out: Mitsuba's directional light shines through no image"] = True
    if endless and isinstance(light, scene.DistantLight | scene.DomeLight):
        lost["inputs:intensity is dimmed in Mitsuba by fog that fills the whole space: expected fog in a mesh"] = True
    twin.lost += [f"{light.name}.{text}" for text, there in lost.items() if there]
