"""Panoramic cameras: by `PhotonBeamsCameraAPI`, or as Arnold, Omniverse and RenderMan write them.

Other programs say so by attributes of their own beside a `projection` that is perspective. What is none of
`scene.cameras.PROJECTIONS` is told, and rendered in perspective.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...scene.cameras import EQUIRECTANGULAR, FISHEYES, PROJECTIONS
from ..common.definitions import CAMERA, read_attribute
from ..common.openusd import Usd
from ..common.reading import Reading, target_paths

# What is perspective or orthographic, as the camera's `projection` says.
_PLAIN = {"", "pinhole", "persp_camera", "ortho_camera", "PxrCamera", "PxrPerspective", "PxrOrthographic"}
_NAMES = {each: each for each in FISHEYES} | {
    "spherical_camera": EQUIRECTANGULAR, "fisheyeSpherical": EQUIRECTANGULAR,
    "PxrSphereCamera": EQUIRECTANGULAR, "fisheye_camera": "fisheyeEquidistant",
}  # fmt: skip
_POLYNOMIALS = ("fisheyePolynomial", "ftheta")  # of Omniverse: the angle in radians for a radius in pixels


@dataclass(frozen=True)
class Panorama:
    """The projection of a panoramic camera.

    Attributes
    ----------
    projection, field
        As for `scene.Camera.panorama`; an empty field is the usual one.
    shift
        How far the film is shifted right and up, as fractions of its size.
    """

    projection: str
    field: Sequence[float] = ()
    shift: tuple[float, float] = (0.0, 0.0)


def read_panorama(reading: Reading, prim: Usd.Prim) -> Panorama | None:
    """Return a camera's panoramic projection; None if it is perspective or orthographic."""
    own = read_attribute(reading, prim, CAMERA, "projection")
    if own != PROJECTIONS[0]:
        field = tuple(read_attribute(reading, prim, CAMERA, "fieldOfView"))
        return Panorama(own, field if any(field) else ())
    for attribute, name in _spellings(reading, prim):
        if name in _PLAIN:
            continue
        found = _linear(reading, prim) if name in _POLYNOMIALS else _NAMES.get(name) and _known(reading, prim, name)
        if found:
            return found
        text = f"is {name}, which is not rendered: the camera is in perspective, as its focalLength and apertures say"
        reading.warn(prim, text, attribute)
    return None


def _spellings(reading: Reading, prim: Usd.Prim) -> list[tuple[str, str]]:
    """Return what attributes say about the projection, by their names."""
    names = ("primvars:arnold:camera", "cameraProjectionType", "omni:lensdistortion:model")
    found = [(name, str(reading.value(prim, name, "") or "")) for name in names]
    for name in ("ri:projection", "outputs:ri:projection"):
        for target in _projections(prim, name):
            shader = reading.value(target, "info:id")
            found.append((name, str(shader or target.GetTypeName())))
    if reading.value(prim, "karma:camera:use_lensshader"):
        found.append(("karma:camera:use_lensshader", "a lens shader"))
    return found


def _projections(prim: Usd.Prim, name: str) -> list[Usd.Prim]:
    """Return the prims of RenderMan's projections, to which a relationship or a connection leads."""
    attribute = prim.GetAttribute(name)
    paths = attribute.GetConnections() if attribute else target_paths(prim, name)
    found = (prim.GetStage().GetPrimAtPath(each.GetPrimPath()) for each in paths)
    return [each for each in found if each]


def _known(reading: Reading, prim: Usd.Prim, name: str) -> Panorama:
    """Return the projection of another program by its name, with the field of view that the program knows."""
    field: tuple[float, ...] = ()
    if name == "PxrSphereCamera":
        given = {"hsweep": 360.0, "vsweep": 180.0}
        for target in [*_projections(prim, "ri:projection"), *_projections(prim, "outputs:ri:projection")]:
            for attribute in target.GetAttributes():
                if (sweep := attribute.GetName().rpartition(":")[2]) in given:
                    given[sweep] = reading.number(target, attribute.GetName(), given[sweep])
        field = tuple(given.values())
    elif name == "fisheye_camera":  # Arnold's own angle, or that of the aperture
        wide, focal = (reading.positive(prim, each, 1.0) for each in ("horizontalAperture", "focalLength"))
        angle = reading.number(prim, "primvars:arnold:fov", 2 * float(np.degrees(np.arctan(wide / (2 * focal)))))
        field = angle, angle
    elif _NAMES[name] != EQUIRECTANGULAR:
        angle = reading.number(prim, "fthetaMaxFov", 0.0)
        field = (angle, angle) if angle else ()
    return Panorama(_NAMES[name], field)


def _linear(reading: Reading, prim: Usd.Prim) -> Panorama | None:
    """Return Omniverse's polynomial fisheye if it is linear, which is equidistant; else None."""

    def numbers(old: str, new: str, default: Any) -> float:
        return float(reading.number(prim, old, reading.number(prim, f"omni:lensdistortion:ftheta:{new}", default)))

    rest = [numbers(f"fthetaPoly{letter}", f"k{power}", 0.0) for power, letter in enumerate("ABCDE")]
    slope = rest.pop(1)
    width, height = numbers("fthetaWidth", "nominalWidth", 0.0), numbers("fthetaHeight", "nominalHeight", 0.0)
    if any(rest) or not (slope > 0 and width > 0 and height > 0):
        return None
    middle = reading.vector(prim, "omni:lensdistortion:ftheta:opticalCenter", (width / 2, height / 2))
    x, y = (reading.number(prim, f"fthetaC{axis}", own) for axis, own in zip("xy", middle, strict=True))
    field = float(np.degrees(width * slope)), float(np.degrees(height * slope))
    return Panorama("fisheyeEquidistant", field, (0.5 - x / width, y / height - 0.5))
