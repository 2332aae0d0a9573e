"""Write a layer over an export: fog, portals, looks and light groups, with comments that explain each value.

The layer is text, because OpenUSD drops comments of layers that it reads and writes again.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from textwrap import wrap

from ...scene import Array, SceneError
from ...scene.places import origin_within
from ..common.definitions import LOOK
from ..common.openusd import Sdf, Usd
from ..common.reading import target_paths
from ..lights.light import is_light

SUFFIX = ".usda"
_ROOT = "Beams"  # the name of the prim that holds the layer's own
_METADATA = (
    "defaultPrim", "metersPerUnit", "upAxis", "timeCodesPerSecond", "framesPerSecond", "startTimeCode", "endTimeCode",
    "renderSettingsPrimPath", "expressionVariables",
)  # fmt: skip
_ALWAYS = ("metersPerUnit", "upAxis")  # also where the export says nothing, and OpenUSD's fallback counts
_WIDTH = 100


@dataclass(frozen=True)
class Lamp:
    """A lamp that makes a shaft: the path of its prim, and its openings, each the corners of a rectangle, (4, 3)."""

    path: str
    openings: Sequence[Array] = ()


@dataclass(frozen=True)
class Fog:
    """A fog for an export: its scattering per scene unit, and why it is that."""

    scattering: float
    reason: str


@dataclass
class Dressing:
    """A layer over an export.

    Attributes
    ----------
    text
        The layer.
    said
        Sentences about what is in it, and about what the export already has, which stays.
    """

    text: str = ""
    said: list[str] = field(default_factory=list)


def dressing(
    stage: Usd.Stage, path: Path, fog: Fog | None, lamps: Sequence[Lamp], groups: Iterable[str] = ()
) -> Dressing:  # fmt: skip
    """Return a layer over the root layer of a stage, for a file at a path.

    Parameters
    ----------
    fog
        The fog; None: the export has one, which stays.
    lamps
        Lamps that make shafts. Their looks, groups and portals that the export has stay.
    groups
        The light groups of the export: new ones have other names.
    """
    result = Dressing()
    if fog is None:
        result.said.append("the export has fog, which stays")
    else:
        result.said.append(f"a fog with a scattering of {fog.scattering:g} per scene unit")
    root = _free(stage, _ROOT)
    own = _Prim("def Scope", root, comment="What photonbeams adds. Other programs do not know these prims.")
    if fog is not None:
        own.children.append(_fog(fog))
    overs = _Prim("", "")
    taken = set(groups)
    for lamp in lamps:
        over = _lamp(stage, lamp, own, taken, result.said)
        if over is not None:
            _place(overs, lamp.path, over)
    body = [*([own] if own.children else []), *overs.children]
    result.text = "\n".join([_header(stage, path), *(line for each in body for line in ["", *each.lines()])]) + "\n"
    if not Sdf.Layer.CreateAnonymous(SUFFIX).ImportFromString(result.text):
        raise SceneError(f"{path} cannot be written: expected names of prims and files that a .usda layer can hold")
    return result


# -- prims as text ---------------------------------------------------------------------------------------------------


@dataclass
class _Prim:
    """A prim in the layer: its specifier and type, name, schema, lines of its properties, and children."""

    kind: str
    name: str
    api: str = ""
    comment: str = ""
    properties: list[str] = field(default_factory=list)
    children: list[_Prim] = field(default_factory=list)

    def add(self, comment: str, line: str) -> None:
        self.properties += [*_comment(comment), line]

    def lines(self) -> Iterator[str]:
        """Yield the lines of the prim and its children."""
        yield from _comment(self.comment)
        yield f'{self.kind} "{self.name}"' + (" (" if self.api else "")
        if self.api:
            yield f'    prepend apiSchemas = ["{self.api}"]'
            yield ")"
        yield "{"
        for line in self.properties:
            yield f"    {line}"
        for index, each in enumerate(self.children):
            if index or self.properties:
                yield ""
            yield from (f"    {line}" if line else "" for line in each.lines())
        yield "}"


def _comment(text: str) -> list[str]:
    return [f"# {line}" for line in wrap(text, _WIDTH)]


def _place(root: _Prim, path: str, prim: _Prim) -> None:
    """Put a prim at a path, below overs of the prims above it."""
    for name in path.strip("/").split("/")[:-1]:
        found = next((each for each in root.children if each.name == name), None)
        if found is None:
            found = _Prim("over", name)
            root.children.append(found)
        root = found
    same = next((each for each in root.children if each.name == prim.name), None)
    if same is None:
        root.children.append(prim)
    else:  # a lamp above another one
        same.api, same.comment, same.properties = prim.api, prim.comment, prim.properties


def _header(stage: Usd.Stage, path: Path) -> str:
    """Return the layer's metadata: its sublayers, session layers and the export, and units and times of the export."""
    source, layer = stage.GetRootLayer(), Sdf.Layer.CreateAnonymous(SUFFIX)
    export = source.realPath or source.identifier
    below = (os.path.relpath(each, path.parent) for each in (*stage.GetSessionLayer().subLayerPaths, export))
    relative = (each.replace(os.sep, "/") for each in below)
    layer.subLayerPaths = [each if each.startswith("../") else f"./{each}" for each in relative]
    for name in _METADATA:
        if source.pseudoRoot.HasInfo(name):
            layer.pseudoRoot.SetInfo(name, source.pseudoRoot.GetInfo(name))
        elif name in _ALWAYS or stage.HasAuthoredMetadata(name):
            layer.pseudoRoot.SetInfo(name, stage.GetMetadata(name))
    first, *rest = layer.ExportToString().strip().splitlines()
    text = (
        f"Light beams over {Path(export).name}, which stays as it is: export again, and this layer still fits. Change "
        "the numbers here, and render this file. A line that you remove has its default again. Units and times repeat "
        "those of the export, because OpenUSD takes them from the top layer alone."
    )
    return "\n".join([first, *_comment(text), *rest])


def _free(stage: Usd.Stage, name: str) -> str:
    """Return a name of a root prim that the stage does not have."""
    names = (name, *(f"{name}{number}" for number in range(2, 10_000)))
    return next(each for each in names if not stage.GetPrimAtPath(f"/{each}"))


# -- what is in the layer --------------------------------------------------------------------------------------------


def _fog(fog: Fog) -> _Prim:
    result = _Prim("def Scope", "Fog", "PhotonBeamsMediumAPI", "Fog fills all of space.")
    result.add(
        f"How much light the fog scatters per scene unit, in red, green and blue. {fog.reason} More makes shafts "
        "brighter and what is far away dimmer; unequal numbers colour it.",
        f"color3f photonbeams:scattering = {_triple(3 * [fog.scattering])}",
    )
    result.add(
        "How much light it swallows per scene unit: dark smoke, murky water.",
        "color3f photonbeams:absorption = (0, 0, 0)",
    )
    result.add(
        "From -0.99 to 0.99: above 0, as in dust and mist, shafts are brighter when they come toward the camera.",
        "float photonbeams:anisotropy = 0.3",
    )
    result.add(
        "0: the fog shows shafts alone, and dims no surface.",
        "bool photonbeams:surfaces = 1",
    )
    return result


def _lamp(stage: Usd.Stage, lamp: Lamp, own: _Prim, taken: set[str], said: list[str]) -> _Prim | None:
    """Return the values over a lamp, and add its look and its portals to the layer's own; None if none are needed."""
    prim = stage.GetPrimAtPath(lamp.path) if Sdf.Path.IsValidPathString(lamp.path) else None
    if not prim or prim.IsInstanceProxy():
        said.append(f"{lamp.path} is an instance, which no layer can change: its beams stay as they are")
        return None
    name, count = _name(prim, taken), len(lamp.openings)
    result = _Prim("over", prim.GetName(), "PhotonBeamsLightAPI", f"The beams of {lamp.path}.")
    if not is_light(prim):
        result.add("A surface that glows is a lamp.", "bool photonbeams:enabled = 1")
    added, kept = [], [each for each in ("intensity", "lightGroup", "look", "portal") if _has(prim, each)]
    if "intensity" not in kept:
        result.add("Brighter or darker shafts; surfaces stay as they are.", "float photonbeams:intensity = 1")
    if "lightGroup" not in kept:
        text = f"Its beams have a layer of their own in the EXR, beams_{name}."
        result.add(text, f'token photonbeams:lightGroup = "{name}"')
        added.append("a light group")
    if "look" not in kept:
        own.children.append(_look(name, lamp.path))
        result.add("How its beams look.", f"rel photonbeams:look = </{own.name}/{name}_Look>")
        added.append("a look")
    if "portal" not in kept and lamp.openings:
        names = [f"{name}_Portal{number or ''}" for number in range(count)]
        own.children += [_portal(*each, lamp.path) for each in zip(names, lamp.openings, strict=True)]
        result.add(*_to_portals([f"</{own.name}/{each}>" for each in names]))
        added.append("a portal" if count == 1 else f"{count} portals")
    stay = f"the export has its {', '.join(kept)}, which stay{'s' if len(kept) == 1 else ''}" if kept else ""
    said.append(f"{lamp.path}: {'; '.join(filter(None, (', '.join(added), stay)))}")
    return result if result.properties else None


def _to_portals(targets: list[str]) -> tuple[str, str]:
    """Return the comment on the portals of a lamp, and the relationship to them."""
    openings, meshes = ("opening", "a mesh") if len(targets) == 1 else ("openings", "meshes")
    text = (
        f"The {openings} that its beams are aimed at, so that they are finer. Name {meshes} of your own instead, or "
        "remove the line: the picture is as bright."
    )
    named = targets[0] if len(targets) == 1 else f"[{', '.join(targets)}]"
    return text, f"rel photonbeams:portal = {named}"


def _has(prim: Usd.Prim, name: str) -> bool:
    """Return whether the export sets an attribute of photonbeams on a lamp, or a relationship."""
    attribute = prim.GetAttribute(f"photonbeams:{name}")
    return bool(attribute and attribute.HasAuthoredValue()) or bool(target_paths(prim, f"photonbeams:{name}"))


def _look(name: str, path: str) -> _Prim:
    result = _Prim(f"def {LOOK}", f"{name}_Look", comment=f"The look of the beams of {path}.")
    result.add(
        'The rim of beams: "biweight" is soft, "constant" is hard, "gaussian" is a bright core, "hollow" is a tube.',
        'uniform token photonbeams:across:profile = "biweight"',
    )
    result.add("A colour on them.", "color3f photonbeams:along:tint = (1, 1, 1)")
    result.add(
        "Clouds that drift through them: 0 is none, 1 is torn smoke.",
        "float photonbeams:noise:amount = 0",
    )
    return result


def _portal(name: str, corners: Array, path: str) -> _Prim:
    result = _Prim("def Mesh", name, comment=f"An opening through which {path} lights what the camera sees.")
    result.add("A guide: no program draws it.", 'uniform token purpose = "guide"')
    result.properties += [
        "int[] faceVertexCounts = [4]",
        "int[] faceVertexIndices = [0, 1, 2, 3]",
    ]
    origin = origin_within(corners)
    places = ", ".join(_triple(corner) for corner in corners - origin)
    result.add("Its corners, in the world's scene units.", f"point3f[] points = [{places}]")
    if origin.any():
        text = "From where they are measured: points have single precision, which is coarse far from zero."
        result.add(text, f"double3 xformOp:translate = {tuple(origin.tolist())}")
        result.properties.append('uniform token[] xformOpOrder = ["xformOp:translate"]')
    return result


def _name(prim: Usd.Prim, taken: set[str]) -> str:
    """Return a name for what belongs to a lamp: that of its prim, as a group may have it."""
    base = re.sub(r"\W", "_", prim.GetName(), flags=re.ASCII).strip("_") or "Lamp"
    base = base if base[0].isalpha() else f"Lamp_{base}"
    names = (base, *(f"{base}_{number}" for number in range(2, 10_000)))
    name = next(each for each in names if each not in taken)
    taken.add(name)
    return name


def _triple(values: Sequence[float] | Array) -> str:
    return f"({', '.join(f'{float(each) + 0.0:.6g}' for each in values)})"
