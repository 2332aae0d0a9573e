"""Frame rates, time range, units and up axis of a stage: left to a sublayer, or without sense."""

import logging

import pytest
from pxr import Sdf, Usd, UsdGeom

from photonbeams import Shot
from photonbeams.scene import SceneError
from photonbeams.usd.layers.frames import time_range
from photonbeams.usd.stage import default_time, open_stage

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


@pytest.mark.parametrize(
    ("metadata", "message"),
    [
        *(
            (f"{name} = {value}", f"{name} is {value}: expected a number from {limits}; {usual} is used")
            for name, values, limits, usual in (
                ("timeCodesPerSecond", ("0", "-24", "nan", "inf", "1e+12"), "0.001 to 1e+06", 24),
                ("framesPerSecond", ("inf",), "0.001 to 1e+06", 24),
                ("metersPerUnit", ("0", "-1", "nan", "inf"), "1e-15 to 1e+18", 0.01),
            )
            for value in values
        ),
        ('upAxis = "X"', "upAxis is 'X': expected Y or Z; Y is used"),
        ('upAxis = ""', "upAxis is '': expected Y or Z; Y is used"),
    ],
)
def test_metadata_that_make_no_sense_are_named_and_replaced(usd, caplog, metadata, message):
    text = 'def Xform "A" { double x.timeSamples = { 1: 1, 24: 24\n }\n }'
    stage = usd(text, metadata)
    assert [each.partition("stage.usda: ")[2] for each in caplog.messages] == [message]
    assert stage.GetPrimAtPath("/A").GetAttribute("x").GetTimeSamples() == [1, 24]
    assert (stage.GetTimeCodesPerSecond(), stage.GetFramesPerSecond()) == (24, 24)
    assert (UsdGeom.GetStageMetersPerUnit(stage), UsdGeom.GetStageUpAxis(stage)) == (0.01, "Y")


@pytest.mark.parametrize("first", ["subLayers = [@./wrong.usda@]", 'timeCodesPerSecond = 25\n    upAxis = "Z"'])
def test_a_wrong_rate_of_another_layer_is_named_with_its_file(tmp_path, caplog, first):
    """With the rate of 0, OpenUSD would never return the times of the keys."""
    (tmp_path / "wrong.usda").write_text(EXPORT.replace("timeCodesPerSecond = 30", "timeCodesPerSecond = 0"))
    reference = "" if "wrong" in first else 'def "B" (\n    references = @./wrong.usda@</A>\n)\n{\n}\n'
    (tmp_path / "top.usda").write_text(f"#usda 1.0\n(\n    {first}\n)\n{reference}")
    stage = open_stage(tmp_path / "top.usda")
    assert f"{tmp_path / 'wrong.usda'}: timeCodesPerSecond is 0: expected a number" in caplog.text
    prim = stage.GetPrimAtPath("/B" if reference else "/A")
    rate = stage.GetTimeCodesPerSecond() / 24
    assert prim.GetAttribute("x").GetTimeSamples() == pytest.approx([rate, 24 * rate])


@pytest.mark.parametrize(
    ("first", "last", "message", "expected", "begins"),
    [
        ("10", "1", "startTimeCode is 10: expected no more than the endTimeCode, which is 1; the", (1, 10), 1),
        ("1", "inf", "endTimeCode is inf: expected a frame between -1e+09 and 1e+09; there", None, 1),
        ("-inf", "5", "startTimeCode is -inf: expected a frame", None, None),
        ("nan", "5", "startTimeCode is nan: expected a frame", None, None),
        ("1e+300", "5", "startTimeCode is 1e+300: expected a frame", None, None),
        ("3", "3", None, (3, 3), 3),
    ],
)
def test_an_impossible_range_is_named(usd, caplog, first, last, message, expected, begins):
    stage = usd("", f"startTimeCode = {first}\nendTimeCode = {last}")
    assert len(caplog.messages) == (message is not None)
    assert (message or "") in caplog.text
    assert time_range(stage) == expected
    time = default_time(stage)
    assert (None if time.IsDefault() else time.GetValue()) == begins


def test_a_stage_that_the_user_opened_is_refused_with_the_same_sentence():
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.timeCodesPerSecond = 0
    with pytest.raises(SceneError, match=r"\.usda: timeCodesPerSecond is 0"):
        Shot(Usd.Stage.Open(layer))
