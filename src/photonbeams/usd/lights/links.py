"""Links by the collections of UsdLux: which surfaces and media a light shines on, which block it, where filters act."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ...scene import DomeLight, Light, LightFilter, Mesh
from ..common.openusd import Sdf, Usd
from ..common.reading import LOG, Reading, quiet, target_paths

#: The kind of links that filters have.
FILTER_LINK = "filterLink"

_INCLUDES = "collection:lightLink:includes"


def linked(reading: Reading, light: Light, prim: Usd.Prim, meshes: Sequence[Mesh], media: Sequence[str]) -> Light:
    """Return a light with the names of the surfaces and media that its links, and those of its filters, leave out.

    A light whose light link leaves out all media makes no beams, because beams are how media are lit.
    """
    every = frozenset(mesh.name for mesh in meshes)
    unlit = _left_out(reading, prim, "lightLink", [mesh.name for mesh in meshes])
    casts = reading.flag(prim, "inputs:shadow:enable", True)
    unshadowed = _left_out(reading, prim, "shadowLink", [mesh.name for mesh in meshes]) if casts else every
    dark = _left_out(reading, prim, "lightLink", media)
    if len(unlit) + len(dark) == len(every) + len(media) > 0:
        lost = [path for path in target_paths(prim, _INCLUDES) if not reading.stage.GetPrimAtPath(path.GetPrimPath())]
        nothing = "the light lights neither surfaces nor fog"
        if lost:
            reading.lack(prim, f"names {lost[0]}, which is not there: {nothing}", _INCLUDES)
        else:
            reading.warn(prim, f"includes nothing that is rendered: {nothing}", "collection:lightLink")
    if media and len(dark) == len(media):
        if light.emits_beams:
            text = "%s makes no beams: its light link leaves out the fog %s"
            LOG.info(text, reading.place(prim), ", ".join(media))
        light = replace(light, emits_beams=False)
        if isinstance(light, DomeLight):
            light = replace(light, lights_media=False)
    filters = _linked_filters(reading, light, [*(mesh.name for mesh in meshes), *media])
    if not (unlit or dark or unshadowed or filters != light.filters):
        return light
    return replace(light, unlit=unlit, unlit_media=dark, unshadowed=unshadowed, filters=filters)


def _linked_filters(reading: Reading, light: Light, names: Sequence[str]) -> tuple[LightFilter, ...]:
    """Return a light's filters with the names of what their links leave out."""
    result = []
    for each in light.filters:
        prim = reading.stage.GetPrimAtPath(each.name)
        left_out = _left_out(reading, prim, FILTER_LINK, names)
        result.append(replace(each, left_out=left_out) if left_out else each)
    return tuple(result)


def lights_media(reading: Reading, prim: Usd.Prim, media: Sequence[str]) -> bool:
    """Return whether a light's link includes a medium's prim; a medium without a prim is lit by all lights."""
    return not media or any(_reaches(reading, prim, "lightLink", media))


def is_linked(reading: Reading, prim: Usd.Prim, kind: str) -> bool:
    """Return whether a light or a filter has a link of this kind that may leave something out."""
    prefix = f"collection:{kind}"
    named = any(prim.GetRelationship(f"{prefix}:{end}").HasAuthoredTargets() for end in ("includes", "excludes"))
    named = named or reading.value(prim, f"{prefix}:mode") == "expression"
    return named or not reading.value(prim, f"{prefix}:includeRoot", True)


def _left_out(reading: Reading, prim: Usd.Prim, kind: str, names: Sequence[str]) -> frozenset[str]:
    return frozenset(
        name for name, reached in zip(names, _reaches(reading, prim, kind, names), strict=True) if not reached
    )


@quiet()  # it warns of collections in a circle
def _reaches(reading: Reading, prim: Usd.Prim, kind: str, names: Sequence[str]) -> list[bool]:
    """Return which prims a link includes.

    For copies, the link to their instancer decides, unless it names them, or what is above them, in the prototype.
    """
    if not is_linked(reading, prim, kind):
        return [True] * len(names)
    query = Usd.CollectionAPI(prim, kind).ComputeMembershipQuery()
    mode = reading.value(prim, f"collection:{kind}:mode")
    rules = {} if mode == "expression" else query.GetAsPathExpansionRuleMap()
    paths = [_linked_path(reading, name, rules) for name in names]
    # OpenUSD does not know of filters whose type it does not know that their links include the root, as all do.
    known = reading.value(prim, f"collection:{kind}:includeRoot") is not None or mode == "expression"
    return [
        bool(query.IsPathIncluded(path)) or not (known or any(map(rules.__contains__, path.GetPrefixes())))
        for path in paths
    ]


def _linked_path(reading: Reading, name: str, rules: Mapping[Sdf.Path, str]) -> Sdf.Path:
    """Return the path by which rules of a link include a surface or a medium, or do not."""
    path, above = Sdf.Path(name.partition("[")[0]), name.rpartition("/")[0]  # a subset of a copied mesh has no own item
    own = reading.cache.get(("copied", name.partition("[part ")[0])) or reading.cache.get(("copied", above))
    nearest = next((each for each in reversed(own.GetPrefixes()) if each in rules), None) if own else None
    return path if own is None or nearest is None or path.HasPrefix(nearest) else own
