"""The layers of a view, developed from the sums over its passes."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from .deep import DeepPicture, deep_picture
from .mattes import matte_layers
from .sums import ALBEDO, DEEP, DEPTH, MOTION, NORMAL, POSITION, PassSums

#: Prefixes of the names of a light group's sums. Light from beams.
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
    surface = pictures.get("surface", black) * scale
    alpha = pictures.get("alpha", black[..., :1]) * scale
    by_group: dict[str, Any] = {}
    for prefix, factor in ((GATHERED, of_beams), (SCATTERED, scale)):
        for name in sorted(each for each in pictures if each.startswith(prefix)):
            group = name.removeprefix(prefix)
            by_group[group] = by_group.get(group, 0) + pictures[name] * factor
    beams = sum(by_group.values(), black)
    layers = {"rgba": np.concatenate([surface + beams, alpha], axis=2), "surface": surface, "beams": beams}
    for group, name in groups.items():
        # Black if no beam of the group was in a medium. A group named "default" shares the layer of the unnamed group.
        layers[name] = layers.get(name, 0) + by_group.get(group, black)
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


def deep_of(sums: PassSums, shape: tuple[int, int], beams: np.ndarray) -> DeepPicture | None:
    """Return the deep picture that is the layer `beams`, denoised or not, when it is flattened; None if not known."""
    total = sums.total()
    if not any(name.startswith(DEEP) for name in total):
        return None
    pictures = _pictures(total, shape)
    black = np.zeros((*shape, 3), dtype=np.float32)
    lights = (
        sum((each * factor for name, each in pictures.items() if name.startswith(prefix)), black)
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
    """Return the layer of each light group; empty if all beams are of the unnamed group."""
    return {group: f"beams_{group or 'default'}" for group in sorted(groups)} if set(groups) - {""} else {}


def layer_names(groups: Mapping[str, str]) -> list[str]:
    """Return the names of the layers, in their order, of a stage whose light groups have these layers."""
    return ["rgba", "surface", "beams", *dict.fromkeys(groups.values()), "transmittance", "depth"]
