"""The stages of the matrix, as text: a box of fog in the dark, lit from above, seen from outside."""

from __future__ import annotations

HEAD = '#usda 1.0\n(\n    metersPerUnit = 1\n    upAxis = "Y"\n)\n'

CAMERA = """
def Camera "Camera"
{
    float focalLength = 24
    float horizontalAperture = 20
    float verticalAperture = 11.25
    double3 xformOp:translate = (0, 0.1, 4)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""

LAMP = """
def SphereLight "Lamp"
{
    float inputs:intensity = 200
    color3f inputs:color = (1, 0.8, 0.5)
    float inputs:radius = 0.1
    double3 xformOp:translate = (-0.5, 1.8, 0.3)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""


def fog(scattering: object = (0.4, 0.4, 0.4), absorption: object = (0.1, 0.1, 0.1), anisotropy: float = 0.0) -> str:
    """Return a box of fog, [-1, 1] x [-1, 1] x [-1, 1]."""
    return f"""
def Cube "Fog" (prepend apiSchemas = ["PhotonBeamsMediumAPI"])
{{
    color3f photonbeams:scattering = {scattering}
    color3f photonbeams:absorption = {absorption}
    float photonbeams:anisotropy = {anisotropy}
}}
"""


def stage(*parts: str) -> str:
    """Return the text of a stage."""
    return HEAD + "".join(parts)
