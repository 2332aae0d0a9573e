"""Frame specifications, as usdrecord reads them."""

import pytest

from photonbeams.scene import SceneError
from photonbeams.usd.layers.frames import check_frames, decimals, parse_frames


@pytest.mark.parametrize(
    ("text", "frames"),
    [
        ("101", [101]),
        ("-3", [-3]),
        ("+5", [5]),
        ("-0", [0]),
        ("7.5", [7.5]),
        ("101:105", [101, 102, 103, 104, 105]),
        ("105:101", [105, 104, 103, 102, 101]),
        ("-1:2", [-1, 0, 1, 2]),
        ("101:109x2", [101, 103, 105, 107, 109]),
        ("101:110x2", [101, 103, 105, 107, 109]),
        ("109:101x-4", [109, 105, 101]),
        ("101:102x0.5", [101, 101.5, 102]),
        ("0:0.5x0.1", [0, 0.1, 0.2, 0.3, 0.4, 0.5]),
        ("1.5:3.5", [1.5, 2.5, 3.5]),
        ("101:103,110,120:130x5", [101, 102, 103, 110, 120, 125, 130]),
        ("3, 1:2", [3, 1, 2]),
    ],
)
def test_a_specification_is_frames_in_its_order(text, frames):
    assert parse_frames(text) == frames


def test_a_frame_that_is_named_twice_is_one():
    assert parse_frames("1:3,2,5:3,0:1x0.1,0.3")[:8] == [1, 2, 3, 5, 4, 0, 0.1, 0.2]
    assert parse_frames("0:1x0.1,0.3,1:0x-0.1") == parse_frames("0:1x0.1")


def test_no_frame_is_minus_zero():
    assert str(parse_frames("-1:0")[1]) == str(parse_frames("-0")[0]) == "0.0"


@pytest.mark.parametrize(
    "text",
    ["", ",", "1,", "1:", ":5", "1:2:3", "x", "1x2", "1:5x", "1:9x2x3", "abc", "nan", "1:inf", "1 2", "DEFAULT", "١:٣"],
)
def test_what_is_no_specification_is_refused(text):
    with pytest.raises(SceneError, match="expected frames such as 101, 101:105"):
        parse_frames(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1:5x0", "stride cannot be zero"),
        ("5:1x1", "endTimeCode cannot be less than startTimeCode"),
        ("1:5x-1", "endTimeCode cannot be greater than startTimeCode"),
        ("1:100001", "no more than 100,000 frames"),
        ("1:2x0.0000001", "no more than 100,000 frames"),
        ("1:60000,70000:140000", "no more than 100,000 frames"),
        ("1e3", "expected frames such as"),
        ("1:9999999999", "between -1e"),
        ("1:99999999999999999999", "between -1e"),
        ("9" * 400, "expected frames"),
    ],
)
def test_what_makes_no_frames_or_too_many_is_refused(text, message):
    with pytest.raises(SceneError, match=message):
        parse_frames(text)


def test_digits_after_the_point_are_those_that_are_needed():
    assert [decimals(frame) for frame in (1, -3, 7.5, 0.25, 1.125, parse_frames("0:1x0.1")[3])] == [0, 0, 1, 2, 3, 1]
    assert decimals(1 / 3) == 9


def test_frames_outside_the_stages_range_are_refused(usd):
    stage = usd("", "startTimeCode = 1\nendTimeCode = 10")
    check_frames(stage, [1, 5.5, 10])
    with pytest.raises(SceneError, match=r"stage\.usda has no frame 11"):
        check_frames(stage, [10, 11])
    with pytest.raises(SceneError, match="has no frame 0 and 2 more of those asked for"):
        check_frames(stage, [0, 1, 11, 12])
    with pytest.raises(SceneError, match="has no frame nan"):
        check_frames(stage, [float("nan")])


def test_a_stage_without_a_range_has_any_frame(usd):
    for stage in (usd(""), usd("", "startTimeCode = 1\nendTimeCode = inf")):
        assert check_frames(stage, [-1e6, 1e6]) is None  # nor does it raise
