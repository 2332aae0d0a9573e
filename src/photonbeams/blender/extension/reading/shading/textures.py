"""Image Texture nodes as the prims of images: their files, their places on surfaces, their UV layers."""

from __future__ import annotations

from math import degrees
from typing import Any

from ..images import Images
from ..meshes import uv_name
from ..nodes import Texture, source_of
from ..prims import Prim, Told, Values
from .baking import baked


def shader_prim(path: str, identifier: str, output: str, values: Values, sources: dict[str, str] | None = None) -> Prim:
    """Return the prim of a shader with one output of a name; values and sources are those of its inputs."""
    values = {f"inputs:{name}": value for name, value in values.items()}
    values |= {"info:id": identifier, f"outputs:{output}": None}
    return Prim(path, "Shader", values, sources={f"inputs:{name}": source for name, source in (sources or {}).items()})


def texture_prims(
    texture: Texture, path: str, images: Images, told: Told, scaled: Values | None = None, *, is_number: bool = False
) -> tuple[list[Prim], str]:
    """Return the prims of a texture, and the path of the output that has its value.

    `scaled` are the factors, `scale`, and what is added, `bias`, of its four channels.
    """
    node = texture.node
    repeat = {"REPEAT": "repeat", "EXTEND": "clamp", "CLIP": "black", "MIRROR": "mirror"}[node.extension]
    if node.projection != "FLAT":
        told(f"{node.name} is projected as {node.projection.lower()}, which is not rendered: the UVs are used")
    if texture.output is None:
        file, space = images.file_of(node.image), _space_of(node.image, told)
    else:
        file, space = images.written(baked(texture.output), "made"), "raw"
    values = {
        "file": file, "wrapS": repeat, "wrapT": repeat,
        "sourceColorSpace": space, **(scaled or {}),
    }  # fmt: skip
    moved, layer = _placement(node, told)
    prims = [shader_prim(f"{path}_st", "UsdPrimvarReader_float2", "result", {"varname": uv_name(layer)})]
    place = f"{path}_st.outputs:result"
    if moved is not None:
        prims.append(shader_prim(f"{path}_placed", "UsdTransform2d", "result", moved, {"in": place}))
        place = f"{path}_placed.outputs:result"
    output = "rgb" if not is_number else "a" if texture.alpha else "r"
    prims.append(shader_prim(path, "UsdUVTexture", output, values, {"st": place}))
    return prims, f"{path}.outputs:{output}"


def _space_of(image: Any, told: Told) -> str:
    """Return the colour space of an image's values."""
    name = image.colorspace_settings.name
    if image.colorspace_settings.is_data or name.startswith("Linear Rec.709"):
        return "raw"
    if name != "sRGB":
        told(f"{image.name} is in {name}: it is read as sRGB")
    return "sRGB"


def _placement(node: Any, told: Told) -> tuple[Values | None, str]:
    """Return the values of a UsdTransform2d that moves UVs as a Mapping node does, or None; and the UVs' layer."""
    found, moved = source_of(node.inputs["Vector"]), None
    if found is not None and found.node.type == "MAPPING":
        mapping = found.node
        found = source_of(mapping.inputs["Vector"])
        inputs = [mapping.inputs[name] for name in ("Location", "Rotation", "Scale") if name in mapping.inputs]
        if mapping.vector_type == "POINT" and not any(each.is_linked for each in inputs):
            location, rotation, scale = (tuple(each.default_value) for each in inputs)
            moved = {
                "scale": list(scale[:2]),
                "rotation": degrees(rotation[2]),
                "translation": list(location[:2]),
            }
        else:
            told(f"{mapping.name} is not rendered: the UVs are used as they are")
    if found is not None and found.node.type == "UVMAP":
        return moved, found.node.uv_map
    if found is not None and not (found.node.type == "TEX_COORD" and found.name == "UV"):
        told(f"the coordinates of {node.name} are not rendered: the active UVs are used")
    return moved, ""
