"""Textures: their size is limited, and a large one is read at a lower resolution."""

import os

import numpy as np
import OpenImageIO
import pytest

from photonbeams.images import files
from photonbeams.images.files import read_image
from photonbeams.images.textures import decoded, linear, wrap_modes
from photonbeams.scene import SceneError


def raw(pixels, kind):
    return pixels


def test_an_image_within_the_limit_is_read_as_it_is(image):
    pixels = np.random.default_rng(3).random((5, 8, 3)).astype(np.float32)
    found = decoded(str(image("a.exr", pixels, "float")), raw, 8)
    np.testing.assert_array_equal(found.pixels, pixels)
    assert (found.width, found.height, found.error) == (8, 5, "")


@pytest.mark.parametrize("strip", [1, 2**20])
@pytest.mark.parametrize("tiled", [False, True])
def test_a_large_image_is_read_in_strips_of_means(tmp_path, monkeypatch, strip, tiled):
    """Reduction by a whole factor is a mean over squares, exact to the rounding of float32."""
    monkeypatch.setattr(files, "_STRIP", strip)
    pixels = np.random.default_rng(3).random((48, 64, 3)).astype(np.float32)
    path = str(tmp_path / "a.exr")
    spec = OpenImageIO.ImageSpec(64, 48, 3, "float")
    if tiled:
        spec.tile_width = spec.tile_height = 16
    file = OpenImageIO.ImageOutput.create(path)
    assert file.open(path, spec)
    assert file.write_image(pixels)
    file.close()
    found = decoded(path, raw, 16)
    expected = pixels.reshape(12, 4, 16, 4, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(found.pixels, expected, rtol=1e-6)
    assert (found.width, found.height) == (64, 48)


@pytest.mark.parametrize("size", [(30, 17), (17, 30), (16, 1), (33, 33)])
def test_other_sizes_keep_their_ratio_and_their_mean(image, size):
    found = decoded(str(image("a.exr", np.full((*size, 1), 0.25), "float")), raw, 12).pixels
    assert max(found.shape[:2]) == 12
    assert found.shape[0] / found.shape[1] == pytest.approx(size[0] / size[1], rel=0.5 / min(found.shape[:2]) + 1e-6)
    np.testing.assert_allclose(found, 0.25, rtol=1e-6)


def test_means_are_of_light_and_not_of_its_encoding(image):
    path = str(image("a.png", [[[0, 0, 0], [1, 1, 1]], [[1, 1, 1], [0, 0, 0]]]))
    found = decoded(path, linear, 1)
    np.testing.assert_allclose(found.pixels, 0.5, atol=1e-6)


def test_a_level_of_the_file_that_is_small_enough_is_read(tmp_path):
    path = str(tmp_path / "a.tx")
    source = OpenImageIO.ImageBuf(np.full((64, 64, 3), 0.5, np.float32))
    assert OpenImageIO.ImageBufAlgo.make_texture(OpenImageIO.MakeTxTexture, source, path)
    found = decoded(path, raw, 16)
    assert found.pixels.shape == (16, 16, 3)
    np.testing.assert_allclose(found.pixels, 0.5, rtol=1e-3)
    assert wrap_modes(path) == ("black", "black")  # as maketx writes them


def exr(path, *parts, window=None):
    """Write parts of an EXR: names of channels, and pixels; `window` is where they begin in a picture, and its size."""
    specs = []
    for channels, pixels in parts:
        height, width = np.shape(pixels)[:2]
        spec = OpenImageIO.ImageSpec(width, height, len(channels), "float")
        spec.channelnames = channels
        if window is not None:
            spec.x, spec.y, spec.full_width, spec.full_height = window
        specs.append(spec)
    file = OpenImageIO.ImageOutput.create(str(path))
    assert file.open(str(path), tuple(specs))
    for number, (_, pixels) in enumerate(parts):
        assert not number or file.open(str(path), specs[number], "AppendSubimage")
        assert file.write_image(np.asarray(pixels, np.float32))
    file.close()
    return str(path)


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        ([("Z", [9]), ("R G B", [1, 2, 3])], [1, 2, 3]),
        ([("a.Z key.R key.G key.B", [9, 1, 2, 3])], [1, 2, 3]),
        ([("AO.R AO.G AO.B Combined.R Combined.G Combined.B Combined.A", [7, 8, 9, 1, 2, 3, 4])], [1, 2, 3, 4]),
        ([("Y N.R N.G N.B", [1, 7, 8, 9])], [1]),
        ([("R G B Z", [1, 2, 3, 9])], [1, 2, 3]),
        ([("Y A Z", [1, 2, 9])], [1, 2]),
        ([("Z", [9])], [9]),
        ([("X Y Z", [1, 2, 3])], [1, 2, 3]),
    ],
)
def test_the_picture_is_read_wherever_it_is(tmp_path, parts, expected):
    path = exr(tmp_path / "a.exr", *((tuple(names.split()), [[values]]) for names, values in parts))
    found = decoded(path, raw)
    assert found.pixels.tolist() == [[expected]]
    assert not found.warnings


def test_several_pictures_are_told(tmp_path):
    path = exr(tmp_path / "a.exr", (("a.R", "a.G", "a.B", "b.R", "b.G", "b.B"), [[[1, 2, 3, 4, 5, 6]]]))
    (warning,) = decoded(path, raw).warnings
    assert "has the pictures a, b: the first is used" in warning


def test_deep_images_are_no_textures(tmp_path):
    spec = OpenImageIO.ImageSpec(2, 1, 4, "float")
    spec.deep = True
    samples = OpenImageIO.DeepData()
    samples.init(spec)
    file = OpenImageIO.ImageOutput.create("a.exr")
    assert file.open(str(tmp_path / "a.exr"), spec) and file.write_deep_image(samples)
    file.close()
    assert decoded(str(tmp_path / "a.exr"), raw).error == "it is a deep one"


@pytest.mark.parametrize("corner", [(2, 2), (3, 5)])
@pytest.mark.parametrize("limit", [8, 4])
def test_a_picture_is_black_where_a_file_holds_none_of_it(tmp_path, limit, corner):
    """A file of 4 × 2 pixels begins somewhere in a picture of 8 × 8, or at (-2, 0) with two columns of it inside."""
    pixels = np.ones((2, 4, 3), np.float32)
    inside = decoded(exr(tmp_path / "a.exr", (("R", "G", "B"), pixels), window=(*corner, 8, 8)), raw, limit)
    whole = np.zeros((8, 8))
    whole[corner[1] : corner[1] + 2, corner[0] : corner[0] + 4] = 1
    assert (inside.width, inside.height) == (8, 8)
    squares = whole.reshape(limit, 8 // limit, limit, 8 // limit).mean(axis=(1, 3))
    np.testing.assert_allclose(inside.pixels[..., 0], squares, rtol=1e-6)
    beyond = decoded(exr(tmp_path / "b.exr", (("R", "G", "B"), pixels), window=(-2, 0, 8, 8)), raw, 8).pixels
    assert beyond[..., 0].sum() == beyond[:2, :2, 0].sum() == 4


def test_pipes_and_devices_are_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "a.png")
    assert decoded(str(tmp_path / "a.png"), raw).error == "it is a named pipe"
    with pytest.raises(SceneError, match=r"a\.png cannot be read: expected an image \(it is a named pipe"):
        read_image(tmp_path / "a.png")
    assert decoded("/dev/zero", raw).error == "it is a device"
    assert decoded(str(tmp_path), raw).error == "it is a folder"
