"""Presets: each replaces a look or one of its factors, whatever it was before, or gives a light a new look."""

import logging
from pathlib import Path

import pytest

from photonbeams.scene import SceneError
from photonbeams.usd.authoring.controls import controls_of
from photonbeams.usd.authoring.editing import EditLayer
from photonbeams.usd.authoring.presets import PRESETS, apply_preset, preset_look, preset_of
from photonbeams.usd.common.reading import Reading
from photonbeams.usd.common.warnings import Warnings
from photonbeams.usd.look_library import find_looks
from photonbeams.usd.looks.look import read_look
from photonbeams.usd.stage import open_stage

LIBRARY = Path(__file__).resolve().parents[3] / "examples" / "looks" / "looks.usda"
FACTORS = ("along", "across", "eye", "angle", "noise", "variation")

#: A stage with a look that sets every factor, so that presets have something to replace.
STAGE = """
def Xform "World" {
    def SphereLight "Lamp" {
        rel photonbeams:look = </World/Looks/Old> }
    def SphereLight "Bare" { }
    def DomeLight "Sky" { }
    def SphereLight "Off" {
        bool photonbeams:enabled = 0 }
    def Xform "Group" { }
    def Scope "Looks" {
        def PhotonBeamsLook "Old" {
            uniform token photonbeams:along:falloff = "power"
            float photonbeams:along:length.timeSamples = { 1: 2, 5: 3, }
            color3f photonbeams:along:tint = (1, 0.5, 0)
            float[] photonbeams:along:ramp:knots = [0, 1]
            color3f[] photonbeams:along:ramp:colors = [(1, 0, 0), (0, 1, 0)]
            string photonbeams:along:expression = "1 - s"
            float photonbeams:along:outer = 9
            uniform token photonbeams:across:profile = "smoothstep"
            string photonbeams:across:expression = "1 - 0.5 * r"
            uniform token photonbeams:eye:falloff = "none"
            string photonbeams:eye:expression = "0.5"
            uniform token photonbeams:angle:shading = "glow"
            string photonbeams:angle:expression = "0.5"
            float photonbeams:noise:amount = 0.5
            float photonbeams:variation = 0.25 } } }
"""
LOOK = "/World/Looks/Old"


@pytest.fixture
def edited(usd):
    stage = usd(STAGE)
    return stage, EditLayer(stage)


def look_of(stage, path=LOOK):
    prim = stage.GetPrimAtPath(path)
    return read_look(Reading(stage, None, Warnings(strict=True)), prim, prim)


def factors(look):
    return {name: {key: value for key, value in look.values.items() if key.split(":")[0] == name} for name in FACTORS}


@pytest.mark.parametrize("preset", PRESETS, ids=lambda preset: preset.name)
def test_a_preset_replaces_its_factor_whatever_the_stage_says_and_nothing_else(edited, preset):
    stage, layer = edited
    before, text = look_of(stage), layer.text()
    assert apply_preset(stage, layer, preset, LOOK) == LOOK
    after, wanted = factors(look_of(stage)), factors(preset_look(preset.name))
    changed = FACTORS if preset.factor == "look" else (preset.factor,)
    assert after == {**factors(before), **{name: wanted[name] for name in changed}}
    layer.replace(text)
    assert look_of(stage) == before


def test_presets_have_names_of_their_own_and_differ():
    assert len({each.name for each in PRESETS}) == len(PRESETS)
    looks = [(each.factor, str(factors(preset_look(each.name)))) for each in PRESETS]
    assert len(set(looks)) == len(PRESETS)
    with pytest.raises(SceneError, match="no preset 'look-gone'"):
        preset_of("look-gone")


def test_the_looks_of_the_examples_are_presets():
    found, _, _ = find_looks(open_stage(LIBRARY), ())
    for look in found:
        assert factors(look) == factors(preset_look(f"look-{look.name.rpartition('/')[2].lower()}")), look.name


def test_lengths_of_presets_go_with_the_stage(edited):
    stage, layer = edited
    apply_preset(stage, layer, preset_of("look-dust"), LOOK, 25.3)
    look, small = look_of(stage), preset_look("look-dust")
    assert (look.values["along:inner"], look.values["along:outer"]) == (38.0, 100.0)
    assert look.values["noise:scale"] == pytest.approx(13.0)
    assert look.values["noise:amount"] == small.values["noise:amount"]


@pytest.mark.parametrize("light, enabled", [("Lamp", None), ("Bare", None), ("Sky", True), ("Off", True)])
def test_a_light_gets_a_look_of_its_own_and_makes_beams(edited, light, enabled):
    stage, layer = edited
    path = f"/World/{light}"
    made = apply_preset(stage, layer, preset_of("look-soft-shaft"), path)
    assert made == "/World/Looks/SoftShaft" and factors(look_of(stage, made)) == factors(preset_look("look-soft-shaft"))
    assert apply_preset(stage, layer, preset_of("look-soft-shaft"), "/World/Bare") == "/World/Looks/SoftShaft1"
    group = next(each for each in controls_of(stage) if each.path == path)
    control = next(each for each in group.controls if each.path.endswith(":enabled"))
    assert control.value is True and control.authored is bool(enabled)
    assert group.uses[0].startswith("/World/Looks/SoftShaft")
    assert [each.path for each in controls_of(stage) if each.kind == "look"] == [LOOK, made, f"{made}1"]


def test_what_a_light_does_unless_told_is_what_its_control_shows(edited):
    shown = {each.path: each for each in controls_of(edited[0])}
    values = {
        name: next(each for each in shown[f"/World/{name}"].controls if each.path.endswith(":enabled"))
        for name in ("Bare", "Sky", "Off")
    }
    assert [(each.value, each.default) for each in values.values()] == [(True, True), (False, False), (False, True)]


def test_new_looks_are_in_a_scope_of_the_lights_world_where_there_are_none(usd):
    for body, path, made in (
        ('def SphereLight "L" { }', "/L", "/Looks/Glow"),
        ('def Xform "W" {\n def Xform "X" {\n def SphereLight "L" { } } }', "/W/X/L", "/W/Looks/Glow"),
    ):
        stage = usd(body)
        layer = EditLayer(stage)
        assert apply_preset(stage, layer, preset_of("look-glow"), path) == made
        assert stage.GetPrimAtPath(made).IsDefined() and stage.GetPrimAtPath(made).GetParent().GetTypeName() == "Scope"
        look = read_look(Reading(stage), stage.GetPrimAtPath(path), stage.GetPrimAtPath(made))
        assert look.values["angle:shading"] == "glow"
        layer.replace("#usda 1.0\n")
        assert not stage.GetPrimAtPath("/Looks") and not stage.GetPrimAtPath("/W/Looks")


@pytest.mark.parametrize("path", ["/World/Group", "/World/Gone", "", "not a path", "/World/Lamp.inputs:radius"])
def test_presets_are_for_lights_and_looks(edited, path):
    stage, layer = edited
    with pytest.raises(SceneError, match="has no light or look"):
        apply_preset(stage, layer, PRESETS[1], path)


def test_a_place_that_the_stage_does_not_show_is_told(tmp_path):
    path = tmp_path / "stage.usda"
    path.write_text('#usda 1.0\ndef Xform "W"\n{\n    def SphereLight "L"\n    {\n    }\n}\n')
    from photonbeams.usd.common.selection import Selection

    stage = open_stage(path, selection=Selection.of("/W/L", None, (), None))
    with pytest.raises(SceneError, match="does not show it"):
        apply_preset(stage, EditLayer(stage), PRESETS[1], "/W/L")


def test_presets_are_read_without_a_warning(caplog):
    preset_look.cache_clear()
    with caplog.at_level(logging.WARNING, logger="photonbeams"):
        for each in PRESETS:
            preset_look(each.name)
    assert not caplog.records
