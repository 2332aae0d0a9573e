"""A stage rendered by Shot: the comparison scene against numerical integration, layers, determinism, kernels."""

import shutil
import weakref
from fractions import Fraction
from pathlib import Path

import drjit as dr
import numpy as np
import pytest
from pxr import Sdf, UsdGeom

import photonbeams as pb
from photonbeams.numerics.samples import Samples
from photonbeams.render.films.film import Film
from photonbeams.shot.subject import Viewpoint
from photonbeams.usd import stage as stages
from photonbeams.usd.authoring.presets import preset_look
from photonbeams.usd.layers.header import frame_rate
from photonbeams.usd.looks.look import LookSpec
from photonbeams.usd.stage import open_stage, read_scene
from tests.helpers.comparison import camera_rays, lit, scattered_along, single_scattering
from tests.helpers.kernels import compiled

STAGE = Path(__file__).parents[1] / "usd" / "data" / "comparison.usda"
CAMERA = "/World/Camera"


def test_a_frame_that_the_stage_does_not_have_is_refused(usd):
    shot = pb.Shot(usd('def Camera "C" {\n}\n', "startTimeCode = 1\nendTimeCode = 4"))
    for ask in (shot.render, shot.beams):
        with pytest.raises(pb.SceneError, match="has no frame 5: expected frames from 1 to 4"):
            ask(5)


def test_looks_that_differ_in_one_of_a_thousand_numbers_are_two(usd):
    shot, row = pb.Shot(usd('def Camera "C" {\n}\n')), np.ones((2000, 3))
    changed = row.copy()
    changed[1000] = 0.5  # NumPy leaves this one out when it prints

    def look(texture):
        values = {**preset_look("look-physical").values, "along:texture": texture}
        return shot.subject._look("/Lamp", LookSpec("/Look", values))

    first = look(row)
    assert look(row.copy()) is first and look(changed) is not first


def stage_with_camera(position, turn):
    return pb.Shot.open(
        STAGE,
        overrides=[f"{CAMERA}.xformOp:translate={position}", f"{CAMERA}.xformOp:rotateXYZ=(0, {turn}, 0)"],
    )


@pytest.mark.parametrize(
    ("position", "turn"),
    [
        pytest.param((0.0, 1.5, 1.95), 0.0, id="from beside"),
        pytest.param((-0.4, 1.5, 0.02), 0.0, id="inside, across the shaft"),
        pytest.param((0.5, 1.5, 0.02), 90.0, id="inside, along the shaft toward the light", marks=pytest.mark.soak),
        pytest.param(
            (-0.4, 1.52, 0.02), -90.0, id="inside, along the shaft away from the light", marks=pytest.mark.soak
        ),
    ],
)
def test_a_pass_of_4096_beams_is_the_single_scattering_of_the_comparison_scene(position, turn):
    places = Film((36, 64)).places(Samples(0, 0, 0)).numpy().reshape(2, 36, 64).transpose(1, 2, 0)
    rays = camera_rays(64, 36, position, turn, places)
    reference = scattered_along(*rays, steps=192, light_points=12).reshape(36, 64)
    shot, size = stage_with_camera(position, turn), {"width": 64, "height": 36}
    pictures = [shot.render(passes=1, beams=4096, seed=seed, **size).layers["beams"][..., 0] for seed in range(4)]
    mask = lit(reference)
    assert mask.sum() > 100
    # theory.md, section 7, reports a median of 0.7 % for 4,096 beams seen from the side.
    assert np.median(np.abs(pictures[0] - reference)[mask] / reference[mask]) < 1.5e-2
    # The mean of four points in a pixel is within 0.2 % of the integral (`test_plain_integration_has_converged`). The
    # bias is at most 0.5 %; seen from inside, the mean of one pass has a spread of 0.6 %.
    whole = single_scattering(128, 72, position, steps=96, light_points=6, turn=turn)
    reference = whole.reshape(36, 2, 64, 2).mean(axis=(1, 3))
    mask = lit(reference)
    means = [each[mask].mean() for each in pictures]
    assert np.isclose(np.mean(means), reference[mask].mean(), rtol=2e-3 + 5e-3 + 3 * 6e-3 / np.sqrt(len(means)))


@pytest.fixture(scope="module")
def shot():
    return pb.Shot.open(STAGE)


@pytest.fixture(scope="module")
def frame(shot):
    return shot.render(passes=2, width=70, height=40, beams=512)


def test_rgba_is_surface_plus_beams_and_beams_are_the_sum_of_their_groups(frame):
    layers = frame.layers
    assert np.array_equal(layers["rgba"][..., :3], layers["surface"] + layers["beams"])
    grouped = pb.Shot.open(STAGE, overrides=["/World/Light.photonbeams:lightGroup=key"])
    layers = grouped.render(passes=2, width=70, height=40, beams=512).layers
    assert np.array_equal(layers["beams"], layers["beams_key"])
    assert layers["beams"].max() > 0


def test_depth_is_planar_and_transmittance_is_that_of_the_fog_up_to_it(frame):
    depth, through = frame.layers["depth"][20, 35, 0], frame.layers["transmittance"][20, 35]
    assert np.isclose(depth, 3.95, rtol=1e-4)
    # The layer is a mean over passes, whose distances to the wall differ by up to a pixel's slope, 1/35.
    assert np.allclose(through, np.exp(-0.11 * 3.95), rtol=0.11 * 3.95 * 1e-3)


def test_one_thread_and_two_make_the_same_frame(shot, frame, set_threads):
    set_threads(2 if dr.thread_count() == 1 else 1)
    again = shot.render(passes=2, width=70, height=40, beams=512)
    assert all(np.array_equal(frame.layers[name], again.layers[name]) for name in frame.layers)


def test_passes_are_independent_of_how_many_there_are(shot, frame):
    longer = shot.render(passes=4, width=70, height=40, beams=512).layers["beams"]
    assert not np.array_equal(longer, frame.layers["beams"])
    # Two of the four passes are the same; the others change the mean by no more than the spread of single passes.
    assert np.isclose(longer.mean(), frame.layers["beams"].mean(), rtol=0.05)


def test_a_second_frame_compiles_nothing(shot, frame):
    assert not compiled(lambda: shot.render(passes=3, width=70, height=40, beams=600, seed=5))


@pytest.fixture
def own(tmp_path):
    """Return a function that opens a stage which the test may change."""
    shutil.copy(STAGE, tmp_path / "own.usda")
    return lambda: pb.Shot.open(tmp_path / "own.usda")


def test_a_change_of_the_stage_is_rendered(own):
    shot = own()
    (still, _), (same, _) = shot.exposure()(0.0), shot.exposure()(0.0)
    assert same.bounds is still.bounds and same.groups is still.groups  # reading does not count as a change
    light = shot.stage.GetPrimAtPath("/World/Light")
    light.CreateAttribute("photonbeams:lightGroup", Sdf.ValueTypeNames.Token).Set("key")
    UsdGeom.Sphere.Define(shot.stage, "/World/Ball").AddTranslateOp().Set((0, 90, 0))
    changed, _ = shot.exposure()(0.0)
    assert changed.bounds[1] > still.bounds[1] + 20
    assert (still.groups, changed.groups) == ({""}, {"key"})
    fresh, _ = pb.Shot(shot.stage).exposure()(0.0)
    assert np.array_equal(changed.bounds[0], fresh.bounds[0]) and changed.bounds[1] == fresh.bounds[1]


def test_a_shot_that_is_used_no_more_is_forgotten_though_its_stage_is_kept(own, capfd):
    shot = own()
    stage, gone = shot.stage, [weakref.ref(shot), weakref.ref(shot.subject)]
    del shot
    assert [each() for each in gone] == [None, None]
    stage.GetPrimAtPath("/World/Light").GetAttribute("inputs:intensity").Set(3)
    assert capfd.readouterr().err == ""


def test_a_crop_is_a_part_of_the_whole_picture(shot, frame):
    part = shot.render(passes=2, width=70, height=40, beams=512, crop=(0.3, 0.25, 0.8, 0.75)).layers["beams"]
    whole = frame.layers["beams"][10:30, 21:56]
    assert part.shape == whole.shape
    # Directions are computed from other pixel centres, so the geometry differs by float32 rounding.
    assert np.allclose(part, whole, rtol=2e-3, atol=1e-4 * whole.max())


def test_a_frame_writes_its_layers_and_headers(frame, tmp_path):
    from photonbeams.images.files import read_layers

    frame.write(tmp_path / "frame.exr")
    layers = read_layers(tmp_path / "frame.exr")
    assert list(layers) == ["rgba", "surface", "beams", "transmittance", "depth"]
    # Half has 11 bits of mantissa.
    assert np.allclose(layers["beams"], frame.layers["beams"], rtol=2**-11, atol=1e-7)


@pytest.mark.parametrize(
    ("rate", "expected"),
    [
        *((rate, Fraction(24000, 1001)) for rate in (23.976, 23.98, 24000 / 1001, 23.9760239)),
        (29.97, Fraction(30000, 1001)),
        (59.94, Fraction(60000, 1001)),
        (119.88, Fraction(120000, 1001)),
        *((rate, Fraction(rate)) for rate in (24, 25, 12.5, 60, 48, 0, 999)),
        (1e30, Fraction(10**6)),
    ],
)
def test_rates_of_ntsc_are_thousands_over_1001(rate, expected):
    assert frame_rate(rate) == expected


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"overlap": -1}, "overlap is -1: expected a finite number above 0"),
        ({"overlap": 0}, "overlap is 0: expected a finite number above 0"),
        ({"overlap": np.nan}, "overlap is nan: expected a finite number above 0"),
        ({"overlap": "2"}, "overlap is '2': expected a finite number above 0"),
        ({"time_limit": "5"}, "time_limit is '5': expected a positive number of seconds"),
        ({"passes": "4"}, "passes is '4': expected a whole number"),
        ({"passes": 4.0}, "passes is 4.0: expected a whole number"),
        ({"beams": 0}, "beams is 0: expected 1 to 100000000"),
        ({"pases": 4}, "pases is not a setting: expected passes"),
        ({"settings": 4}, "settings is 4: expected Settings"),
        ({"seed": 0.5}, "seed is 0.5: expected a whole number"),
        ({"frame": np.nan}, "frame is nan: expected a finite number"),
        ({"frame": "4"}, "frame is '4': expected a number"),
        ({"width": 64.0}, "width is 64.0: expected a whole number"),
        ({"height": "32"}, "height is '32': expected a whole number"),
        ({"rule": 6}, "rule is 6: expected a Rule, such as gauss_legendre(6)"),
        ({"crop": "abcd"}, "the crop is 'abcd': expected four numbers, x0, y0, x1, y1"),
        ({"crop": 0.5}, "the crop is 0.5: expected four numbers, x0, y0, x1, y1"),
    ],
)
def test_arguments_of_another_kind_are_told_in_a_sentence(shot, arguments, sentence):
    with pytest.raises(pb.scene.SceneError) as error:
        shot.render(**{"passes": 1, "width": 8, "beams": 16} | arguments)
    assert str(error.value) == sentence


def test_numbers_of_numpy_are_numbers(shot):
    frame = shot.render(np.float32(0), np.int64(1), width=np.int32(8), beams=np.uint16(16), overlap=np.float32(2))
    assert frame.statistics.passes == 1


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"looks": [1]}, "looks is [1]: expected a Look, or a dict of Looks by the names of lights"),
        ({"looks": {"/Lamp": 1.0}}, "looks is 1.0 for /Lamp: expected a Look"),
        ({"medium": "x"}, "medium is 'x': expected a Medium or a function of 1 argument"),
        ({"emit": "a.py:x"}, "emit is 'a.py:x': expected a function of 1 argument"),
        ({"simulate": 1}, "simulate is 1: expected a function of 2 arguments"),
    ],
)
def test_a_shot_refuses_what_it_could_not_render_with(shot, arguments, sentence):
    with pytest.raises(pb.scene.SceneError) as error:
        pb.Shot(shot.stage, **arguments)
    assert str(error.value) == sentence


def test_a_shot_is_of_a_stage_and_opened_from_a_file():
    with pytest.raises(pb.scene.SceneError, match=r"stage is 'a.usda': expected a Usd.Stage; Shot.open takes a file"):
        pb.Shot("a.usda")


def test_stereo_is_a_stereo():
    with pytest.raises(pb.scene.SceneError, match=r"stereo is \(6, 300\): expected a Stereo, such as Stereo\("):
        pb.Shot.open(STAGE, stereo=(6, 300))
    with pytest.raises(pb.scene.SceneError, match="interaxial is '6': expected a distance in scene units"):
        pb.Stereo("6")


def test_worldtondc_projects_a_point_to_its_pixel(shot):
    frame = shot.render(passes=1, width=64, height=36, beams=16)
    point = np.array([0.4, 1.9, -0.3, 1.0]) @ frame.metadata["worldToNDC"]
    x, y = point[:2] / point[3]
    # The view is 90 degrees wide: x/z = y/z = 0.4 / 2.25, for a half width of 1 and a half height of 9/16.
    assert np.allclose([x, y], [0.5 + 0.5 * 0.4 / 2.25, 0.5 + 0.5 * (0.4 / 2.25) / (9 / 16)])


def test_traced_beams_are_written_as_curves_that_are_read_again(shot, tmp_path):
    traced = shot.drawn_beams(beams=64)
    assert {"random", "id", "generation"} <= traced[0].arrays().keys()
    count = shot.write_beams(tmp_path / "beams.usda", beams=64)
    assert count == sum(len(each.start) for each in traced) > 0
    (read,) = read_scene(open_stage(tmp_path / "beams.usda")).drawn
    assert np.allclose(read.start, traced[0].start, atol=1e-6)


# -- looks of one's own ------------------------------------------------------------------------------------------------

LOOKED_AT = """#usda 1.0
(
    defaultPrim = "World"
)
def Xform "World" {
    def Camera "Camera" {
        double3 xformOp:translate = (0, 0, 6)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def SphereLight "Red" (prepend apiSchemas = ["ShapingAPI", "PhotonBeamsLightAPI"]) {
        float inputs:radius = 0.1
        float inputs:intensity = 50
        int photonbeams:count = 64
        token photonbeams:lightGroup = "red"
        rel photonbeams:look = </World/Look>
    }
    def SphereLight "Blue" (prepend apiSchemas = ["PhotonBeamsLightAPI"]) {
        float inputs:radius = 0.1
        float inputs:intensity = 50
        int photonbeams:count = 64
        token photonbeams:lightGroup = "blue"
    }
    def PhotonBeamsLook "Look" {
        color3f photonbeams:along:tint = (1, 0, 0)
    }
    def Scope "Fog" (prepend apiSchemas = ["PhotonBeamsMediumAPI"]) {
        color3f photonbeams:scattering = (0.1, 0.1, 0.1)
    }
}
"""
GREEN = pb.Look(along=pb.looks.Constant([0, 1, 0]) * pb.looks.Attenuation())


@pytest.mark.parametrize(
    ("looks", "green"),
    [
        (GREEN, {"red", "blue"}),
        ({"Red": GREEN}, {"red"}),
        ({Sdf.Path("/World/Blue"): GREEN}, {"blue"}),
        ({"Look": GREEN}, {"red"}),
        ({"/World/Look": GREEN, "Blue": GREEN}, {"red", "blue"}),
        (None, set()),
    ],
)
def test_looks_of_ones_own_replace_the_stages(tmp_path, looks, green):
    (tmp_path / "a.usda").write_text(LOOKED_AT)
    shot = pb.Shot.open(tmp_path / "a.usda", looks=looks)
    layers = shot.render(passes=1, width=16, height=9).layers
    for group in ("red", "blue"):
        colour = layers[f"beams_{group}"].sum(axis=(0, 1))
        expected = [0, 1, 0] if group in green else [1, 0, 0] if group == "red" else [1, 1, 1]
        assert (colour > 0).tolist() == [bool(each) for each in expected]


def test_a_look_for_beams_that_are_not_there_is_an_error(tmp_path):
    (tmp_path / "a.usda").write_text(LOOKED_AT)
    shot = pb.Shot.open(tmp_path / "a.usda", looks={"Green": GREEN})
    with pytest.raises(
        pb.SceneError, match=r"no beams are named Green: expected one of /World/Blue, /World/Look, /World/Red"
    ):
        shot.render(passes=1, width=16, height=9)


@pytest.mark.parametrize("name", ["Red", "/World/Red", "Look"])
def test_a_look_may_be_of_beams_that_are_not_there_yet(tmp_path, name):
    hidden = 'token visibility.timeSamples = { 1: "invisible", 3: "inherited" }'
    begin = LOOKED_AT.index("        float inputs:radius")
    (tmp_path / "a.usda").write_text(f"{LOOKED_AT[:begin]}        {hidden}\n{LOOKED_AT[begin:]}")
    shot = pb.Shot.open(tmp_path / "a.usda", looks={name: GREEN})
    first, later = (shot.render(frame, passes=1, width=16, height=9).layers["beams_red"] for frame in (1, 3))
    assert not first.any()
    assert (later.sum(axis=(0, 1)) > 0).tolist() == [False, True, False]


def test_another_look_in_a_running_session_compiles_at_most_once(tmp_path):
    (tmp_path / "a.usda").write_text(LOOKED_AT)
    shot = pb.Shot.open(tmp_path / "a.usda")
    look = shot.stage.GetPrimAtPath("/World/Look")
    changes = {
        "along:length": 2.0,  # a number that is not used
        "along:tint": (0.5, 1, 0.25),  # a number
        "across:profile": "gaussian",  # a different formula
        "along:expression": "0.5 + s * noise(2 * P)",
        "noise:amount": 0.5,
    }

    def new():
        return len(compiled(lambda: shot.render(passes=1, width=16, height=9)))

    new()
    for name, value in changes.items():
        look.GetAttribute(f"photonbeams:{name}").Set(value)
        first, second = new(), new()
        assert second == 0, name
        assert first == 0 or name not in ("along:length", "along:tint"), name
    for name, value in {"along:expression": "0.25 + s * noise(3 * P)", "noise:amount": 0.25, "noise:scale": 2}.items():
        look.GetAttribute(f"photonbeams:{name}").Set(value)
        assert new() == 0, name


def test_a_stage_that_did_not_change_is_not_read_again(usd, monkeypatch):
    shot = pb.Shot(usd('def SphereLight "Lamp" {\n    float inputs:intensity = 1\n}\ndef Camera "C" {\n}\n'))
    lamp, own, read = shot.stage.GetPrimAtPath("/Lamp").GetAttribute("inputs:intensity"), stages.read_scene, []

    def counted(*arguments):
        read.append(lamp.Get())
        return own(*arguments)

    monkeypatch.setattr(stages, "read_scene", counted)
    for value in (2, 3):
        lamp.Set(value)  # scenes are kept once the stage was edited
        radiance = {shot.subject.read(Viewpoint(None, None), None, None)[0].lights[0].radiance[0] for _ in range(3)}
        assert len(radiance) == 1
    assert read == [2, 3]


def test_what_is_wrong_with_a_look_is_said_again_once_forgotten(usd):
    lamp = 'def SphereLight "Lamp" {\n    rel photonbeams:look = </Look>\n}\n'
    shot = pb.Shot(usd(f'def PhotonBeamsLook "Look" {{\n}}\n{lamp}def Camera "C" {{\n}}\n'))
    shot.stage.GetPrimAtPath("/Look").GetAttribute("photonbeams:across:hardness").Set(-1)
    for _ in range(3):
        shot.subject.read(Viewpoint(None, None), None, None)
        (text,) = shot.warnings.given
        assert "hardness is -1" in text
        shot.warnings.given.clear()
