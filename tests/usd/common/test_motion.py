"""Animated stages: motion while the shutter is open, what stays the same from frame to frame, and stereo."""

import re
from pathlib import Path

import numpy as np
import OpenImageIO
import pytest

import photonbeams as pb
from photonbeams.scene import SceneError
from photonbeams.scene.changes import equal, followed
from photonbeams.usd.cameras.stereo import Stereo
from photonbeams.usd.common import textures

KEYHOLE = Path(__file__).parents[3] / "examples" / "keyhole" / "keyhole.usda"
SMALL = {"passes": 2, "width": 48, "height": 32, "beams": 64}

METADATA = "startTimeCode = 1\nendTimeCode = 9\ntimeCodesPerSecond = 24\nframesPerSecond = 24"
STAGE = """
def Scope "Fog" ( prepend apiSchemas = ["PhotonBeamsMediumAPI"] )
{
    color3f photonbeams:scattering = (0.1, 0.1, 0.1)
}
def Mesh "Wall"
{
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-6, -4, -8), (6, -4, -8), (6, 4, -8), (-6, 4, -8)]
    uniform token subdivisionScheme = "none"
}
def Mesh "Baffle"
{
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(0, -9, -9), (0, 9, -9), (0, 9, 9), (0, -9, 9)]
    uniform token subdivisionScheme = "none"
}
def SphereLight "Still" ( prepend apiSchemas = ["PhotonBeamsLightAPI", "ShapingAPI"] )
{
    bool treatAsPoint = 1
    float inputs:radius = 0
    float inputs:intensity = 50
    float inputs:shaping:cone:angle = 20
    token photonbeams:lightGroup = "still"
    double3 xformOp:translate = (-1.5, 0, -2)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def SphereLight "Swinging" ( prepend apiSchemas = ["PhotonBeamsLightAPI", "ShapingAPI"] )
{
    bool treatAsPoint = 1
    float inputs:radius = 0
    float inputs:intensity = 50
    float inputs:shaping:cone:angle = 20
    token photonbeams:lightGroup = "swinging"
    double3 xformOp:translate.timeSamples = { 1: (1.5, 0, -2), 9: (2.5, 0.5, 2) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Camera "Camera"
{
    float focalLength = 10
    float horizontalAperture = 12
    float verticalAperture = 8
    float focusDistance = 5
    float fStop = 0
    double shutter:open = 0
    double shutter:close = 0
    double3 xformOp:translate = (0, 0, 1)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""


@pytest.fixture
def shot(usd):
    def opened(*overrides, text=STAGE, **arguments):
        path = usd(text, METADATA).GetRootLayer().realPath
        return pb.Shot.open(path, overrides=overrides, **arguments)

    return opened


# -- What moves -------------------------------------------------------------------------------------------------------


def test_what_is_at_rest_is_the_same_object_all_the_time(shot):
    exposure = shot("/Camera.shutter:close=0.5").exposure(2)
    assert exposure.moving and exposure.duration == 0.5
    (first, eyes), (later, same_eyes) = exposure(0.0), exposure(0.25)
    assert eyes[0] is same_eyes[0] and first.meshes is later.meshes and first.medium is later.medium
    assert first.lights[0] is later.lights[0] and first.lights[1] is not later.lights[1]
    # At frame 2.125, the light is 1.125 of 8 frames on its way from 1.5 to 2.5.
    assert later.lights[1].center[0] == pytest.approx(1.5 + 1.125 / 8)
    assert exposure(0.25)[0] is later


def test_a_long_render_keeps_a_few_moments_alone(shot):
    exposure = shot("/Camera.shutter:close=0.5").exposure(2)
    first = exposure(0.0)
    for fraction in np.linspace(0, 1, 40):
        moment = exposure(fraction)
        assert exposure(fraction) is moment
    assert exposure(0.0) is first
    assert exposure(1.0) is moment and len(exposure._known) < 10


def test_velocities_blur_what_has_one_sample(shot):
    points = "[(0, -9, -9), (0, 9, -9), (0, 9, 9), (0, -9, 9)]"
    samples = f"""points.timeSamples = {{ 2: {points} }}
    vector3f[] velocities.timeSamples = {{ 2: [{", ".join(4 * ["(24, 0, 0)"])}] }}"""
    text = STAGE.replace("9: (2.5, 0.5, 2)", "9: (1.5, 0, -2)").replace(f"points = {points}", samples)
    exposure = shot("/Camera.shutter:open=-0.5", "/Camera.shutter:close=0.5", text=text).exposure(2)
    assert exposure.moving
    for fraction in (0, 0.25, 1):
        assert exposure(fraction)[0].meshes[1].points[:, 0] == pytest.approx(fraction - 0.5)


def test_a_shutter_that_opens_before_the_frame_sees_the_frames_topology(shot):
    kinds = ((4, "(1, 0, 0)"), (3, "(24, 0, 0)"), (3, "(0, 576, 0)"))
    slow, fast, pull = (f"[{', '.join(count * [each])}]" for count, each in kinds)
    text = STAGE[: STAGE.index('def Mesh "Baffle"')] + STAGE[STAGE.index('def SphereLight "Still"') :]
    text += f"""def Mesh "Splash"
{{
    int[] faceVertexCounts.timeSamples = {{ 1: [4], 2: [3] }}
    int[] faceVertexIndices.timeSamples = {{ 1: [0, 1, 2, 3], 2: [0, 1, 2] }}
    point3f[] points.timeSamples = {{ 1: {slow}, 2: [(0, 0, 0), (0, 1, 0), (0, 1, 1)] }}
    vector3f[] velocities.timeSamples = {{ 1: {slow}, 2: {fast} }}
    vector3f[] accelerations.timeSamples = {{ 1: {slow}, 2: {pull} }}
}}"""
    exposure = shot("/Camera.shutter:open=-0.5", "/Camera.shutter:close=0.5", text=text).exposure(2)
    for fraction in (0, 0.25, 1):
        (mesh,) = [each for each in exposure(fraction)[0].meshes if each.name == "/Splash"]
        time = fraction - 0.5
        assert len(mesh.faces) == 1
        assert mesh.points - [time, time**2 / 2, 0] == pytest.approx(np.array([[0, 0, 0], [0, 1, 0], [0, 1, 1]]))


# A bool is held from one time sample to the next.
JUMPING = STAGE.replace(
    'token photonbeams:lightGroup = "still"',
    """token photonbeams:lightGroup = "still"
    float inputs:colorTemperature = 2000
    bool inputs:enableColorTemperature.timeSamples = { 1: 0, 3: 1 }""",
)


def test_what_jumps_as_the_shutter_closes_is_not_in_the_beams(shot):
    """A value that jumps when the shutter closes has no effect, because the close is read just before the jump."""
    plain, jumping = (
        shot("/Camera.shutter:close=1", text=text).render(2, **SMALL).layers["beams_still"] for text in (STAGE, JUMPING)
    )
    assert np.array_equal(plain, jumping) and plain.any()
    standing = JUMPING.replace("9: (2.5, 0.5, 2)", "9: (1.5, 0, -2)")
    assert not shot("/Camera.shutter:close=1", text=standing).exposure(2).moving


def test_a_slice_that_closes_where_something_jumps_is_before_it(shot):
    exposure = shot("/Camera.shutter:open=-0.5", "/Camera.shutter:close=0.5", text=JUMPING).exposure(3)
    shutter = exposure.shutter([0])
    (white, before), (red, after) = shutter.ends(0.0, 0.5), shutter.ends(0.5, 1.0)
    assert before.scene.lights[0] is white.scene.lights[0]
    assert equal(red.scene.lights[0], after.scene.lights[0]) and not equal(before.scene.lights[0], red.scene.lights[0])
    assert before.scene.lights[1].center == pytest.approx(red.scene.lights[1].center, abs=1e-8)


def test_a_closed_shutter_and_a_still_stage_do_not_move(shot):
    assert not shot().exposure(3).moving
    still = shot("/Camera.shutter:close=0.5", text=STAGE.replace("9: (2.5, 0.5, 2)", "9: (1.5, 0, -2)"))
    assert not still.exposure(3).moving
    assert not shot("/Camera.shutter:close=0.5").exposure(3, blur=False).moving


def test_without_blur_all_is_as_at_the_frames_own_time(shot):
    """Without blur, the shutter interval is [0, 0], as UsdRenderSettings defines disableMotionBlur."""
    open_early = shot("/Camera.shutter:open=-0.5", "/Camera.shutter:close=0.5")
    exposure = open_early.exposure(3, blur=False)
    assert exposure.duration == 0 and exposure.code(0) == 3
    assert exposure(0.0)[0].lights[1].center[0] == pytest.approx(1.5 + 2 / 8)
    still = shot().render(3, **SMALL)
    sharp = open_early.render(3, blur=False, **SMALL)
    assert sharp.metadata["expTime"] == 0
    assert all(np.array_equal(sharp.layers[name], still.layers[name]) for name in still.layers)


def test_prims_are_followed_by_their_names(shot):
    first, later = (shot().read(frame)[0] for frame in (1, 2))
    gone = followed(first, type(later)(later.meshes[:1], later.lights[1:], (), ()))
    assert [light.name for light in gone.lights] == ["/Still", "/Swinging"]
    assert gone.lights[0] is first.lights[0] and equal(gone.lights[1], later.lights[1])
    assert len(gone.meshes) == 2 and gone.medium is first.medium
    assert followed(first, first) is first


def test_equality_looks_into_arrays():
    mesh = pb.scene.Mesh("/a", np.zeros((3, 3)), np.array([[0, 1, 2]]))
    assert equal(mesh, pb.scene.Mesh("/a", np.zeros((3, 3)), np.array([[0, 1, 2]])))
    assert not equal(mesh, pb.scene.Mesh("/a", np.ones((3, 3)), np.array([[0, 1, 2]])))
    assert not equal((1, 2), (1, 2, 3)) and not equal(1, 1.5) and not equal(np.zeros(3), 0)
    assert equal((0.1 + 0.2, np.array([0.1 + 0.2])), (0.3, np.array([0.3]))) and not equal(0.3, 0.3 + 1e-8)


def test_a_moving_light_blurs_and_the_exr_says_how_long_the_shutter_was_open(shot):
    layers = []
    for close in (0, 0.5):
        frame = shot(f"/Camera.shutter:close={close}").render(3, **SMALL)
        assert frame.metadata["expTime"] == pytest.approx(close / 24)
        layers.append(frame.layers)
    assert np.array_equal(layers[0]["beams_still"], layers[1]["beams_still"])
    assert not np.array_equal(layers[0]["beams_swinging"], layers[1]["beams_swinging"])


# -- From frame to frame ----------------------------------------------------------------------------------------------


def test_what_a_moving_light_does_not_reach_does_not_flicker(shot):
    """Pixels that the moving light does not reach have no temporal variance (issue 3)."""
    stage = shot("/Camera.shutter:close=0.5")
    frames = [stage.render(frame, **SMALL).layers for frame in (2, 4, 6)]
    for other in frames[1:]:
        assert np.array_equal(other["beams_still"], frames[0]["beams_still"])
        assert not np.array_equal(other["beams_swinging"], frames[0]["beams_swinging"])
        # The baffle keeps the moving light from the left half of the wall.
        left = (frames[0]["beams_swinging"] == 0).all(axis=-1) & (other["beams_swinging"] == 0).all(axis=-1)
        assert left[:, : SMALL["width"] // 2 - 1].mean() > 0.9
        left[:, SMALL["width"] // 2 - 1 :] = False  # the light may reach a surface where no beam is before it
        assert np.array_equal(other["rgba"][left], frames[0]["rgba"][left])


# Far from all light, and out of sight.
UNSEEN = """
def Cube "Unseen"
{
    double3 xformOp:translate.timeSamples = { 1: (-5, 0, 9), 2: (-5, 0, 9), 3: (-4, 1, 9) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""
AT_REST = STAGE.replace("9: (2.5, 0.5, 2)", "9: (1.5, 0, -2)")
# Their pictures have rays of all kinds: evenly spaced ones, others, and more of them at edges.
WIDE = {"passes": 2, "width": 400, "height": 24, "beams": 64}


@pytest.mark.parametrize("depth", [2, 4])
def test_what_stands_still_is_the_same_once_something_else_begins_to_move(shot, depth):
    """From frame 2 on a light moves and becomes brighter while the shutter is open, and so does an unseen object.

    Some walks of scattered light meet that object, however far it is: with them, there is none.
    """
    text = STAGE.replace("{ 1: (1.5, 0, -2), 9: (2.5, 0.5, 2) }", "{ 1: (1.5, 0, -2), 2: (1.5, 0, -2), 3: (3, 1, -1) }")
    begin = text.index('"Swinging"')
    brighter = "float inputs:intensity.timeSamples = { 1: 50, 2: 50, 3: 900 }"
    text = text[:begin] + text[begin:].replace("float inputs:intensity = 50", brighter)
    stage = shot("/Camera.shutter:close=0.5", text=text + (UNSEEN if depth == 2 else ""))
    assert stage.exposure(2).moving and not stage.exposure(1).moving
    first, later = (stage.render(frame, max_depth=depth, **WIDE).layers for frame in (1, 2))
    assert np.array_equal(first["beams_still"], later["beams_still"]) and first["beams_still"].any()
    assert not np.array_equal(first["beams_swinging"], later["beams_swinging"])
    # The baffle keeps the moving light from the left half of the picture, all but what is scattered or reflected.
    dark = (first["beams_swinging"] == 0).all(axis=-1) & (later["beams_swinging"] == 0).all(axis=-1)
    assert depth > 2 or dark[:, : WIDE["width"] // 2 - 1].mean() > 0.9
    dark[:, WIDE["width"] // 2 - 1 :] = False
    # Scattered light reaches surfaces where no beam is before them.
    names = [name for name in first if depth == 2 or not name.startswith(("rgba", "surface"))]
    assert dark.any() and all(np.array_equal(first[name][dark], later[name][dark]) for name in names)


def test_what_begins_to_move_changes_nothing_that_it_does_not_touch(shot):
    """An unseen object leaves all layers as they were; a card that moves through a light blurs that light alone."""
    stage = shot("/Camera.shutter:close=1", text=AT_REST + UNSEEN)
    first, later = (stage.render(frame, **WIDE).layers for frame in (1, 2))
    assert all(np.array_equal(first[name], later[name]) for name in first)
    through = UNSEEN.replace("(-5, 0, 9)", "(1.5, 0, -5)").replace("(-4, 1, 9)", "(3.5, 0, -5)")
    stage = shot("/Camera.shutter:close=1", text=AT_REST + through)
    first, later = (stage.render(frame, **WIDE).layers for frame in (1, 2))
    assert np.array_equal(first["beams_still"], later["beams_still"])
    instants = [stage.render(2 + (k + 0.5) / 4, blur=False, **WIDE).layers["beams_swinging"].sum() for k in range(4)]
    assert later["beams_swinging"].sum() == pytest.approx(np.mean(instants), rel=0.03)
    assert abs(first["beams_swinging"].sum() / later["beams_swinging"].sum() - 1) > 0.06


def test_a_program_sees_the_same_times_whether_or_not_anything_moves(shot):
    def fading(beams, context):
        beams.power = beams.power * (3 - context.time)
        return beams

    later = UNSEEN.replace("2: (-5, 0, 9), 3:", "7: (-5, 0, 9), 8:")  # it moves then, so the bounds are the same
    layers = [
        shot("/Camera.shutter:close=0.5", text=AT_REST + more, simulate=fading).render(2, **SMALL).layers["beams_still"]
        for more in (UNSEEN, later)
    ]
    assert np.array_equal(*layers) and layers[0].any()


def test_two_frames_of_what_is_static_are_identical(shot):
    stage = shot(text=STAGE.replace("9: (2.5, 0.5, 2)", "9: (1.5, 0, -2)"))
    first, later = (stage.render(frame, **SMALL).layers for frame in (1, 7))
    assert all(np.array_equal(first[name], later[name]) for name in first)


def test_what_is_broken_at_another_frame_does_not_keep_this_one_from_rendering(shot):
    text = STAGE.replace("9: (2.5, 0.5, 2)", "9: (nan, 0, 0)")
    stage = shot(text=text)
    assert stage.render(1, **SMALL).layers["beams"].max() > 0
    assert [light.name for light in stage.read(9)[0].lights] == ["/Still"]
    with pytest.raises(SceneError, match="/Swinging has a transform that is not finite"):
        shot(text=text, strict=True).read(9)


def test_no_lens_is_a_pinhole_and_a_wide_one_blurs(shot):
    sharp, off, wide = (
        shot(f"/Camera.fStop={stop}").render(1, lens=lens, **SMALL).layers
        for stop, lens in ((0, True), (0.5, False), (0.5, True))
    )
    assert all(np.array_equal(sharp[name], off[name]) for name in sharp)
    assert not np.array_equal(sharp["beams"], wide["beams"])
    assert np.array_equal(sharp["depth"], wide["depth"])


LIGHT = ("rgba", "surface", "beams")


def test_a_cameras_exposure_multiplies_all_light_and_nothing_else(shot):
    plain, bright = (shot(f"/Camera.exposure={stops}").render(1, **SMALL).layers for stops in (0, 3))
    for name, layer in plain.items():
        channels = 3 if name.startswith(LIGHT) else 0
        assert np.array_equal(bright[name][..., :channels], 8 * layer[..., :channels])
        assert np.array_equal(bright[name][..., channels:], layer[..., channels:])
    assert plain["surface"].any() and plain["rgba"][..., 3].any()


def test_a_pass_has_the_exposure_of_the_middle_of_its_slice(shot):
    text = STAGE.replace("9: (2.5, 0.5, 2)", "9: (1.5, 0, -2)")
    text = text.replace("float fStop = 0", "float fStop = 0\n    float exposure:iso.timeSamples = { 1: 100, 9: 500 }")
    found = shot("/Camera.shutter:close=8", text=text).render(1, **SMALL | {"passes": 1}).layers
    first = shot(text=text).render(1, **SMALL | {"passes": 1}).layers
    assert np.allclose(found["beams"], 3 * first["beams"], rtol=1e-5) and first["beams"].any()


# -- Hard cases -------------------------------------------------------------------------------------------------------


def moving(prim, name, samples):
    """Return the stage with one attribute of a prim animated."""
    kind = {"inputs:intensity": "float", "xformOp:translate": "double3", "photonbeams:scattering": "color3f"}[name]
    begin = STAGE.index(f'"{prim}"')
    end = STAGE.index("\n}", begin)
    body = re.sub(rf"    {kind} {name}[^\n]*\n", "", STAGE[begin:end] + "\n")
    return STAGE[:begin] + body + f"    {kind} {name}.timeSamples = {samples}" + STAGE[end:]


@pytest.mark.parametrize("back", ["(1.5, 0, -2)", "(1.5, 0.001, -2)"])
def test_what_comes_back_to_where_it_was_has_moved(shot, back):
    """The bounds include a light that is far away only in the middle of a loop, between evenly spaced times."""
    stage = shot(text=STAGE.replace("9: (2.5, 0.5, 2)", f"4.1: (1.5, 0, -2), 4.2: (90, 0, -2), 4.3: {back}, 9: {back}"))
    assert stage.exposure(1)(0.0)[0].bounds[1] > 40


def test_what_moves_by_a_spline_has_the_same_bounds_in_each_frame(shot):
    """The bounds do not depend on the frame, so machines that share the frames of a film make the same beams."""
    samples = "timeSamples = { 1: (1.5, 0, -2), 9: (2.5, 0.5, 2) }"
    spline = STAGE.replace(
        f"double3 xformOp:translate.{samples}",
        """double xformOp:translateX.spline = {
        1: 0; post curve (1.0, 90.0),
        9: 0; pre (1.0, -90.0),
    }""",
    )
    begin = spline.index('"Swinging"')
    spline = spline[:begin] + spline[begin:].replace('["xformOp:translate"]', '["xformOp:translateX"]', 1)
    alone = [shot(text=spline).exposure(frame)(0.0)[0].bounds for frame in (1, 5, 9)]
    assert all(equal(bounds, alone[0]) for bounds in alone)
    assert alone[0][1] > shot().exposure(1)(0.0)[0].bounds[1] + 20  # the curve overshoots
    blurred = shot("/Camera.shutter:close=0.5", text=spline)
    assert blurred.exposure(1).moving


def test_a_light_that_fades_out_is_rendered_black_and_warned_of_once(shot, caplog):
    dark = STAGE.replace("float inputs:intensity = 50", "float inputs:intensity.timeSamples = { 1: 9, 3: 0 }")
    stage = shot(text=dark)
    assert stage.render(1, **SMALL).layers["beams"].max() > 0
    for frame in (3, 4):
        assert not stage.render(frame, **SMALL).layers["beams"].any()
    assert [record.message.count("expected some of /Still, /Swinging to shine") for record in caplog.records] == [1]


def test_a_flash_between_shutter_open_and_close_is_seen(shot):
    flash = moving("Still", "inputs:intensity", "{ 2: 50, 2.1: 50, 2.12: 5000, 2.14: 50, 4: 50 }")
    still = flash.replace("9: (2.5, 0.5, 2)", "9: (1.5, 0, -2)")
    assert shot("/Camera.shutter:close=0.5", text=still).exposure(2).moving
    turns = STAGE.replace("1: (1.5, 0, -2), 9: (2.5, 0.5, 2)", "1: (1.5, 0, -2), 1.5: (0, 9, 0), 2: (1.5, 0, -2)")
    assert shot("/Camera.shutter:close=1", text=turns).exposure(1).moving


def test_fog_looks_and_lens_are_those_of_a_slices_middle(shot):
    """One pass over a shutter interval in which the fog thickens linearly shows the fog of its middle."""
    text = moving("Fog", "photonbeams:scattering", "{ 1: (0.001, 0.001, 0.001), 9: (0.081, 0.081, 0.081) }")
    text = text.replace("9: (2.5, 0.5, 2)", "9: (1.5, 0, -2)")
    blurred = shot("/Camera.shutter:close=8", text=text).render(1, **SMALL | {"passes": 1}).layers["beams_still"]
    middle = shot(text=text).render(5, **SMALL | {"passes": 1}).layers["beams_still"]
    assert np.allclose(blurred, middle, rtol=1e-4, atol=1e-7)


def test_an_error_inside_the_shutter_says_when(shot):
    text = STAGE.replace("9: (2.5, 0.5, 2)", "2.2: (1.5, 0, -2), 2.3: (nan, 0, 0)")
    with pytest.raises(SceneError, match=r"/Swinging .*\(at time 2\.[0-9]+, while the shutter is open\)"):
        shot("/Camera.shutter:close=0.5", text=text, strict=True).exposure(2)


def test_images_are_decoded_once_for_all_times(tmp_path, shot, monkeypatch):
    image = OpenImageIO.ImageBuf(OpenImageIO.ImageSpec(4, 4, 3, "uint8"))
    image.write(str(tmp_path / "wood.png"))
    shader = f'''def Shader "Image"
    {{
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @{tmp_path}/wood.png@
        color3f outputs:rgb
    }}
    def Shader "Surface"'''
    text = STAGE + ROD[ROD.index("def Mesh") : ROD.index("def Camera")].replace("DEPTH", "-3")
    text = text.replace('def Shader "Surface"', shader)
    uvs = 'texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] ( interpolation = "vertex" )'
    text = text.replace("    rel material:binding = </Glow>", f"    {uvs}\n    rel material:binding = </Glow>")
    text = text.replace("diffuseColor = (0, 0, 0)", "diffuseColor.connect = </Glow/Image.outputs:rgb>")
    decoded = []
    whole = textures.decoded
    monkeypatch.setattr(textures, "decoded", lambda path, *given: decoded.append(path) or whole(path, *given))
    stage = shot(text=text)
    first, later = (stage.read(frame)[0] for frame in (1, 2))
    assert len(decoded) == 1
    assert followed(first, later).meshes is first.meshes


# -- Stereo -----------------------------------------------------------------------------------------------------------


def test_eyes_at_one_place_see_the_same(shot):
    frame = shot(stereo=Stereo(interaxial=0, convergence=5)).render(1, **SMALL)
    mono = shot().render(1, **SMALL)
    assert list(frame.views) == ["left", "right"] and frame.layers is frame.views["left"][0]
    for layers, _ in frame.views.values():
        assert all(np.array_equal(layers[name], mono.layers[name]) for name in layers)


def test_each_eye_alone_sees_what_it_sees_of_both(shot):
    stage = shot(stereo=Stereo(interaxial=0.3, convergence=5))
    both = stage.render(1, **SMALL)
    for view in ("left", "right"):
        alone = stage.render(1, view=view, **SMALL)
        assert not alone.views
        assert all(np.array_equal(alone.layers[name], both.views[view][0][name]) for name in alone.layers)
        assert np.array_equal(alone.metadata["worldToNDC"], both.views[view][1]["worldToNDC"])


ROD = """
def Scope "Fog" ( prepend apiSchemas = ["PhotonBeamsMediumAPI"] )
{
    color3f photonbeams:scattering = (0.01, 0.01, 0.01)
}
def BasisCurves "Beam" ( prepend apiSchemas = ["PhotonBeamsCurvesAPI"] )
{
    uniform token type = "linear"
    int[] curveVertexCounts = [2]
    point3f[] points = [(0, -3, DEPTH), (0, 3, DEPTH)]
    float[] widths = [0.2]
}
def Mesh "Rod" ( prepend apiSchemas = ["MaterialBindingAPI"] )
{
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-0.1, -3, DEPTH), (0.1, -3, DEPTH), (0.1, 3, DEPTH), (-0.1, 3, DEPTH)]
    uniform token subdivisionScheme = "none"
    bool photonbeams:enabled = 0
    rel material:binding = </Glow>
}
def Material "Glow"
{
    token outputs:surface.connect = </Glow/Surface.outputs:surface>
    def Shader "Surface"
    {
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor = (0, 0, 0)
        color3f inputs:emissiveColor = (1, 1, 1)
        token outputs:surface
    }
}
def Camera "Camera"
{
    float focalLength = 10
    float horizontalAperture = 12
    float verticalAperture = 8
}
"""


@pytest.mark.parametrize("depth", [3.0, 5.0, 9.0])
def test_a_beams_disparity_is_that_of_geometry_at_its_place(usd, depth):
    behind = depth + 0.11  # of the rod, which is behind the beam
    stage = usd(ROD.replace("DEPTH", f"{-depth}", 2).replace("DEPTH", f"{-behind}"))
    interaxial, convergence, width = 0.4, 5.0, 240
    shot = pb.Shot(stage, stereo=Stereo(interaxial, convergence))
    frame = shot.render(passes=8, width=width, crop=(0, 0.49, 1, 0.51))
    column = np.arange(width) + 0.5

    def middle(view, layer):
        picture = frame.views[view][0][layer][..., 0].sum(axis=0)
        return (picture * column).sum() / picture.sum()

    for layer, place in (("surface", behind), ("beams", depth)):
        # The disparity of parallel eyes with shifted apertures is b f (1 / z − 1 / convergence), here in pixels.
        expected = interaxial * (1 / place - 1 / convergence) / 1.2 * width
        found = middle("left", layer) - middle("right", layer)
        assert found == pytest.approx(expected, abs=0.15)
        assert abs(found) > 1 or depth == convergence


def test_a_pair_of_prims_needs_no_numbers(shot):
    text = STAGE.replace('def Camera "Camera"\n{', 'def Camera "Right"\n{\n    uniform token stereoRole = "right"')
    text += (
        STAGE[STAGE.index('def Camera "Camera"') :]
        .replace('def Camera "Camera"\n{', 'def Camera "Left"\n{\n    uniform token stereoRole = "left"')
        .replace("(0, 0, 1)", "(-0.1, 0, 1)")
    )
    left, right = shot(text=text, camera="Right", stereo=Stereo()).cameras(1)
    assert (left.name, right.name) == ("/Left", "/Right")
    assert right.to_world[0, 3] - left.to_world[0, 3] == pytest.approx(0.1)


# -- Bad input --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("message", "overrides"),
    [
        (r"/Camera\.shutter:close is -1 but shutter:open is 0", ["/Camera.shutter:close=-1"]),
        (r"/Camera\.shutter:open=nan'", ["/Camera.shutter:open=nan"]),
    ],
)
def test_bad_cameras_are_told_in_a_sentence(shot, message, overrides):
    with pytest.raises(SceneError, match=message):
        shot(*overrides).render(1, **SMALL)


@pytest.mark.parametrize(
    ("message", "overrides"),
    [
        ("/Camera.focusDistance is 0 but fStop is 2", ["/Camera.fStop=2", "/Camera.focusDistance=0"]),
        ("/Camera.fStop is -1", ["/Camera.fStop=-1"]),
    ],
)
def test_a_lens_that_cannot_be_is_a_pinhole_with_a_warning(shot, message, overrides, caplog):
    assert shot(*overrides).cameras(1)[0].lens_radius == 0
    assert message in caplog.text
    assert "all is in focus" in caplog.text


def test_bad_eyes_are_told_in_a_sentence(shot):
    with pytest.raises(SceneError, match="interaxial is -1"):
        Stereo(interaxial=-1)
    with pytest.raises(SceneError, match="convergence is 0"):
        Stereo(convergence=0)
    with pytest.raises(SceneError, match="view is 'middle'"):
        shot(stereo=Stereo()).render(1, view="middle", **SMALL)
    with pytest.raises(SceneError, match="view is 'left'"):
        shot().render(1, view="left", **SMALL)
    alone = STAGE.replace('def Camera "Camera"\n{', 'def Camera "Camera"\n{\n    uniform token stereoRole = "left"')
    with pytest.raises(SceneError, match="/Camera is one of two eyes"):
        shot(text=alone, stereo=Stereo())
    other = STAGE[STAGE.index('def Camera "Camera"') :].replace("horizontalAperture = 12", "horizontalAperture = 13")
    other = other.replace('def Camera "Camera"\n{', 'def Camera "Other"\n{\n    uniform token stereoRole = "right"')
    with pytest.raises(SceneError, match=r"/Camera\.horizontalAperture is 12 but that of /Other is 13"):
        shot(text=alone + other, camera="/Camera", stereo=Stereo())


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("focalLength=11", r"/Left\.focalLength is 10 but that of /Right is 11"),
        ("projection=orthographic", r"/Left\.projection is perspective but that of /Right is orthographic"),
        ("shutter:close=0.5", r"/Left\.shutter:close is 0 but that of /Right is 0\.5"),
        ("exposure=1", r"/Left\.exposure is 0 but that of /Right is 1"),
    ],
)
@pytest.mark.parametrize("camera", ["Left", "Right"])
def test_eyes_that_differ_are_told_in_the_files_own_numbers(shot, camera, override, message):
    body = STAGE[STAGE.index('def Camera "Camera"') :]
    text = STAGE.replace(body, "") + "".join(
        body.replace('def Camera "Camera"\n{', f'def Camera "{name}"\n{{\n    uniform token stereoRole = "{role}"')
        for name, role in (("Left", "left"), ("Right", "right"))
    )
    assert shot(text=text, camera=camera, stereo=Stereo()).cameras(1)
    with pytest.raises(SceneError, match=message):
        shot(f"/Right.{override}", text=text, camera=camera, stereo=Stereo())


def test_eyes_that_converge_too_near_to_see_the_same_are_refused(shot):
    # The focal length is 1, the aperture 1.2 and half of the interaxial distance 3: the limit is 3 · 1 / 1.2.
    assert shot(stereo=Stereo(6, 2.51)).cameras(1)
    expected = r"/Camera has eyes 6 apart that converge at {}: expected a convergence of at least 2\.5 scene units"
    for near in (2.49, 1e-30):
        with pytest.raises(SceneError, match=expected.format(f"{near:g}")):
            shot(stereo=Stereo(6, near))
    with pytest.raises(SceneError, match=expected.format("its focusDistance, 2")):
        shot("/Camera.focusDistance=2", stereo=Stereo(6))


def test_an_orthographic_camera_is_not_split(shot):
    with pytest.raises(SceneError, match="/Camera is orthographic"):
        shot("/Camera.projection=orthographic", stereo=Stereo())
