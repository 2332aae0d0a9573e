"""Meshes and their materials as Mitsuba's shapes, BSDFs, emitters and textures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ... import scene
from ...numerics.arrays import to_float, to_uint
from ...runtime.device import backend, mitsuba
from .normal_maps import DIFFUSE, MIXED, NORMAL_MAP, SPECULAR

if TYPE_CHECKING:
    from ...runtime.mitsuba_types import MiBsdf, MiEmitter, MiMedium, MiMesh, MiObject, MiScene, MiShape

mi = mitsuba()

#: Roughness up to which a mirror or glass is smooth.
SMOOTH = 0.05


def shape_of(
    mesh: scene.Mesh, bsdf: MiBsdf | None = None, emitter: MiEmitter | None = None, interior: MiMedium | None = None,
    exterior: MiMedium | None = None,
) -> MiMesh:  # fmt: skip
    """Return a mesh as a Mitsuba shape, with the media inside and outside of it."""
    properties = mi.Properties()
    for name, value in (("bsdf", bsdf), ("emitter", emitter), ("interior", interior), ("exterior", exterior)):
        if value is not None:
            properties[name] = value
    shape = mi.Mesh(
        mesh.name,
        vertex_count=len(mesh.points),
        face_count=len(mesh.faces),
        has_vertex_normals=mesh.normals is not None,
        has_vertex_texcoords=mesh.uvs is not None,
        props=properties,
    )
    for name, value in vars(mesh.material).items():
        if isinstance(value, scene.VertexValues):
            values = np.ascontiguousarray(value.values, dtype=np.float32)
            shape.add_attribute(f"vertex_{name}", values.shape[1], values.ravel())
    parameters = mi.traverse(shape)
    parameters["faces"] = to_uint(mesh.faces)
    buffers = {"vertex_positions": mesh.points, "vertex_normals": mesh.normals, "vertex_texcoords": mesh.uvs}
    for name, buffer in buffers.items():
        if buffer is not None:
            parameters[name] = to_float(buffer)
    parameters.update()
    return shape


def scene_of(shapes: Sequence[MiShape], host: MiScene | None = None) -> MiScene:
    """Return a Mitsuba scene of shapes alone, which keep their ids.

    On CUDA, a kernel can only trace rays in several scenes if all share the shader binding table of one, `host`.
    """
    names = [shape.id() for shape in shapes]
    children: dict[str, MiObject] = {f"mesh_{index}": shape for index, shape in enumerate(shapes)}
    if host is not None and backend() == "cuda":
        children["host"] = host
    result = mi.load_dict({"type": "scene", **children})
    for shape, name in zip(shapes, names, strict=True):
        shape.set_id(name)
    return result


def is_null(shape: MiShape) -> bool:
    """Return whether all light passes straight through a shape: its BSDF has only a null lobe."""
    lobes = int(shape.bsdf().flags()) & int(mi.BSDFFlags.All)  # flags hold more than lobes
    return lobes == int(mi.BSDFFlags.Null)


def sharp_bsdf_of(material: scene.Material, thin: bool = False) -> dict[str, Any] | None:
    """Describe a mirror or glass as a Mitsuba BSDF; None for another material.

    A transparent material is glass of its `ior`, unless its opacity means presence; smooth metal is a mirror of its
    colour. `thin` glass has both of its sides in one surface, and does not bend light; a rough one is None.
    """
    if _is_glass(material) and (_is_smooth(material) or not thin):
        assert isinstance(material.opacity, float | int)
        plain = _clear(material, material.ior)
        rough = 1.0 if isinstance(material.roughness, scene.UVTexture) else float(material.roughness)
        glass: dict[str, Any] = {"type": "dielectric", **plain}
        if rough > SMOOTH:
            glass = {"type": "roughdielectric", "alpha": rough**2, **plain}
        glass = {"type": "thindielectric", **plain} if thin else _perturbed(material, glass, SPECULAR)
        if material.opacity == 0:
            return glass
        solid = bsdf_of(replace(material, opacity=1.0))
        return {"type": "blendbsdf", "weight": float(material.opacity), "clear": glass, "solid": solid}
    if _is_mirror(material):
        color = _texture(material.diffuse, "diffuse")
        conductor = {"type": "conductor", "material": "none", "specular_reflectance": color}
        return _perturbed(material, {"type": "twosided", "surface": conductor}, SPECULAR)
    return None


def _clear(material: scene.Material, ior: float) -> dict[str, Any]:
    """Describe the inside of a Mitsuba BSDF of glass."""
    color = _texture(material.tint, "tint") if _is_tinted(material) else 1.0
    return {"int_ior": float(ior), "ext_ior": 1.0, "specular_transmittance": color}


def _is_tinted(material: scene.Material) -> bool:
    return not isinstance(material.tint, tuple) or material.tint != scene.WHITE


def _is_glass(material: scene.Material) -> bool:
    """Return whether a material is transparent and reflects as glass does."""
    clear = isinstance(material.opacity, float | int) and material.opacity < 1
    return clear and not material.presence and material.ior > 1.001


def is_body(mesh: scene.Mesh) -> bool:
    """Return whether a mesh is a body of glass, and no shell."""
    return _is_glass(mesh.material) and not mesh.material.thin and mesh.closed


def is_pane(mesh: scene.Mesh) -> bool:
    """Return whether a mesh is glass without thickness, through which light goes straight: thin, or a flat sheet.

    Other open surfaces of glass, such as waves, refract light into what is behind them, and so do rough ones of opacity
    0, which are frosted. Rough ones of a higher opacity are cut out by it.
    """
    material = mesh.material
    straight = _is_glass(material) and (material.opacity != 0 or _is_smooth(material))
    return (straight and mesh.plane() is not None) or material.thin


def _is_mirror(material: scene.Material) -> bool:
    """Return whether a material is an ideal mirror."""
    metal = not isinstance(material.metallic, scene.UVTexture) and material.metallic > 0.99
    return metal and _is_smooth(material)


def _is_smooth(material: scene.Material) -> bool:
    return not isinstance(material.roughness, scene.UVTexture) and material.roughness <= SMOOTH


def bsdf_of(material: scene.Material, exported: bool = False) -> dict[str, Any]:
    """Describe a UsdPreviewSurface as a two-sided `principled` or `diffuse` BSDF, cut out by its opacity.

    What passes it goes straight, and has the colour of its tint. If `exported`, only Mitsuba's own plug-ins are used.
    """
    if _is_matte(material):
        surface, lobes = {"type": "diffuse", "reflectance": _texture(material.diffuse, "diffuse")}, DIFFUSE
    else:
        surface, lobes = _principled(material), SPECULAR if _is_metal(material) else MIXED
    if exported:  # Mitsuba's own maps work on one side only
        both_sides: dict[str, Any] = {"type": "twosided", "surface": _perturbed(material, surface, None)}
    else:
        both_sides = _perturbed(material, {"type": "twosided", "surface": surface}, lobes)
    if cut_out(material) and _is_tinted(material):
        clear = {"type": "thindielectric", **_clear(material, 1.0)}
        both_sides = {"type": "blendbsdf", "weight": _texture(material.opacity, "opacity"), "clear": clear,
                      "solid": both_sides}  # fmt: skip
    elif cut_out(material):
        both_sides = {"type": "mask", "opacity": _texture(material.opacity, "opacity"), "surface": both_sides}
    return both_sides


def _perturbed(material: scene.Material, surface: dict[str, Any], lobes: str | None) -> dict[str, Any]:
    """Describe a BSDF under the material's normal or bump map; if `lobes` is None, by Mitsuba's plug-ins."""
    if material.normal is not None:
        plain, name, texture = "normalmap", "normalmap", material.normal
    elif material.bump is not None:
        plain, name, texture = "bumpmap", "slopes", material.bump
    else:
        return surface
    if lobes is None:
        return {"type": plain, name: _texture(texture), "surface": surface}
    texture = texture.slopes() if name == "slopes" else texture
    return {"type": NORMAL_MAP, "lobes": lobes, name: _texture(texture), "surface": surface}


def _is_metal(material: scene.Material) -> bool:
    """Return whether a material is mostly metal."""
    metallic = material.metallic
    return float(np.mean(metallic.pixels) if isinstance(metallic, scene.UVTexture) else metallic) > 0.5


def _is_matte(material: scene.Material) -> bool:
    """Return whether a material reflects diffusely alone; its BSDF is then Lambert's."""
    return material.ior == 1 and material.metallic == 0 and material.clearcoat == 0


def _principled(material: scene.Material) -> dict[str, Any]:
    alpha = max(float(material.clearcoat_roughness) ** 2, 1e-3)
    return {
        "type": "principled",
        "base_color": _texture(material.diffuse, "diffuse"),
        "roughness": _texture(material.roughness),
        "metallic": _texture(material.metallic),
        "eta": max(material.ior, 1 / max(material.ior, 1e-3), 1.001),  # reflectance at normal incidence is symmetric
        "clearcoat": float(np.clip(material.clearcoat, 0, 1)),
        "clearcoat_gloss": float(np.clip((0.1 - alpha) / 0.099, 0, 1)),  # Mitsuba: alpha = lerp(0.1, 0.001, gloss)
    }


def emitter_of(material: scene.Material) -> dict[str, Any]:
    """Describe the light that a material emits as a Mitsuba emitter."""
    value = material.emissive
    color, image = ((1.0, 1.0, 1.0), value) if isinstance(value, scene.UVTexture) else (value, None)
    return {"type": "area", "radiance": radiance_of(color, image)}


def radiance_of(color: scene.Color, image: scene.UVTexture | None = None) -> dict[str, Any]:
    """Describe a radiance: a colour, times an image where there is one."""
    if image is None:
        return {"type": "rgb", "value": [float(channel) for channel in color]}
    pixels = np.asarray(image.pixels, dtype=np.float32) * np.asarray(color, dtype=np.float32)
    return _texture(replace(image, pixels=pixels))


def _texture(value: scene.Color | scene.UVTexture | scene.VertexValues | float, name: str = "") -> Any:
    """Describe a number, a colour or an image as a Mitsuba texture; numbers and colours are clamped to [0, 1].

    `name` is the name of the material's field, for values at vertices.
    """
    if isinstance(value, scene.VertexValues):
        return {"type": "mesh_attribute", "name": f"vertex_{name}"}
    if isinstance(value, scene.UVTexture):
        pixels = np.asarray(value.pixels, dtype=np.float32)
        flip = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, 1.0]])  # Mitsuba's first row is at v = 0
        return {
            "type": "bitmap",
            "bitmap": mi.Bitmap(np.ascontiguousarray(pixels)),
            "raw": True,
            "wrap_mode": value.wrap,
            "to_uv": mi.ScalarTransform3f(flip @ np.asarray(value.uv_transform, dtype=np.float64)),
        }
    if isinstance(value, tuple):
        return {"type": "rgb", "value": [float(np.clip(channel, 0, 1)) for channel in value]}
    return float(np.clip(value, 0, 1))


def cut_out(material: scene.Material) -> bool:
    """Return whether a material lets some light through."""
    return not isinstance(material.opacity, float | int) or material.opacity < 1


def glows(material: scene.Material) -> bool:
    """Return whether a material emits light."""
    return isinstance(material.emissive, scene.UVTexture) or max(material.emissive) > 0
