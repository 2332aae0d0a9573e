"""UsdRender's settings and products."""

import logging
from pathlib import Path

import pytest

from photonbeams.images.frame import pixels_of
from photonbeams.scene import SceneError
from photonbeams.usd.cameras.camera import chosen_camera
from photonbeams.usd.common.warnings import Warnings
from photonbeams.usd.settings import RenderProduct, RenderSettings, product_file, read_settings

CAMERAS = 'def Camera "A" {\n}\ndef Camera "B" {\n}\n'
METADATA = 'renderSettingsPrimPath = "/S"'


def settings(body="", name="S"):
    return f'def RenderSettings "{name}" {{\n{body}\n}}\n'


def product(body="", name="P"):
    return f'def RenderProduct "{name}" {{\n{body}\n}}\n'


@pytest.fixture
def warnings(caplog):
    caplog.set_level(logging.WARNING, "photonbeams")
    return caplog


def test_a_stage_without_settings_says_nothing(usd):
    assert read_settings(usd(CAMERAS)) == RenderSettings()


def test_what_is_not_authored_is_none(usd, warnings):
    assert read_settings(usd(settings(), METADATA)) == RenderSettings(path="/S")
    assert warnings.messages == []


def test_settings_are_those_of_the_path_else_of_the_metadata(usd):
    stage = usd(settings("uniform int2 resolution = (3, 2)") + settings("", "T"), METADATA)
    assert read_settings(stage).resolution == (3, 2)
    assert read_settings(stage, "/T") == RenderSettings(path="/T")


def test_all_that_settings_say_is_read(usd, warnings):
    body = """
        rel camera = </B>
        uniform int2 resolution = (640, 360)
        uniform float pixelAspectRatio = 2
        uniform token aspectRatioConformPolicy = "cropAperture"
        uniform float4 dataWindowNDC = (-0.25, 0.5, 1, 1)
        uniform bool disableMotionBlur = true
        uniform bool disableDepthOfField = false
        rel products = </P>"""
    variables = 'def RenderVar "beams_key" {\n}\ndef RenderVar "Ci" {\n}\ndef RenderVar "Deep" {\n'
    variables += '    uniform string sourceName = "Z"\n}\n'
    text = CAMERAS + settings(body) + product("rel orderedVars = [</beams_key>, </Ci>, </Deep>]") + variables
    assert read_settings(usd(text, METADATA)) == RenderSettings(
        path="/S",
        camera="/B",
        resolution=(640, 360),
        data_window=(-0.25, 0.5, 1.0, 1.0),
        pixel_aspect=2.0,
        conform="cropAperture",
        disable_motion_blur=True,
        disable_depth_of_field=False,
        products=(RenderProduct("/P", ("beams_key", "rgba", "depth")),),
    )
    assert warnings.messages == []


@pytest.mark.parametrize(
    ("body", "still"),
    [
        ("uniform bool instantaneousShutter = true", True),
        ("uniform bool instantaneousShutter = false", False),
        ("uniform bool instantaneousShutter = false\nuniform bool disableMotionBlur = true", True),
        ("uniform bool instantaneousShutter = true\nuniform bool disableMotionBlur = false", True),
    ],
)
def test_the_old_name_of_no_motion_blur_is_known(usd, body, still):
    assert read_settings(usd(settings(body), METADATA)).disable_motion_blur is still


def test_the_data_window_is_from_the_lower_left_and_of_pixel_centres():
    def pixels(window, width, height):
        x0, y0, x1, y1 = RenderSettings(data_window=window).crop(width, height)
        return pixels_of((x0, y0, x1, y1), width, height, overscan=True)

    assert RenderSettings().crop(10, 10) is None
    assert pixels((0, 0, 1, 1), 32, 18) == (0, 0, 32, 18)
    assert pixels((0, 0, 0.5, 0.25), 8, 8) == (0, 6, 4, 8)
    assert pixels((0.5, 0.75, 1, 1), 8, 8) == (4, 0, 8, 2)
    assert pixels((0.06, 0, 0.14, 1), 10, 1) == (1, 0, 2, 1)  # no pixel centre is within, but one pixel remains
    assert pixels((0.04, 0, 0.16, 1), 10, 1) == (0, 0, 2, 1)
    assert pixels((-0.5, -0.5, 1.5, 1.5), 64, 36) == (-32, -18, 96, 54)
    assert pixels((-0.14, 0, 1.06, 1.24), 10, 10) == (-1, -2, 11, 10)
    assert pixels((0.96, 0, 1.2, 1), 10, 1) == (10, 0, 12, 1)
    # Thirds and tenths in single precision give whole pixels, and adjacent tiles share no pixel.
    third, tenth = 0.3333333432674408, 0.699999988079071
    assert pixels((third, 0, tenth, 1), 1920, 1) == (640, 0, 1344, 1)
    assert pixels((tenth, 0, 1, 1), 1920, 1) == (1344, 0, 1920, 1)
    for width in range(1, 200):
        for edge in range(1, width):
            assert pixels((0, 0, edge / width, 1), width, 1)[2] == pixels((edge / width, 0, 1, 1), width, 1)[0] == edge


@pytest.mark.parametrize(
    ("body", "warning"),
    [
        ("uniform float pixelAspectRatio = -2", "/S.pixelAspectRatio is -2: expected a number from 0.001 to 1000"),
        ("uniform float pixelAspectRatio = 0", "/S.pixelAspectRatio is 0: expected a number from 0.001 to 1000"),
        ('uniform token aspectRatioConformPolicy = "fit"', "/S.aspectRatioConformPolicy is 'fit': expected one of"),
    ],
)
def test_a_wrong_shape_of_pixels_is_warned_of_once_and_ignored(usd, warnings, body, warning):
    assert read_settings(usd(settings(body), METADATA)) == RenderSettings(path="/S")
    assert len(warnings.messages) == 1
    assert warning in warnings.messages[0]


def test_the_policy_that_adjusts_the_pixels_disregards_their_ratio(usd):
    body = 'uniform float pixelAspectRatio = 2\nuniform token aspectRatioConformPolicy = "adjustPixelAspectRatio"'
    assert read_settings(usd(settings(body), METADATA)) == RenderSettings(path="/S", conform="adjustPixelAspectRatio")


@pytest.mark.parametrize(
    "body",
    [
        *(f"uniform float4 dataWindowNDC = ({window})" for window in
          ("0.5, 0, 0.5, 1", "0.75, 0, 0.25, 1", "0, 0, 0, 0", "0, nan, 1, 1", "0, 0, inf, 1", "1, 0, 2, 1")),
        "uniform int2 resolution = (0, 5)",
        "uniform int2 resolution = (-4, 5)",
    ],
)  # fmt: skip
def test_an_empty_window_is_an_error_though_warnings_are_not(usd, body):
    """Otherwise the whole picture would be rendered."""
    with pytest.raises(SceneError, match=rf"stage\.usda: /S\.{body.split()[2]} is .*"):
        read_settings(usd(settings(body), METADATA))


def test_too_much_overscan_names_the_window(usd):
    window = "uniform float4 dataWindowNDC = (-1000, 0, 1000, 1)"
    expected = r"stage\.usda: /S\.dataWindowNDC is \(-1000, 0, 1000, 1\): 64,000 pixels beyond an edge of 64, expected "
    with pytest.raises(SceneError, match=expected):
        read_settings(usd(settings(window), METADATA)).crop(64, 36)


@pytest.mark.parametrize("path", ["/A", "/Gone", "A", "no path"])
def test_metadata_that_names_no_settings_is_ignored_with_a_warning(usd, warnings, capfd, path):
    stage = usd(CAMERAS, f'renderSettingsPrimPath = "{path}"')
    assert read_settings(stage) == RenderSettings() and chosen_camera(stage, None)
    assert len(warnings.messages) == 1
    assert f"renderSettingsPrimPath is {path}, which is not a RenderSettings prim" in warnings.messages[0]
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("path", ["/A", "/Gone", "S", "/S.camera", "no path", "/"])
def test_a_path_without_settings_is_refused(usd, path):
    with pytest.raises(SceneError, match=rf"stage\.usda has no render settings '{path}'"):
        read_settings(usd(CAMERAS + settings() + settings(name="T")), path)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("rel camera = </Gone>", "/S.camera names /Gone"),
        ("rel camera = </S>", "/S.camera names /S"),
        ("uniform int2 resolution = (0, 5)", "/S.resolution is 0 x 5"),
        ("uniform int2 resolution = (5, 100000)", "/S.resolution is 5 x 100000"),
        ("uniform float pixelAspectRatio = nan", "/S.pixelAspectRatio is nan"),
        (
            "uniform float4 dataWindowNDC = (0.5, 0, 0.5, 1)",
            r"/S.dataWindowNDC is \(0.5, 0, 0.5, 1\)",
        ),
        ("uniform float4 dataWindowNDC = (2, 0, 3, 1)", r"/S.dataWindowNDC is \(2, 0, 3, 1\)"),
        ("uniform float4 dataWindowNDC = (nan, 0, 3, 1)", r"/S.dataWindowNDC is \(nan, 0, 3, 1\)"),
        ("rel products = </Gone>", "/S.products names /Gone"),
        ("rel products = </A>", "/S.products names /A"),
    ],
)
def test_what_makes_no_picture_is_refused_with_file_and_prim(usd, body, message):
    with pytest.raises(SceneError, match=rf"stage\.usda: {message}"):
        stage = usd(CAMERAS + settings(body) + product("rel orderedVars = </A>", "Bad"), METADATA)
        read_settings(stage, warnings=Warnings(strict=True))


def test_a_path_on_a_stage_without_settings_is_refused(usd):
    with pytest.raises(SceneError, match="has no render settings '/S'"):
        read_settings(usd(CAMERAS), "/S")


def test_what_is_given_otherwise_may_be_wrong(usd):
    body = "rel camera = </Gone>\nuniform int2 resolution = (0, 0)\nrel products = </Gone>"
    given = ("camera", "resolution", "products")
    assert read_settings(usd(settings(body), METADATA), given=given) == RenderSettings(path="/S")


def test_a_product_is_stronger_than_its_settings_and_the_first_than_others(usd, warnings):
    body = "uniform int2 resolution = (8, 4)\nrel camera = </A>\nrel products = [</P>, </Q>, </R>]"
    first = product("uniform int2 resolution = (6, 3)")
    alike = product("uniform int2 resolution = (6, 3)\nrel camera = </A>", "Q")
    other = product("uniform int2 resolution = (6, 3)\nrel camera = </B>", "R")
    found = read_settings(usd(CAMERAS + settings(body) + first + alike + other, METADATA))
    assert (found.resolution, found.camera) == ((6, 3), "/A")
    assert [each.path for each in found.products] == ["/P", "/Q", "/R"]
    assert len(warnings.messages) == 1
    assert "/R.camera differs from that of /P, which is used for all products" in warnings.messages[0]


def test_variables_are_layers_by_the_names_that_other_renderers_have(usd, warnings):
    names = {
        "Ci": "rgba",
        "color": "rgba",
        "RGBA": "rgba",
        "Z": "depth",
        "depth": "depth",
        "volume": "beams",
        "N": "normal",
    }
    variables = [
        f'def RenderVar "V{k}" {{\n uniform string sourceName = "{name}"\n}}\n' for k, name in enumerate(names)
    ]
    lpe = 'def RenderVar "%s" {\n uniform string sourceName = "%s"\n uniform token sourceType = "lpe"\n}\n'
    variables += [lpe % ("All", "C.*"), lpe % ("Direct", "C<RD>L")]
    listed = [*(f"</V{k}>" for k in range(len(names))), "</All>", "</Direct>", "</S>", "</Gone>"]
    text = settings("rel products = </P>") + product(f"rel orderedVars = [{', '.join(listed)}]") + "".join(variables)
    assert read_settings(usd(text, METADATA)).products == (RenderProduct("/P", ("rgba", "depth", "beams", "normal")),)
    told = ["/Direct.sourceType is 'lpe': it is left out", "/P.orderedVars names /S: expected a RenderVar",
            "/P.orderedVars names /Gone: expected a RenderVar"]  # fmt: skip
    assert all(part in message for part, message in zip(told, warnings.messages, strict=True))


def test_products_are_rasters_or_deep_ones(usd, warnings):
    kinds = {"D": "deepRaster", "Q": "sound"}
    text = settings("rel products = [</D>, </Q>, </P>]") + product()
    text += "".join(product(f'uniform token productType = "{kind}"', name) for name, kind in kinds.items())
    found = read_settings(usd(text, METADATA)).products
    assert [(each.path, each.deep) for each in found] == [("/D", True), ("/Q", False), ("/P", False)]
    assert len(warnings.messages) == 1
    assert "/Q.productType is 'sound': expected one of raster, deepRaster" in warnings.messages[0]


def test_a_product_names_its_file_at_each_time(usd):
    stage = usd(product('token productName.timeSamples = { 1: "a.1.exr", 2: "a.2.PNG"\n}\n'))
    assert [product_file(stage, RenderProduct("/P"), time) for time in (1, 2)] == [Path("a.1.exr"), Path("a.2.PNG")]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("", "a name that ends in .exr or .png"),
        ("a.tif", "a name that ends in .exr or .png"),
        (".exr", "a name that ends in .exr or .png"),
        ("a.#.##_#.exr", "one run of #"),
        ("d.##/a.##.exr", "one run of #"),
    ],
)
def test_a_product_without_a_picture_is_refused(usd, name, expected):
    stage = usd(product(f'token productName = "{name}"'))
    with pytest.raises(SceneError, match=rf"stage\.usda: /P\.productName is '{name}': expected {expected}"):
        product_file(stage, RenderProduct("/P"))
