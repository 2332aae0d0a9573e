"""Surfaces by light group: with lamps of pure red, green and blue, each group is one channel of the picture."""

import numpy as np
import pytest

import photonbeams as pb
from photonbeams.runtime.device import mitsuba

mi = mitsuba()

COLOURS = {"red": (1, 0, 0), "green": (0, 1, 0), "blue": (0, 0, 1)}
SMOOTH = "float inputs:roughness = 0"
SIZE = {"width": 24, "height": 16}


def lamp(kind, name, group, place, more=""):
    return f"""def {kind} "{name}"
{{
    color3f inputs:color = {COLOURS[group]}
    token photonbeams:lightGroup = "{group}"
    double3 xformOp:translate = {place}
    uniform token[] xformOpOrder = ["xformOp:translate"]
    {more}
}}
"""


def material(name, values):
    return f"""def Material "{name}"
{{
    token outputs:surface.connect = </{name}/Shader.outputs:surface>
    def Shader "Shader"
    {{
        uniform token info:id = "UsdPreviewSurface"
        {values}
        token outputs:surface
    }}
}}
"""


def ball(name, place, look, more=""):
    return f"""def Sphere "{name}" (prepend apiSchemas = ["MaterialBindingAPI"])
{{
    double radius = 0.5
    rel material:binding = </{look}>
    double3 xformOp:translate = {place}
    uniform token[] xformOpOrder = ["xformOp:translate"]
    {more}
}}
"""


def square(name, points, more=""):
    return f"""def Mesh "{name}" ({'prepend apiSchemas = ["MeshLightAPI"]' if more else ""})
{{
    point3f[] points = {points}
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    {more}
}}
"""


STAGE = (
    """#usda 1.0
(
    upAxis = "Z"
    metersPerUnit = 1
)
def Camera "Camera"
{
    float focalLength = 18
    double3 xformOp:translate = (0, -3.8, 1.5)
    float3 xformOp:rotateXYZ = (80, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
}
def Scope "Fog" (prepend apiSchemas = ["PhotonBeamsMediumAPI"])
{
    color3f photonbeams:scattering = (0.02, 0.02, 0.02)
}
"""
    + material("Mirror", f"float inputs:metallic = 1\n{SMOOTH}\ncolor3f inputs:diffuseColor = (0.9, 0.9, 0.9)")
    + material("Glass", f"float inputs:opacity = 0.02\n{SMOOTH}\ncolor3f inputs:diffuseColor = (0, 0, 0)")
    + material("Glow", "color3f inputs:emissiveColor = (0, 0, 2)\ncolor3f inputs:diffuseColor = (0, 0, 0)")
    + square("Floor", "[(-4, -4, 0), (4, -4, 0), (4, 4, 0), (-4, 4, 0)]")
    + square("Wall", "[(-4, 3, 0), (4, 3, 0), (4, 3, 4), (-4, 3, 4)]")
    + ball("Chrome", (-1.5, 1, 0.5), "Mirror")
    + ball("Lens", (1.5, 1, 0.6), "Glass")
    + ball("Bulb", (0, 2, 0.4), "Glow", 'bool photonbeams:enabled = 1\ntoken photonbeams:lightGroup = "blue"')
    + lamp("SphereLight", "Lamp", "red", (-1, 1, 2), "float inputs:radius = 0.1\nfloat inputs:intensity = 20")
    + lamp("RectLight", "Window", "red", (0, 0, 3.5), "float inputs:intensity = 2")
    + lamp("DistantLight", "Sun", "green", (0, 0, 0), "float inputs:angle = 1\nfloat inputs:intensity = 0.5")
    + lamp("DomeLight", "Sky", "blue", (0, 0, 0), "float inputs:intensity = 0.1")
    + square(
        "Panel", "[(3, -1, 2), (3, 1, 2), (3, 1, 1), (3, -1, 1)]",
        'color3f inputs:color = (0, 1, 0)\nfloat inputs:intensity = 3\ntoken photonbeams:lightGroup = "green"',
    )
)  # fmt: skip


def of_stage(tmp_path):
    path = tmp_path / "groups.usda"
    path.write_text(STAGE)
    return pb.Shot.open(path)


def of_scene(tmp_path):
    def colored(group, value):
        return {"type": "rgb", "value": [value * each for each in COLOURS[group]]}

    def sphere(radius, place, **more):
        return {"type": "sphere", "radius": radius, "center": place, **more}

    eye = mi.ScalarTransform4f().look_at([0, -3.8, 1.5], [0, 0, 0.8], [0, 0, 1])
    return pb.Shot(
        {
            "type": "scene",
            "floor": {"type": "rectangle", "to_world": mi.ScalarTransform4f().scale(4)},
            "mirror": sphere(0.5, [-1.5, 1, 0.5], bsdf={"type": "conductor"}),
            "glass": sphere(0.5, [1.5, 1, 0.6], bsdf={"type": "dielectric"}),
            "lamp": {"type": "point", "position": [-1, 1, 2], "intensity": colored("red", 5.0)},
            "panel": sphere(0.3, [0, 2, 0.5], panel_light={"type": "area", "radiance": colored("green", 2.0)}),
            "sky": {"type": "constant", "radiance": colored("blue", 0.1)},
            "sensor": {"type": "perspective", "fov": 60, "to_world": eye, "film": {"type": "hdrfilm"}},
        },
        groups={"lamp": "red", "panel_light": "green", "sky": "blue"},
    )  # fmt: skip


@pytest.mark.parametrize(
    ("made", "bounces"),
    [
        pytest.param(of_stage, 0, id="stage", marks=pytest.mark.soak),
        pytest.param(of_scene, 0, id="scene"),
        pytest.param(of_stage, 3, id="stage, bounces"),
        pytest.param(of_scene, 3, id="scene, bounces", marks=pytest.mark.soak),
    ],
)
def test_each_group_has_the_light_of_its_lamps_alone(tmp_path, made, bounces):
    """Grey surfaces and fog keep light of one channel in it: the layers are known to the bit."""
    layers = made(tmp_path).render(passes=2, max_depth=bounces + 2, seed=3, **SIZE).layers
    for kind in ("surface", "beams"):
        parts = [layers[name] for name in layers if name.startswith(f"{kind}_")]
        assert np.array_equal(sum(parts[1:], parts[0]), layers[kind]), kind
    for channel, group in enumerate(COLOURS):
        found = layers[f"surface_{group}"]
        assert np.array_equal(found[..., channel], layers["surface"][..., channel]), group
        assert found[..., channel].mean() > 1e-3, group
        assert not np.delete(found, channel, axis=2).any(), group
    assert not layers["surface_default"].any()
