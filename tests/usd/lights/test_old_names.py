"""Lights with the names of before OpenUSD 21.02, without "inputs:", are those with the names of today."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from photonbeams.usd.authoring.controls import controls_of
from photonbeams.usd.common.openusd import Sdf, Usd
from photonbeams.usd.common.warnings import Warnings
from photonbeams.usd.stage import read_scene

SIZES = {
    "SphereLight": ("radius",), "DiskLight": ("radius",), "RectLight": ("width", "height"),
    "CylinderLight": ("length", "radius"), "DistantLight": ("angle",), "DomeLight": (),
}  # fmt: skip
# The area by the sizes above, where `normalize` divides by it.
AREAS = {
    "SphereLight": lambda radius: 4 * np.pi * radius**2, "DiskLight": lambda radius: np.pi * radius**2,
    "RectLight": lambda width, height: width * height,
    "CylinderLight": lambda length, radius: 2 * np.pi * radius * length,
    "DistantLight": lambda angle: np.pi * np.sin(np.radians(angle / 2)) ** 2, "DomeLight": lambda: 1.0,
}  # fmt: skip
NUMBER = st.floats(0.125, 9.0, width=32)
EVERY = {
    "intensity": NUMBER, "exposure": NUMBER, "color": st.tuples(NUMBER, NUMBER, NUMBER), "normalize": st.booleans(),
    "diffuse": NUMBER, "shadow:distance": NUMBER, "shadow:color": st.tuples(*[st.floats(0, 1, width=32)] * 3),
    "shadow:enable": st.booleans(),
}  # fmt: skip
SHAPING = {
    "shaping:cone:angle": NUMBER, "shaping:cone:softness": st.floats(0, 1, width=32), "shaping:focus": NUMBER,
    "shaping:focusTint": st.tuples(NUMBER, NUMBER, NUMBER),
}  # fmt: skip
FLOOR = """def Mesh "Floor" {
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
}
"""


def typed(value):
    if isinstance(value, bool):
        return "bool", int(value)
    return ("color3f", value) if isinstance(value, tuple) else ("float", value)


def opened(kind, values, old):
    """Return a stage with a light; the names in `old` are without "inputs:"."""
    lines = (f"{typed(value)[0]} {'' if name in old else 'inputs:'}{name} = {typed(value)[1]}"
             for name, value in values.items())  # fmt: skip
    layer = Sdf.Layer.CreateAnonymous(".usda")
    assert layer.ImportFromString(f'#usda 1.0\n{FLOOR}def {kind} "L" {{\n' + "\n".join(lines) + "\n}\n")
    return Usd.Stage.Open(layer)


@st.composite
def lights(draw):
    """Return a kind of light, values of some of its inputs, and which of these have their old names."""
    kind = draw(st.sampled_from([*SIZES]))
    own = dict.fromkeys(SIZES[kind], NUMBER) | EVERY | (SHAPING if kind not in ("DistantLight", "DomeLight") else {})
    names = draw(st.sets(st.sampled_from([*own]), min_size=1))
    return kind, {name: draw(own[name]) for name in sorted(names)}, draw(st.sets(st.sampled_from(sorted(names))))


@given(lights())
def test_a_light_is_the_same_by_old_and_by_new_names(drawn):
    kind, values, old = drawn
    warnings = Warnings(muted=True)
    (found,) = read_scene(opened(kind, values, old), warnings=warnings).lights
    (right,) = read_scene(opened(kind, values, ()), warnings=Warnings(muted=True)).lights
    assert str(found) == str(right)
    sizes = {"radius": 0.5, "width": 1.0, "height": 1.0, "length": 1.0, "angle": 0.53}
    area = AREAS[kind](*(values.get(name, sizes[name]) for name in SIZES[kind])) if values.get("normalize") else 1.0
    usual = 50000.0 if kind == "DistantLight" else 1.0
    value = values.get("intensity", usual) * 2 ** values.get("exposure", 0.0) * np.array(values.get("color", (1, 1, 1)))
    assert found.radiance == pytest.approx(value / area, rel=1e-5)  # numbers on a stage have seven digits
    named = [each for each in warnings.given if "without inputs:, as before OpenUSD 21.02" in each]
    assert bool(named) == bool(old)
    for name in old:
        assert re.search(rf"/L has .*\b{name}\b.* without inputs:", named[0])


def test_what_has_a_new_name_too_or_is_no_light_keeps_its_own(scene, caplog):
    both = 'def SphereLight "L" { float intensity = 7\n float inputs:intensity = 3\n }\n'
    (light,) = scene(both + 'def Sphere "S" { float intensity = 7\n double radius = 2\n }').lights
    assert light.radiance == (3, 3, 3)
    assert not caplog.text


def test_old_names_may_change_with_time_and_are_shown_by_the_studio():
    stage = opened("SphereLight", {"radius": 0.1}, ("radius",))
    stage.GetPrimAtPath("/L").CreateAttribute("intensity", Sdf.ValueTypeNames.Float).Set(3.0, 1)
    stage.GetPrimAtPath("/L").GetAttribute("intensity").Set(5.0, 3)
    assert [read_scene(stage, time).lights[0].radiance[0] for time in (1, 2, 3)] == [3, 4, 5]
    shown = {each.path: each.value for group in controls_of(stage, 2.0) for each in group.controls}
    assert shown["/L.inputs:intensity"] == 4
    assert shown["/L.inputs:radius"] == pytest.approx(0.1)


def test_filters_have_an_old_name_too(scene):
    blocker = '\ndef PhotonBeamsBlockerFilter "B" {\n }'
    for name in ("filters", "light:filters"):
        (light,) = scene(f'def SphereLight "L" {{ rel {name} = </B>\n float inputs:radius = 0.1\n }}{blocker}').lights
        assert len(light.filters) == 1
