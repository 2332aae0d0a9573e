"""Scenes of Mitsuba 0.5 and 0.6 in the form of Mitsuba 3, where that is plain.

Mitsuba 3 itself renames properties (`maxDepth` to `max_depth`). What it does not convert is here: elements, colours
that are written as spectra, films, samplers, integrators, media, textures. All else is left as it is, and refused by
Mitsuba if it is unknown to it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from ..runtime.device import mitsuba

_VERSION = re.compile(rb"<\w+[^<>]*\sversion\s*=\s*[\"'](0\.[\d.]*)")
_BEGINNING = 1 << 16  # bytes in which the root element begins
_DEEPEST = 15  # files that include each other, as in Mitsuba

# The properties that remain; a render needs nothing else of these, or writes its own files.
_KEPT = {
    "film": ("width", "height", "cropOffsetX", "cropOffsetY", "cropWidth", "cropHeight", "rfilter"),
    "sampler": ("sampleCount", "seed"),
    "integrator": ("maxDepth", "rrDepth", "hideEmitters"),
}
_EMITTED = ("radiance", "intensity", "irradiance")  # the names of what emitters emit
_COEFFICIENTS = ("sigmaA", "sigmaS", "sigmaT")  # of media
_TYPES = {"film": "hdrfilm", "sampler": "independent", "integrator": "volpath"}


def version_of(path: Path) -> str | None:
    """Return the version of a scene of Mitsuba 0.5 or 0.6, or None for newer scenes and other files."""
    found = _root(path)
    return None if found is None else found[1].decode()


def _root(path: Path) -> re.Match[bytes] | None:
    """Return where the root element of an old scene begins, or None for other files."""
    try:
        with path.open("rb") as file:
            return _VERSION.search(file.read(_BEGINNING))
    except OSError:
        return None


def converted(path: Path) -> str | None:
    """Return a scene of Mitsuba 0.5 or 0.6 as the text of one that Mitsuba 3 reads; None for all other files."""
    start = _root(path)
    root = None if start is None else _tree(path)
    if start is None or root is None:
        return None
    _include(root, path.parent, _DEEPEST)
    for element in [*root.iter()]:
        if isinstance(element.tag, str):  # comments have a function
            _convert(element)
    above = start.string[: start.start()].count(b"\n")  # lines, so that messages name the file's own
    return "\n" * above + ElementTree.tostring(root, encoding="unicode")


class Parsed(NamedTuple):
    """Mitsuba's parsed form of a scene, and the text in which its messages count lines: it must live as long."""

    state: Any
    text: str | None


def parse(path: Path, parameters: Mapping[str, str]) -> Parsed:
    """Return a file as Mitsuba has parsed it; RuntimeError if Mitsuba cannot."""
    parser, variant = mitsuba().parser, mitsuba().variant()
    text = converted(path)
    config = parser.ParserConfig(variant)
    if text is None:
        return Parsed(parser.parse_file(config, str(path), **parameters), None)
    return Parsed(parser.parse_string(config, text, **parameters), text)


def _tree(path: Path) -> Element | None:
    """Return the root element of a file, or None if there is none; comments are kept, so that lines are the same."""
    parser = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))
    try:
        return ElementTree.parse(path, parser).getroot()
    except (OSError, ElementTree.ParseError):
        return None


def _include(element: Element, folder: Path, left: int) -> None:
    """Replace the elements that include old scenes by what is in these."""
    for index, child in reversed([*enumerate(element)]):
        path = folder / child.get("filename", "")
        if child.tag == "include" and left and version_of(path) is not None:
            inner = _tree(path)
            if inner is not None:
                _include(inner, folder, left - 1)
                element[index : index + 1] = [*inner]
        elif isinstance(child.tag, str):
            _include(child, folder, left)


def _convert(element: Element) -> None:
    """Convert an element, apart from its children."""
    element.attrib.pop("intent", None)
    kind = element.tag
    if kind == "lookAt":
        element.tag = "lookat"
    elif kind in ("spectrum", "srgb") and (color := _color(element)) is not None:
        # One number is grey there; in Mitsuba 3 it is the same number at all wavelengths, which is reddish light.
        if kind == "srgb" or len(color) == 3 or element.get("name") in _EMITTED:
            _make_color(element, [_linear(each) for each in color] if kind == "srgb" else color)
    elif kind in _KEPT and element.get("type") != "photon_beams":
        element.set("type", _TYPES[kind])
        _remove(element, lambda child: (child.get("name") or child.tag) not in _KEPT[kind])
    elif kind == "medium":
        _convert_medium(element)
    elif kind == "shape":
        _convert_shape(element)
    elif kind == "texture" and element.get("type") == "bitmap":
        _convert_bitmap(element)
    elif kind == "volume" and element.get("type") == "gridvolume":
        _remove(element, lambda child: child.get("name") == "sendData")
        ElementTree.SubElement(element, "boolean", name="useGridBbox", value="true")


def _convert_shape(element: Element) -> None:
    """Make a boundary of media that has no BSDF one that light passes: Mitsuba 3 would make it diffuse."""
    names = [child.get("name") for child in element if child.tag in ("medium", "ref", "bsdf")]
    boundary = [name for name in names if name in ("interior", "exterior")]
    if boundary and len(boundary) == len(names):
        ElementTree.SubElement(element, "bsdf", type="null")


def _convert_medium(element: Element) -> None:
    """Convert a medium: σa and σs to σt and albedo, and the names of density and scale."""
    _make_homogeneous(element)
    named = {child.get("name"): child for child in element}
    for old, new in (("density", "sigmaT"), ("densityMultiplier", "scale")):
        if old in named:
            named[old].set("name", new)
            named[new] = named[old]
    _remove(element, lambda child: child.get("name") in ("method", "stepSize", "stepSizeMultiplier"))
    colors = {name: _color(named[name]) or _sampled(named[name]) for name in _COEFFICIENTS if name in named}
    absorption, scattering, total = map(colors.get, _COEFFICIENTS)
    if absorption and scattering:
        pairs = [*zip(*(each * (3 // len(each)) for each in (absorption, scattering)), strict=True)]
        total, own = [a + s for a, s in pairs], named["sigmaA"]
        albedo = [s / both if both > 0 else 0.0 for (_, s), both in zip(pairs, total, strict=True)]
        _make_color(named["sigmaS"], albedo, "albedo")
    elif total:
        own = named["sigmaT"]
    else:
        return
    scale = named.get("scale")
    most, factor = max(*total, 1.0), [1.0] if scale is None else _color(scale)
    if most > 1 and factor is not None:  # Mitsuba 3 takes colours of a medium up to 1
        if scale is None:
            scale = ElementTree.SubElement(element, "float", name="scale")
        scale.set("value", repr(most * factor[0]))
        total = [each / most for each in total]
    _make_color(own, total, "sigmaT")


def _make_homogeneous(element: Element) -> None:
    """Make a medium homogeneous if its volumes are constants, which in Mitsuba 3 are not endless."""
    volumes = [child for child in element if child.tag == "volume"]
    values = [next((child for child in each if child.get("name") == "value"), each) for each in volumes]
    colors = [_color(each) for each in values]
    if not volumes or not all(each.get("type") == "constvolume" for each in volumes) or None in colors:
        return
    element.set("type", "homogeneous")
    for volume, color in zip(volumes, colors, strict=True):
        del volume[:]
        _make_color(volume, color or [])


def _convert_bitmap(element: Element) -> None:
    """Convert a texture: pixels of gamma 1 are raw; filters that Mitsuba 3 does not have are bilinear."""
    gamma = next((child for child in element if child.get("name") == "gamma"), None)
    if gamma is not None and gamma.get("value", "").strip() in ("1", "1.0"):
        gamma.tag, gamma.attrib = "boolean", {"name": "raw", "value": "true"}
    filters = {"name": "filterType", "value": "nearest"}
    _remove(element, lambda child: child.get("name") in ("maxAnisotropy", "cache"))
    _remove(element, lambda child: child.get("name") == "filterType" and child.attrib != filters)


def _remove(element: Element, unwanted: Callable[[Element], bool]) -> None:
    """Make empty comments of the unwanted children, of as many lines: messages name the lines of the file."""
    for child in element:
        if isinstance(child.tag, str) and unwanted(child):
            child.text = "\n" * "".join(child.itertext()).count("\n")
            child.tag = ElementTree.Comment  # type: ignore[assignment]


def _color(element: Element) -> list[float] | None:
    """Return the one number or the three of a colour, or None for spectra, parameters and the like."""
    text = element.get("value", "").strip()
    if element.tag == "srgb" and re.fullmatch(r"#[0-9a-fA-F]{6}", text):
        return [int(text[at : at + 2], 16) / 255 for at in (1, 3, 5)]
    try:
        numbers = [float(each) for each in re.split(r"[\s,]+", text)]
    except ValueError:
        return None
    return numbers if len(numbers) in (1, 3) else None


def _sampled(element: Element) -> list[float] | None:
    """Return the colour of a spectrum that is given at wavelengths, as Mitsuba converts it; None for others."""
    try:
        pairs = [tuple(map(float, each.split(":"))) for each in re.split(r"[\s,]+", element.get("value", "").strip())]
        wavelengths, values = zip(*pairs, strict=True)
    except ValueError:
        return None
    return [*map(float, mitsuba().spectrum_list_to_srgb([*wavelengths], [*values], False))]


def _make_color(element: Element, color: list[float], name: str = "") -> None:
    numbers = color * (3 // len(color))
    element.tag, element.attrib = (
        "rgb",
        {"name": name or element.get("name", ""), "value": ", ".join(map(repr, numbers))},
    )


def _linear(value: float) -> float:
    """Return a value of sRGB as light."""
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4
