"""Read the material that is bound to a gprim, whichever surface shaders it has."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from ...scene import Array, Material, UVTexture
from ..common.blender import wrote_prim
from ..common.openusd import Tf, Usd, UsdShade
from ..common.reading import Reading, is_relationship, quiet, target_paths
from .bumps import BUMPS
from .images import IMAGES
from .kept import kept
from .network import Network, ShaderNode, Surface, broken
from .nodes import NODES, ignored
from .ramps import RAMPS
from .surfaces import SURFACES, surface_of
from .values import Image, PrimvarValue, Value, as_color, as_number, constant, mapped

COLORS = ("diffuse", "emissive", "tint")
TEXTURED = ("diffuse", "emissive", "roughness", "metallic", "opacity", "tint")
_AT_VERTICES = ("diffuse", "opacity", "tint")
# Fields with values from 0 to 1. Others have values from 0 up; but a reflectance that is one colour is at most 1, too.
_PARTS = ("metallic", "opacity", "clearcoat", "clearcoat_roughness", "roughness", "tint")

_NOISE = 1e-3  # by which numbers of images may leave their range, as filters make them do

#: Renderers in the order in which their networks are preferred; "" is for all renderers.
_CONTEXTS = ("mtlx", "", "arnold", "ai", "karma", "ri", "mdl")


@dataclass(frozen=True)
class Bound:
    """A material bound to a gprim, and what has to be looked up on the gprim.

    Attributes
    ----------
    material
        The material with constants only: the mean of an image, or the fallback of a primvar.
    images
        Images, by the fields that they are for.
    primvars
        Primvars of the gprim, by the fields that they are for.
    uv_name
        Primvar of the texture coordinates; "" if there is no image.
    """

    material: Material
    images: dict[str, Image] = field(default_factory=dict)
    primvars: dict[str, PrimvarValue] = field(default_factory=dict)
    uv_name: str = ""


_GREY = "displayColor or grey is used"
#: Readers of all nodes.
READERS = {**NODES, **IMAGES, **RAMPS, **BUMPS}

# The default where no material is bound: grey, with `displayColor` and `displayOpacity`.
_UNBOUND = Bound(
    Material(),
    primvars={
        "diffuse": PrimvarValue("displayColor", np.array(Material().diffuse)),
        "opacity": PrimvarValue("displayOpacity", np.ones(1)),
    },
)


def bound_to(
    reading: Reading, prim: Usd.Prim, purposes: Sequence[str] = (UsdShade.Tokens.full, UsdShade.Tokens.preview)
) -> UsdShade.Material | None:
    """Return the material that is bound to a prim for the first of the purposes that has one, or None."""
    return next((found for purpose in purposes if (found := _bound_for(reading, prim, purpose)) is not None), None)


def _bound_for(reading: Reading, prim: Usd.Prim, purpose: str) -> UsdShade.Material | None:
    """Return the material that is bound to a prim for a purpose, resolved once, or None."""
    key = ("bound", prim.GetPath(), purpose)
    if key not in reading.cache:
        try:
            with quiet():  # it warns of bindings without their API
                material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial(purpose)
        except Tf.ErrorException:  # the binding is an attribute
            material = None
        reading.cache[key] = material or None
    return reading.cache[key]


def bound_material(reading: Reading, prim: Usd.Prim) -> Bound:
    """Return the material bound to a gprim or face subset; without one, a grey with `displayColor`."""
    material = bound_to(reading, prim, (UsdShade.Tokens.full,))
    if material is None:
        _warn_of_missing(reading, prim)
        return _UNBOUND
    own = material.GetPrim()
    key = ("material", (own.GetPrimInPrototype() if own.IsInstanceProxy() else own).GetPath())
    known = kept(reading)
    if key not in known:
        known[key] = reading.attempt(own, partial(_read, reading, material), _UNBOUND, _GREY)
    found: Bound = known[key]
    return found


def _warn_of_missing(reading: Reading, prim: Usd.Prim) -> None:
    """Warn if the binding of a prim, or of its nearest ancestor with one, names a missing material."""
    while prim:
        if not is_relationship(prim, "material:binding"):
            text = f"is an attribute: expected a relationship, rel; {_GREY}"
            reading.warn(prim, text, "material:binding")
            return
        targets = target_paths(prim, "material:binding")
        if targets:
            text = f"names {targets[0]}: expected a material on the stage; {_GREY}"
            reading.lack(prim, text, "material:binding")
            return
        prim = prim.GetParent()


def _read(reading: Reading, material: UsdShade.Material) -> Bound:
    """Return the first of a material's surfaces that loses nothing, or else the one that loses least."""
    best: tuple[int, Network, Surface] | None = None
    unknown = []
    for node in _surfaces(reading, material):
        surface = surface_of(node)
        if surface is None:
            unknown.append(node.label or "without an id")
            continue
        losses = len(node.network.losses) + (node.category not in SURFACES)
        if best is None or losses < best[0]:
            best = losses, node.network, surface
        if not node.network.losses:
            break
    prim = material.GetPrim()
    if best is None:
        problems = (each for output in material.GetSurfaceOutputs() for each in broken(output.GetAttr(), _GREY))
        if (problem := next(problems, None)) is not None:
            reading.lack(*problem)
        else:
            text = f"has a surface shader '{[*unknown, 'none'][0]}': expected UsdPreviewSurface, standard_surface or"
            reading.warn(prim, f"{text} open_pbr_surface; {_GREY}")
        return _UNBOUND
    _, network, surface = best
    for tell in network.losses:
        tell()
    bound = _bound(reading, material, surface)
    if wrote_prim(prim) and "glass" in prim.GetName().lower():
        _warn_of_glass(reading, material, bound.material)
    return bound


def _surfaces(reading: Reading, material: UsdShade.Material) -> Iterator[ShaderNode]:
    """Yield a material's surface shaders, those of preferred renderers first, each with a network of its own."""
    contexts = [str(output.GetFullName()).removeprefix("outputs:").rpartition("surface")[0].strip(":")
                for output in material.GetSurfaceOutputs()]  # fmt: skip
    preferred = [each for each in _CONTEXTS if each in contexts or not each]
    seen = set()
    for context in [*preferred, *sorted(set(contexts) - set(preferred))] if contexts else [""]:
        shader, _, _ = material.ComputeSurfaceSource(context)
        if shader and shader.GetPath() not in seen:
            seen.add(shader.GetPath())
            yield ShaderNode(Network(reading, READERS, ignored), shader)


def _warn_of_glass(reading: Reading, material: UsdShade.Material, read: Material) -> None:
    """Warn if a surface that Blender calls glass is opaque, with the flag that makes it clear."""
    nodes = (each for each in _surfaces(reading, material) if each.category == "UsdPreviewSurface")
    node = next(nodes, None)
    if node is not None and isinstance(read.opacity, float | int) and read.opacity == 1:
        flag = f"--set '{node.shader.GetPath().AppendProperty('inputs:opacity')}=0'"
        text = f"is opaque, because Blender writes no transmission, and no light passes it; for glass: {flag}"
        reading.warn(material.GetPrim(), text)


def _bound(reading: Reading, material: UsdShade.Material, surface: Surface) -> Bound:
    """Return a surface's constants, images and primvars by fields of `scene.Material`, clipped to their ranges."""
    prim = material.GetPrim()
    fields: dict[str, Any] = {"presence": surface.presence, "thin": surface.thin}
    images, primvars = {}, {}
    for name, value in vars(surface).items():
        if name in ("presence", "thin", "normal", "bump") or value is None:
            continue
        value = _in_range(reading, prim, name, as_color(value) if name in COLORS else as_number(value))
        if isinstance(value, Image) and name in TEXTURED:
            images[name] = value
        elif isinstance(value, PrimvarValue) and name in _AT_VERTICES:
            primvars[name] = value
        elif isinstance(value, Image | PrimvarValue):
            kind, instead = ("a texture", "mean") if isinstance(value, Image) else ("a primvar", "fallback")
            text = f"has {kind} for its {name.replace('_', ' ')}, which is not rendered: its {instead} is used"
            reading.warn(prim, text)
        fields[name] = plain(name, constant(value))
    tilts = {"normal": surface.normal, "bump": surface.bump}
    images |= {name: value for name, value in tilts.items() if isinstance(value, Image)}
    return Bound(Material(**fields, name=str(prim.GetPath())), images, primvars, _uv_name(reading, prim, images))


def plain(name: str, value: Array) -> Any:
    """Return a constant as a field of `scene.Material`, a number or a colour."""
    numbers = np.asarray(value, dtype=np.float64).tolist()
    return tuple(np.broadcast_to(numbers, 3).tolist()) if name in COLORS else numbers[0]


def _in_range(reading: Reading, prim: Usd.Prim, name: str, value: Value) -> Value:
    """Return a value clipped to the range of a field; warn if something is outside of it."""
    most = 1.0 if name in _PARTS or (name == "diffuse" and isinstance(value, np.ndarray)) else np.inf
    result = mapped(lambda values: np.clip(values, 0.0, most), value)
    if isinstance(value, PrimvarValue):  # its values are those of a gprim
        return result
    numbers, slack = (value.pixels, _NOISE) if isinstance(value, Image) else (value, 1e-6)
    if numbers.min() < -slack or numbers.max() > most + slack:
        shown = ", ".join(f"{each:g}" for each in np.ravel(numbers))
        if isinstance(value, Image):
            shown = f"of a texture, {numbers.min():g} to {numbers.max():g}"
        expected = "0 to 1" if most == 1 else "0 or more"
        reading.warn(prim, f"has the {name} {shown}: expected {expected}; the nearest value is used")
    return result


def _uv_name(reading: Reading, prim: Usd.Prim, images: dict[str, Image]) -> str:
    """Return the primvar of the texture coordinates; a mesh has only one set of these."""
    names = list(dict.fromkeys(each.uv_name for each in images.values()))
    if len(names) > 1:
        others = ", ".join(names[1:])
        reading.warn(prim, f"has textures on the primvars '{names[0]}' and '{others}': the former is used for all")
    return names[0] if names else ""


def texture_of(name: str, image: Image, wrap: str) -> UVTexture:
    """Return an image as a field of `scene.Material`; normals are encoded as n / 2 + 1 / 2."""
    pixels = image.pixels * 0.5 + 0.5 if name == "normal" else image.pixels
    return UVTexture(np.ascontiguousarray(pixels, dtype=np.float32), wrap, image.transform)
