"""Frame rates, time range, units and up axis of a stage whose root layer leaves them to a sublayer."""

import logging

import pytest
from pxr import UsdGeom

from photonbeams.usd.stage import open_stage

EXPORT = """#usda 1.0
(
    endTimeCode = 48
    framesPerSecond = 30
    metersPerUnit = 1
    startTimeCode = 1
    timeCodesPerSecond = 30
    upAxis = "Z"
)
def Xform "A" {
    double x.timeSamples = { 1: 1, 24: 24
    }
}
"""


@pytest.fixture
def opened(tmp_path, caplog):
    caplog.set_level(logging.WARNING, "photonbeams")

    def opened(metadata="", prims="", offset=""):
        (tmp_path / "export.usda").write_text(EXPORT)
        text = f"#usda 1.0\n(\n    subLayers = [@./export.usda@{offset}]\n    {metadata}\n)\n{prims}"
        (tmp_path / "top.usda").write_text(text)
        stage = open_stage(tmp_path / "top.usda")
        times = stage.GetPrimAtPath("/A").GetAttribute("x").GetTimeSamples()
        return stage, times, [each.partition("top.usda: ")[2] for each in caplog.messages]

    return opened


def test_what_a_layer_over_an_export_does_not_say_is_the_exports(opened):
    stage, times, told = opened()
    assert times == [1, 24]
    assert (stage.GetTimeCodesPerSecond(), stage.GetFramesPerSecond()) == (30, 30)
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1, 48)
    assert (UsdGeom.GetStageMetersPerUnit(stage), UsdGeom.GetStageUpAxis(stage)) == (1, "Z")
    said = "metersPerUnit, upAxis, timeCodesPerSecond, framesPerSecond, startTimeCode, endTimeCode"
    assert told == [f"has no {said}: taken from its sublayer export.usda"]


def test_what_it_says_stays(opened):
    stage, times, told = opened('metersPerUnit = 0.1\n    upAxis = "Y"\n    timeCodesPerSecond = 60')
    assert times == [2, 48] and not stage.HasAuthoredTimeCodeRange() and told == []
    assert (UsdGeom.GetStageMetersPerUnit(stage), UsdGeom.GetStageUpAxis(stage)) == (0.1, "Y")


@pytest.mark.parametrize(
    "given",
    [
        {"prims": 'over "A" {\n    double y.timeSamples = { 24: 1\n    }\n}\n'},
        {"offset": " (offset = 10)"},
    ],
)
def test_keys_of_its_own_are_not_moved_and_those_of_the_export_are_warned_of(opened, given):
    stage, times, told = opened(**given)
    assert times[1] == pytest.approx(19.2 + (10 if "offset" in given else 0)) and stage.GetTimeCodesPerSecond() == 24
    assert told[0].startswith("has no timeCodesPerSecond, but its sublayer export.usda has 30: its keys are moved")
    assert told[1:] == ["has no metersPerUnit, upAxis: taken from its sublayer export.usda"]
