"""The emitters of a Mitsuba scene, with gobos and portals before them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from ... import scene
from ...numerics.arrays import by_number
from ...runtime.device import Array3f, UInt32, mitsuba
from ...scene import SceneError
from ..bounds import Bounds
from ..checks import check_finite
from ..surfaces.shapes import is_null, shape_of
from .emitter import Emitter
from .gobos import Images, projected
from .mitsuba_emitter import MitsubaEmitter, MitsubaSphere
from .portals import Portal

if TYPE_CHECKING:
    from ...runtime.mitsuba_types import EmitterPtr, MiEmitter, MiScene, MiShape

mi = mitsuba()

_SQUARE = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])


def names_of(emitter: MiEmitter) -> list[str]:
    """Return the names by which users may refer to an emitter: its own id, and that of its shape."""
    shape = emitter.get_shape()
    return [each.id() for each in (emitter, shape) if each is not None and each.id()]


def by_emitter(plugin: MiScene, places: Sequence[int], values: Any) -> np.ndarray:
    """Return values of some emitters, given by their places in a scene, as a table by Mitsuba's numbers of them.

    Others have 0 in it.
    """
    known = [int(emitter_number(mi.EmitterPtr(each))[0]) for each in plugin.emitters()]
    every = np.zeros(len(known))
    every[[*places]] = values
    return by_number(known, every)


def emitter_number(emitter: EmitterPtr) -> Any:
    """Return Mitsuba's numbers of emitters."""
    return dr.reinterpret_array(UInt32, emitter)


def emitters_of(plugin: MiScene, beams: Sequence[scene.BeamSettings], bounds: Bounds) -> list[Emitter]:
    """Return the emitters of a scene, in their order.

    Parameters
    ----------
    beams
        The settings of each emitter.
    bounds
        The sphere around the scene.

    Raises
    ------
    SceneError
        A gobo on an emitter that cannot have one; a portal that does not exist, is not flat, or stops light; numbers of
        an emitter that are not finite.
    """
    images: Images = {}
    return [_lamp(plugin, emitter, own, bounds, images) for emitter, own in zip(plugin.emitters(), beams, strict=True)]


def _lamp(plugin: MiScene, emitter: MiEmitter, own: scene.BeamSettings, bounds: Bounds, images: Images) -> Emitter:
    name, lamp = (names_of(emitter) or [emitter.class_name()])[-1], _bare(plugin, emitter)
    own_name = emitter.id() or emitter.class_name()
    check_finite(emitter, f"emitter {own_name}")
    others = own.gobo or own.portal or own.portal_gobo or any(each.in_media for each in own.filters)
    if not others and not (own.filters and lamp.illuminates):  # else, tints act on its photons alone
        return Emitter(own_name, lamp, own)
    if not lamp.illuminates:
        raise SceneError(
            f"emitter {name}: shines along one direction: expected another kind for a gobo, filter or portal"
        )
    mesh, portal = None, None
    if own.portal is not None:
        mesh, shape = _portal(plugin, name, own.portal)
        portal = Portal(mesh, shape, plugin)
        if lamp.infinite and not bounds.contains(mesh.points):
            raise SceneError(f"emitter {name}: its portal {mesh.name} lies outside of the scene: expected one inside")
    elif own.portal_gobo is not None:
        raise SceneError(f"emitter {name}: has a gobo on its portal, but no portal: expected both")
    shared = {"gobo": own.gobo, "portal": mesh, "portal_gobo": own.portal_gobo, "filters": own.filters}
    light = _described(emitter, name, shared)
    if isinstance(light, scene.SphereLight):
        lamp.central, lamp.center = True, Array3f(*(float(each) for each in light.center))
    return Emitter(own_name, projected(lamp, light, portal, images), own, portal)


def _bare(plugin: MiScene, emitter: MiEmitter) -> MitsubaEmitter:
    """Return an emitter without images or a portal."""
    shape = emitter.get_shape()
    sphere = emitter.class_name() == "AreaLight" and shape.class_name() == "Sphere"
    if sphere and not shape.has_flipped_normals():
        light = _described(emitter, "", {"gobo": None})
        assert isinstance(light, scene.SphereLight)
        return MitsubaSphere(emitter, light, plugin)
    return MitsubaEmitter(emitter, plugin)


def _described(emitter: MiEmitter, name: str, shared: dict[str, Any]) -> scene.Light:
    """Return an emitter as a light of a stage, with the properties that place images before it."""
    shape, kind = emitter.get_shape(), emitter.class_name()
    to_world = _matrix(shape if shape is not None else emitter)
    about = {"name": name, "radiance": scene.BLACK, "frame": _frame(to_world), **shared}
    axis = about["frame"][:3, :3] @ [0, 0, -1]
    shape_kind = "" if shape is None else shape.class_name()
    if kind == "PointLight":
        about["frame"][:3, 3] = np.ravel(mi.traverse(emitter)["position"])
    if kind in ("PointLight", "SpotLight"):
        cone = float(np.ravel(mi.traverse(emitter)["cutoff_angle"])[0]) if kind == "SpotLight" else 180.0
        return scene.SphereLight(**about, center=about["frame"][:3, 3], axis=axis, shaping=scene.Shaping(cone))
    if kind == "AreaLight" and shape_kind == "Sphere":
        radius = float(np.cbrt(abs(np.linalg.det(to_world[:3, :3]))))
        return scene.SphereLight(**about, center=to_world[:3, 3], radius=radius, axis=axis)
    if kind == "AreaLight" and shape_kind in ("Rectangle", "Disk"):
        half_x, half_y, center = to_world[:3, 0], to_world[:3, 1], to_world[:3, 3]
        disk = shape_kind == "Disk"
        return scene.FlatLight(**about, center=center, half_x=half_x, half_y=half_y, axis=axis, disk=disk)
    if kind == "DirectionalEmitter":
        return scene.DistantLight(**about, axis=axis, angle=0.0)
    if shared["gobo"] is not None:
        expected = "a point, spot or directional emitter, or a rectangle, disk or sphere that shines"
        raise SceneError(f"emitter {name} is of type {kind}, which cannot have a gobo: expected {expected}")
    return scene.Light(**about)


def _matrix(part: MiEmitter | MiShape) -> np.ndarray:
    """Return the (4, 4) transform of an emitter or a shape, the identity where it has none."""
    parameters = mi.traverse(part)
    transform = parameters["to_world"] if "to_world" in parameters else mi.Transform4f()
    return np.array(transform.matrix, dtype=np.float64).reshape(4, 4)


def _frame(to_world: np.ndarray) -> np.ndarray:
    """Return an emitter's frame, +Z ahead in Mitsuba, as stage lights have it: −Z ahead, +Y up."""
    linear = to_world[:3, :3]
    ahead = np.cross(linear[:, 0], linear[:, 1]) * np.sign(np.linalg.det(linear))
    ahead /= np.linalg.norm(ahead)
    up = linear[:, 1] - (linear[:, 1] @ ahead) * ahead
    up /= np.linalg.norm(up)
    side = np.cross(ahead, up) * np.sign(np.linalg.det(linear))
    result = np.eye(4)
    result[:3] = np.column_stack([side, up, -ahead, to_world[:3, 3]])
    return result


def _portal(plugin: MiScene, name: str, given: scene.Mesh | str) -> tuple[scene.Mesh, Any]:
    """Return a portal as a mesh and as a Mitsuba shape."""
    if isinstance(given, scene.Mesh):
        mesh, shape = given, shape_of(given)
    else:
        mesh, shape = _opening(plugin, name, given)
    if mesh.plane() is None:
        raise SceneError(f"emitter {name}: its portal {mesh.name} is not flat: expected one that lies in a plane")
    return mesh, shape


def _opening(plugin: MiScene, name: str, given: str) -> tuple[scene.Mesh, Any]:
    """Return a shape of the scene as a mesh (a disk as the square around it), and the shape itself."""
    shapes = {str(each.id()): each for each in plugin.shapes()}
    if given not in shapes:
        known = ", ".join(each for each, shape in shapes.items() if each and is_null(shape)) or "none"
        text = f"emitter {name}: its portal '{given}' is no shape of the scene"
        hint = "; Mitsuba has merged meshes and dropped their ids: load with optimize=False" if "" in shapes else ""
        raise SceneError(f"{text}: expected one with a null BSDF ({known}), or a Mesh{hint}")
    shape = shapes[given]
    if not is_null(shape):
        raise SceneError(f"emitter {name}: its portal {given} stops light: expected a null BSDF, which lets it pass")
    parameters = mi.traverse(shape)
    if shape.class_name() in ("Rectangle", "Disk"):
        to_world = _matrix(shape)
        points, faces = _SQUARE @ to_world[:3, :3].T + to_world[:3, 3], np.array([[0, 1, 2], [0, 2, 3]])
    elif shape.is_mesh():
        points = np.array(parameters["vertex_positions"], dtype=np.float64).reshape(-1, 3)
        faces = np.array(parameters["faces"], dtype=np.int64).reshape(-1, 3)
    else:
        raise SceneError(f"emitter {name}: its portal {given} is of type {shape.class_name()}: expected a flat shape")
    return scene.Mesh(given, points, faces), shape
