"""Layers for compositing through the command: asked for by flags and RenderVars, in parts, tiles and one part."""

import numpy as np
import OpenImageIO
import pytest

from photonbeams.images.files import read_layers
from tests.helpers.commands import fails, same
from tests.helpers.small_stage import CAMERA, FLOOR, FOG, KEY, write_stage

LAYERS = "rgba,beams,depth,normal,position,motion,crypto_object"
FLAGS = ("--res", 32, 48, "--passes", 2, "--beams", 64, "-q", "--filter", "gaussian")
SETTINGS = """def RenderSettings "Settings" {
    rel products = </Product>
}
def RenderProduct "Product" {
    token productName = "product.exr"
    bool photonbeams:singlePart = 1
    rel orderedVars = [</P>, </Mattes>, </Motion>]
}
def RenderVar "P" {
    string sourceName = "P"
}
def RenderVar "Mattes" {
    string sourceName = "crypto_object"
}
def RenderVar "Motion" {
    string sourceName = "motionvector"
}
"""


@pytest.fixture
def stage(tmp_path):
    metadata = 'startTimeCode = 1\n    renderSettingsPrimPath = "/Settings"'
    return write_stage(tmp_path / "stage.usda", FOG, CAMERA, KEY, FLOOR, SETTINGS, metadata=metadata)


def test_layers_on_request_are_the_same_in_parts_tiles_and_one_part(call, render, stage, out, monkeypatch):
    asked = (*FLAGS, "--layers", LAYERS)
    assert render(stage, "-o", out / "whole.exr", *asked)[0] == 0
    whole = read_layers(out / "whole.exr")
    assert np.ptp(whole["position"]) > 1 and whole["crypto_object00"].any()
    for part in (1, 2):
        assert render(stage, "-o", out / f"{part}.checkpoint", *asked, "--pass-range", f"{part}/2")[0] == 0
        assert render(stage, "-o", out / f"tile{part}.exr", *asked, "--tile", f"{part}/2")[0] == 0
    assert call("merge", out / "*.checkpoint", "-o", out / "joined.exr", "--layers", LAYERS, "-q")[0] == 0
    assert call("merge", out / "tile*.exr", "-o", out / "tiles.exr", "-q")[0] == 0
    assert same(out / "joined.exr", out / "whole.exr") and same(out / "tiles.exr", out / "whole.exr")
    monkeypatch.chdir(out)
    assert render(stage, *FLAGS)[0] == 0
    image = OpenImageIO.ImageInput.open(str(out / "product.exr"))
    spec, pixels = image.spec(), image.read_image("float")
    assert not image.seek_subimage(1, 0)
    wanted = ["R", "G", "B", "A", *(f"crypto_object{k:02d}.{name}" for k in range(3) for name in "RGBA")]
    assert [*spec.channelnames] == [*wanted, "motion.u", "motion.v", *(f"position.{axis}" for axis in "XYZ")]
    assert spec.getattribute("oiio:ColorSpace") == "lin_rec709_scene"
    for layer, names in (("rgba", wanted[:4]), ("position", [f"position.{axis}" for axis in "XYZ"])):
        assert np.array_equal(pixels[..., [spec.channelindex(name) for name in names]], whole[layer])


def test_two_eyes_in_one_part_have_openexrs_older_form(render, stage, out):
    eyes = (*FLAGS, "--stereo", "--interaxial", 0.2, "--layers", "rgba,depth,beams")
    assert render(stage, "-o", out / "parts.exr", *eyes)[0] == 0
    assert render(stage, "-o", out / "one.exr", *eyes, "--single-part")[0] == 0
    image = OpenImageIO.ImageInput.open(str(out / "one.exr"))
    spec, pixels = image.spec(), image.read_image("float")
    assert list(spec.getattribute("multiView")) == ["left", "right"]
    for view, prefix in (("left", ""), ("right", "right.")):
        layers = read_layers(out / "parts.exr", view)
        for layer, names in (("rgba", "RGBA"), ("depth", "Z"), ("beams", ("beams.R", "beams.G", "beams.B"))):
            found = pixels[..., [spec.channelindex(prefix + name) for name in names]]
            assert np.array_equal(found if found.shape[2] > 1 else found[..., 0], layers[layer])


def deep_file(path):
    image = OpenImageIO.ImageBuf(str(path))
    return image.spec(), OpenImageIO.ImageBufAlgo.flatten(image).get_pixels("float")


def test_deep_files_are_written_by_flags_products_parts_and_farms_of_them(call, render, tmp_path, out, monkeypatch):
    product = """def RenderSettings "Settings" {
    rel products = </Deep>
}
def RenderProduct "Deep" {
    token productName = "product.exr"
    token productType = "deepRaster"
}
"""
    metadata = 'startTimeCode = 1\n    renderSettingsPrimPath = "/Settings"'
    stage = write_stage(tmp_path / "deep.usda", FOG, CAMERA, KEY, FLOOR, product, metadata=metadata)
    assert render(stage, *FLAGS, "-o", out / "flat.exr", "--deep", out / "deep.exr")[0] == 0
    spec, flat = deep_file(out / "deep.exr")
    assert spec.deep and spec.getattribute("camera") == "/Camera"
    beams = read_layers(out / "flat.exr")["beams"]
    assert beams.max() > 0 and np.abs(flat[..., :3] - beams).max() < 5e-3 * beams.max()
    for part in (1, 2):
        flags = ("-o", out / f"{part}.checkpoint", "--deep", out / "unused.exr", "--pass-range", f"{part}/2")
        assert render(stage, *FLAGS, *flags)[0] == 0
    merged = call("merge", out / "*.checkpoint", "-o", out / "x.exr", "--deep", out / "joined.exr", "-q")
    assert merged[0] == 0 and not (out / "unused.exr").exists()
    monkeypatch.chdir(out)
    assert render(stage, *FLAGS)[0] == 0
    for name in ("joined.exr", "product.exr"):
        assert np.array_equal(deep_file(out / name)[1], flat)
    assert render(stage, *FLAGS, "--deep", "eyes.exr", "--stereo", "--interaxial", 0.2, "--crop", 0, 0, 0.5, 1)[0] == 0
    eyes = OpenImageIO.ImageInput.open("eyes.exr")
    names = [eyes.seek_subimage(k, 0) and eyes.spec().getattribute("oiio:subimagename") for k in (0, 1)]
    assert names == ["rgba.left", "rgba.right"] and eyes.spec().width == 16 and eyes.spec().full_width == 32
    fails(call("merge", out / "deep.exr", out / "product.exr", "-o", out / "y.exr"), 1, "deep.exr: is a deep picture")
    right, (height, width) = OpenImageIO.ImageBuf("eyes.exr", 1, 0), (eyes.spec().height, eyes.spec().width)
    count = sum(right.deep_samples(column, row) for row, column in np.ndindex(height, width))
    row = call("info", "eyes.exr")[1].splitlines()[2]
    wanted = f"half, float; deep, {count:,} samples"
    assert wanted in row and row.split()[:2] == ["rgba", "right"] and row.split()[-5:] == ["-"] * 5


def test_layers_of_numbers_make_no_pictures(render, stage, out):
    flags = (*FLAGS, "--layers", LAYERS, "--picture", f"crypto_object00={out / 'a.png'}")
    fails(render(stage, *flags), 2, "'crypto_object00', which has no colours")
