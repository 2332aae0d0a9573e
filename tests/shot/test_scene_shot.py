"""Mitsuba scenes as shots: crops with two eyes, holdouts and plates; session layers; other integrators."""

import struct

import numpy as np
import pytest

import photonbeams as pb
from photonbeams.runtime.device import mitsuba
from photonbeams.scene import BeamSettings, DistanceRamp, Gobo, SceneError
from tests.helpers.deep_files import write_deep
from tests.helpers.mitsuba_scenes import T, camera, cube_of, fog, load, rgb

pytestmark = pytest.mark.usefixtures("helping_thread")

mi = mitsuba()
HALF = np.tile(np.linspace(0, 1, 4, dtype=np.float32)[None, :, None], (4, 1, 3))
LAMP = {"type": "point", "position": [0.3, 0.4, 0.2], "intensity": rgb([3.0, 2.0, 1.0])}
WALL = {"type": "rectangle", "to_world": T().translate([0, 0, -1.5]).scale(4)}
CROP = (0.5, 0.25, 1, 0.75)
SIZE = {"width": 24, "height": 16}


@pytest.fixture(scope="module")
def shot():
    scene = load(fog=cube_of(fog(0.5)), lamp=LAMP, wall=WALL, sensor=camera((0.2, 0.3, 4), **SIZE))
    return pb.Shot(scene, stereo=pb.Stereo(interaxial=0.4, convergence=4))


def pictures(shot, **given):
    """Return the layers of both eyes, without guiding, which would depend on the crop."""
    frame = shot.render(passes=1, beams=500, max_depth=2, guiding=False, **given)
    return [frame.views[eye][0] for eye in ("left", "right")]


@pytest.mark.parametrize("more", ["", "holdout", "over"])
def test_a_crop_shows_its_part_of_the_whole_to_both_eyes(shot, more):
    rows, columns = np.mgrid[: SIZE["height"], : SIZE["width"]]
    depth = (3.0 + 0.05 * columns + 0.02 * rows).astype(np.float32)
    plate = np.stack([rows, columns, rows + columns], axis=2).astype(np.float32)
    given = {"": {}, "holdout": {"holdout": np.stack([depth, depth + 0.3])}, "over": {"over": plate}}[more]
    whole, part = pictures(shot, **given), pictures(shot, crop=CROP, **given)
    for layers, own in zip(whole, part, strict=True):
        for name in ("rgba", "beams", "surface"):
            # The light and its samples are the same, up to the float32 rounding of places in pixels.
            np.testing.assert_allclose(own[name], layers[name][4:12, 12:24], rtol=1e-3, atol=1e-5, err_msg=name)
    assert not np.allclose(whole[0]["beams"], whole[1]["beams"], rtol=1e-2)
    assert part[0]["beams"].any()


def test_a_holdout_far_away_hides_no_beam(shot):
    """A holdout behind the scene's own wall changes no beam, since light does not get behind that wall."""
    far = np.full((2, SIZE["height"], SIZE["width"]), 50.0, np.float32)
    own, held = pictures(shot), pictures(shot, holdout=far)
    for layers, other in zip(own, held, strict=True):
        assert layers["beams"].any()
        np.testing.assert_allclose(other["beams"], layers["beams"], rtol=1e-3, atol=1e-5)
        assert not other["surface"].any()


def test_each_eye_has_its_own_deep_samples(shot, tmp_path):
    """All light is behind the samples: a surface covers 0.75 for the left eye, volumes 0.2 and 0.5 for the right."""
    samples = [[(1.0, 1.0, 0.75)], [(1.0, 1.5, 0.2), (1.2, 2.0, 0.5)]]
    size = SIZE["width"], SIZE["height"]
    path = write_deep(tmp_path / "eyes.exr", lambda part, _: samples[part], size, parts=2, views=("left", "right"))
    given = {"passes": 20, "beams": 500, "max_depth": 2, "guiding": False, "method": "beams"}
    whole, held = (shot.render(**given, **more).views for more in ({}, {"holdout": path}))
    for eye, passed in (("left", 0.25), ("right", 0.4)):
        light, seen = (views[eye][0]["beams"].sum(axis=2, dtype=np.float64) for views in (whole, held))
        # The light of each pixel in each pass is seen or not; from pass to pass it varies, at most by its own size.
        error = 4 * np.sqrt(2 * passed * (1 - passed) * (light**2).sum() / 20) / light.sum()
        assert seen.sum() / light.sum() == pytest.approx(passed, abs=error) and error < 0.1
        np.testing.assert_allclose(held[eye][0]["depth"], 1.0, rtol=1e-6)


FILTERED = """#usda 1.0
over "key_lamp" {
    rel light:filters = [</half>, </flag>]
}
def PhotonBeamsRampFilter "half" {
    float[] photonbeams:distances = [0]
    color3f[] photonbeams:colors = [(0.5, 0.25, 1)]
}
def PhotonBeamsBlockerFilter "flag" {
    float photonbeams:width = 4
    float photonbeams:height = 4
    float photonbeams:depth = 0.1
    double3 xformOp:translate = (2.3, 0.4, -0.5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""


def test_filters_of_emitters_act_on_beams_and_surfaces(tmp_path):
    """Half of the wall is behind the flag; on the rest, the lamp is dimmer."""
    lamp = {**LAMP, "id": "key_lamp"}
    scene = load(fog=cube_of(fog(0.5)), key_lamp=lamp, wall=WALL, sensor=camera((0.2, 0.3, 4), **SIZE))
    (tmp_path / "filters.usda").write_text(FILTERED)
    dimmer = BeamSettings(filters=(DistanceRamp("half", [0.0], [[0.5, 0.25, 1]]),))
    plain, filtered, dimmed = (
        pb.Shot(scene, **given).render(passes=4, beams=8000, max_depth=2, guiding=False, method="beams").layers
        for given in ({}, {"session_layers": tmp_path / "filters.usda"}, {"beams": {"key_lamp": dimmer}})
    )
    right = slice(16, None)
    assert plain["surface"][:, right].any()
    assert not filtered["surface"][:, right].any()
    for name, layers in (("surface", filtered), ("surface", dimmed), ("beams", dimmed)):
        ratio = layers[name][:, :10].sum(axis=(0, 1)) / plain[name][:, :10].sum(axis=(0, 1))
        np.testing.assert_allclose(ratio, [0.5, 0.25, 1], rtol=5e-3, err_msg=name)


def test_a_look_tints_the_surfaces_of_a_scene():
    """The wall has the colour of the beam's end, by a look in Python and by one in a layer; the beams are the same."""
    scene = load(
        fog=cube_of(fog(0.5)), key_lamp={**LAMP, "id": "key_lamp"}, wall=WALL, sensor=camera((0.2, 0.3, 4), **SIZE)
    )
    ramp = pb.looks.ColorRamp([0, 1], [[1, 1, 1], [0.5, 0.25, 1]])
    plain, tinted = (
        pb.Shot(scene, looks={"key_lamp": pb.Look(along=ramp, surfaces=each)})
        .render(passes=2, beams=2000, max_depth=2, guiding=False).layers
        for each in ("off", "tint")
    )  # fmt: skip
    assert plain["surface"].any()
    np.testing.assert_allclose(tinted["surface"], plain["surface"] * [0.5, 0.25, 1], rtol=1e-5, atol=1e-7)
    np.testing.assert_array_equal(tinted["beams"], plain["beams"])


LAYER = """#usda 1.0
def PhotonBeamsLook "warm" {
    float[] photonbeams:along:ramp:knots = [0, 1]
    color3f[] photonbeams:along:ramp:colors = [(1, 0.5, 0.25), (0.125, 0.25, 1)]
}
over "key_lamp" {
    rel photonbeams:look = </warm>
    string photonbeams:lightGroup = "key"
    float photonbeams:intensity = 0.5
    int photonbeams:count = 300
    int photonbeams:bounces = 1
    token photonbeams:scattered = "off"
    rel photonbeams:portal = </opening>
    asset photonbeams:portal:gobo = @half.exr@
}
over "opening" {}
"""


@pytest.fixture(scope="module")
def lit(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lit")
    parts = {"fog": cube_of(fog(0.5)), "key-lamp": LAMP, "wall": WALL}
    null = {"type": "rectangle", "bsdf": {"type": "null"}, "to_world": T().translate([0, 0, -0.9]).scale(0.5)}
    scene = {"type": "scene", **parts, "opening": null, "sensor": camera((0.2, 0.3, 4), **SIZE)}
    mi.Bitmap(HALF).write(str(folder / "half.exr"))
    (folder / "say.usda").write_text(LAYER)
    return scene, folder


def test_a_layer_says_of_beams_what_python_says(lit):
    scene, folder = lit
    ramp = pb.looks.ColorRamp([0, 1], [[1, 0.5, 0.25], [0.125, 0.25, 1]])
    said = BeamSettings(
        look=pb.Look(along=ramp * pb.looks.Attenuation()), group="key", beam_scale=0.5, beam_count=300, bounces=1,
        scattered="off", portal="opening", portal_gobo=Gobo(HALF),
    )  # fmt: skip
    shots = [
        pb.Shot(mi.load_dict(scene, optimize=False), **given)
        for given in ({"session_layers": [folder / "say.usda"]}, {"beams": {"key-lamp": said}})
    ]
    of_layer, of_python = (each.render(passes=1, beams=500).layers for each in shots)
    assert of_python["beams_key"].any()
    assert of_layer.keys() == of_python.keys()
    for name, values in of_python.items():
        np.testing.assert_array_equal(of_layer[name], values, err_msg=name)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"key_lamp"', '"lamp"', "/lamp has no emitter of its name in the scene: expected one of key-lamp"),
        ('over "opening"', 'over "door"', "/opening: expected a prim that is on the stage"),
        ("opening", "door", "/door has no shape of its name in the scene: expected one of"),
    ],
)
def test_a_layer_that_does_not_fit_is_refused_in_a_sentence(lit, tmp_path, old, new, words):
    scene, folder = lit
    (tmp_path / "say.usda").write_text(LAYER.replace(old, new).replace("half.exr", f"{folder}/half.exr"))
    with pytest.raises(pb.SceneError, match=words):
        pb.Shot(mi.load_dict(scene, optimize=False), session_layers=[tmp_path / "say.usda"])


def test_a_render_leaves_the_film_as_it_was(shot):
    small = shot.render(passes=1, beams=100, width=12, crop=CROP)
    assert small.layers["rgba"].shape == (4, 6, 4)
    assert shot.resolution() == (SIZE["width"], SIZE["height"])
    assert shot.render(passes=1, beams=100).layers["rgba"].shape == (16, 24, 4)


@pytest.mark.parametrize(
    ("integrator", "depths"),
    [
        ({"type": "volpath", "max_depth": 6, "rr_depth": 9}, (6, 9)),
        ({"type": "volpath"}, (-1, 5)),
        ({"type": "moment", "inner": {"type": "volpathmis", "max_depth": 3}}, (3, 5)),
        ({"type": "prbvolpath", "max_depth": 4, "hide_emitters": True}, (4, 5)),
    ],
)
def test_another_integrators_paths_are_as_long_as_it_says(integrator, depths):
    settings = pb.Shot(load(lamp=LAMP, sensor=camera(), integrator=integrator)).settings()
    assert (settings.max_depth, settings.rr_depth) == depths
    assert settings.hide_emitters == integrator.get("hide_emitters", False)


@pytest.mark.parametrize(
    ("counts", "size", "message"),
    [
        ((0, 4, 4, 1), 0, "it has 0 x 4 x 4 cells"),
        ((2, 2, 2, 99), 8 * 99, "it has 99 channels"),
        ((4, 4, 4, 1), 3, "it ends before its 64 values"),
    ],
)
def test_grids_that_would_end_the_process_are_refused(tmp_path, counts, size, message):
    header = struct.pack("<3sB5i6f", b"VOL", 3, 1, *counts, 0, 0, 0, 1, 1, 1)
    (tmp_path / "smoke.vol").write_bytes(header + bytes(4 * size))
    (tmp_path / "a.xml").write_text(
        """<scene version="3.0.0"><default name="grid" value="smoke"/><shape type="cube">
        <medium type="heterogeneous" name="interior"><volume type="gridvolume" name="sigma_t">
        <string name="filename" value="$grid.vol"/></volume></medium></shape><sensor type="perspective"/></scene>"""
    )
    with pytest.raises(
        SceneError, match=rf"a\.xml: names .*smoke\.vol: expected a file that can be read, but {message}"
    ):
        pb.Shot.open(tmp_path / "a.xml")


@pytest.mark.parametrize("size", ["0 x 18", "32 x 0", "99999999 x 18"])
def test_a_film_without_pixels_or_of_too_many_is_refused_by_its_own_size(tmp_path, size):
    width, height = size.split(" x ")
    film = (
        f'<film type="hdrfilm"><integer name="width" value="{width}"/><integer name="height" value="{height}"/></film>'
    )
    view = '<float name="fov" value="40"/>'
    path = tmp_path / "scene.xml"
    path.write_text(f'<scene version="3.0.0"><sensor type="perspective">{view}{film}</sensor></scene>')
    with pytest.raises(SceneError, match=f"the resolution is {size}: expected 1 to"):
        pb.Shot.open(path).cameras()


@pytest.mark.parametrize("name", ["photon_beam", "photon_beams", "path"])
def test_an_integrator_that_is_not_there_is_named_once(tmp_path, caplog, name):
    path = tmp_path / "scene.xml"
    path.write_text(
        f'<scene version="3.0.0"><integrator type="{name}"/><sensor type="perspective"/><emitter type="point"/></scene>'
    )
    shot = pb.Shot.open(path)
    assert len(shot.cameras()) == 1 and shot.settings().passes == 4
    told = [each.message for each in caplog.records if each.levelname == "WARNING" and "integrator" in each.message]
    assert [f"there is no integrator '{name}'" in each for each in told] == [True] * (name == "photon_beam")
