"""The variants of Mitsuba: those that the documentation names, and the one that a user has set."""

import subprocess
import sys

import numpy as np
import pytest

import photonbeams as pb
from photonbeams.export.shot import export
from photonbeams.integrator import VARIANTS
from photonbeams.runtime.device import cuda_problem, mitsuba, mitsuba_variant
from tests.helpers.mitsuba_scenes import camera, cube_of, fog, load
from tests.helpers.small_stage import CAMERA, FLOOR, FOG, LAMP, write_stage
from tests.helpers.sweep import sweep
from tests.helpers.variants import CASES, NAMES, Variant

mi = mitsuba()
SMALL = {"passes": 1, "width": 16, "height": 9}
TWINS = [
    pytest.param(each, marks=pytest.mark.skipif(each[:4] == "cuda" and bool(cuda_problem()), reason="no CUDA here"))
    for each in VARIANTS
    if each.endswith("_mono")
]
KEPT = ("area, auto, without surfaces", "point, beams, without surfaces", "envmap, paths, with surfaces")


@pytest.fixture(scope="module")
def variants():
    """Return a function of a variant's name that returns its process, one for all cases."""
    made = {}
    yield lambda name: made.get(name) or made.setdefault(name, Variant(name))
    for each in made.values():
        each.close()


@pytest.mark.parametrize("name", TWINS)
@pytest.mark.parametrize("case", sweep(CASES, KEPT, NAMES), ids=NAMES)
def test_a_monochrome_variant_has_the_picture_of_the_one_in_colors(variants, name, case):
    found, expected = (variants(each).picture(case) for each in (name, name.replace("mono", "rgb")))
    # Both have the same samples. A pixel sums some thousand numbers of seven digits, of which luminance is a mean.
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-3 * expected.mean())
    assert np.isfinite(found).all()


@pytest.fixture(params=["scalar_rgb", mitsuba_variant().replace("rgb", "mono")])
def variant(request):
    """Return the variant that a user has set, who gets it back."""
    mi.set_variant(request.param)
    yield request.param
    mi.set_variant(mitsuba_variant())


def stage_of(folder):
    return pb.Shot.open(write_stage(folder / "stage.usda", CAMERA, FLOOR, LAMP, FOG))


def scene_of():
    return load(
        fog=cube_of(fog(0.5)),
        sensor=camera(size=8),
        light={"type": "point"},
        integrator={"type": "photon_beams", "method": "beams"},
    )


def fails(*_):
    raise ZeroDivisionError


@pytest.mark.parametrize(
    "call",
    [
        lambda shot: shot.render(**SMALL),
        lambda shot: shot.beams(beams=64),
        lambda shot: shot.exposure(),
        lambda shot: [shot.settings(), shot.cameras(), shot.resolution()],
        lambda shot: shot.estimate(**SMALL),
    ],
    ids=["render", "beams", "exposure", "settings", "estimate"],
)
def test_a_shot_leaves_mitsubas_variant_as_it_is(call, tmp_path, variant):
    call(stage_of(tmp_path))
    assert mi.variant() == variant


def test_a_render_that_fails_leaves_mitsubas_variant_as_it_is(tmp_path, variant):
    shot = pb.Shot(stage_of(tmp_path).stage, simulate=fails)
    with pytest.raises(ZeroDivisionError):
        shot.render(**SMALL)
    assert mi.variant() == variant


def test_an_export_leaves_mitsubas_variant_as_it_is(tmp_path, variant):
    assert export(stage_of(tmp_path), tmp_path / "scene.xml") and mi.variant() == variant


def test_a_scene_is_rendered_in_the_variant_in_which_it_was_loaded(variant):
    mi.set_variant(mitsuba_variant())
    scene = scene_of()
    shot = pb.Shot(scene)
    expected = shot.render(passes=1, beams=64).layers["rgba"]
    mi.set_variant(variant)
    assert np.array_equal(shot.render(passes=1, beams=64).layers["rgba"], expected)
    assert len(shot.beams(beams=64)) == len(pb.Shot(scene).beams(beams=64)) == 1
    assert mi.variant() == variant


def test_a_scene_of_another_variant_is_refused():
    mi.set_variant("scalar_rgb")
    try:
        with pytest.raises(pb.SceneError, match=f"Mitsuba's variant scalar_rgb: expected {mitsuba_variant()} or"):
            pb.Shot(mi.load_dict({"type": "scene"}))
        assert mi.variant() == "scalar_rgb"
    finally:
        mi.set_variant(mitsuba_variant())


def test_normal_maps_of_stages_render_after_a_scene_without_colors():
    script = """
import mitsuba as mi, photonbeams as pb
mi.set_variant("llvm_ad_mono")
import photonbeams.world.world
from photonbeams.scene import Camera, Material, Mesh, Scene, SphereLight, UVTexture
up = UVTexture([[[0.6, 0.5, 0.9]]])
corners = [[0, 0], [1, 0], [1, 1], [0, 1]]
wall = Mesh("/Wall", [[9 * x, 9 * y, 0] for x, y in corners], [[0, 1, 2], [0, 2, 3]], uvs=corners,
            material=Material(normal=up))
content = Scene(meshes=wall, lights=SphereLight("/Lamp", 50.0, center=(4, 4, 4)))
shot = pb.Shot(content, Camera.look_at(origin=(4, 4, 9), target=(4, 4, 0)))
print(shot.render(passes=1, width=16).layers["surface"].mean() > 0, mi.variant())
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "llvm_ad_mono"]
