"""Layers over Mitsuba scenes: prims named by the ids of emitters hold beam settings, as lights on stages do."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable
from typing import Any

from ..scene import WHITE, Light, Mesh
from .common.definitions import BLOCKER, LOOK, RAMP
from .common.openusd import Tf, Usd
from .common.reading import Reading, target_paths
from .common.warnings import Warnings
from .geometry.meshes import is_gprim
from .lights.beam_settings import read_beam_settings, read_portal
from .lights.filters import filtered, warn_of_link
from .lights.links import FILTER_LINK, is_linked
from .stage import open_stage

# The properties of PhotonBeamsLightAPI that apply to emitters of Mitsuba scenes, without "photonbeams:".
_SUPPORTED = ("look", "lightGroup", "enabled", "count", "intensity", "seed", "portal", "gobo", "scattered", "bounces")


class SceneLayers:
    """Layers over a Mitsuba scene.

    Parameters
    ----------
    layers
        USD files, the strongest first.

    Raises
    ------
    SceneError
        A file is not a USD file, or cannot be read.
    """

    def __init__(self, layers: Iterable[str | os.PathLike[str]]) -> None:
        *stronger, last = layers
        self.stage = open_stage(last, stronger)
        self._warnings = Warnings()

    def read(
        self, frame: float | None, emitters: Collection[str], shapes: Collection[str]
    ) -> dict[str, dict[str, Any]]:
        """Return the fields of `BeamSettings` that the layers set, by the ids of emitters; looks are specs.

        Parameters
        ----------
        frame
            Frame number, or None.
        emitters, shapes
            The ids of the scene's emitters and shapes. Characters other than letters, digits and _ become _ in names of
            prims.

        Raises
        ------
        SceneError
            A prim has the name of no emitter, a portal is not a shape, or a setting cannot be read.
        """
        reading = Reading(self.stage, frame, self._warnings)
        result = {}
        for prim in self.stage.TraverseAll():
            said = [each.GetName() for each in prim.GetAuthoredPropertiesInNamespace("photonbeams")]
            if (said or target_paths(prim, "light:filters")) and prim.GetTypeName() not in (LOOK, BLOCKER, RAMP):
                name = _named(reading, prim, emitters, "emitter")
                for each in said:
                    if each.split(":")[1] not in _SUPPORTED:
                        reading.warn(prim, "is not rendered: emitters of Mitsuba scenes do not have it", each)
                result[name] = read_beam_settings(reading, prim, _portal(reading, prim, shapes))
                shining = filtered(reading, prim, Light(name, WHITE, gobo=result[name]["gobo"]))
                result[name] |= {"filters": shining.filters, "gobo": shining.gobo}
                for own in (self.stage.GetPrimAtPath(each.name) for each in shining.filters):
                    if is_linked(reading, own, FILTER_LINK):
                        warn_of_link(reading, own)
        return result


def _named(reading: Reading, prim: Usd.Prim, ids: Collection[str], kind: str) -> str:
    """Return the id that a prim is named after."""
    known = {Tf.MakeValidIdentifier(each): each for each in ids if each}
    if prim.GetName() not in known:
        expected = ", ".join(known.values()) or "none"
        text = f"has no {kind} of its name in the scene: expected one of {expected}"
        raise reading.fail(prim, "", text)
    return known[prim.GetName()]


def _portal(reading: Reading, prim: Usd.Prim, shapes: Collection[str]) -> Mesh | str | None:
    """Return the portal that a prim names: gprims of the layers, or the id of a shape."""
    targets = reading.targets(prim, "photonbeams:portal")
    if len(targets) == 1 and not is_gprim(targets[0]):
        return _named(reading, targets[0], shapes, "shape")
    return read_portal(reading, prim)
