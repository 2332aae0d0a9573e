"""The layers of a view, developed from the sums over its passes."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from .deep import DeepPicture, deep_picture
from .mattes import matte_layers
from .sums import ALBEDO, DEEP, DEPTH, MOTION, NORMAL, POSITION, PassSums

#: Prefixes of the names of a light group's sums. Light of surfaces and of the background.
SURFACE = "surface/"
#: The part of it that lamps, surfaces that glow and the background emit, if it is known.
EMITTED = "emitted/"
#: Light from beams.
GATHERED = "beams/"
#: Light from paths from the camera and from domes, whose samples have other places than those of beams.
SCATTERED = "scattered/"


def develop(sums: PassSums, shape: tuple[int, int], groups: Mapping[str, str]) -> dict[str, np.ndarray]:
    """Return the layers of a view, (H, W, C) float32: means over the passes, in the order of `layer_names`.

    Raises
    ------
    SceneError
        If the sums are of another picture.
    """
    pictures = _pictures(sums.total(), shape)
    scale, of_beams = _scales(pictures, len(sums))
    black = np.zeros((*shape, 3), dtype=np.float32)
    alpha = pictures.get("alpha", black[..., :1]) * scale
    of_surfaces = _by_group(pictures, {SURFACE: scale})
    of_media = _by_group(pictures, {GATHERED: of_beams, SCATTERED: scale})
    surface, beams = (sum(each.values(), black) for each in (of_surfaces, of_media))
    layers = {"rgba": np.concatenate([surface + beams, alpha], axis=2), "surface": surface, "beams": beams}
    for found, own in ((of_media, groups), (of_surfaces, surface_layers(groups))):
        for group, layer in own.items():
            # Black if the group has no light here. A group named "default" shares the layer of the unnamed group.
            layers[layer] = layers.get(layer, 0) + found.get(group, black)
    if "transmittance" in pictures:
        layers["transmittance"] = pictures["transmittance"] * scale
    layers[DEPTH] = pictures.get(DEPTH, np.full_like(alpha, np.inf))
    layers |= {name: pictures[name] for name in (NORMAL, POSITION) if name in pictures}
    if MOTION in pictures:
        layers[MOTION] = np.ascontiguousarray(pictures[MOTION][..., :2])
    layers |= matte_layers(pictures)
    if ALBEDO in pictures:
        layers[ALBEDO] = pictures[ALBEDO] * scale
    return layers


def emitted_of(sums: PassSums, shape: tuple[int, int], groups: Mapping[str, str]) -> dict[str, np.ndarray]:
    """Return what lamps, surfaces that glow and the background emit, (H, W, 3), by the layers to which it belongs."""
    pictures = _pictures(sums.total(), shape)
    found = _by_group(pictures, {EMITTED: _scales(pictures, len(sums))[0]})
    result: dict[str, np.ndarray] = {}
    for group, light in found.items():
        layer = surface_layers(groups).get(group, "surface")
        result[layer] = result.get(layer, 0) + light
    return result


def _by_group(pictures: Mapping[str, np.ndarray], factors: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Return the sums of each light group over the prefixes of names, times a factor for each prefix."""
    result: dict[str, Any] = {}
    for prefix, factor in factors.items():
        for name in sorted(each for each in pictures if each.startswith(prefix)):
            group = name.removeprefix(prefix)
            result[group] = result.get(group, 0) + pictures[name] * factor
    return result


def surface_layers(groups: Mapping[str, str]) -> dict[str, str]:
    """Return the layer of what surfaces show of each light group, given that of its beams; none without groups.

    What belongs to no group, such as surfaces that glow, has a layer, too: surfaces are the sum of these layers.
    """
    every = {**groups, "": "beams_default"} if groups else {}
    return {group: f"surface_{layer.removeprefix('beams_')}" for group, layer in sorted(every.items())}


def layer_of(name: str, groups: Mapping[str, str]) -> str | None:
    """Return the layer by itself to which the light of a sum belongs, by its name; None: it has none."""
    surface = name.startswith((SURFACE, EMITTED))
    group = name.partition("/")[2]
    if not groups:
        return "surface" if surface else "beams"
    return (surface_layers(groups) if surface else groups).get(group)


def deep_of(sums: PassSums, shape: tuple[int, int], beams: np.ndarray) -> DeepPicture | None:
    """Return the deep picture that is the layer `beams`, denoised or not, when it is flattened; None if not known."""
    total = sums.total()
    if not any(name.startswith(DEEP) for name in total):
        return None
    pictures = _pictures(total, shape)
    black = np.zeros((*shape, 3), dtype=np.float32)
    lights = (
        sum(_by_group(pictures, {prefix: factor}).values(), black)
        for prefix, factor in zip((SCATTERED, GATHERED), _scales(pictures, len(sums)), strict=True)
    )
    scattered, gathered = lights
    both = scattered + gathered
    factor = np.divide(beams, both, out=np.ones_like(both), where=both != 0)
    return deep_picture(pictures, factor * gathered, factor * scattered)


def _pictures(total: Mapping[str, np.ndarray], shape: tuple[int, int]) -> dict[str, np.ndarray]:
    """Return sums as pictures (H, W, C)."""
    return {name: np.ascontiguousarray(each.reshape(-1, *shape).transpose(1, 2, 0)) for name, each in total.items()}


def _scales(pictures: Mapping[str, np.ndarray], passes: int) -> list[Any]:
    """Return the factors that make means of sums over samples, and of sums of beams' light."""
    usual = np.float32(1 / max(passes, 1))
    return [1 / pictures[name] if name in pictures else usual for name in ("weight", "beams weight")]


def group_layers(groups: Collection[str]) -> dict[str, str]:
    """Return the layer of each light group's beams; empty if all are of the unnamed group."""
    return {group: f"beams_{group or 'default'}" for group in sorted(groups)} if set(groups) - {""} else {}


def layer_names(groups: Mapping[str, str]) -> list[str]:
    """Return the names of the layers, in their order, of a stage whose light groups have these layers."""
    of_groups = dict.fromkeys([*groups.values(), *surface_layers(groups).values()])
    return ["rgba", "surface", "beams", *of_groups, "transmittance", "depth"]
