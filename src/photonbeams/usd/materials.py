"""UsdPreviewSurface materials, their textures decoded."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from pxr import Sdf, Tf, Usd, UsdShade

from ..scene import Array, Material, SceneError, UVTexture, color, number, rgb
from .reading import Reading, is_relationship, target_paths
from .textures import read_image

GREY = Material()

_CHANNELS = {"r": slice(0, 1), "g": slice(1, 2), "b": slice(2, 3), "a": slice(3, 4), "rgb": slice(0, 3)}
_WRAPS = {"repeat": "repeat", "clamp": "clamp", "mirror": "mirror", "black": "clamp", "useMetadata": "repeat"}
# Material's fields by UsdPreviewSurface's inputs, which are colours, and which may be textures.
_COLORS = {"diffuseColor": "diffuse", "emissiveColor": "emissive"}
_NUMBERS = {"roughness": "roughness", "metallic": "metallic", "opacity": "opacity"}
_PLAIN = {"ior": "ior", "clearcoat": "clearcoat", "clearcoatRoughness": "clearcoat_roughness"}
_IGNORED = ("normal", "displacement")


@dataclass(frozen=True)
class Bound:
    """A material as bound to a gprim, with what has to be looked up on the gprim.

    Attributes
    ----------
    uv_name
        Primvar of the texture coordinates; "" where there is no texture.
    diffuse_primvar
        Primvar that gives the diffuse colour, or "".
    """

    material: Material
    uv_name: str = ""
    diffuse_primvar: str = ""


def bound_material(reading: Reading, prim: Usd.Prim) -> Bound:
    """Return the material bound to a gprim or face subset; without one, a grey that takes `displayColor`."""
    try:
        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial(UsdShade.Tokens.full)
    except Tf.ErrorException:  # of a binding that is an attribute
        material = None
    if not material:
        _warn_of_missing(reading, prim)
        return Bound(GREY, diffuse_primvar="displayColor")
    own = material.GetPrim()
    key = ("material", (own.GetPrimInPrototype() if own.IsInstanceProxy() else own).GetPath())
    if key not in reading.cache:
        plain = Bound(GREY, diffuse_primvar="displayColor")
        text = "displayColor or grey is used"
        reading.cache[key] = reading.attempt(own, partial(_read, reading, material), plain, text)
    return reading.cache[key]


def _warn_of_missing(reading: Reading, prim: Usd.Prim) -> None:
    """Warn where a prim or its nearest ancestor with a binding names a material that is not there."""
    while prim:
        if not is_relationship(prim, "material:binding"):
            text = "is an attribute: expected a relationship, rel; displayColor or grey is used"
            reading.warn(prim, text, "material:binding")
            return
        targets = target_paths(prim, "material:binding")
        if targets:
            text = f"names {targets[0]}: expected a material on the stage; displayColor or grey is used"
            reading.warn(prim, text, "material:binding")
            return
        prim = prim.GetParent()


def _read(reading: Reading, material: UsdShade.Material) -> Bound:
    prim = material.GetPrim()
    shader, _, _ = material.ComputeSurfaceSource()
    kind = str(shader.GetShaderId()) if shader else "none"
    if kind != "UsdPreviewSurface":
        reading.warn(prim, f"has a surface shader '{kind}': expected UsdPreviewSurface; displayColor or grey is used")
        return Bound(GREY, diffuse_primvar="displayColor")
    return _Preview(reading, shader).bound()


class _Preview:
    """A UsdPreviewSurface, read input by input."""

    def __init__(self, reading: Reading, shader: UsdShade.Shader) -> None:
        self.reading, self.shader = reading, shader
        self.uv_name = ""
        self.diffuse_primvar = ""

    def bound(self) -> Bound:
        """Return the material."""
        fields: dict[str, Any] = {}
        for name, own in {**_COLORS, **_NUMBERS, **_PLAIN}.items():
            value = self._input(name)
            if isinstance(value, UVTexture) and name in _PLAIN:
                self.reading.warn(self.shader.GetPrim(), "is a texture: its mean is used", f"inputs:{name}")
                value = float(value.pixels.mean())
            if value is not None:
                fields[own] = value
        for name in _IGNORED:
            if self.shader.GetInput(name) and self.shader.GetInput(name).HasConnectedSource():
                self.reading.warn(self.shader.GetPrim(), "is not rendered: it is ignored", f"inputs:{name}")
        if self._input("useSpecularWorkflow"):
            self.reading.warn(
                self.shader.GetPrim(), "is not rendered: metallic and ior are used", "inputs:useSpecularWorkflow"
            )
        self._cut_out(fields)
        return Bound(Material(**fields), self.uv_name, self.diffuse_primvar)

    def _cut_out(self, fields: dict[str, Any]) -> None:
        threshold = self._input("opacityThreshold") or 0.0
        opacity = fields.get("opacity")
        mode = self.shader.GetInput("opacityMode")
        fields["presence"] = threshold > 0 or (bool(mode) and str(mode.Get(self.reading.time)) == "presence")
        if threshold > 0 and isinstance(opacity, UVTexture):
            cut = (opacity.pixels >= threshold).astype(np.float32)
            fields["opacity"] = UVTexture(cut, opacity.wrap, opacity.uv_transform)
        elif threshold > 0 and opacity is not None:
            fields["opacity"] = float(opacity >= threshold)

    def _input(self, name: str) -> Any:
        """Return an input as a number, a colour or a Texture; None where nothing is authored."""
        source = self.shader.GetInput(name)
        attribute = _source(source) if source else None
        if attribute is None:
            return None
        if UsdShade.Utils.GetType(attribute.GetName()) == UsdShade.AttributeType.Output:
            return self._node(name, attribute)
        value = attribute.Get(self.reading.time)
        if value is None:
            return None
        place = self.reading.place(attribute.GetPrim(), attribute.GetName())
        if name in _COLORS:
            return color(np.asarray(value, dtype=float), place)
        return number(value, place, minimum=0.0, maximum=1.0 if name in ("opacity", "metallic") else np.inf)

    def _node(self, name: str, output: Usd.Attribute) -> Any:
        """Return what another shader feeds into an input."""
        node = UsdShade.Shader(output.GetPrim())
        kind = str(node.GetShaderId())
        if kind == "UsdUVTexture":
            return self._texture(name, node, str(output.GetName()).removeprefix("outputs:"))
        if kind.startswith("UsdPrimvarReader") and name == "diffuseColor":
            self.diffuse_primvar = str(_value(self.reading, node, "varname", ""))
            fallback = _value(self.reading, node, "fallback", None)
            return None if fallback is None else color(np.asarray(fallback, dtype=float), self._place(node, "fallback"))
        self.reading.warn(node.GetPrim(), f"is a shader '{kind}', which is not rendered: inputs:{name} is ignored")
        return None

    def _place(self, node: UsdShade.Shader, name: str) -> str:
        return self.reading.place(node.GetPrim(), f"inputs:{name}")

    def _texture(self, name: str, node: UsdShade.Shader, output: str) -> Any:
        source = node.GetInput("file")
        attribute = _source(source) if source else None
        if output not in _CHANNELS:
            raise SceneError(f"{self._place(node, 'file')} is read as '{output}': expected r, g, b, a or rgb")
        scale, bias = (np.asarray(_value(self.reading, node, key, (d,) * 4), float) for key, d in _ADJUST)
        pixels = self._pixels(node, attribute)
        if pixels is None:
            value = np.asarray(_value(self.reading, node, "fallback", (0, 0, 0, 1)), dtype=float)
            pixels = value.reshape(1, 1, -1)
        pixels = _four_channels(pixels) * scale + bias
        if not np.isfinite(pixels).all():
            place = self._place(node, "fallback")
            raise SceneError(f"{place}, scale or bias is not finite: expected finite numbers")
        chosen = np.maximum(pixels[..., _CHANNELS[output]], 0.0).astype(np.float32)
        if name not in _COLORS:
            chosen = chosen[..., :1]
        if chosen.shape[:2] == (1, 1):
            flat = chosen.reshape(-1).tolist()
            return flat[0] if name not in _COLORS else tuple(np.broadcast_to(flat, 3).tolist())
        return UVTexture(chosen, self._wrap(node), self._coordinates(node))

    def _pixels(self, node: UsdShade.Shader, attribute: Usd.Attribute | None) -> Array | None:
        if attribute is None:
            return None
        asset = attribute.Get(self.reading.time)
        if isinstance(asset, Sdf.AssetPath) and "<UDIM>" in asset.path:
            self.reading.warn(node.GetPrim(), f"names {asset.path}, tiles are not rendered: its fallback is used")
            return None
        space = str(_value(self.reading, node, "sourceColorSpace", "auto"))
        read = partial(read_image, self.reading, attribute.GetPrim(), str(attribute.GetName()), space)
        return self.reading.attempt(node.GetPrim(), read, None, "its fallback is used")

    def _wrap(self, node: UsdShade.Shader) -> str:
        s, t = (str(_value(self.reading, node, key, "useMetadata")) for key in ("wrapS", "wrapT"))
        if s != t:
            self.reading.warn(node.GetPrim(), f"is '{s}' and wrapT is '{t}': wrapS is used for both", "inputs:wrapS")
        if s == "black":
            self.reading.warn(node.GetPrim(), "is 'black', which is not rendered: clamp is used", "inputs:wrapS")
        if s not in _WRAPS:
            raise self.reading.fail(node.GetPrim(), "inputs:wrapS", f"is '{s}': expected one of {', '.join(_WRAPS)}")
        return _WRAPS[s]

    def _coordinates(self, node: UsdShade.Shader) -> Array:
        """Return the (3, 3) transform of the texture coordinates, and remember their primvar."""
        transform = np.eye(3)
        source = node.GetInput("st")
        for _ in range(16):  # a chain of transforms ends; a loop of them must too
            attribute = _source(source) if source else None
            if attribute is None or UsdShade.Utils.GetType(attribute.GetName()) != UsdShade.AttributeType.Output:
                break
            upstream = UsdShade.Shader(attribute.GetPrim())
            kind = str(upstream.GetShaderId())
            if kind == "UsdTransform2d":
                transform = transform @ _transform_2d(self.reading, upstream)
                source = upstream.GetInput("in")
                continue
            if kind.startswith("UsdPrimvarReader"):
                self._use_uvs(node, str(_value(self.reading, upstream, "varname", "st")))
            break
        self.uv_name = self.uv_name or "st"
        return transform

    def _use_uvs(self, node: UsdShade.Shader, name: str) -> None:
        if self.uv_name and self.uv_name != name:
            self.reading.warn(node.GetPrim(), f"reads primvar '{name}', others '{self.uv_name}': the latter is used")
        self.uv_name = self.uv_name or name


_ADJUST = (("scale", 1.0), ("bias", 0.0))


def _source(source: UsdShade.Input) -> Usd.Attribute | None:
    """Return the attribute that gives an input its value, through the interfaces of networks."""
    attributes = UsdShade.Utils.GetValueProducingAttributes(source)
    return attributes[0] if attributes else None


def _value(reading: Reading, node: UsdShade.Shader, name: str, default: Any) -> Any:
    source = node.GetInput(name)
    attribute = _source(source) if source else None
    value = attribute.Get(reading.time) if attribute is not None else None
    return default if value is None else value


def _four_channels(pixels: Array) -> Array:
    """Return pixels as RGBA: grey is repeated, and what has no alpha is opaque."""
    channels = pixels.shape[2]
    alpha = pixels[..., -1:] if channels in (2, 4) else np.ones_like(pixels[..., :1])
    return np.concatenate([rgb(pixels), alpha], axis=2)


def _transform_2d(reading: Reading, node: UsdShade.Shader) -> Array:
    """Return UsdTransform2d: scale, then rotate counter-clockwise by degrees, then translate."""
    angle = np.radians(float(_value(reading, node, "rotation", 0.0)))
    scale = np.asarray(_value(reading, node, "scale", (1, 1)), dtype=float)
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    result = np.eye(3)
    result[:2, :2] = rotation * scale
    result[:2, 2] = np.asarray(_value(reading, node, "translation", (0, 0)), dtype=float)
    return result
