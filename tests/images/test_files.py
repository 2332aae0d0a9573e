"""Picture files: they read back as they were written, and no file is half written."""

import os
from fractions import Fraction
from pathlib import Path

import numpy as np
import OpenEXR
import OpenImageIO
import pytest

from photonbeams.images import display, files, textures, writing
from photonbeams.runtime.files import try_path
from photonbeams.scene import SceneError
from tests.helpers.frames import write_frame

SIZE = (30, 44)


@pytest.fixture
def layers():
    random = np.random.default_rng(1)
    colour = {name: random.uniform(0, 2, (*SIZE, 3)).astype(np.float32) for name in ("surface", "beams", "beams_key")}
    depth = random.uniform(1, 9, SIZE).astype(np.float32)
    depth[0, 0] = np.inf
    rgba = np.concatenate([colour["surface"] + colour["beams"], np.ones((*SIZE, 1), np.float32)], axis=2)
    return {**colour, "transmittance": colour["beams"] / 2, "depth": depth, "rgba": rgba}


METADATA = {
    "worldToCamera": np.arange(16.0).reshape(4, 4),
    "worldToNDC": np.eye(4),
    "framesPerSecond": Fraction(24000, 1001),
    "expTime": np.float32(1 / 48),
    "software": "photonbeams 0.1.0",
    "commandLine": "photonbeams render keyhole.usda",
    "seed": np.int64(7),
    "passes": 16,
    "lightGroups": ["key", "fill"],
    "bigSeed": 2**40,
}


def subimages(path):
    file = OpenImageIO.ImageInput.open(str(path))
    result = []
    while file.seek_subimage(len(result), 0):
        result.append(file.spec())
    file.close()
    return result


def names_in(folder):
    return sorted(each.name for each in folder.iterdir())


def test_an_exr_has_a_part_for_each_layer_with_rgba_first(tmp_path, layers):
    write_frame(tmp_path / "a.exr", layers, METADATA)
    found = [
        (s.get_string_attribute("oiio:subimagename"), tuple(s.channelnames), str(s.format))
        for s in subimages(tmp_path / "a.exr")
    ]
    rgb = ("R", "G", "B")
    assert found == [
        ("rgba", (*rgb, "A"), "half"),
        ("surface", rgb, "half"),
        ("beams", rgb, "half"),
        ("beams_key", rgb, "half"),
        ("transmittance", rgb, "half"),
        ("depth", ("Z",), "float"),
    ]


def test_layers_read_back_as_written_to_the_precision_of_their_type(tmp_path, layers):
    write_frame(tmp_path / "a.exr", layers)
    found = files.read_layers(tmp_path / "a.exr")
    assert list(found) == ["rgba", "surface", "beams", "beams_key", "transmittance", "depth"]
    for name, pixels in layers.items():
        expected = pixels if name == "depth" else pixels.astype(np.float16).astype(np.float32)
        np.testing.assert_array_equal(found[name], expected)


def test_headers_keep_their_values_and_types(tmp_path, layers):
    write_frame(tmp_path / "a.exr", layers, METADATA)
    with OpenEXR.File(str(tmp_path / "a.exr"), header_only=True) as file:
        assert len({part.name() for part in file.parts}) == 6
        for part in file.parts:
            header = part.header
            np.testing.assert_array_equal(header["worldToCamera"], METADATA["worldToCamera"])
            assert header["worldToCamera"].dtype == np.float32  # M44f
            assert header["framesPerSecond"] == Fraction(24000, 1001)
            assert header["expTime"] == np.float32(1 / 48)
            assert (header["seed"], header["passes"]) == (7, 16)
            assert header["bigSeed"] == str(2**40)
            assert header["lightGroups"] == ["key", "fill"]
            assert header["software"] == "photonbeams 0.1.0"
            assert header["chromaticities"] == pytest.approx((0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290))
            assert header["compression"] == OpenEXR.ZIP_COMPRESSION


def test_a_cropped_frame_keeps_its_place_in_the_whole(tmp_path, layers):
    windows = {"dataWindow": (10, 5, 53, 34), "displayWindow": (0, 0, 99, 49)}
    write_frame(tmp_path / "a.exr", layers, windows)
    for spec in subimages(tmp_path / "a.exr"):
        assert (spec.x, spec.y, spec.width, spec.height) == (10, 5, 44, 30)
        assert (spec.full_width, spec.full_height) == (100, 50)


def test_colours_too_bright_for_half_become_the_largest_half_and_are_named(tmp_path, caplog):
    pixels = np.full((2, 2, 3), 1e6, np.float32)
    pixels[0, 0] = np.inf, -np.inf, 65519.0
    alpha = np.full((2, 2, 4), (0.0, 0.0, 0.0, 1.0), np.float32)
    write_frame(tmp_path / "a.exr", {"rgba": alpha, "beams": pixels, "surface": 2e-8 * alpha[..., 1:]})
    found = files.read_layers(tmp_path / "a.exr")["beams"]
    assert [each.getMessage() for each in caplog.records] == [
        f"{tmp_path / 'a.exr'}: beams: colours beyond 65504, the largest half float: they are clamped, and layers do "
        "not add up there",
        f"{tmp_path / 'a.exr'}: surface: all light is below 6e-8, the smallest half float: it is black",
    ]
    assert found[1, 1].tolist() == [65504.0] * 3
    assert found[0, 0].tolist() == [65504.0, -65504.0, 65504.0]


def test_nan_stays_nan_so_that_it_can_be_found(tmp_path):
    pixels = np.full((2, 2, 3), np.nan, np.float32)
    write_frame(tmp_path / "a.exr", {"beams": pixels})
    assert np.isnan(files.read_layers(tmp_path / "a.exr")["beams"]).all()


def test_whole_numbers_in_an_exr_are_what_they_are(tmp_path):
    """OpenImageIO divides them by the largest one: a plate would be black, and a coverage nothing."""
    path, header = tmp_path / "a.exr", {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {name: np.full((4, 6), k + 1, np.uint32) for k, name in enumerate("RGB")}).write(str(path))
    expected = np.broadcast_to([1.0, 2.0, 3.0], (4, 6, 3))
    assert np.allclose(files.read_parts(path)[0].pixels, expected, rtol=1e-6)
    assert files.summaries(path)[0].greatest == pytest.approx(3, rel=1e-6)
    for limit in (16, 3):  # whole, and in strips
        found = textures.decoded(str(path), lambda pixels, _: pixels, limit).pixels
        assert np.allclose(found, expected[: len(found), : found.shape[1]], rtol=1e-6)


def test_the_same_layers_make_the_same_bytes(tmp_path, layers):
    for name in ("a", "b"):
        write_frame(tmp_path / f"{name}.exr", layers, METADATA)
        write_frame(tmp_path / f"{name}.png", layers)
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_a_missing_folder_is_made(tmp_path, layers):
    write_frame(tmp_path / "new" / "deep" / "a.exr", layers)
    assert names_in(tmp_path / "new" / "deep") == ["a.exr"]


def test_a_file_has_the_mode_that_the_umask_says(tmp_path, layers):
    before = os.umask(0o027)
    try:
        write_frame(tmp_path / "a.exr", layers)
        write_frame(tmp_path / "a.png", layers)
    finally:
        os.umask(before)
    assert {(tmp_path / name).stat().st_mode & 0o777 for name in ("a.exr", "a.png")} == {0o640}


def test_layers_of_several_sizes_are_refused(tmp_path, layers):
    with pytest.raises(ValueError, match=r"depth \(2, 2\)"):
        write_frame(tmp_path / "a.exr", {**layers, "depth": np.ones((2, 2))})
    assert names_in(tmp_path) == []


@pytest.mark.parametrize("name", ["a.jpg", "a.tif", "a", ".exr"])
def test_other_suffixes_are_refused(tmp_path, layers, name):
    with pytest.raises(SceneError, match=r"\.exr \(layers\) or \.png"):
        write_frame(tmp_path / name, layers)
    assert names_in(tmp_path) == []


def test_a_layer_without_colours_is_no_picture(tmp_path):
    depth = {"depth": np.ones((2, 3, 1), dtype=np.float32)}
    with pytest.raises(SceneError, match=r"cannot write .*a\.png: 'depth' has no colours: expected another layer"):
        write_frame(tmp_path / "a.png", depth, layer="depth")
    assert names_in(tmp_path) == []


def test_a_layer_that_is_not_there_is_named(tmp_path, layers):
    with pytest.raises(SceneError, match="no layer 'fog', only surface, beams"):
        write_frame(tmp_path / "a.png", layers, layer="fog")


# -- two eyes --------------------------------------------------------------------------------------------------------


@pytest.fixture
def views(layers):
    """Return two eyes with different pixels and different matrices."""
    right = {name: pixels[:, ::-1] for name, pixels in layers.items()}
    return {
        "left": (layers, {**METADATA, "camera": "/Rig/Left"}),
        "right": (right, {**METADATA, "camera": "/Rig/Right", "worldToCamera": 2 * METADATA["worldToCamera"]}),
    }


def test_a_stereo_exr_has_the_parts_of_the_left_eye_and_then_of_the_right(tmp_path, views):
    write_frame(tmp_path / "a.exr", *views["left"], views=views)
    found = [
        (s.get_string_attribute("name"), s.get_string_attribute("view"), tuple(s.channelnames), str(s.format))
        for s in subimages(tmp_path / "a.exr")
    ]
    rgb = ("R", "G", "B")
    colours = ("surface", "beams", "beams_key", "transmittance")
    assert found == [
        part
        for eye in ("left", "right")
        for part in (
            (f"rgba.{eye}", eye, (*rgb, "A"), "half"),
            *((f"{name}.{eye}", eye, rgb, "half") for name in colours),
            (f"depth.{eye}", eye, ("Z",), "float"),
        )
    ]


def test_each_eye_of_an_exr_has_its_own_matrices_and_no_legacy_header(tmp_path, views):
    write_frame(tmp_path / "a.exr", *views["left"], views=views)
    assert OpenEXR.isOpenExrFile(str(tmp_path / "a.exr"))
    with OpenEXR.File(str(tmp_path / "a.exr")) as file:
        assert len({part.name() for part in file.parts}) == 12
        assert [part.part_index for part in file.parts] == list(range(12))
        for part in file.parts:
            metadata = views[part.header["view"]][1]
            np.testing.assert_array_equal(part.header["worldToCamera"], metadata["worldToCamera"])
            assert part.header["camera"] == metadata["camera"]
            assert part.header["framesPerSecond"] == metadata["framesPerSecond"]
            assert "multiView" not in part.header
            assert {channel.pixels.shape[:2] for channel in part.channels.values()} == {SIZE}


def test_each_eye_reads_back_by_itself(tmp_path, views):
    write_frame(tmp_path / "a.exr", {}, views=views)
    parts = files.read_parts(tmp_path / "a.exr")
    assert [(part.layer, part.view) for part in parts[::6]] == [("rgba", "left"), ("rgba", "right")]
    both = files.read_layers(tmp_path / "a.exr")
    assert list(both) == [part.name for part in parts]
    for view, (layers, _) in views.items():
        found = files.read_layers(tmp_path / "a.exr", view)
        assert sorted(found) == sorted(layers)
        for name, pixels in layers.items():
            expected = pixels if name == "depth" else pixels.astype(np.float16).astype(np.float32)
            np.testing.assert_array_equal(found[name], expected)
            np.testing.assert_array_equal(both[f"{name}.{view}"], expected)
    np.testing.assert_array_equal(files.read_image(tmp_path / "a.exr"), both["rgba.left"])


def test_a_view_that_is_not_there_is_named(tmp_path, layers, views):
    write_frame(tmp_path / "one.exr", layers)
    write_frame(tmp_path / "two.exr", layers, views=views)
    with pytest.raises(SceneError, match=r"one\.exr has no view 'left': its views are none"):
        files.read_layers(tmp_path / "one.exr", "left")
    with pytest.raises(SceneError, match=r"two\.exr has no view 'centre': its views are left, right"):
        files.read_layers(tmp_path / "two.exr", "centre")


def test_one_eye_alone_says_which_it_is_under_the_names_of_a_mono_file(tmp_path, layers):
    write_frame(tmp_path / "a.exr", layers, {"view": "right"})
    write_frame(tmp_path / "b.exr", {}, views={"right": (layers, {})})
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()
    assert {part.view for part in files.read_parts(tmp_path / "a.exr")} == {"right"}
    assert list(files.read_layers(tmp_path / "a.exr"))[:2] == ["rgba", "surface"]


def test_a_mono_file_says_no_view(tmp_path, layers):
    write_frame(tmp_path / "a.exr", layers, METADATA, views={})
    with OpenEXR.File(str(tmp_path / "a.exr"), header_only=True) as file:
        assert [part.name() for part in file.parts][:2] == ["rgba", "surface"]
        assert not any({"view", "multiView"} & set(part.header) for part in file.parts)


def test_a_cropped_stereo_frame_keeps_its_place_in_both_eyes(tmp_path, layers):
    display = {"displayWindow": (0, 0, 99, 49)}
    places = {"left": (10, 5, 53, 34), "right": (12, 5, 55, 34)}
    views = {view: (layers, {**display, "dataWindow": window}) for view, window in places.items()}
    write_frame(tmp_path / "a.exr", {}, views=views)
    for spec in subimages(tmp_path / "a.exr"):
        left, top = places[spec.get_string_attribute("view")][:2]
        assert (spec.x, spec.y, spec.width, spec.height) == (left, top, 44, 30)
        assert (spec.full_width, spec.full_height) == (100, 50)


def test_a_stereo_picture_shows_the_eyes_side_by_side_each_as_it_is_alone(tmp_path, views):
    def pixels(path):
        file = OpenImageIO.ImageInput.open(str(path))
        result = file.read_image("uint8")
        file.close()
        return result

    write_frame(tmp_path / "both.png", *views["left"], "beams", 1.5, views=views)
    for view, (layers, metadata) in views.items():
        write_frame(tmp_path / f"{view}.png", layers, metadata, "beams", 1.5)
    both = pixels(tmp_path / "both.png")
    assert both.shape == (SIZE[0], 2 * SIZE[1], 3)
    np.testing.assert_array_equal(both[:, : SIZE[1]], pixels(tmp_path / "left.png"))
    np.testing.assert_array_equal(both[:, SIZE[1] :], pixels(tmp_path / "right.png"))


WHOLE = {"displayWindow": (0, 0, 43, 29)}
WIDER = {"displayWindow": (0, 0, 99, 29)}


@pytest.mark.parametrize(
    ("left", "right", "message"),
    [
        (({"rgba": (4, 4, 4)}, {}), ({"rgba": (4, 5, 4)}, {}), r"rgba\.right \(4, 5, 4\): expected some .* one size"),
        (({"rgba": (4, 4, 4)}, {}), ({}, {}), r"got layers rgba\.left \(4, 4, 4\): expected some for each view"),
        (({"rgba": (30, 44, 4)}, WHOLE), ({"rgba": (30, 44, 4)}, WIDER), r"43, 29\) for left and \(0, 0, 99, 29\) for"),
        (({"rgba": (4, 4, 4)}, {"chromaticities": (0.3,) * 8}), ({"rgba": (4, 4, 4)}, {}), r"got chromaticities"),
    ],
)
def test_views_that_cannot_be_in_one_file_are_refused_before_a_byte_is_written(tmp_path, left, right, message):
    views = {
        view: ({name: np.zeros(shape) for name, shape in shapes.items()}, metadata)
        for view, (shapes, metadata) in (("left", left), ("right", right))
    }
    with pytest.raises(ValueError, match=message) as error:
        write_frame(tmp_path / "a.exr", {}, views=views)
    assert "\n" not in str(error.value)
    assert names_in(tmp_path) == []


def test_one_view_without_a_name_is_refused_beside_another(tmp_path, layers):
    with pytest.raises(ValueError, match="got views '', 'right': expected a name for each"):
        write_frame(tmp_path / "a.exr", {}, views={"": (layers, {}), "right": (layers, {})})


def test_a_stereo_picture_of_unlike_eyes_is_refused(tmp_path, layers):
    with pytest.raises(SceneError, match=r"no layer 'beams', only rgba"):
        views = {"left": (layers, {}), "right": ({"rgba": layers["rgba"]}, {})}
        write_frame(tmp_path / "a.png", layers, layer="beams", views=views)
    with pytest.raises(ValueError, match=r"eyes \[30, 29\] pixels high"):
        writing.write_png(tmp_path / "a.png", layers["rgba"], layers["rgba"][1:])
    assert names_in(tmp_path) == []


# -- nothing half written --------------------------------------------------------------------------------------------


def test_an_output_is_tried_before_rendering_and_leaves_no_trace(tmp_path):
    (tmp_path / "old.exr").write_bytes(b"yesterday")
    try_path(tmp_path / "old.exr")
    try_path(tmp_path / "sub" / "new.png")
    assert (tmp_path / "old.exr").read_bytes() == b"yesterday"
    assert names_in(tmp_path) == ["old.exr"]


def test_a_folder_in_the_way_is_an_error_that_names_it(tmp_path, layers):
    (tmp_path / "a.exr").mkdir()
    with pytest.raises(IsADirectoryError) as error:
        write_frame(tmp_path / "a.exr", layers)
    assert error.value.filename == str(tmp_path / "a.exr")


def test_a_file_in_the_folders_place_is_an_error(tmp_path, layers):
    (tmp_path / "out").write_text("a file")
    with pytest.raises(OSError) as error:
        write_frame(tmp_path / "out" / "a.exr", layers)
    assert error.value.filename == str(tmp_path / "out" / "a.exr")
    with pytest.raises(OSError):
        write_frame(tmp_path / "out" / "sub" / "a.exr", layers)
    assert names_in(tmp_path) == ["out"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_an_unwritable_folder_is_an_error_that_names_the_file(tmp_path, layers):
    tmp_path.chmod(0o555)
    with pytest.raises(PermissionError) as error:
        write_frame(tmp_path / "a.exr", layers)
    assert error.value.filename == str(tmp_path / "a.exr")


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs a folder where nobody may write")
def test_a_folder_where_nobody_may_write_is_an_error_that_names_the_file(layers):
    with pytest.raises(OSError) as error:
        write_frame("/proc/self/a.exr", layers)
    assert error.value.filename == "/proc/self/a.exr"


# -- pictures --------------------------------------------------------------------------------------------------------


def test_a_picture_is_the_view_of_its_layer_to_one_step_of_8_bits(tmp_path, layers):
    writing.write_png(tmp_path / "a.png", layers["rgba"], exposure=-1.0)
    file = OpenImageIO.ImageInput.open(str(tmp_path / "a.png"))
    found = file.read_image("uint8").astype(float)
    file.close()
    expected = 255 * display.srgb_encoded(display.tone_mapped(layers["rgba"][..., :3], -1.0))
    assert np.abs(found - expected).max() < 1.0


def test_a_written_picture_reads_back_linear(tmp_path):
    pixels = np.full((20, 20, 3), (0.01, 0.1, 0.4), np.float32)  # below the shoulder
    writing.write_png(tmp_path / "a.png", pixels)
    # A step of 8 bits is 1.055/2.4 · x^(1/2.4 − 1) / 255 wide: at most 2 % of the value from 0.01 up.
    np.testing.assert_allclose(files.read_image(tmp_path / "a.png").mean(axis=(0, 1)), pixels[0, 0], rtol=0.02)


# -- bad input -------------------------------------------------------------------------------------------------------


def test_a_file_that_is_no_image_is_named(tmp_path):
    (tmp_path / "a.exr").write_text("no picture")
    for read in (files.read_layers, files.read_image):
        with pytest.raises(SceneError, match=r"a\.exr cannot be read: expected an image"):
            read(tmp_path / "a.exr")
        with pytest.raises(FileNotFoundError):
            read(tmp_path / "b.exr")


def test_a_truncated_exr_is_an_error(tmp_path, layers):
    path = tmp_path / "a.exr"
    write_frame(path, layers)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(SceneError, match=r"a\.exr cannot be read"):
        files.read_layers(path)
