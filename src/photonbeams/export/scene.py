"""The twin of a scene: its description for Mitsuba, a dictionary of plug-ins with files for meshes and images.

What Mitsuba cannot describe is left out, with one warning for each. Lengths and colours stay as they are. Cameras and
lights look along −Z in scenes of photonbeams, and along +Z in Mitsuba's.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import scene
from ..runtime.device import helping_thread, mitsuba
from ..scene import Array
from ..world.bounds import bounding_sphere
from ..world.cameras.cameras import Window
from ..world.media.densities import density_grid
from ..world.surfaces.shapes import bsdf_of, cut_out, emitter_of, glows, shape_of

if TYPE_CHECKING:
    from ..runtime.mitsuba_types import Bitmap, ScalarTransform, Stream

mi = mitsuba()

#: Half a turn around Y, from a space in which −Z is ahead to one in which +Z is.
TURNED = np.diag([-1.0, 1.0, -1.0, 1.0])

# Clipping planes cut nothing off on stages. In a twin, the near one is at most the first of these fractions of the
# scene's radius away, the far one at least the second.
_NEAR, _FAR = 1e-4, 1e2

#: A function that writes a file to one of Mitsuba's streams.
Write = Callable[[Any], None]


@dataclass
class Twin:
    """A Mitsuba scene that is being written."""

    folder: str  # of its files, as the scene names it
    parts: dict[str, Any] = field(default_factory=dict)  # plug-ins by id, as `mi.load_dict` takes them but for files
    files: dict[str, Callable[[], bytes]] = field(default_factory=dict)  # their bytes, by their names in the folder
    lost: list[str] = field(default_factory=list)  # warnings about what is left out
    _taken: set[str] = field(default_factory=set)

    def id_of(self, path: str) -> str:
        """Return an id for a prim, which no other part has or gets."""
        name = unique = re.sub(r"[^\w-]+", "-", path, flags=re.ASCII).strip("-") or "part"
        number = 1
        while unique.lower() in self._taken:  # some file systems ignore case
            number += 1
            unique = f"{name}-{number}"
        self._taken.add(unique.lower())
        return unique

    def file(self, name: str, write: Write) -> str:
        """Add a file that `write` will write, and return its path as the scene names it."""
        self.files[name] = partial(_bytes_of, write)
        return f"{self.folder}/{name}"

    def with_images(self, part: dict[str, Any], name: str) -> dict[str, Any]:
        """Return a plug-in whose images are in files."""
        result = {}
        for key, value in part.items():
            if key == "bitmap":
                key, value = "filename", self.file(f"{name}.exr", partial(_write_image, value))
            result[key] = self.with_images(value, f"{name}-{key}") if isinstance(value, dict) else value
        return result


def twin_of(content: scene.Scene, camera: scene.Camera, window: Window, folder: str) -> Twin:
    """Return the twin of a scene as its camera sees it; `folder` is for its files, beside the file that names them."""
    from .lights import add_lights  # here, because it imports this module

    twin = Twin(folder)
    twin.parts["integrator"] = {"type": "photon_beams", "method": "beams", "max_depth": 2 + content.bounces}
    eye = np.asarray(camera.to_world, dtype=np.float64)[:3, 3]
    center, radius = content.bounds or bounding_sphere([content], [eye])
    content = content.within((center, radius))
    media = TwinMedia(twin, content)
    reach = float(np.linalg.norm(eye - center)) + radius
    twin.parts[twin.id_of(camera.name)] = {
        **sensor_of(camera, window, reach), **media.named("medium", media.at(eye)),
    }  # fmt: skip
    if camera.lens_radius > 0 and not camera.orthographic and (camera.horizontal_offset or camera.vertical_offset):
        twin.lost.append(
            f"{camera.name}.horizontalApertureOffset and the vertical one are left out, because fStop is not 0"
        )
    _add_surfaces(twin, content, camera.exposure_scale)
    add_lights(twin, content.lights, camera.exposure_scale, radius, media)
    for each in content.drawn:
        twin.lost.append(f"{each.name} is left out: Mitsuba has no drawn beams")
    return twin


def sensor_of(camera: scene.Camera, window: Window, reach: float) -> dict[str, Any]:
    """Describe a camera as a Mitsuba sensor; `reach` is the distance of the farthest object from it."""
    aspect = window.width / window.height
    width = max(camera.horizontal_aperture, camera.vertical_aperture * aspect)  # as `View` expands it
    left, top, right, bottom = window.crop
    film: dict[str, Any] = {
        "type": "hdrfilm", "width": window.width, "height": window.height, "rfilter": {"type": "box"},
    }  # fmt: skip
    if window.crop != (0, 0, window.width, window.height):
        film |= {"crop_offset_x": left, "crop_offset_y": top, "crop_width": right - left, "crop_height": bottom - top}
    near, far = min(camera.clipping[0] or np.inf, _NEAR * reach), max(camera.clipping[1], _FAR * reach)
    to_world = np.asarray(camera.to_world, dtype=np.float64) @ TURNED
    shift_x, shift_y = camera.horizontal_offset, camera.vertical_offset
    result: dict[str, Any] = {"near_clip": near, "far_clip": far}
    if camera.orthographic:
        film_to_camera = np.diag([width / 2, width / 2, 1.0, 1.0])
        film_to_camera[:2, 3] = -shift_x, shift_y
        to_world = to_world @ film_to_camera
        result |= {"type": "orthographic"}
    else:
        field = float(np.degrees(2 * np.arctan(width / (2 * camera.focal_length))))
        result |= {"type": "perspective", "fov": field, "fov_axis": "x"}
        if camera.lens_radius > 0:  # Mitsuba's thin lens has no shift
            result |= {
                "type": "thinlens",
                "aperture_radius": camera.lens_radius,
                "focus_distance": camera.focus_distance,
            }
        elif shift_x or shift_y:
            result |= {
                "principal_point_offset_x": shift_x / width,
                "principal_point_offset_y": -shift_y / width * aspect,
            }
    if camera.panoramic:
        kinds = "expected a perspective or an orthographic camera"
        raise scene.SceneError(f"{camera.name} is {camera.projection}, and Mitsuba has no such sensor: {kinds}")
    sampler = {"type": "independent", "sample_count": 16}
    return {**result, "to_world": matrix(to_world), "film": film, "sampler": sampler}


def matrix(values: np.ndarray) -> ScalarTransform:
    """Return a (4, 4) transform of column vectors as Mitsuba's."""
    return mi.ScalarTransform4f(np.asarray(values, dtype=np.float64))


def scaled(color: scene.Color, factor: float) -> scene.Color:
    """Return a colour times a factor."""
    return (factor * color[0], factor * color[1], factor * color[2])


def rgb(value: Sequence[float] | np.ndarray) -> dict[str, Any]:
    """Describe a colour."""
    return {"type": "rgb", "value": [float(each) for each in value]}


# -- surfaces ----------------------------------------------------------------------------------------------------------


def _add_surfaces(twin: Twin, content: scene.Scene, exposure: float) -> None:
    """Add the meshes and their materials."""
    hidden = {light.portal.name for light in content.lights if light.portal is not None}
    hidden |= {medium.mesh.name for medium in content.media if medium.mesh is not None}
    bsdfs: dict[int, str] = {}
    for mesh in content.meshes:
        if mesh.name in hidden or not len(mesh.faces):
            continue
        if not (mesh.seen and mesh.blocks) or mesh.holdout:
            twin.lost.append(f"{mesh.name} is met by all rays: Mitsuba hides nothing from the camera or from lights")
        material, name = mesh.material, twin.id_of(mesh.name)
        part = ply(twin, mesh, name)
        twin.parts[name] = part
        if id(material) not in bsdfs:
            bsdfs[id(material)] = own = twin.id_of(f"{mesh.name}-material")
            twin.parts[own] = twin.with_images(bsdf_of(material, exported=True), own)
        part["bsdf"] = {"type": "ref", "id": bsdfs[id(material)]}
        if glows(material):
            _warn_of_glow(twin, mesh)
            part[f"{name}-light"] = twin.with_images(emitter_of(_exposed(material, exposure)), f"{name}-light")


def ply(twin: Twin, mesh: scene.Mesh, name: str) -> dict[str, Any]:
    """Describe a mesh, and add a file for it."""
    path = twin.file(f"{name}.ply", lambda stream: shape_of(mesh).write_ply(stream))
    return {"type": "ply", "filename": path, "face_normals": mesh.normals is None}


def _exposed(material: scene.Material, exposure: float) -> scene.Material:
    """Return a material whose emitted light is multiplied by `exposure`."""
    value = material.emissive
    if isinstance(value, scene.UVTexture):
        return replace(material, emissive=replace(value, pixels=value.pixels * np.float32(exposure)))
    return replace(material, emissive=scaled(value, exposure))


def _warn_of_glow(twin: Twin, mesh: scene.Mesh) -> None:
    if not mesh.closed:
        twin.lost.append(
            f"{mesh.name} glows on its front alone: it is not closed, and Mitsuba's emitters have one side"
        )
    if cut_out(mesh.material):
        twin.lost.append(f"{mesh.name} also glows where its opacity cuts it out: Mitsuba's emitters have no opacity")


def _write_image(bitmap: Bitmap, stream: Stream) -> None:
    with helping_thread():
        bitmap.write(stream, mi.Bitmap.FileFormat.OpenEXR)


def _bytes_of(write: Write) -> bytes:
    stream = mi.MemoryStream()  # streams to files report no error if their last bytes cannot be written
    write(stream)
    return bytes(stream.raw_buffer())


# -- media -------------------------------------------------------------------------------------------------------------


class TwinMedia:
    """The media of a twin. One that fills a closed mesh is the interior of a shape with a null BSDF."""

    def __init__(self, twin: Twin, content: scene.Scene) -> None:
        self._known = {twin.id_of(each.name or "fog"): each for each in content.media if max(each.extinction) > 0}
        for name, each in self._known.items():
            twin.parts[f"{name}-medium"] = _medium_of(twin, each, name)
            if each.boundary is not None:
                around = self.at(each.boundary.points[0], than=name)
                sides = {**self.named("interior", name), **self.named("exterior", around)}
                twin.parts[name] = {**ply(twin, each.boundary, name), "bsdf": {"type": "null"}, **sides}
            if not each.surfaces:
                where = each.name or "the fog"
                twin.lost.append(f"{where}.photonbeams:surfaces is on: Mitsuba's surfaces are dimmed by every fog")

    def at(self, point: np.ndarray, than: str | None = None) -> str | None:
        """Return the id of the smallest medium at a point, leaving out `than`; None where there is none."""
        found = [
            (np.inf if each.boundary is None else each.boundary.volume, name) for name, each in self._known.items()
            if name != than and (each.boundary is None or each.boundary.winding(point) > 0.5)
        ]  # fmt: skip
        return min(found, default=(0.0, None))[1]

    def named(self, key: str, name: str | None) -> dict[str, Any]:
        """Return a plug-in's reference to a medium, by `key`; an empty dictionary if `name` is None."""
        return {} if name is None else {key: {"type": "ref", "id": f"{name}-medium"}}

    @property
    def endless(self) -> bool:
        """Whether a medium fills the whole space."""
        return any(each.boundary is None for each in self._known.values())


def _medium_of(twin: Twin, medium: scene.Medium, name: str) -> dict[str, Any]:
    """Describe a medium, and add a file for its grid if it has one."""
    extinction, peak = np.array(medium.extinction), max(medium.extinction)
    albedo = np.array(medium.scattering) / np.where(extinction > 0, extinction, 1)
    phase = {"type": "hg", "g": medium.anisotropy} if medium.anisotropy else {"type": "isotropic"}
    # Mitsuba takes the colours of media for reflectances, which are at most 1: the scale has the rest.
    shared = {"scale": peak, "albedo": rgb(albedo), "phase": phase}
    if medium.scattering_color is not None:
        colors = medium.scattering_color.values
        factors = (colors if colors.ndim == 4 else colors[..., None]) * albedo
        shared["albedo"] = _grid_of(twin, f"{name}-albedo", factors, medium.scattering_color)
    if medium.emission is not None:
        twin.lost.append(f"{medium.name} emits light, but Mitsuba's media cannot: its emission is left out")
    grid = medium.grid or density_grid(medium)
    if grid is None:
        return {"type": "homogeneous", "sigma_t": rgb(extinction / peak), **shared}
    values = grid.values[..., None] if grid.values.ndim == 3 else grid.values
    if values.shape[3] > 1 or np.ptp(extinction) > 0:
        values = values * (extinction / peak)
    return {"type": "heterogeneous", "sigma_t": _grid_of(twin, name, values, grid), **shared}


def _grid_of(twin: Twin, name: str, values: Array, place: scene.DensityGrid) -> dict[str, Any]:
    """Describe values on a grid, and add a file for them."""
    grid = mi.VolumeGrid(np.ascontiguousarray(values, dtype=np.float32))
    path = twin.file(f"{name}.vol", grid.write)
    return {"type": "gridvolume", "filename": path, "raw": True, "to_world": matrix(place.to_world)}
