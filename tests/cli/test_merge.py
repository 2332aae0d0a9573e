"""Parts of a frame, by passes or by tiles, merge to the bits of one render; snapshots show the passes so far."""

import os
import signal

import numpy as np
import OpenEXR
import pytest

from photonbeams import Shot
from photonbeams.images.files import read_layers
from photonbeams.images.frame import tile_of
from photonbeams.render.frame import FrameRenderer
from tests.helpers.commands import fails, same
from tests.helpers.frames import write_frame
from tests.helpers.small_stage import CAMERA, FILL, FLOOR, FOG, KEY, write_stage
from tests.helpers.sweep import sweep

SMALL = ("--res", 40, 48, "--passes", 6, "--beams", 64, "-q")


@pytest.fixture
def stage(tmp_path):
    """Return a stage with a lens and two light groups, one of which moves while the shutter is open."""
    camera = CAMERA.replace(
        "float focal",
        "double shutter:close = 0.5\n    float fStop = 2\n    float focusDistance = 5\n    float focal",
        1,
    )
    return write_stage(tmp_path / "stage.usda", FOG, camera, KEY, FILL, FLOOR, metadata="startTimeCode = 1")


def headers(path):
    return [
        {name: str(value) for name, value in part.header.items() if name != "commandLine"}
        for part in OpenEXR.File(str(path)).parts
    ]


def test_passes_of_two_machines_are_those_of_one(call, render, stage, out):
    flags = (*SMALL, "--stereo", "--interaxial", 0.2, "--convergence", 5)
    assert render(stage, "-o", out / "whole.exr", *flags)[0] == 0
    for part in ("2/3", "0:1", "4:5"):
        name = part.translate({47: 95, 58: 95})
        assert render(stage, "-o", out / f"{name}.checkpoint", *flags, "--pass-range", part)[0] == 0
    code, _, stderr = call("merge", out / "?_?.checkpoint", "-o", out / "joined.exr", "-o", out / "joined.png")
    assert (code, stderr) == (0, f"6 passes of 3 files, wrote {out / 'joined.exr'}, {out / 'joined.png'}\n")
    for view in ("left", "right"):
        assert same(out / "joined.exr", out / "whole.exr", view)
    assert headers(out / "joined.exr") == headers(out / "whole.exr")
    gap = ("merge", out / "0_1.checkpoint", out / "4_5.checkpoint", "-o", out / "gap.exr", "--remove")
    fails(call(*gap), 1, f"{out / 'gap.exr'}: passes 2 to 3 are missing; expected all, or --partial")
    assert (out / "0_1.checkpoint").exists() and not (out / "gap.exr").exists()
    text = "the frame has no deep picture: expected one rendered with --deep, or deep=True"
    fails(call(*gap, "--partial", "--deep", out / "deep.exr"), 1, text, warnings=1)
    code, _, stderr = call(*gap, "--partial")
    assert code == 0 and stderr.startswith(f"Warning: {out / 'gap.exr'}: passes 2 to 3 are missing")
    assert not (out / "0_1.checkpoint").exists() and (out / "2_3.checkpoint").exists()


def test_frames_are_joined_by_their_numbers(call, render, stage, out):
    flags = (*SMALL, "--passes", 2, "-f", "1:2")
    assert render(stage, "-o", out / "whole.##.exr", *flags)[0] == 0
    for part in (1, 2):
        assert render(stage, "-o", out / f"a.##.{part}.checkpoint", *flags, "--pass-range", f"{part}/2")[0] == 0
    assert call("merge", out / "a.##.*.checkpoint", "-f", "1:2", "-o", out / "a.##.exr", "-q")[0] == 0
    assert all(same(out / f"a.{k}.exr", out / f"whole.{k}.exr") for k in ("01", "02"))


def test_passes_that_do_not_belong_together_are_refused(call, render, stage, out):
    parts = {"a": ("0:1",), "b": ("1:2",), "c": ("3:3", "--seed", 1), "d": ("3:3", "--passes", 8)}
    for name, (part, *more) in parts.items():
        assert render(stage, "-o", out / f"{name}.checkpoint", *SMALL, "--pass-range", part, *more)[0] == 0
    result = call("merge", out / "a.checkpoint", out / "b.checkpoint", "-o", out / "x.exr")
    fails(result, 1, f"{out / 'b.checkpoint'}: passes 1 to 1 are there twice")
    for name in "cd":
        result = call("merge", out / "a.checkpoint", out / f"{name}.checkpoint", "-o", out / "x.exr")
        fails(result, 1, f"{out / name}.checkpoint: is of another scene or of other settings")
    fails(call("merge", out / "z.checkpoint", "-o", out / "x.exr"), 1, "z.checkpoint: no such file")
    for text, told in (
        ("6:7", "from 0 to 5"),
        ("0/3", "expected FIRST:LAST"),
        ("4/3", "FIRST:LAST"),
        ("x", "FIRST:LAST"),
    ):
        fails(
            render(stage, "-o", out / "x.checkpoint", *SMALL, "--pass-range", text), 2, f"--pass-range is {text}", told
        )
    fails(
        render(stage, "-o", out / "x.exr", *SMALL, "--pass-range", "0:1"), 2, "expected a name that ends in .checkpoint"
    )
    assert not (out / "x.exr").exists() and not (out / "x.checkpoint").exists()


@pytest.mark.parametrize("pixel_filter", sweep(["box", "gaussian", "lanczos"], keep=["box", "lanczos"]))
def test_tiles_join_without_a_seam(call, render, stage, out, pixel_filter):
    flags = (*SMALL, "--passes", 2, "--filter", pixel_filter)
    assert render(stage, "-o", out / "whole.exr", *flags)[0] == 0
    for tile in (1, 2, 3):
        assert render(stage, "-o", out / f"tile{tile}.exr", *flags, "--tile", f"{tile}/3")[0] == 0
    assert call("merge", out / "tile*.exr", "-o", out / "joined.exr", "-q")[0] == 0
    assert same(out / "joined.exr", out / "whole.exr")
    assert headers(out / "joined.exr") == headers(out / "whole.exr")


def test_a_crop_is_that_part_of_the_whole_picture_to_the_bit(stage):
    """A crop equals its part of the whole picture, also within tiles, at odd sizes, with a lens and with motion."""
    shot, given = Shot.open(stage), {"passes": 2, "beams": 64, "width": 53, "height": 47}
    whole, part = (shot.render(1, crop=crop, **given).layers for crop in (None, (0.31, 0.23, 0.83, 0.92)))
    assert part["rgba"].shape[:2] == (33, 28) and part["beams_fill"].any()
    for name, pixels in part.items():
        assert np.array_equal(pixels, whole[name][10:43, 16:44]), name


def test_overscan_leaves_the_bits_of_the_picture_and_of_its_tiles(stage):
    """That is so at odd sizes and corners, with a lens, with motion, and with filters that reach across the edge."""
    shot, given = Shot.open(stage), {"passes": 2, "beams": 64, "width": 53, "height": 47, "pixel_filter": "gaussian"}
    crop = (-0.31, -0.2, 1.25, 1.1)
    band = tile_of(crop, 53, 47, (3, 5))
    frame, part = shot.render(1, crop=crop, **given), shot.render(1, crop=band, **given)
    whole, wide = shot.render(1, **given).layers, frame.layers
    assert (frame.metadata["dataWindow"], frame.metadata["displayWindow"]) == ((-17, -10, 65, 51), (0, 0, 52, 46))
    left, top, _, bottom = part.metadata["dataWindow"]
    assert (left, top, bottom) == (-17, 16, 31)
    for name, pixels in whole.items():
        assert np.array_equal(wide[name][10:57, 17:70], pixels), name
        assert np.array_equal(wide[name][26:42], part.layers[name]), name
    assert all(wide["beams"][side].any() for side in (np.s_[:10], np.s_[57:], np.s_[:, :17], np.s_[:, 70:]))


def test_tiles_that_do_not_belong_together_are_refused(call, render, stage, out):
    flags = (*SMALL, "--passes", 1)
    for name, more in (("a", ("--tile", "1/3")), ("b", ("--tile", "1/2")), ("c", ("--tile", "3/3", "--res", 40, 64)),
                       ("d", ("--tile", "3/3")), ("e", ("--tile", "3/3", "--seed", 1)),
                       ("f", ("--tile", "3/3", "--passes", 2))):  # fmt: skip
        assert render(stage, "-o", out / f"{name}.exr", *flags, *more)[0] == 0
    fails(call("merge", out / "a.exr", out / "b.exr", "-o", out / "x.exr"), 1, "b.exr: covers what another tile covers")
    fails(call("merge", out / "a.exr", out / "c.exr", "-o", out / "x.exr"), 1, "c.exr: has other layers or another")
    fails(call("merge", out / "a.exr", out / "e.exr", "-o", out / "x.exr"), 1, "e.exr: has another seed than")
    code, _, stderr = call("merge", out / "a.exr", out / "f.exr", "-o", out / "x.exr", "--partial")
    assert code == 0 and "x.exr: its tiles have different numbers of passes, so that their noise differs" in stderr
    gap = ("merge", out / "a.exr", out / "d.exr", "-o", out / "x.exr")
    fails(call(*gap), 1, "640 of 1,920 pixels are in no tile: expected all tiles, or --partial")
    code, _, stderr = call(*gap, "--partial")
    assert code == 0 and "640 of 1,920 pixels are in no tile and stay black" in stderr
    code, _, stderr = call("merge", out / "b.exr", "-o", out / "x.exr")
    assert code == 0 and "of 1,920 pixels of the picture are beyond these tiles: expected all tiles" in stderr
    for flag in (("--layers", "beams"), ("--single-part",), ("--exposure", "1"), ("--remove",)):
        fails(call(*gap, "--partial", *flag), 2, "tiles are joined as they are: expected no --layers")
    for text in ("0/2", "3/2", "1", "a/b"):
        fails(render(stage, "-o", out / "y.exr", *flags, "--tile", text), 2, f"--tile is {text}: expected NUMBER/COUNT")
    fails(
        render(stage, "-o", out / "y.exr", *flags, "--tile", "1/4"),
        1,
        "the tile is 1/4: 48 rows make up to 3, of 16 rows each",
    )


def test_pixels_beyond_tiles_are_counted_in_windows_of_any_size(call, tmp_path):
    window = {"displayWindow": (0, 0, 69_999, 69_999), "dataWindow": (0, 0, 7, 3)}  # more pixels than 32 bits hold
    write_frame(tmp_path / "a.exr", {"rgba": np.ones((4, 8, 4), np.float32)}, window)
    code, _, stderr = call("merge", tmp_path / "a.exr", "-o", tmp_path / "x.exr")
    assert code == 0 and "4,899,999,968 of 4,900,000,000 pixels of the picture are beyond these tiles" in stderr


def test_snapshots_show_what_is_done_and_go_when_the_frame_is_there(render, stage, out, monkeypatch):
    seen = []
    add_pass = FrameRenderer.add_pass

    def signalled(self, number):
        add_pass(self, number)
        if number == 2:
            os.kill(os.getpid(), signal.SIGUSR1)
        kept = out / "a.snapshot.exr"
        seen.append(int(OpenEXR.File(str(kept)).header()["passes"]) if kept.exists() else 0)

    monkeypatch.setattr(FrameRenderer, "add_pass", signalled)
    assert render(stage, "-o", out / "a.exr", *SMALL)[0] == 0
    assert seen == [0, 0, 0, 3, 3, 3]
    seen.clear()
    assert render(stage, "-o", out / "a.exr", *SMALL, "--snapshot", 1e-9)[0] == 0
    assert seen == [0, 1, 2, 3, 4, 5]
    assert sorted(each.name for each in out.iterdir()) == ["a.exr", "old.exr"]
    fails(render(stage, "-o", out / "a.exr", *SMALL, "--snapshot", 0), 2, "--snapshot is 0.0: expected a positive")


def test_more_passes_than_first_asked_go_on_with_what_is_there(call, render, stage, out):
    first = (*SMALL, "--passes", 4)
    assert render(stage, "-o", out / "a.checkpoint", *first, "--pass-range", "0:3")[0] == 0
    code, _, stderr = render(stage, "-o", out / "a.exr", *SMALL, "--passes", 10, "--resume")
    assert (code, stderr) == (0, "")
    longer = {name: each.astype(np.float64) for name, each in read_layers(out / "a.exr").items()}
    assert int(OpenEXR.File(str(out / "a.exr")).header()["passes"]) == 10
    # Later passes repeat the slices of the shutter with other samples: up to noise, the mean is that of ten passes.
    assert render(stage, "-o", out / "ten.exr", *SMALL, "--passes", 10)[0] == 0
    expected = read_layers(out / "ten.exr")
    assert longer["beams"].mean() == pytest.approx(expected["beams"].mean(), rel=0.05)
