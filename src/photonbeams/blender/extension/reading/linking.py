"""Light linking and shadow linking: the objects that a light shines on, and that block it, as UsdLux collections."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from .nodes import Told

_KINDS = {"receiver_collection": "lightLink", "blocker_collection": "shadowLink"}


class Links:
    """The links of lights, by the paths of what they light and of what blocks them.

    Parameters
    ----------
    told
        Called with a sentence about a link that is not rendered as in Blender.
    """

    def __init__(self, told: Told) -> None:
        self._told, self._emitters = told, dict[Any, Any]()

    def see(self, thing: Any, key: Any) -> None:
        """Keep the links of an object."""
        linking = thing.original.light_linking
        if any(getattr(linking, name) is not None for name in _KINDS):
            self._emitters[key] = thing.original

    def write(self, prims: Iterable[dict[str, Any]], places: Mapping[Any, str], names: Mapping[str, str]) -> None:
        """Write the links into the prims of lights; `places` are the paths by instancer and object, `names` by path."""
        if not self._emitters:
            return
        by_path = {each["path"]: each for each in prims}
        named = [((key[1], key[0]), path) for key, path in places.items()]
        fogs = {path: names[path] for path, each in by_path.items() if _is_fog(each)}
        for key, thing in self._emitters.items():
            prim = by_path.get(places.get(key, ""))
            if prim is None or not _is_light(prim):
                continue
            values, targets = links_of(thing, named)
            prim["values"] = {**prim["values"], **values}
            prim["targets"] = {**prim.get("targets", {}), **targets}
            self._tell_fogs(thing, values, targets, fogs)

    def _tell_fogs(self, thing: Any, values: Any, targets: Any, fogs: Mapping[str, str]) -> None:
        """Say which fog a light lights, as it makes its beams in all fog or in none."""
        _, all_others = values.get("collection:lightLink:includeRoot", ("bool", True))
        linked = targets.get(f"collection:lightLink:{'excludes' if all_others else 'includes'}", ())
        dark = [name for path, name in fogs.items() if (path in linked) == all_others]
        if 0 < len(dark) < len(fogs):
            self._told(f"{thing.name}: its light link leaves out the fog {dark[0]}, but not all: its beams are in all")


def links_of(
    thing: Any, places: Iterable[tuple[tuple[str, ...], str]]
) -> tuple[dict[str, Any], dict[str, list[str]]]:  # fmt: skip
    """Return the attributes and the relationships of a light's links.

    Parameters
    ----------
    thing
        The object of the light.
    places
        Paths, each with the names of what is there: an object, and the one that it is a copy for. A copy is as its
        instancer, if that is linked.
    """
    values, targets = dict[str, Any](), dict[str, list[str]]()
    for name, kind in _KINDS.items():
        collection = getattr(thing.light_linking, name)
        if not (states := _states(collection)):  # an empty collection links everything, as in Cycles
            continue
        ends: dict[bool, list[str]] = {True: [], False: []}
        for names, path in places:
            own = next((states[each] for each in reversed(names) if each in states), None)
            if own is not None:
                ends[own].append(path)
        some = any(states.values())  # if a collection includes things, all others are left out
        values[f"collection:{kind}:includeRoot"] = ["bool", not some]
        targets[f"collection:{kind}:{'includes' if some else 'excludes'}"] = ends[some]
    return values, {name: paths for name, paths in targets.items() if paths}


def _states(collection: Any) -> dict[str, bool]:
    """Return whether a collection includes or excludes objects, by their names; those in it precede its children's."""
    found: dict[str, bool] = {}
    if collection is not None:
        for child, link in zip(collection.children, collection.collection_children, strict=True):
            found |= dict.fromkeys((each.name_full for each in child.all_objects), _is_included(link))
        for thing, link in zip(collection.objects, collection.collection_objects, strict=True):
            found[thing.name_full] = _is_included(link)
    return found


def _is_included(link: Any) -> bool:
    return bool(link.light_linking.link_state == "INCLUDE")


def _is_light(prim: Mapping[str, Any]) -> bool:
    """Return whether a prim is a lamp, or a mesh that glows and makes beams."""
    own = prim["values"].get("photonbeams:enabled", ["bool", False])[1]
    return prim["type"].endswith("Light") or bool(own) or "MeshLightAPI" in prim.get("apis", ())


def _is_fog(prim: Mapping[str, Any]) -> bool:
    """Return whether a prim is fog: with a medium's API, a grid, or a mesh around the material of a volume."""
    (bound,) = prim.get("targets", {}).get("material:binding", [""])
    if "PhotonBeamsMediumAPI" in prim.get("apis", ()) or prim["type"] == "Volume":
        return True
    return bool(bound.startswith(f"{prim['path']}/"))
