"""Light filters of several programs, as fields of `scene.Light`, and what is named because it does not map."""

import re

import numpy as np
import pytest

from photonbeams.scene import Blocker, DistanceRamp, SceneError
from photonbeams.usd.authoring.controls import controls_of

PLACE = """
    double3 xformOp:translate = (1, 2, 3)
    float xformOp:rotateZ = 90
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateZ"]"""
LIGHT = """
def Xform "Rig" {
    double3 xformOp:translate = (10, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def %s "Lamp" (prepend apiSchemas = ["ShapingAPI"]) {
        float inputs:radius = 0.1
        float inputs:shaping:cone:angle = 45
        rel light:filters = [%s]
    }
    %s
}"""


@pytest.fixture
def light(scene):
    """Return a function that reads a light with one filter, given by its type and its attributes."""

    def read(kind, body="", lamp="SphereLight"):
        return scene(LIGHT % (lamp, "</Rig/F>", f'def {kind} "F" {{{body}\n}}')).lights[0]

    return read


@pytest.fixture
def one(light):
    """Return a function that reads the only filter."""
    return lambda *given: light(*given).filters[0]


@pytest.mark.parametrize("kind", ["PhotonBeamsBlockerFilter", "KarmaBlockerLightFilter", "PxrRodLightFilter"])
def test_a_filter_is_where_its_prim_is_also_if_its_type_is_not_installed(one, kind):
    frame = one(kind, PLACE).frame
    assert np.allclose(frame @ [1, 0, 0, 1], [11, 3, 3, 1])


def test_our_blocker_has_its_shape(one):
    body = 'uniform token photonbeams:shape = "{}"\nfloat photonbeams:radius = 0.2\nfloat photonbeams:width = 3'
    found = {each: one("PhotonBeamsBlockerFilter", body.format(each)) for each in ("sphere", "capsule", "box", "plane")}
    sizes = {name: (each.half.tolist(), round(each.radius, 6), each.flat) for name, each in found.items()}
    assert sizes == {
        "sphere": ([0, 0, 0], 0.2, False), "capsule": ([0, 0.5, 0], 0.2, False),
        "box": ([1.5, 0.5, 0.5], 0, False), "plane": ([1.5, 0.5, 0], 0, True),
    }  # fmt: skip
    more = 'uniform token photonbeams:where = "inside"\nbool photonbeams:invert = 1\nfloat photonbeams:edge = 0.25'
    rod = one("PhotonBeamsBlockerFilter", f"{more}\ncolor3f photonbeams:color = (0, 0.5, 2)")
    assert (rod.where, rod.invert, rod.edge, rod.color) == ("inside", True, 0.25, (0, 0.5, 2))


def test_our_ramp_has_distances_and_colors(one):
    body = "float[] photonbeams:distances = [1, 3]\ncolor3f[] photonbeams:colors = [(1, 1, 1), (0, 0, 1)]"
    ramp = one("PhotonBeamsRampFilter", body)
    assert (ramp.knots.tolist(), ramp.colors.tolist()) == ([1, 3], [[1, 1, 1], [0, 0, 1]])
    steps = one("PhotonBeamsRampFilter", f'{body}\nuniform token photonbeams:interpolation = "none"')
    assert (steps.knots.tolist(), steps.colors[:, 0].tolist()) == ([1, 3, 3], [1, 1, 0])
    eased = one("PhotonBeamsRampFilter", f'{body}\nuniform token photonbeams:interpolation = "smooth"')
    assert np.allclose(eased.colors[:, 0], [1, 1 - 5 / 32, 0.5, 5 / 32, 0])


def test_karmas_blocker_takes_light_and_tints_the_rest(light):
    body = (
        'uniform token inputs:shape = "box"\nfloat inputs:width = 4\nfloat inputs:exposure = 1\nbool inputs:invert = 1'
    )
    blocker, tint = light("KarmaBlockerLightFilter", f"{body}\ncolor3f inputs:tint = (1, 0.5, 0)").filters
    assert (blocker.half.tolist(), blocker.where, blocker.invert) == ([2, 0.5, 0.5], "behind", True)
    assert tint.colors.tolist() == [[2, 1, 0]]


def test_rods_act_inside_and_are_refined_by_side(one):
    rman = "inputs:ri:lightFilter:"
    body = f"float {rman}width = 2\nfloat {rman}right = 1\nfloat {rman}scaleDepth = 3\nfloat {rman}density = 0.75"
    rod = one("PxrRodLightFilter", f"{body}\nfloat {rman}radius = 0.1\nfloat {rman}edge = 0.2")
    assert (rod.half.tolist(), rod.where) == ([1.5, 0.5, 1.5], "inside")
    assert np.allclose((rod.radius, rod.edge, *rod.color), (0.1, 0.2, 0.25, 0.25, 0.25))
    assert np.allclose(rod.frame[:3, 3], [10.5, 0, 0])
    moonray = 'uniform token lightFilter:shaderId = "RodLightFilter"\ncolor3f inputs:moonray:color = (0.5, 1, 1)'
    assert one("LightFilter", f"{moonray}\nfloat inputs:moonray:intensity = 2").color == (1, 2, 2)


def test_filters_of_moonray_have_a_class(one):
    """As the test suite of hdMoonray writes them."""
    rod = one(
        "MoonrayLightFilter",
        """uniform token moonray:class = "RodLightFilter"
        float moonray:width = 10
        float moonray:edge = 2
        color3f moonray:color = (1, 0, 0.3)""",
    )
    assert (rod.half.tolist(), rod.edge, rod.where) == ([5, 0.5, 0.5], 2, "inside")
    assert np.allclose(rod.color, (1, 0, 0.3))


def test_graphs_of_arnold_name_filters_of_a_light(scene):
    """As Arnold's exporters write them; a filter that `light:filters` names, too, acts once."""
    graph = """def ArnoldNodeGraph "Graph" {
        token outputs:filters:i1.connect = </Rig/Graph/Decay.outputs:out>
        token outputs:filters:i2.connect = </Rig/F/Box.outputs:out>
        def Shader "Decay" {
            uniform token info:id = "arnold:light_decay"
            bool inputs:use_far_atten = 1
            float inputs:far_start = 1
            float inputs:far_end = 4
            token outputs:out
        }
    }
    def Material "F" {
        token outputs:surface.connect = </Rig/F/Box.outputs:out>
        def Shader "Box" {
            uniform token info:id = "arnold:light_blocker"
            token outputs:out
        }
    }"""
    lamp = LIGHT.replace("rel light", 'string primvars:arnold:shaders = "/Rig/Graph"\n        rel light')
    blocker, decay = scene(lamp % ("SphereLight", "</Rig/F>", graph)).lights[0].filters
    assert (blocker.half.tolist(), blocker.where) == ([0.5, 0.5, 0.5], "behind")
    assert (decay.knots.tolist(), decay.colors[:, 0].tolist()) == ([1, 4], [1, 0])
    assert [each.name for each in scene(lamp % ("SphereLight", "", graph)).lights[0].filters] == [
        "/Rig/Graph/Decay", "/Rig/F/Box",
    ]  # fmt: skip


def test_a_barn_is_a_window_with_a_place(light):
    body = 'float inputs:ri:lightFilter:height = 3\ntoken inputs:ri:lightFilter:preBarn = "{}"'
    for word, where in (("noEffect", "behind"), ("cone", "along")):
        (doors,) = light("PxrBarnLightFilter", body.format(word)).filters
        assert (doors.flat, doors.invert, doors.where, doors.half.tolist()) == (True, True, where, [0.5, 1.5, 0])


@pytest.mark.parametrize("program", ["karma", "arnold"])
def test_doors_at_the_lamp_cover_parts_of_its_cone(light, program):
    """A quarter of the cone from the left: at one unit the square of 45 degrees goes from -1 to 1."""
    bodies = {
        "karma": 'uniform token info:id = "kma_lfilter_barndoor"\nfloat inputs:left = 0.25\nfloat inputs:top = 0.5',
        "arnold": 'uniform token info:id = "arnold:barndoor"\nfloat inputs:barndoor_left_top = 0.25\n'
        "float inputs:barndoor_left_bottom = 0.25\nfloat inputs:barndoor_top_left = 0.5\n"
        "float inputs:barndoor_top_right = 0.5",
    }
    body = f'token outputs:f.connect = </Rig/F/S.outputs:o>\ndef Shader "S" {{\n{bodies[program]}\ntoken outputs:o\n}}'
    (doors,) = light("LightFilter", body).filters
    corners = [doors.frame @ [x, y, 0, 1] for x, y in (doors.half[:2] * [-1, -1], doors.half[:2])]
    seen = [(corner[:2] - [10, 0]) / -corner[2] for corner in corners]
    assert np.allclose(seen, [[-0.5, -1], [1, 0]])
    assert (doors.where, doors.invert) == ("along", True)


def test_decay_and_ramps_by_distance(light):
    arnold = 'uniform token info:id = "light_decay"\nbool inputs:use_far_atten = 1\nfloat inputs:far_start = 1\n'
    (decay,) = light("Shader", f"{arnold}float inputs:far_end = 4").filters
    assert (decay.knots.tolist(), decay.colors[:, 0].tolist()) == ([1, 4], [1, 0])
    rman = "inputs:ri:lightFilter:"
    body = f"float {rman}beginDist = 1\nfloat {rman}endDist = 3\nfloat[] {rman}colorRamp_Knots = [0, 0, 0.5, 1, 1]"
    (ramp,) = light(
        "PxrRampLightFilter", f"{body}\ncolor3f[] {rman}colorRamp_Colors = [(1, 0, 0), (0, 1, 0), (0, 0, 1)]"
    ).filters
    assert (ramp.knots.tolist(), ramp.colors.tolist()) == ([1, 2, 3], np.eye(3).tolist())
    assert light("PxrRampLightFilter", "", "DistantLight").filters == ()


@pytest.mark.parametrize("kind, body", [
    ("PxrIntMultLightFilter", "float inputs:ri:lightFilter:exposure = 1"),
    ("LightFilter", 'uniform token lightFilter:shaderId = "kma_lfilter_gel"\ncolor3f inputs:tint = (2, 2, 2)'),
    ("LightFilter", 'uniform token lightFilter:shaderId = "IntensityLightFilter"\nfloat inputs:moonray:intensity = 2'),
])  # fmt: skip
def test_a_factor_on_all_light(one, kind, body):
    found = one(kind, body)
    assert isinstance(found, DistanceRamp)
    assert found.colors.tolist() == [[2, 2, 2]]


def test_a_gobo_becomes_that_of_the_light(light, image, caplog):
    path = image("gobo.exr", np.full((2, 2, 3), 0.25, dtype=np.float32))
    body = f'uniform token info:id = "gobo"\nasset inputs:filename = @{path}@'
    found = light("Shader", body)
    assert found.filters == ()
    assert np.allclose(found.gobo.colors, 0.25)
    assert not caplog.text
    light("Shader", body + "\nrel collection:filterLink:excludes = </Rig>")
    text = "/Rig/F.collection:filterLink is not rendered: the filter acts on everything that its light shines on"
    assert text in caplog.text


def test_several_filters_are_kept_in_order(scene):
    more = 'def PhotonBeamsBlockerFilter "F" {\n}\ndef PxrIntMultLightFilter "G" {\nfloat inputs:intensity = 2\n}'
    found = scene(LIGHT % ("SphereLight", "</Rig/G>, </Rig/F>", more)).lights[0].filters
    assert [type(each) for each in found] == [DistanceRamp, Blocker]
    assert [each.name for each in found] == ["/Rig/G", "/Rig/F"]


@pytest.mark.parametrize("kind, body, message", [
    ("PxrCookieLightFilter", "", "/Rig/F is a PxrCookieLightFilter, which is not rendered as a filter: "
     "/Rig/Lamp shines without it"),
    ("PxrRodLightFilter", "float inputs:ri:lightFilter:saturation = 0.5\nfloat inputs:ri:lightFilter:leftEdge = 1",
     "/Rig/F has inputs that are not rendered: inputs:ri:lightFilter:saturation"),
    ("PxrRampLightFilter", 'token inputs:rampMode = "linear"', "/Rig/F has the mode linear, which is not rendered: "
     "expected the distance to the light; it is left out"),
])  # fmt: skip
def test_what_does_not_map_is_named(light, caplog, kind, body, message):
    light(kind, body)
    assert message in caplog.text


@pytest.mark.parametrize("kind, body, message", [
    ("PhotonBeamsBlockerFilter", "float photonbeams:edge = -1", "photonbeams:edge is -1.0: expected a finite number"),
    ("PhotonBeamsRampFilter", "float[] photonbeams:distances = [1]", "photonbeams:colors has 0 colours: expected one"),
    ("LightFilter", 'uniform token lightFilter:shaderId = "light_blocker"\nstring inputs:geometry_type = "cylinder"',
     "inputs:geometry_type is 'cylinder', which is not rendered: expected box, sphere or plane"),
])  # fmt: skip
def test_values_without_sense_are_errors(light, kind, body, message):
    with pytest.raises(SceneError, match=re.escape(f"/Rig/F.{message}")):
        light(kind, body)


def test_a_light_has_the_controls_of_its_filters(usd):
    flag = 'def PhotonBeamsBlockerFilter "F" {\nfloat photonbeams:edge = 0.5\n}\ndef PxrRodLightFilter "G" {\n}'
    (group,) = controls_of(usd(LIGHT % ("SphereLight", "</Rig/G>, </Rig/F>", flag)))
    found = {each.path: each for each in group.controls if each.section.startswith("Filter")}
    assert {each.section for each in found.values()} == {"Filter F"}
    assert (found["/Rig/F.photonbeams:edge"].value, found["/Rig/F.photonbeams:edge"].authored) == (0.5, True)
    assert found["/Rig/F.photonbeams:where"].choices == ("behind", "inside", "along")
