"""What the renderer says, in Blender's words: names of objects and panels instead of USD and the command."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

from ..scene.checks import shortened

#: The beginning of messages about a stage without a file, which Blender's is.
_STAGE = "the stage: "
#: Phrases that say what to do on a stage, and what to do in Blender instead.
_PHRASES = (
    (r"a prim with PhotonBeamsMediumAPI(, or a fog given by --scattering)?",
     "World > Volume, or a mesh whose material has a volume"),
    ("a UsdLux light", "a lamp"),
    ("drawn beams", "a curve with Object Data > Beams"),
    ("--exposure or inputs:exposure", "its Exposure"),
    (r"(nothing makes beams) at frame [^:]+", r"\1"),  # a scene that is sent has one frame, without its number
    (r"photonbeams:enabled on", "Object Data > Beams of"),
    (r"(inputs:intensity is )-[\d.e+-]+(?=:)", r"\1negative"),  # intensities are no watts
    (r"\ba prim(?![\w/-])", "an object"),
    ("on the stage", "in the scene"),
    ("a photonbeams:portal", "a portal (Object Data > Beams)"),
    (r"; for its own, set photonbeams:scattering[\w:, ]*", ""),
    (r"--set '?([^\s=]+)=([^\s']+)'?", r"\1 = \2"),
)  # fmt: skip
#: What is called otherwise in Blender than its name here says.
_NAMES = {
    "photonbeams:enabled": "Beams", "inputs:intensity": "Power", "photonbeams:intensity": "Beams > Intensity in Fog",
    "photonbeams:count": "Beams > Count", "photonbeams:seed": "Beams > Seed", "photonbeams:portal": "Beams > Portal",
    "photonbeams:portal:gobo": "Beams > Portal Image", "photonbeams:gobo": "Beams > Gobo",
    "photonbeams:scattered": "Beams > Scattered Light", "inputs:texture:file": "image", "inputs:file": "image",
    "inputs:shaping:ies:file": "IES Texture", "filePath": "file", "material:binding": "Material",
    "focalLength": "Lens > Focal Length", "horizontalAperture": "Camera > Size", "fStop": "Depth of Field > F-Stop",
    "focusDistance": "Depth of Field > Focus Distance", "clippingRange": "Lens > Clip Start and End",
    "--res": "Format > Resolution", "--crop": "Format > Render Region", "--passes": "Sampling > Passes",
    "--error": "Sampling > Error", "--time-limit": "Sampling > Time Limit", "--seed": "Sampling > Seed",
    "--denoise": "Sampling > Denoise", "--bounces": "Light > Bounces", "--beams": "Light > Light Paths",
    "--estimator": "Light > Estimator", "--exposure": "Exposure", "prim": "object", "prims": "objects",
    "gprim": "mesh", "gprims": "meshes", "primvar": "attribute", "primvars": "attributes", "stage": "scene",
    "stages": "scenes",
}  # fmt: skip
_NAMESPACE = r"(?:photonbeams|inputs|primvars|shaping|collection|light):[\w:]*\w"
_PATH = r"(?<![\w…./])(?P<path>/\w+(?:/\w+)*)(?:\.(?P<attribute>[A-Za-z][\w:]*))?"
# Blender's extension writes images that have no file of their own, and grids, into such folders.
_TEMPORARY = re.compile(r"\S*[/\\]photonbeams\w{8}[/\\](?:\d+_)?(?=\w)")
# Words, none of them a part of a file's name.
_SINGLE = r"--[a-z][a-z-]*|g?prim(?:var)?s?|stages?|fStop|horizontalAperture|\w+API"
_WORD = rf"(?<![\w/.-])(?:{_NAMESPACE}|{_SINGLE})(?![\w/-]|\.\w)"
_FOREIGN = re.compile(f"{_PATH}|{_WORD}")  # at once: a lamp may be called "stage left"


class Words:
    """Translates messages about a scene that Blender has sent."""

    def __init__(self) -> None:
        self._names: dict[str, str] = {}

    def learn(self, prims: Iterable[Mapping[str, Any]]) -> None:
        """Learn what descriptions of prims are called in Blender: by their `name`, or as what they are a part of."""
        for each in prims:
            path = each["path"]
            self._names[path] = each.get("name") or self._names.get(path.rpartition("/")[0], path.rpartition("/")[2])

    def of(self, text: str) -> str:
        """Return a message in Blender's words."""
        text = _TEMPORARY.sub("", text.replace(_STAGE, ""))
        for pattern, said in _PHRASES:
            text = re.sub(pattern, said, text)
        return shortened(_FOREIGN.sub(self._said, text))

    def _said(self, found: re.Match[str]) -> str:
        path, attribute = found["path"], found["attribute"]
        if path is None:
            return _name(found[0])
        if path not in self._names:  # a file's
            return found[0]
        return self._names[path] + (f": {_name(attribute)}" if attribute else "")


def _name(name: str) -> str:
    """Return what an attribute, a flag or a word is called in Blender."""
    if name in _NAMES:
        return _NAMES[name]
    bare = re.sub(r"^(photonbeams|inputs|primvars|--)[:]?|API$", "", name)
    return re.sub(r"[:_-]+|(?<=[a-z])(?=[A-Z])", " ", bare).title()
