"""Volume shaders of worlds and materials, as the attributes of `PhotonBeamsMediumAPI`."""

from __future__ import annotations

from typing import Any

import numpy as np

from .nodes import Told, color_of, number_of, output_of, source_of
from .shading.evaluation import Evaluation, Points, UnknownNodeError

APIS = ["PhotonBeamsMediumAPI"]


def medium_of(owner: Any, told: Told, density: float | None = None) -> dict[str, Any] | None:
    """Return the attributes of the volume of a material or a world; None if it has none.

    A density replaces that of the volume.
    """
    source = _source(owner)
    if source is None:
        return None
    found = _volume(source.node, lambda text: told(f"{owner.name}: {text}"), density)
    if found is None:
        return None
    scattering, absorption, anisotropy = found
    return {
        "photonbeams:scattering": ["color3f", scattering.tolist()],
        "photonbeams:absorption": ["color3f", absorption.tolist()],
        "photonbeams:anisotropy": ["float", anisotropy],
    }


def is_dense(medium: dict[str, Any]) -> bool:
    """Return whether no light of any colour comes through a medium from infinitely far away."""
    scattering, absorption = (np.array(medium[f"photonbeams:{name}"][1]) for name in ("scattering", "absorption"))
    return bool(np.all(scattering + absorption > 0))


def has_volume(owner: Any) -> bool:
    """Return whether a material or a world has a volume."""
    return _source(owner) is not None


def _source(owner: Any) -> Any:
    """Return the socket that the volume of a material or a world comes from; None if it has none."""
    if owner is None or owner.node_tree is None:
        return None
    output = output_of(owner.node_tree, "OUTPUT_MATERIAL") or output_of(owner.node_tree, "OUTPUT_WORLD")
    return None if output is None else source_of(output.inputs["Volume"])


def density_at(owner: Any, points: Points) -> Any:
    """Return the densities (N,) of the volume of a material at points; None if they are even or not known."""
    source = _source(owner)
    socket = None if source is None else source.node.inputs.get("Density")
    if socket is None or not socket.is_linked:
        return None
    try:
        return Evaluation(points).input(socket)
    except UnknownNodeError:
        return None


def _volume(node: Any, told: Told, density: float | None = None) -> tuple[Any, Any, float] | None:
    """Return the scattering and absorption coefficients per metre, and the anisotropy, of a volume shader."""
    match node.type:
        case "PRINCIPLED_VOLUME":
            density = number_of(node, "Density", told) if density is None else density
            color = np.array(color_of(node, "Color", told))
            absorbed = np.array(color_of(node, "Absorption Color", told))
            # As Cycles: what is not scattered is absorbed, except for the absorption colour.
            kept = np.maximum(1 - color, 0) * np.maximum(1 - np.sqrt(absorbed), 0)
            if number_of(node, "Emission Strength", told) > 0 or number_of(node, "Blackbody Intensity", told) > 0:
                told(f"the light that {node.name} emits is not rendered")
            return density * color, density * kept, number_of(node, "Anisotropy", told)
        case "VOLUME_SCATTER":
            density = number_of(node, "Density", told) if density is None else density
            color = np.array(color_of(node, "Color", told))
            return density * color, np.zeros(3), number_of(node, "Anisotropy", told)
        case "VOLUME_ABSORPTION":
            density = number_of(node, "Density", told) if density is None else density
            color = np.array(color_of(node, "Color", told))
            return np.zeros(3), density * np.maximum(1 - color, 0), 0.0
        case "ADD_SHADER":
            parts = [source_of(each) for each in node.inputs]
            found = [own for each in parts if each is not None and (own := _volume(each.node, told)) is not None]
            if not found:
                return None
            weights = [own[0].sum() for own in found]
            mean = np.average([own[2] for own in found], weights=weights) if sum(weights) else 0.0
            return sum(own[0] for own in found), sum(own[1] for own in found), float(mean)
    told(f"the volume of {node.name} is not rendered")
    return None
