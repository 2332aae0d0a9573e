"""Light linking by the collections of UsdLuxLightAPI: which surfaces a light shines on, and which block it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...scene import DomeLight, Light, Mesh
from ..common.openusd import Sdf, Usd, UsdLux
from ..common.reading import LOG, Reading


def linked(reading: Reading, light: Light, prim: Usd.Prim, meshes: Sequence[Mesh], media: Sequence[str]) -> Light:
    """Return a light with the names of the surfaces and media that its links leave out.

    A light whose light link leaves out all media makes no beams, because beams are how media are lit.
    """
    unlit = _left_out(reading, prim, "lightLink", [mesh.name for mesh in meshes])
    casts = reading.flag(prim, "inputs:shadow:enable", True)
    every = frozenset(mesh.name for mesh in meshes)
    unshadowed = _left_out(reading, prim, "shadowLink", [mesh.name for mesh in meshes]) if casts else every
    dark = _left_out(reading, prim, "lightLink", media)
    if light.emits_beams and not lights_media(reading, prim, media):
        names = ", ".join(media)
        LOG.info("%s makes no beams: its light link leaves out the fog %s", reading.place(prim), names)
        light = replace(light, emits_beams=False)
    if isinstance(light, DomeLight) and light.lights_media and not lights_media(reading, prim, media):
        light = replace(light, lights_media=False)
    if not (unlit or dark or unshadowed):
        return light
    return replace(light, unlit=unlit, unlit_media=dark, unshadowed=unshadowed)


def lights_media(reading: Reading, prim: Usd.Prim, media: Sequence[str]) -> bool:
    """Return whether a light's link includes a medium's prim; a medium without a prim is lit by all lights."""
    return not media or any(_reaches(reading, prim, "lightLink", media))


def _left_out(reading: Reading, prim: Usd.Prim, kind: str, names: Sequence[str]) -> frozenset[str]:
    return frozenset(
        name for name, reached in zip(names, _reaches(reading, prim, kind, names), strict=True) if not reached
    )


def _reaches(reading: Reading, prim: Usd.Prim, kind: str, names: Sequence[str]) -> list[bool]:
    """Return which prims a link includes; for copies, the link to their instancer decides."""
    prefix = f"collection:{kind}"
    named = any(prim.GetRelationship(f"{prefix}:{end}").HasAuthoredTargets() for end in ("includes", "excludes"))
    named = named or reading.value(prim, f"{prefix}:mode") == "expression"
    if not named and reading.value(prim, f"{prefix}:includeRoot", True):
        return [True] * len(names)
    api = UsdLux.LightAPI(prim)
    collection = api.GetLightLinkCollectionAPI() if kind == "lightLink" else api.GetShadowLinkCollectionAPI()
    query = collection.ComputeMembershipQuery()
    return [bool(query.IsPathIncluded(Sdf.Path(name.partition("[")[0]))) for name in names]
