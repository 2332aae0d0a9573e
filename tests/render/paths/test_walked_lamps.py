"""Paths from the camera on stages: the light of each kind of lamp is that of beams and photons."""

import numpy as np
import pytest

import photonbeams as pb
from tests.helpers.sweep import sweep

#: A room with an open front, with a ball and a thin fog.
ROOM = """
def Mesh "Room"
{
    int[] faceVertexCounts = [4, 4, 4, 4, 4]
    int[] faceVertexIndices = [0, 1, 5, 4, 3, 7, 6, 2, 0, 4, 7, 3, 1, 2, 6, 5, 4, 5, 6, 7]
    point3f[] points = [(-2, -1, 3), (2, -1, 3), (2, 2, 3), (-2, 2, 3),
                        (-2, -1, -3), (2, -1, -3), (2, 2, -3), (-2, 2, -3)]
    uniform token subdivisionScheme = "none"
    bool doubleSided = 1
    color3f[] primvars:displayColor = [(0.7, 0.5, 0.3)]
}
def Sphere "Ball"
{
    double radius = 0.6
    double3 xformOp:translate = (0.3, -0.4, -0.5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Scope "Fog" (
    prepend apiSchemas = ["PhotonBeamsMediumAPI"]
)
{
    color3f photonbeams:scattering = (0.1, 0.12, 0.15)
    color3f photonbeams:absorption = (0.01, 0.01, 0.01)
}
def Camera "Camera"
{
    float focalLength = 20
    double3 xformOp:translate = (0, 0.4, 2.8)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""
LAMPS = {
    "RectLight": "float inputs:width = 1\nfloat inputs:height = 0.7\nfloat inputs:intensity = 6",
    "DiskLight": "float inputs:radius = 0.4\nfloat inputs:intensity = 9",
    "SphereLight": "float inputs:radius = 0.2\nfloat inputs:intensity = 9",
    "CylinderLight": "float inputs:radius = 0.1\nfloat inputs:length = 1\nfloat inputs:intensity = 6",
}


def lamp(kind):
    """Return a lamp below the ceiling."""
    return f"""
def {kind} "{kind}"
{{
    {LAMPS[kind]}
    double3 xformOp:translate = (-0.6, 1.7, 0.3)
    float3 xformOp:rotateXYZ = (-80, 10, 0)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
}}
"""


def means(shot, seeds=3, **settings):
    """Return the mean of several renders in the layers of surfaces and beams, and its standard error, (2, 2)."""
    frames = [shot.render(**{"width": 24, "height": 18, **settings}, seed=seed) for seed in range(seeds)]
    found = np.array([[each.layers[name][..., :3].mean() for name in ("surface", "beams")] for each in frames])
    return found.mean(axis=0), found.std(axis=0, ddof=1) / np.sqrt(seeds)


KINDS = {
    "one": ["RectLight"],
    "several": ["DiskLight", "CylinderLight", "SphereLight", "SphereLight"],
    "disk": ["DiskLight"],
    "three": ["CylinderLight", "SphereLight", "SphereLight"],
}


@pytest.mark.parametrize("kinds", sweep(KINDS.values(), ["several"], list(KINDS)), ids=list(KINDS))
def test_paths_from_the_camera_find_the_light_of_beams_and_photons(usd, kinds):
    lamps = "".join(lamp(kind).replace(f'"{kind}"', f'"Lamp{number}"') for number, kind in enumerate(kinds))
    shot = pb.Shot(usd(ROOM + lamps))
    # These are as many samples as 32 passes over 24 × 18 pixels have, by a sixteenth of the launches.
    paths, error = means(shot, width=96, height=72, passes=2, max_depth=4, method="paths")
    beams, own_error = means(shot, passes=4, max_depth=4, method="beams", beams=8192 if len(kinds) < 4 else 4096)
    # Few renders underestimate the errors; 1 % is the bias of wide beams and photons at this number of passes.
    assert np.all(np.abs(paths - beams) < 5 * np.hypot(error, own_error) + 0.01 * beams)
    assert np.all(paths > 0)


def test_stages_take_beams_unless_light_is_scattered_more_than_once(usd):
    """Without bounces nothing changes; with them, and without fog, paths from the camera light surfaces."""
    shot = pb.Shot(usd(ROOM + lamp("RectLight")))
    given = {"width": 8, "height": 6, "passes": 2}
    one, other = (shot.render(**given, **more).layers["rgba"] for more in ({}, {"method": "beams"}))
    assert np.array_equal(one, other)
    clear = pb.Shot(usd(ROOM.replace("(0.1, 0.12, 0.15)", "(0, 0, 0)") + lamp("RectLight")))
    one, other = (clear.render(**given, max_depth=4, **more).layers["rgba"] for more in ({}, {"method": "paths"}))
    assert np.array_equal(one, other)


#: The ball is of glass, and the fog, around it, ends within the room.
GLASS = ROOM.replace('def Sphere "Ball"\n{', '''def Material "Glass"
{
    token outputs:surface.connect = </Glass/Shader.outputs:surface>
    def Shader "Shader"
    {
        uniform token info:id = "UsdPreviewSurface"
        float inputs:opacity = 0
        float inputs:roughness = 0
        float inputs:ior = 1.5
        token outputs:surface
    }
}
def Sphere "Ball" (
    prepend apiSchemas = ["MaterialBindingAPI"]
)
{
    rel material:binding = </Glass>''').replace('def Scope "Fog"', 'def Cube "Fog"').replace(
    "color3f photonbeams:scattering", "double size = 2.4\n    color3f photonbeams:scattering"
)  # fmt: skip


@pytest.mark.parametrize("moving", sweep(["lamp", "ball", "lamp and ball"], ["lamp and ball"]))
def test_light_that_glass_turns_counts_once(usd, moving):
    """Caustics come from the lamp, all other light from paths, also beside bounded fog, while something moves."""
    text = GLASS + lamp("SphereLight")
    for place in [{"lamp": "(-0.6, 1.7, 0.3)", "ball": "(0.3, -0.4, -0.5)"}[name] for name in moving.split(" and ")]:
        x, rest = place[1:].split(",", 1)
        samples = f"{{0: {place}, 1: ({float(x) + 0.3},{rest}}}"
        text = text.replace(f"translate = {place}", f"translate.timeSamples = {samples}")
    text = text.replace("float focalLength = 20", "float focalLength = 20\n    double shutter:close = 1")
    shot = pb.Shot(usd(text))
    given = {"frame": 0, "max_depth": 4, "passes": 2, "beams": 4096, "width": 34, "height": 25, "guiding": False}
    paths, error = means(shot, method="paths", **given)
    beams, own_error = means(shot, method="beams", **given)
    assert np.all(np.abs(paths - beams) < 5 * np.hypot(error, own_error) + 0.015 * beams)
    assert np.all(paths > 0)
