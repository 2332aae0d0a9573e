"""Depths and plates of other renderers: they are found by name and put in the right place, with beams over them.

`examples/blender/plate.exr` is Cycles' picture and depth of the attic (examples/blender/plate.py). A render by Mitsuba
showed that its depth is a distance, in a channel whose name ends in .T, and 0 where there is no surface.
"""

from pathlib import Path

import numpy as np
import OpenEXR
import OpenImageIO
import pytest
from scipy.ndimage import binary_dilation

import photonbeams as pb
from photonbeams.images.color_spaces import ColorSpaces
from photonbeams.images.files import UnreadableImageError, read_layers
from photonbeams.images.plates import Holdout, Plate
from photonbeams.render.holdouts import HoldoutDepth
from photonbeams.scene import Camera
from photonbeams.world.cameras.cameras import View, Window
from tests.helpers.deep_files import write_deep
from tests.helpers.kernels import compiled

ATTIC = Path(__file__).resolve().parents[2] / "examples" / "blender" / "attic.usda"
PLATE = ATTIC.with_name("plate.exr")
STAGE = Path(__file__).parents[1] / "usd" / "data" / "comparison.usda"
SIZE = (6, 4)
DEPTH = np.arange(1, 25, dtype=np.float32).reshape(4, 6)


def exr(path, *parts, view=(), window=None):
    """Write parts, each a dict of channels; `window` is the data window's place in a picture of SIZE."""
    written = []
    for index, channels in enumerate(parts):
        header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
        if view:
            header["view"] = view[index]
        if window is not None:
            height, width = next(iter(channels.values())).shape[:2]
            low = np.array(window, np.int32)
            header["dataWindow"] = (low, low + np.array([width - 1, height - 1], np.int32))
            header["displayWindow"] = (np.zeros(2, np.int32), np.array(SIZE, np.int32) - 1)
        written.append(OpenEXR.Part(header, {n: np.ascontiguousarray(c) for n, c in channels.items()}, f"part{index}"))
    if len(parts) == 1:
        OpenEXR.File(written[0].header, written[0].channels).write(str(path))
    else:
        OpenEXR.File(written).write(str(path))
    return path


def named(path, *parts):
    """Write a multi-part file of these names and channels."""
    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    OpenEXR.File([OpenEXR.Part(dict(header), channels, name) for name, channels in parts]).write(str(path))
    return path


def read(holdout, views=("",), size=SIZE, frame=1.0):
    """Return depths of the views, and the warnings."""
    warnings = []
    found = holdout.read(frame, views, size, warnings.append)
    return found, warnings


def color(value):
    return np.full((4, 6, 3), value, np.float32)


# -- in the right place ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def attic(tmp_path_factory):
    """Return a shot without the sky's light in fog, whose samples differ between pictures."""
    layer = tmp_path_factory.mktemp("plates") / "dark.usda"
    layer.write_text('#usda 1.0\nover "Attic" {\nover "env_light" {\nbool photonbeams:enabled = 0\n}\n}\n')
    return pb.Shot.open(ATTIC, medium=pb.Medium(scattering=(0.05, 0.05, 0.05)), session_layers=layer)


@pytest.fixture(scope="module")
def own(attic):
    return attic.render(passes=2, width=320, beams=1024).layers


@pytest.fixture(scope="module")
def over(attic):
    return attic.render(passes=2, holdout=PLATE, over=PLATE, beams=1024).layers


def smooth(depth):
    """Return where the second difference of 1/Z, which is linear on planes, is at most 0.3 % of it: away from edges."""
    inverse = 1 / depth.astype(np.float64)
    bent = np.zeros(depth.shape, bool)
    for axis in (0, 1):
        second = np.abs(np.diff(inverse, 2, axis=axis))
        second = np.pad(second, [(1, 1) if axis == each else (0, 0) for each in (0, 1)], mode="edge")
        bent |= second > 3e-3 * np.maximum(inverse, 1e-3)
    return ~binary_dilation(bent, np.ones((3, 3)))


def test_cycles_depth_of_the_exported_camera_is_ours_at_every_pixel(own):
    (found,), warnings = read(Holdout(PLATE), size=(320, 180))
    assert not warnings
    assert not found.distance
    theirs, ours = found.values.astype(np.float64), own["depth"][..., 0].astype(np.float64)
    assert np.array_equal(np.isinf(theirs), np.isinf(ours))  # the sky is seen through the same pixels
    there = np.isfinite(ours)
    # Coordinates of some units are rounded to single precision several times.
    assert np.median(np.abs(theirs[there] / ours[there] - 1)) < 2e-6
    # 1/Z is linear on planes: the difference of the two over the slope is a shift of the picture, in pixels.
    inverse = 1 / ours
    slopes = [np.gradient(inverse, axis=axis)[smooth(ours) & there] for axis in (1, 0)]
    shift, *_ = np.linalg.lstsq(np.stack(slopes, axis=1), (1 / theirs - inverse)[smooth(ours) & there], rcond=None)
    assert np.abs(shift).max() < 0.01


def test_beams_end_at_cycles_depth_as_they_do_at_our_own_surfaces(attic, own, over):
    away = smooth(own["depth"][..., 0])
    assert away.mean() > 0.6
    difference, peak = np.abs(own["beams"] - over["beams"]).max(axis=2), own["beams"].max()
    # Where 1/Z bends by 0.3 %, the depth of a ray in the pixel is known to that accuracy; the rest is rounding.
    assert difference[away].max() < 1e-3 * peak
    assert np.quantile(difference[away], 0.99) < 1e-5 * peak
    # The test would notice a flipped holdout or a missing one.
    depth = over["depth"][..., 0]
    for wrong in (depth[:, ::-1], depth[::-1], np.full_like(depth, np.inf)):
        beams = attic.render(passes=1, holdout=wrong, beams=1024).layers["beams"]
        assert np.quantile(np.abs(own["beams"] - beams).max(axis=2)[away], 0.99) > 0.05 * peak


def test_beams_are_added_to_the_plate_whose_alpha_stays(over):
    picture = read_layers(PLATE)["ViewLayer.Combined"]
    assert np.allclose(over["rgba"][..., :3], picture[..., :3] + over["beams"], rtol=1e-6)
    assert np.array_equal(over["rgba"][..., 3], picture[..., 3])
    assert not over["surface"].any()


def test_fog_dims_the_plate_where_it_is_asked_to(attic, over):
    frames = []
    plate = pb.Plate(PLATE, fog=True)
    # The fixtures rendered the first frame, which compiles the kernels.
    assert not compiled(lambda: frames.append(attic.render(passes=1, holdout=PLATE, over=plate, beams=1024)))
    (dimmed,) = frames
    picture = read_layers(PLATE)["ViewLayer.Combined"][..., :3]
    layers = dimmed.layers
    assert np.allclose(layers["rgba"][..., :3], picture * layers["transmittance"] + layers["beams"], rtol=1e-6)
    depth = layers["depth"][90, 160, 0]  # half a pixel from the camera's axis
    assert np.allclose(layers["transmittance"][90, 160], np.exp(-0.05 * depth), rtol=1e-3)


def test_a_crop_has_its_part_of_holdout_and_plate(attic):
    whole = attic.render(passes=1, holdout=PLATE, over=PLATE, beams=256).layers
    part = attic.render(passes=1, holdout=PLATE, over=PLATE, beams=256, crop=(0.25, 0.5, 0.75, 1)).layers
    assert np.array_equal(part["depth"], whole["depth"][90:, 80:240])
    assert np.array_equal(part["rgba"][..., 3], whole["rgba"][90:, 80:240, 3])
    # As with any crop, directions are computed from other pixel centres, in float32.
    assert np.allclose(part["rgba"], whole["rgba"][90:, 80:240], rtol=2e-3, atol=1e-4 * whole["rgba"].max())


def test_a_preview_of_half_the_size_takes_every_second_depth_and_the_plates_mean(attic):
    half = attic.render(passes=1, width=160, holdout=PLATE, over=PLATE, beams=256).layers
    full = read_layers(PLATE)
    depth = full["ViewLayer.Depth"][1::2, 1::2]
    assert np.array_equal(half["depth"][..., 0], np.where(depth < 1e9, depth, np.inf))
    mean = full["ViewLayer.Combined"].reshape(90, 2, 160, 2, 4).mean(axis=(1, 3))
    assert np.allclose(half["rgba"][..., :3] - half["beams"], mean[..., :3], atol=1e-5)


def test_a_distance_is_the_planar_depth_over_the_cosine():
    shot = pb.Shot.open(STAGE)
    planar = shot.render(passes=1, width=32, height=18, beams=256).layers["depth"][..., 0]
    camera = shot.cameras()[0]
    distance = planar / View(camera, Window.full(32, 18)).cosines((0.5, 0.5))
    assert (distance / planar).max() > 1.2
    along = shot.render(passes=1, width=32, height=18, beams=256, holdout=planar).layers
    away = shot.render(
        passes=1, width=32, height=18, beams=256, holdout=Holdout(distance / 100, kind="distance", scale=100.0)
    ).layers
    assert np.allclose(along["depth"], away["depth"], rtol=1e-6)
    # The rounding of depths, relative to a beam's length.
    assert np.allclose(along["beams"], away["beams"], rtol=1e-4, atol=1e-5 * along["beams"].max())


def test_each_eye_has_its_own_depth_and_plate(tmp_path):
    layers = {eye: np.full((4, 6), value, np.float32) for eye, value in (("left", 1.5), ("right", 3.0))}
    path = exr(
        tmp_path / "both.exr",
        *[{"Z": depth, "RGB": color(depth[0, 0])} for depth in layers.values()],
        view=("left", "right"),
    )
    shot = pb.Shot.open(STAGE, stereo=pb.Stereo(0.1))
    frame = shot.render(passes=1, beams=16, holdout=path, over=path)
    for eye, depth in layers.items():
        seen = frame.views[eye][0]
        assert np.array_equal(seen["depth"][..., 0], depth)
        assert np.allclose(seen["rgba"][..., :3] - seen["beams"], depth[0, 0], rtol=1e-6)
    pixels = np.stack(list(layers.values()))
    again = shot.render(passes=1, beams=16, holdout=pixels)
    assert np.array_equal(again.views["right"][0]["depth"][..., 0], layers["right"])
    # A deep file whose first sample is opaque is the flat one, for each eye.
    samples = [[(9.0, 9.0, 0.5), (depth[0, 0], depth[0, 0], 1.0)] for depth in layers.values()]
    deep = write_deep(tmp_path / "deep.exr", lambda part, _: samples[part], SIZE, parts=2, views=tuple(layers))
    same = shot.render(passes=1, beams=16, holdout=deep)
    for eye, depth in layers.items():
        flat, seen = (each.views[eye][0] for each in (frame, same))
        assert np.array_equal(seen["depth"][..., 0], depth) and flat["beams"].any()
        np.testing.assert_allclose(seen["beams"], flat["beams"], rtol=1e-4, atol=1e-5 * flat["beams"].max())


# -- channels --------------------------------------------------------------------------------------------------------

Z, OTHER = np.ascontiguousarray(DEPTH), np.zeros((4, 6), np.float32)


@pytest.mark.parametrize(
    ("channels", "distance"),
    [
        pytest.param({"RGB": color(0), "Z": Z}, False, id="Z"),
        pytest.param({"RGB": color(0), "depth.Z": Z, "N.X": OTHER, "N.Y": OTHER, "N.Z": OTHER}, False, id="N.Z"),
        pytest.param({"ViewLayer.Depth.Z": Z, "ViewLayer.Normal.X": OTHER, "ViewLayer.Normal.Z": OTHER}, False, id="b"),
        pytest.param({"RGB": color(0), "beauty.Z": Z}, False, id="beauty.Z"),
        pytest.param({"RGB": color(0), "Depth": Z}, False, id="Depth"),
        pytest.param({"RGB": color(0), "zdepth": Z}, False, id="zdepth"),
        pytest.param({"RGB": color(0), "Pz": Z}, False, id="Pz"),
        pytest.param({"RGB": color(0), "depth.R": Z, "depth.G": OTHER, "depth.B": OTHER}, False, id="depth.R"),
        pytest.param({"RGB": color(0), "Depth.V": Z}, False, id="Depth.V"),
        pytest.param({"RGB": color(0), "distance": Z}, True, id="distance"),
        pytest.param({"RGB": color(0), "camera_distance.Z": Z}, True, id="camera_distance.Z"),
        pytest.param({"RGB": color(0), "dd.y.T": Z}, True, id="Mitsuba's"),
        pytest.param({"Y": Z}, False, id="one channel"),
    ],
)
def test_a_depth_is_found_by_its_name(tmp_path, channels, distance):
    (found,), warnings = read(Holdout(exr(tmp_path / "a.exr", channels)))
    assert not warnings
    assert np.array_equal(found.values, DEPTH)
    assert found.distance == distance


def test_a_depth_is_found_in_a_part_of_its_name_and_may_be_chosen(tmp_path):
    path = named(tmp_path / "a.exr", ("rgba", {"RGB": color(0)}), ("depth", {"Z": Z}), ("fog", {"Z": 2 * Z}))
    assert np.array_equal(read(Holdout(path))[0][0].values, DEPTH)
    for name in ("fog.Z", "fog", "FOG"):
        assert np.array_equal(read(Holdout(path, channel=name))[0][0].values, 2 * DEPTH)
    with pytest.raises(pb.SceneError, match=r"has no channel 'haze': expected one of rgba\.R, .*, depth\.Z, fog\.Z$"):
        read(Holdout(path, channel="haze"))


def test_of_several_depths_the_first_is_taken_with_a_warning(tmp_path):
    path = exr(tmp_path / "a.exr", {"A.Depth.Z": Z, "B.Depth.Z": 2 * Z})
    (found,), warnings = read(Holdout(path))
    assert np.array_equal(found.values, DEPTH)
    assert len(warnings) == 1
    assert "A.Depth.Z, B.Depth.Z" in warnings[0]
    assert read(Holdout(path, channel="B"))[1] == []


def test_a_kind_that_is_given_wins_over_the_name(tmp_path):
    path = exr(tmp_path / "a.exr", {"RGB": color(0), "distance": Z})
    assert not read(Holdout(path, kind="planar"))[0][0].distance
    assert read(Holdout(exr(tmp_path / "b.exr", {"Z": Z}), kind="distance"))[0][0].distance


def test_there_is_nothing_where_a_depth_is_none(tmp_path):
    depth = DEPTH.copy()
    depth[0] = [0, -1, np.nan, np.inf, 1e10, 1e30]
    (found,), _ = read(Holdout(exr(tmp_path / "a.exr", {"Z": depth}), scale=2.0))
    assert np.all(np.isinf(found.values[0]))
    assert np.array_equal(found.values[1:], 2 * DEPTH[1:])
    half = DEPTH.astype(np.float16)
    half[0, 0] = 65504
    (found,), warnings = read(Holdout(exr(tmp_path / "b.exr", {"Z": half})))
    assert np.isinf(found.values[0, 0])
    assert np.array_equal(found.values[1:], DEPTH[1:])
    assert not warnings
    _, warnings = read(Holdout(exr(tmp_path / "c.exr", {"Z": 0 * DEPTH})))
    assert "holds no depth" in warnings[0]


def test_a_data_window_has_its_place_in_the_picture(tmp_path):
    inside = exr(tmp_path / "a.exr", {"Z": DEPTH[:2, :3]}, window=(2, 1))
    expected = np.full((4, 6), np.inf, np.float32)
    expected[1:3, 2:5] = DEPTH[:2, :3]
    assert np.array_equal(read(Holdout(inside))[0][0].values, expected)
    larger = exr(tmp_path / "b.exr", {"Z": np.arange(80, dtype=np.float32).reshape(8, 10) + 1}, window=(-2, -3))
    expected = np.arange(80).reshape(8, 10)[3:7, 2:8] + 1
    assert np.array_equal(read(Holdout(larger))[0][0].values, expected)
    beside = exr(tmp_path / "c.exr", {"RGB": np.ones((2, 3, 3), np.float32)}, window=(20, 1))
    assert not Plate(beside).read(1, [""], SIZE, print)[0][..., :3].any()


def test_overscan_of_a_file_is_that_of_the_picture_and_beyond_it_there_is_nothing(tmp_path):
    """A holdout of twice the size has four depths of each pixel."""
    box, inf = (-3, -2, 7, 5), np.inf
    values = np.arange(80, dtype=np.float32).reshape(8, 10) + 1
    expected = np.full((7, 10), inf)
    expected[0:7, 1:10] = values[1:8, 0:9]
    larger = exr(tmp_path / "a.exr", {"Z": values}, window=(-2, -3))
    (found,) = Holdout(larger).read(1, [""], SIZE, print, box)
    assert np.array_equal(found.values, expected)
    (found,) = Holdout(np.kron(DEPTH, np.ones((2, 2)))).read(1, [""], SIZE, print, box)
    finer = found.values.reshape(7, 2, 10, 2)
    for part in np.ndindex(2, 2):
        assert np.array_equal(finer[2:6, part[0], 3:9, part[1]], DEPTH)
    assert np.isinf(found.values).sum() == 4 * (70 - 24)
    pixels = np.stack([values] * 3, axis=2)
    (found,) = Plate(exr(tmp_path / "b.exr", {"RGB": pixels}, window=(-2, -3))).read(1, [""], SIZE, print, box)
    assert np.array_equal(found[..., 0], np.where(np.isinf(expected), 0, expected))
    (found,) = Plate(color(2.0)).read(1, [""], SIZE, print, (2, 1, 8, 3))
    assert np.array_equal(found[..., 0], [[2, 2, 2, 2, 0, 0]] * 2)


def test_slopes_in_the_picture_do_not_depend_on_overscan():
    whole, (left, top) = np.ones((4, 6)) + DEPTH / 50, (2, 3)
    wide = np.full((10, 11), np.inf)
    wide[top : top + 4, left : left + 6] = whole
    window = Window(*SIZE, (-left, -top, 9, 7))
    shapes = (HoldoutDepth(wide, window), HoldoutDepth(whole, Window.full(*SIZE)))
    for found, expected in zip(*(each._slopes for each in shapes), strict=True):
        inner = found.numpy().reshape(10, 11)[top : top + 4, left : left + 6]
        assert np.array_equal(inner, expected.numpy().reshape(4, 6)) and inner.any()


def test_names_have_the_frame_and_the_view(tmp_path):
    for frame, eye, value in ((7, "left", 1), (7, "right", 2), (8, "left", 3)):
        exr(tmp_path / f"z.{frame:04d}.{eye}.exr", {"Z": value * DEPTH})
    found, _ = read(Holdout(tmp_path / "z.####.%V.exr"), views=("left", "right"), frame=7.0)
    assert [each.values[0, 0] for each in found] == [1, 2]
    with pytest.raises(UnreadableImageError, match=r"z\.0008\.right\.exr .*\(there is no such file\)"):
        read(Holdout(tmp_path / "z.####.%V.exr"), views=("left", "right"), frame=8.0)


def test_views_are_parts_or_the_older_form_of_names(tmp_path):
    parts = exr(tmp_path / "a.exr", {"Z": Z}, {"Z": 2 * Z}, view=("left", "right"))
    spec = OpenImageIO.ImageSpec(6, 4, 4, "float")
    spec.channelnames = ("Z", "right.Z", "depth.right.G", "G")
    spec.attribute("multiView", OpenImageIO.TypeDesc("string[2]"), ("left", "right"))
    file = OpenImageIO.ImageOutput.create(str(tmp_path / "b.exr"))
    assert file.open(str(tmp_path / "b.exr"), spec)
    assert file.write_image(np.stack([Z, 2 * Z, OTHER, OTHER], axis=2))
    file.close()
    for path in (parts, tmp_path / "b.exr"):
        found, warnings = read(Holdout(path), views=("left", "right"))
        assert [each.values[0, 0] for each in found] == [1, 2]
        assert read(Holdout(path), views=("right",))[0][0].values[0, 0] == 2
        assert read(Holdout(path))[0][0].values[0, 0] == 1  # a single camera sees the default view
        assert not warnings


def test_a_file_without_views_is_good_for_one_eye_alone(tmp_path):
    path = exr(tmp_path / "a.exr", {"Z": Z})
    assert read(Holdout(path), views=("right",))[0][0].values[0, 0] == 1
    with pytest.raises(pb.SceneError, match=r"a\.exr has no views, and the frame has two: expected parts of the views"):
        read(Holdout(path), views=("left", "right"))


# -- plates ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "parts",
    [
        pytest.param([("", {"RGB": color(0.25), "spec.R": OTHER, "spec.G": OTHER, "spec.B": OTHER})], id="no name"),
        pytest.param([("rgba", {"RGB": color(0.25)}), ("beams", {"RGB": color(1)})], id="rgba"),
        pytest.param([("diffuse", {"RGB": color(1)}), ("beauty", {"RGB": color(0.25)})], id="beauty"),
        pytest.param([("V.Noisy", {"V.Noisy": color(1)}), ("V.Combined", {"V.Combined": color(0.25)})], id="Combined"),
    ],
)
def test_a_plate_is_the_layer_that_is_called_a_picture(tmp_path, parts):
    path = tmp_path / "a.exr"
    if len(parts) > 1:
        named(path, *parts)
    else:
        exr(path, parts[0][1])
    warnings = []
    (pixels,) = Plate(path).read(1, [""], SIZE, warnings.append)
    assert np.all(pixels == [0.25, 0.25, 0.25, 1])
    assert not warnings


def test_a_plate_of_8_bits_is_srgb(tmp_path):
    path = tmp_path / "a.png"
    file = OpenImageIO.ImageOutput.create(str(path))
    assert file.open(str(path), OpenImageIO.ImageSpec(6, 4, 3, "uint8"))
    assert file.write_image(np.full((4, 6, 3), 188, np.uint8))
    file.close()
    (pixels,) = Plate(path).read(1, [""], SIZE, print)
    assert np.allclose(pixels[..., :3], 0.503, atol=5e-4)  # IEC 61966-2-1 of 188 / 255


AP1 = (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.3217, 0.3377)
# Red, green and blue of AP1 in linear Rec. 709, with Bradford's adaptation: the matrix of OpenColorIO's configurations
# (ACES-2.0's documentation gives the same digits).
AP1_TO_REC709 = np.array([[1.70505, -0.13026, -0.024], [-0.62179, 1.1408, -0.12897], [-0.08326, -0.01055, 1.15297]])


@pytest.mark.parametrize(
    ("header", "untagged", "color", "expected"),
    [
        ({"chromaticities": AP1}, "lin_rec709_scene", (1.0, 0.5, 0.25), "lin_ap1_scene"),
        ({"oiio:ColorSpace": "ACEScg"}, "lin_rec709_scene", (1.0, 0.5, 0.25), "lin_ap1_scene"),
        ({}, "lin_ap1_scene", (1.0, 0.5, 0.25), "lin_ap1_scene"),
        ({}, "lin_rec709_scene", (1.0, 0.5, 0.25), "lin_rec709_scene"),
    ],
)
def test_a_plate_is_converted_from_the_space_that_its_header_says(tmp_path, header, untagged, color, expected):
    path, pixels = tmp_path / "plate.exr", np.tile(np.float32(color), (*SIZE[::-1], 1))
    OpenEXR.File({"type": OpenEXR.scanlineimage, **header}, {"RGB": pixels}).write(str(path))
    warnings = []
    plate, spaces = Plate(path), ColorSpaces("lin_rec709_scene", untagged)
    (found,) = plate.read(1, [""], SIZE, warnings.append, spaces=spaces)
    own = np.array(color) @ AP1_TO_REC709 if expected == "lin_ap1_scene" else color
    assert np.allclose(found[..., :3], own, atol=2e-4)  # chromaticities of five digits
    (same,) = plate.read(1, [""], SIZE, warnings.append, spaces=ColorSpaces(expected, untagged))
    assert np.array_equal(same[..., :3], pixels)
    assert not warnings


def test_a_plate_of_unknown_primaries_is_warned_of(tmp_path):
    header = {"type": OpenEXR.scanlineimage, "chromaticities": (0.5, 0.3, 0.3, 0.5, 0.2, 0.1, 0.31, 0.33)}
    OpenEXR.File(header, {"RGB": color(1)}).write(str(tmp_path / "odd.exr"))
    warnings = []
    Plate(tmp_path / "odd.exr").read(1, [""], SIZE, warnings.append)
    assert len(warnings) == 1
    assert "chromaticities 0.5 0.3 0.3 0.5 0.2 0.1 0.31 0.33: expected those of a colour space" in warnings[0]


def test_a_plate_that_is_damaged_inside_leaves_the_layers_and_a_warning(tmp_path, caplog):
    path = tmp_path / "a.exr"
    ramp = np.linspace(0, 1, 180 * 320 * 3, dtype=np.float32).reshape(180, 320, 3)
    OpenEXR.File({"type": OpenEXR.scanlineimage}, {"RGB": ramp}).write(str(path))
    path.write_bytes(path.read_bytes()[:-50] + bytes(50))  # the last rows do not have the checksum of theirs
    frame = pb.Shot.open(STAGE).render(passes=1, beams=64, over=path)
    assert len(caplog.records) == 1
    assert "rgba is what it is without a plate" in caplog.text
    layers = frame.layers
    assert np.array_equal(layers["rgba"][..., :3], layers["surface"] + layers["beams"])


# -- bad input -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("made", "sentence"),
    [
        (lambda path: exr(path, {"RGB": color(0), "N.X": OTHER, "N.Z": Z}), "has no channel that is called a depth"),
        (lambda path: exr(path, {"RGB": color(0), "Z": Z.astype(np.uint32)}), "holds Z as uint"),
        (
            lambda path: exr(path, {"Z": np.ones((8, 8), np.float32)}),
            "is 8 x 8 pixels, and the picture 6 x 4: expected",
        ),
        (lambda path: exr(path, {"Z": np.ones((2, 3), np.float32)}), "--res 3 2 would do"),
        (lambda path: (path.write_text("no image"), path)[1], "expected an image"),
    ],
)
def test_a_holdout_that_is_none_is_refused_before_anything_is_rendered(tmp_path, made, sentence):
    holdout = Holdout(made(tmp_path / "bad.exr"))
    with pytest.raises(pb.SceneError, match=sentence):
        holdout.check(1.0, [""], SIZE)
    with pytest.raises(pb.SceneError, match=sentence):
        read(holdout)


def test_pixels_of_another_shape_are_refused():
    for pixels, views in ((np.ones((3, 4, 6)), [""]), (np.ones((4, 6)), ["left", "right"]), (np.ones(6), [""])):
        with pytest.raises(pb.SceneError, match="shape"):
            Holdout(pixels).read(1, views, SIZE, print)
    with pytest.raises(pb.SceneError, match=r"expected \(H, W, 3\) or \(H, W, 4\)"):
        Plate(np.ones((4, 6, 2))).read(1, [""], SIZE, print)
    with pytest.raises(pb.SceneError, match="the holdout is 6 x 5 pixels, and the picture 6 x 4"):
        Holdout(np.ones((5, 6))).read(1, [""], SIZE, print)


def test_settings_of_a_holdout_are_checked():
    with pytest.raises(pb.SceneError, match="expected one of auto, planar, distance"):
        Holdout("a.exr", kind="z")
    for scale in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(pb.SceneError, match="expected more than 0"):
            Holdout("a.exr", scale=scale)


def test_a_picture_without_colours_is_no_plate(tmp_path):
    with pytest.raises(pb.SceneError, match="has no red, green and blue"):
        Plate(exr(tmp_path / "a.exr", {"Z": Z})).check(1.0, [""], SIZE)


def test_without_a_size_the_picture_has_the_holdouts():
    shot = pb.Shot.open(STAGE)
    frame = shot.render(passes=1, beams=16, holdout=np.full((10, 14), 2.0))
    assert frame.layers["rgba"].shape == (10, 14, 4)


def test_an_orthographic_cameras_distances_are_planar_depths():
    camera = Camera("/c", np.eye(4), 1.0, 2.0, 1.0, projection="orthographic")
    assert np.allclose(View(camera, Window.full(6, 4)).cosines((0.5, 0.5)), 1.0)
