"""What is hidden from what: light linking and shadow linking as UsdLux collections, and which rays meet an object."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from .prims import Prim, Targets, Told, Values

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

    def write(self, prims: Iterable[Prim], places: Mapping[Any, str], names: Mapping[str, str]) -> None:
        """Write the links into the prims of lights; `places` are the paths by instancer and object, `names` by path."""
        if not self._emitters:
            return
        by_path = {each.path: each for each in prims}
        named = [((key[1], key[0]), path) for key, path in places.items()]
        fogs = {path: names[path] for path, each in by_path.items() if _is_fog(each)}
        for key, thing in self._emitters.items():
            prim = by_path.get(places.get(key, ""))
            if prim is None or not _is_light(prim):
                continue
            values, targets = links_of(thing, named)
            prim.values |= values
            prim.targets |= targets
            self._tell_fogs(thing, values, targets, fogs)

    def _tell_fogs(self, thing: Any, values: Any, targets: Any, fogs: Mapping[str, str]) -> None:
        """Say which fog a light lights, as it makes its beams in all fog or in none."""
        all_others = values.get("collection:lightLink:includeRoot", True)
        linked = targets.get(f"collection:lightLink:{'excludes' if all_others else 'includes'}", ())
        dark = [name for path, name in fogs.items() if (path in linked) == all_others]
        if 0 < len(dark) < len(fogs):
            self._told(f"{thing.name}: its light link leaves out the fog {dark[0]}, but not all: its beams are in all")


def links_of(
    thing: Any, places: Iterable[tuple[tuple[str, ...], str]]
) -> tuple[Values, Targets]:  # fmt: skip
    """Return the attributes and the relationships of a light's links.

    Parameters
    ----------
    thing
        The object of the light.
    places
        Paths, each with the names of what is there: an object, and the one that it is a copy for. A copy is as its
        instancer, if that is linked.
    """
    values, targets = Values(), Targets()
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
        values[f"collection:{kind}:includeRoot"] = not some
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


def _is_light(prim: Prim) -> bool:
    """Return whether a prim is a lamp, or a mesh that glows and makes beams."""
    return prim.type.endswith("Light") or bool(prim.values.get("photonbeams:enabled"))


def _is_fog(prim: Prim) -> bool:
    """Return whether a prim is fog: with a medium's API, a grid, or a mesh around the material of a volume."""
    (bound,) = prim.targets.get("material:binding", [""])
    return "PhotonBeamsMediumAPI" in prim.apis or prim.type == "Volume" or bound.startswith(f"{prim.path}/")


def ray_values(thing: Any, owner: Any, layer: Any, told: Told) -> Values:
    """Return the attributes of an object for other rays than all, as a view layer has it.

    `owner` is the object itself, or that which makes it as a copy.
    """
    own, values = owner.original, Values()
    if not thing.visible_camera:
        values["visibleInPrimaryRay"] = False
    if own.indirect_only_get(view_layer=layer):
        values["visibleInPrimaryRay"] = False
    if thing.type == "LIGHT":
        return values | _of_lamp(thing, told)
    if not thing.visible_shadow:
        values["primvars:arnold:visibility:shadow"] = False
    if own.holdout_get(view_layer=layer):
        values["primvars:arnold:matte"] = True
    return values


def _of_lamp(thing: Any, told: Told) -> Values:
    """Return what hides a lamp's light from fog, or from surfaces."""
    values: Values = {} if thing.visible_volume_scatter else {"photonbeams:enabled": False}
    if not thing.visible_diffuse:
        values |= {f"inputs:{name}": 0.0 for name in ("diffuse", "specular")}
    if thing.visible_glossy != thing.visible_diffuse or thing.visible_transmission != thing.visible_diffuse:
        told(f"{thing.name} is hidden from some surfaces, which is not rendered: all are as Diffuse says")
    return values
