"""Write a layer over an export: fog, portals, looks and light groups, with comments that explain each value.

The layer is text, because OpenUSD drops comments of layers that it reads and writes again.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from textwrap import fill, indent

from ...scene import Array, SceneError
from ...scene.places import origin_within
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
class ShaftLamp:
    """A lamp that makes a shaft: the path of its prim, and its openings, each the corners of a rectangle, (4, 3)."""

    path: str
    openings: Sequence[Array] = ()


@dataclass(frozen=True)
class SuggestedFog:
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

    text: str
    said: list[str]


def dressing(
    stage: Usd.Stage, path: Path, fog: SuggestedFog | None, lamps: Sequence[ShaftLamp], groups: Iterable[str] = ()
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
    said = [
        f"a fog with a scattering of {fog.scattering:g} per scene unit" if fog else "the export has fog, which stays"
    ]
    layer = _Layer(stage, _free(_ROOT, lambda name: bool(stage.GetPrimAtPath(f"/{name}"))), said, set(groups))
    if fog is not None:
        layer.own.append(
            _FOG.format(reason=_comment(fog.reason).replace("\n", "\n    "), amount=_triple([fog.scattering] * 3))
        )
    for lamp in lamps:
        layer.add(lamp)
    text = f"{_header(stage, path)}\n{layer.text()}"
    if not Sdf.Layer.CreateAnonymous(SUFFIX).ImportFromString(text):
        raise SceneError(f"{path} cannot be written: expected names of prims and files that a .usda layer can hold")
    return Dressing(text, said)


@dataclass
class _Over:
    """An over of a prim: comment and metadata, properties, and the overs below it; its own text is that within it."""

    comment: str = ""
    metadata: str = ""
    properties: list[str] = field(default_factory=list)
    below: dict[str, _Over] = field(default_factory=dict)

    def text(self) -> str:
        """Return the properties and the overs below."""
        overs = (
            f'{over.comment}over "{name}"{over.metadata}\n{_braced(over.text())}' for name, over in self.below.items()
        )
        return "\n".join(filter(None, ("".join(self.properties), *overs)))


@dataclass
class _Layer:
    """What is in the layer over a stage.

    Attributes
    ----------
    root
        The name of the prim that holds the layer's own ones.
    said
        Sentences about it, which grow.
    groups
        The light groups that there are.
    own, overs
        The layer's own prims, as text, and those over the export.
    """

    stage: Usd.Stage
    root: str
    said: list[str]
    groups: set[str]
    own: list[str] = field(default_factory=list)
    overs: _Over = field(default_factory=_Over)

    def text(self) -> str:
        """Return the layer's prims."""
        own = "\n".join(self.own)
        if own:
            adds = "# What photonbeams adds. Other programs do not know these prims."
            own = f'{adds}\ndef Scope "{self.root}"\n{_braced(own)}'
        return "\n".join(filter(None, (own, self.overs.text())))

    def add(self, lamp: ShaftLamp) -> None:
        """Add the values over a lamp that it needs, its look and its portals."""
        prim = self.stage.GetPrimAtPath(lamp.path) if Sdf.Path.IsValidPathString(lamp.path) else None
        if not prim or prim.IsInstanceProxy():
            self.said.append(f"{lamp.path} is an instance, which no layer can change: its beams stay as they are")
            return
        name, count = _name(prim, self.groups), len(lamp.openings)
        kept = [each for each in ("intensity", "lightGroup", "look", "portal") if _has(prim, each)]
        added, properties = [], [] if is_light(prim) else [_GLOWS]
        if "intensity" not in kept:
            properties.append(_INTENSITY)
        if "lightGroup" not in kept:
            properties.append(_GROUP.format(name=name))
            added.append("a light group")
        if "look" not in kept:
            self.own.append(_LOOK.format(name=name, path=lamp.path))
            properties.append(_LOOKS.format(root=self.root, name=name))
            added.append("a look")
        if "portal" not in kept and lamp.openings:
            names = [f"{name}_Portal{number or ''}" for number in range(count)]
            self.own += [_portal(each, lamp.path, corners) for each, corners in zip(names, lamp.openings, strict=True)]
            properties.append(_PORTALS.format(paths=", ".join(f"</{self.root}/{each}>" for each in names)))
            added.append("a portal" if count == 1 else f"{count} portals")
        stay = f"the export has its {', '.join(kept)}, which stay{'s' if len(kept) == 1 else ''}" if kept else ""
        self.said.append(f"{lamp.path}: {'; '.join(filter(None, (', '.join(added), stay)))}")
        if not properties:
            return
        over = self.overs
        for part in lamp.path.strip("/").split("/"):
            over = over.below.setdefault(part, _Over())
        over.comment, over.metadata = f"# The beams of {lamp.path}.\n", _API
        over.properties = properties


# -- the texts -------------------------------------------------------------------------------------------------------

_API = """ (
    prepend apiSchemas = ["PhotonBeamsLightAPI"]
)"""
_FOG = """\
# Fog fills all of space.
def Scope "Fog" (
    prepend apiSchemas = ["PhotonBeamsMediumAPI"]
)
{{
    # How much light the fog scatters per scene unit, in red, green and blue.
    {reason}
    # More makes shafts brighter and what is far away dimmer; unequal numbers colour it.
    color3f photonbeams:scattering = {amount}
    # How much light it swallows per scene unit: dark smoke, murky water.
    color3f photonbeams:absorption = (0, 0, 0)
    # From -0.99 to 0.99: above 0, as in dust and mist, shafts are brighter when they come toward the camera.
    float photonbeams:anisotropy = 0.3
    # 0: the fog shows shafts alone, and dims no surface.
    bool photonbeams:surfaces = 1
}}
"""
_GLOWS = """\
# A surface that glows is a lamp.
bool photonbeams:enabled = 1
"""
_INTENSITY = """\
# Brighter or darker shafts; surfaces stay as they are.
float photonbeams:intensity = 1
"""
_GROUP = """\
# Its beams have a layer of their own in the EXR, beams_{name}.
token photonbeams:lightGroup = "{name}"
"""
_LOOKS = """\
# How its beams look.
rel photonbeams:look = </{root}/{name}_Look>
"""
_PORTALS = """\
# The openings that its beams are aimed at, so that they are finer. Name meshes of your own instead, or remove the line:
# the picture is as bright.
rel photonbeams:portal = [{paths}]
"""
_LOOK = """\
# The look of the beams of {path}.
def PhotonBeamsLook "{name}_Look"
{{
    # The rim of beams: "biweight" is soft, "constant" is hard, "gaussian" is a bright core, "hollow" is a tube.
    uniform token photonbeams:across:profile = "biweight"
    # A colour on them.
    color3f photonbeams:along:tint = (1, 1, 1)
    # Clouds that drift through them: 0 is none, 1 is torn smoke.
    float photonbeams:noise:amount = 0
}}
"""
_PORTAL = """\
# An opening through which {path} lights what the camera sees.
def Mesh "{name}"
{{
    # A guide: no program draws it.
    uniform token purpose = "guide"
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    # Its corners, in the world's scene units, from the place that is its translation.
    point3f[] points = [{points}]
    # Points have single precision, which is coarse far from zero.
    double3 xformOp:translate = {origin}
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}
"""


def _portal(name: str, path: str, corners: Array) -> str:
    origin = origin_within(corners)
    points = ", ".join(map(_triple, corners - origin))
    return _PORTAL.format(name=name, path=path, points=points, origin=tuple(origin.tolist()))


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
    return "\n".join([first, _comment(text), *rest, ""])


def _comment(text: str) -> str:
    return indent(fill(text, _WIDTH), "# ")


def _braced(text: str) -> str:
    return f"{{\n{indent(text, '    ')}}}\n"


def _has(prim: Usd.Prim, name: str) -> bool:
    """Return whether the export sets an attribute of photonbeams on a lamp, or a relationship."""
    attribute = prim.GetAttribute(f"photonbeams:{name}")
    return bool(attribute and attribute.HasAuthoredValue()) or bool(target_paths(prim, f"photonbeams:{name}"))


def _name(prim: Usd.Prim, taken: set[str]) -> str:
    """Return a name for what belongs to a lamp: that of its prim, as a group may have it."""
    base = re.sub(r"\W", "_", prim.GetName(), flags=re.ASCII).strip("_") or "Lamp"
    name = _free(base if base[0].isalpha() else f"Lamp_{base}", taken.__contains__, "_")
    taken.add(name)
    return name


def _free(name: str, is_taken: Callable[[str], bool], between: str = "") -> str:
    """Return a name that is not taken: this one, or one with a number."""
    names = (name, *(f"{name}{between}{number}" for number in range(2, 10_000)))
    return next(each for each in names if not is_taken(each))


def _triple(values: Sequence[float] | Array) -> str:
    return f"({', '.join(f'{float(each) + 0.0:.6g}' for each in values)})"
