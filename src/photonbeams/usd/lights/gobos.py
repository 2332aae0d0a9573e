"""Gobos: the images of `PhotonBeamsLightAPI` that a light shines through, and the texture of a rectangle light."""

from __future__ import annotations

import numpy as np

from ...scene import Array, Gobo, Mesh, rgb
from ..common.definitions import LIGHT, read_attribute
from ..common.openusd import Usd, UsdGeom
from ..common.reading import Reading
from ..common.textures import read_image


def read_gobo(reading: Reading, prim: Usd.Prim) -> Gobo | None:
    """Return the image in front of a light, or None.

    Raises
    ------
    SceneError
        An image cannot be read, an angle or a width is out of range, or a distant light's image has no width.
    """
    name, kind = "photonbeams:gobo", str(prim.GetTypeName())
    image = _image(reading, prim, name)
    if image is None:
        return None
    if kind.startswith("DomeLight"):
        reading.warn(prim, "is not rendered on a dome light: expected inputs:texture:file instead", name)
        return None
    wrap, angle, width = (read_attribute(reading, prim, LIGHT, f"gobo:{each}") for each in ("wrap", "angle", "width"))
    if width is None and kind == "DistantLight":
        text = "is not given: expected the image's width in scene units, for a distant light"
        raise reading.fail(prim, f"{name}:width", text)
    return Gobo(image, angle, 1.0 if width is None else width, wrap == "repeat")


def read_texture(reading: Reading, prim: Usd.Prim) -> Gobo | None:
    """Return the texture of a rectangle light, which lies on it as a gobo does, or None."""
    image = _image(reading, prim, "inputs:texture:file")
    return None if image is None else Gobo(image)


def read_portal_gobo(reading: Reading, prim: Usd.Prim, portal: Mesh | str | None) -> Gobo | None:
    """Return the image on a light's portal (a mesh, or the name of a Mitsuba shape), or None.

    Raises
    ------
    SceneError
        The image cannot be read, or the portal is not flat.
    """
    name = "photonbeams:portal:gobo"
    image = _image(reading, prim, name)
    if image is None:
        return None
    if portal is None:
        reading.warn(prim, "is not rendered: expected a photonbeams:portal for it to lie on", name)
        return None
    seen = reading.flag(prim, f"{name}:visible", False)
    if isinstance(portal, str):
        if seen:
            reading.warn(
                prim, "is not rendered on a shape of a Mitsuba scene: expected a pane of glass", f"{name}:visible"
            )
        return Gobo(image, up=_up(reading, np.zeros(3)))
    plane = portal.plane()
    if plane is None:
        raise reading.fail(prim, name, f"lies on {portal.name}, which is not flat: expected a portal in one plane")
    return Gobo(image, up=_up(reading, plane.normal), seen=seen)


def _up(reading: Reading, normal: Array) -> Array:
    """Return the direction of an image's upper edge: the stage's up axis or, for a skylight, the back of the stage."""
    up, back = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, -1.0])
    if UsdGeom.GetStageUpAxis(reading.stage) == UsdGeom.Tokens.z:
        up, back = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
    return back if abs(normal @ up) > 0.999 else up


def _image(reading: Reading, prim: Usd.Prim, name: str) -> Array | None:
    """Return an image that light passes through; if it is all black, this warns."""
    image = read_image(reading, prim, name)
    if image is not None and not np.any(rgb(image)):
        reading.warn(prim, "is black: no light passes through it", name)
    return image
