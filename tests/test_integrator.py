"""The plug-in `photon_beams` as Mitsuba's users meet it."""

import gc
import re
import subprocess
import sys
from dataclasses import replace

import drjit as dr
import numpy as np
import pytest

from photonbeams import integrator
from photonbeams.render.scene_frame import render
from photonbeams.render.settings import parameters
from photonbeams.runtime.device import mitsuba
from photonbeams.scene import SceneError
from photonbeams.shot.scene_loading import reason
from tests.helpers.mitsuba_scenes import camera, cube_of, fog, load, rgb

mi = mitsuba()
PLUGIN = {"type": "photon_beams", "paths": 256, "method": "beams"}
LIGHT = {"type": "point", "position": [0.3, 0.4, 0.2], "intensity": rgb([3.0, 2.0, 1.0])}


def plugin(**parameters):
    return mi.load_dict({**PLUGIN, **parameters})


def picture(scene, seed=0, spp=2, **parameters):
    return np.array(mi.render(scene, integrator=plugin(**parameters), seed=seed, spp=spp))


def scene(**film):
    return load(fog=cube_of(fog(0.5)), light=LIGHT, wall={"type": "rectangle"}, sensor=camera(size=8, **film))


@pytest.mark.parametrize(
    "lines",
    [
        "import photonbeams; import mitsuba as mi",
        "import mitsuba as mi; import photonbeams",
        "import mitsuba as mi; mi.set_variant('llvm_ad_rgb'); import photonbeams",
    ],
)
def test_the_package_announces_it_before_and_after_mitsuba(lines):
    script = f"{lines}; mi.set_variant('llvm_ad_rgb'); print(type(mi.load_dict({{'type': 'photon_beams'}})).__name__)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "PhotonBeams"


def test_mitsubas_own_functions_stay_as_they_are():
    names = "load_dict load_file load_string render"
    script = f"""
import mitsuba as mi
mi.set_variant("llvm_ad_rgb")
before = [getattr(mi, name) for name in "{names}".split()], mi.util.render
import photonbeams
mi.load_dict({{"type": "photon_beams"}})
after = [getattr(mi, name) for name in "{names}".split()], mi.util.render
print(all(a is b for a, b in zip(before[0], after[0])), before[1] is after[1] is mi.render)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "True"]


@pytest.mark.parametrize("variant", ["scalar_rgb", "llvm_ad_spectral"])
def test_other_variants_are_refused(variant):
    script = f"import photonbeams, mitsuba as mi; mi.set_variant('{variant}'); mi.load_dict({{'type': 'photon_beams'}})"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode != 0
    sentence = f"the variant is {variant}: expected llvm_ad_rgb, llvm_ad_mono, cuda_ad_rgb or cuda_ad_mono"
    assert done.stderr.splitlines()[-1] == f"NotOfferedError: photon_beams: {sentence}"


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"bogus": 1}, "bogus"),
        ({"beams": "medium"}, "beams is 'medium': expected one of long, short"),
        ({"radius": -1.0}, "radius is -1.0: expected a number above 0"),
        ({"max_depth": -2}, "max_depth is -2: expected -1 (any) or 0 to"),
        ({"paths": 0}, "paths is 0: expected 1 to 100000000"),
        ({"alpha": 2.0}, "alpha is 2.0"),
        ({"estimator": "best"}, "best"),
        ({"order": 0}, "order is 0: expected 1 to 256 points"),
        ({"min_radius": 0.2, "max_radius": 0.1}, "min_radius is 0.2: expected at most 0.1 (max_radius)"),
        ({"paths": 2048.5}, "paths is 2048.5: expected a whole number"),
        ({"max_depth": 3.5}, "max_depth is 3.5: expected a whole number"),
        ({"rr_depth": True}, "rr_depth is True: expected a whole number"),
        ({"order": float("nan")}, "order is nan: expected a whole number"),
        ({"paths": float("inf")}, "paths is inf: expected a whole number"),
        ({"radius": "wide"}, 'radius is "wide": expected a number'),
        ({"guiding": "false"}, 'guiding is "false": expected true or false'),
        ({"hide_emitters": 1}, "hide_emitters is 1: expected true or false"),
        ({"layers": "x"}, 'layers is "x": expected true or false'),
        ({"estimator": 3}, "estimator is 3: expected a string"),
    ],
)
def test_wrong_parameters_are_refused(parameters, message):
    with pytest.raises(RuntimeError, match=re.escape(message)) as refused:
        plugin(**parameters)
    assert len(reason(str(refused.value))) <= 300


def test_a_wrong_parameter_in_a_file_is_named_with_its_place(tmp_path):
    text = '<scene version="3.0.0">\n<integrator type="photon_beams"><integer name="order" value="0"/></integrator>'
    text += "</scene>"
    (tmp_path / "a.xml").write_text(text)
    for load_it, place in (
        (lambda: mi.load_string(text), "string"),
        (lambda: mi.load_file(str(tmp_path / "a.xml")), "a.xml"),
    ):
        with pytest.raises(RuntimeError) as refused:
            load_it()
        ending = " (line 2, col 2): photon_beams: order is 0: expected 1 to 256 points"
        assert reason(str(refused.value)).endswith(place + ending)
        assert str(refused.value).splitlines()[-1].endswith("order is 0: expected 1 to 256 points")


def test_ctrl_c_and_errors_arrive_as_themselves_from_the_integrator(monkeypatch):
    """Through `mi.render`, Dr.Jit makes every error of a render the cause of a RuntimeError."""

    def interrupt(*_):
        raise KeyboardInterrupt

    made, given = plugin(), scene()
    monkeypatch.setattr("photonbeams.render.scene_frame.accumulate", interrupt)
    with pytest.raises(KeyboardInterrupt):
        made.render(given, spp=1)
    with pytest.raises(RuntimeError) as wrapped:
        mi.render(given, integrator=made, spp=1)
    assert isinstance(wrapped.value.__cause__, KeyboardInterrupt)


def test_a_render_that_is_to_be_frozen_is_refused():
    """Dr.Jit would end the process. Its own error says only that there is another."""
    given = scene()
    for within in (plugin(), mi.load_dict({"type": "aov", "aovs": "d:depth", "image": plugin()})):
        frozen = dr.freeze(lambda given, own=within: mi.render(given, integrator=own, spp=1))
        gc.disable()  # garbage of other tests, collected meanwhile, would end the process
        try:
            with pytest.raises(RuntimeError) as refused:
                frozen(given)
        finally:
            gc.enable()
        assert "a render is within drjit.freeze" in str(refused.value.__cause__.__cause__)


def test_numbers_may_be_of_the_other_type_where_nothing_is_lost():
    made = plugin(paths=2048.0, max_depth=4.0, radius=1).settings
    assert (repr(made.beams), repr(made.max_depth), repr(made.radius)) == ("2048", "4", "1.0")


def test_the_documentation_lists_every_parameter():
    listed = re.findall(r"^ \* - (\w+)$", type(plugin()).__doc__, re.MULTILINE)
    assert listed == [*(each.name for _, each in parameters()), "layers"]
    for line in type(plugin()).__doc__.splitlines():
        assert len(line) <= 125


def test_layers_add_up_to_the_picture():
    found = picture(scene(pixel_format="rgba"), layers=True)
    assert found.shape == (8, 8, 10)
    np.testing.assert_allclose(found[..., :3], found[..., 4:7] + found[..., 7:], rtol=1e-4, atol=1e-6)
    assert plugin(layers=True).aov_names()[0] == "beams.R" and plugin().aov_names() == []


def test_aov_around_it_has_the_same_picture_and_mitsubas_depth():
    depth = {"type": "aov", "aovs": "d:depth,n:sh_normal"}
    around, alone = mi.load_dict({**depth, "image": plugin()}), mi.load_dict(depth)
    found, expected = (np.array(mi.render(scene(), integrator=each, spp=2)) for each in (around, alone))
    assert np.array_equal(found[..., :3], picture(scene()))
    np.testing.assert_allclose(found[..., 3:], expected, rtol=1e-5, atol=1e-5)


def test_within_aov_it_chooses_its_method():
    around = {"type": "aov", "aovs": "d:depth", "image": {**PLUGIN, "method": "auto", "max_depth": 3}}
    found = np.array(mi.render(scene(), integrator=mi.load_dict(around), spp=2))[..., :3]
    assert np.array_equal(found, picture(scene(), method="auto", max_depth=3))


def test_moment_around_it_has_the_mean_of_the_picture():
    """The moment integrator has the mean of the picture, but other rays: each call of `sample` traces light anew."""
    around = mi.load_dict({"type": "moment", "image": plugin()})
    own = np.array([picture(scene(), seed) for seed in range(4)])
    found = np.array([mi.render(scene(), integrator=around, spp=2, seed=seed) for seed in range(4)])
    first, luminance, squared = found[..., :3], found[..., 4], found[..., 7]
    means = [each.mean(axis=(1, 2, 3)) for each in (own, first)]
    error = np.hypot(*(each.std(ddof=1) / 2 for each in means))
    assert 0 < abs(means[0].mean() - means[1].mean()) < 6 * error
    assert (squared >= luminance**2 * (1 - 1e-4)).all()


def test_derivatives_are_refused():
    given = scene()
    parameters = mi.traverse(given)
    dr.enable_grad(parameters["fog.interior_medium.albedo.value.value"])
    image = mi.render(given, parameters, integrator=plugin(), spp=1)
    with pytest.raises(integrator.NotOfferedError, match="has no derivatives"):
        dr.backward(dr.sum(image, axis=None))


@pytest.mark.parametrize("sensor", [1, -1])
def test_a_sensor_that_is_not_there_is_refused(sensor):
    with pytest.raises(SceneError, match=f"sensor is {sensor}: expected a sensor of the scene, which has 1"):
        plugin().render(scene(), sensor)


def test_a_seed_is_a_picture():
    a, b, c = (picture(scene(), seed) for seed in (1, 1, 2))
    assert np.array_equal(a, b) and not np.array_equal(a, c)


def test_passes_are_the_samplers_unless_they_are_given():
    sensor = {**camera(size=8), "sampler": {"type": "independent", "sample_count": 3}}
    given = load(fog=cube_of(fog(0.5)), light=LIGHT, sensor=sensor)
    assert np.array_equal(picture(given, spp=0), picture(given, spp=3))


def test_hidden_emitters_are_not_seen():
    lamp = {"type": "sphere", "radius": 0.5, "emitter": {"type": "area", "radiance": 5.0}}
    given = load(light=lamp, sensor=camera(size=8))
    assert picture(given).max() == pytest.approx(5) and not picture(given, hide_emitters=True).any()


def test_alpha_is_that_of_surfaces_and_windows_are_parts():
    whole = picture(scene(pixel_format="rgba"))
    # Two passes of up to sixteen samples each make alpha a multiple of 1/32.
    assert not np.any(32 * whole[..., 3] % 1) and 0 < whole[..., 3].mean() < 1
    window = {"crop_offset_x": 2, "crop_offset_y": 3, "crop_width": 4, "crop_height": 5}
    part = picture(scene(pixel_format="rgba", **window), guiding=False)
    assert part.shape == (5, 4, 4)
    assert np.array_equal(part[..., 3], whole[3:8, 2:6, 3])


def test_the_films_own_filter_is_used():
    box, wide = (picture(scene(rfilter={"type": kind})) for kind in ("box", "gaussian"))
    assert not np.array_equal(box, wide)
    assert np.abs(np.diff(wide, axis=0)).mean() < np.abs(np.diff(box, axis=0)).mean()


def test_bundled_scenes_render_with_fog_added():
    box = mi.cornell_box()
    box["sensor"]["film"].update(width=16, height=16)
    box["fog"] = cube_of(fog(0.3), 0.99)
    found = np.array(mi.render(mi.load_dict(box), integrator=plugin(layers=True), spp=2))
    assert np.isfinite(found).all() and found[..., 3:6].mean() > 0


def test_mitsuba_renders_the_picture_that_the_command_does():
    # Mitsuba suspends derivatives, but must not suspend those of light paths, which give beams their radii.
    glass = {"type": "sphere", "radius": 0.4, "bsdf": {"type": "dielectric", "int_ior": 1.5}}
    both = load(fog=cube_of(fog(0.5)), light=LIGHT, wall={"type": "rectangle"}, glass=glass, sensor=camera(size=8))
    ours = plugin()
    frame = render(both, both.sensors()[0], replace(ours.settings, passes=2, seed=3))
    found = np.array(mi.render(both, integrator=ours, spp=2, seed=3))
    np.testing.assert_array_equal(found[..., :3], frame.layers()["rgba"][..., :3])
    with dr.suspend_grad():
        suspended = frame.light.traced(2, lambda: None).sets
    for before, lit in zip(suspended, frame.light.traced(2, lambda: None).sets, strict=True):
        np.testing.assert_array_equal(before.beams.radius_end.numpy(), lit.beams.radius_end.numpy())
        assert lit.beams.radius_end.numpy().std() > 0


def test_a_denoised_picture_is_the_sum_of_its_layers_with_less_noise():
    # A wide lamp, whose light on surfaces is noisy: what has no noise is left as it is.
    place = mi.ScalarTransform4f().translate([0, 0.9, 0]).rotate([1, 0, 0], 90).scale(0.3)
    lamp = {"type": "rectangle", "to_world": place, "emitter": {"type": "area", "radiance": rgb(4.0)}}
    seen = camera(size=16, pixel_format="rgba", rfilter={"type": "box"})
    lit = load(fog=cube_of(fog(0.5)), lamp=lamp, wall={"type": "rectangle"}, sensor=seen)
    plain, clean = (picture(lit, denoise=denoise, layers=True) for denoise in (False, True))
    assert np.allclose(clean[..., :3], clean[..., 4:7] + clean[..., 7:10], rtol=1e-5)
    assert np.array_equal(clean[..., 3], plain[..., 3])  # alpha
    assert not np.array_equal(clean[..., 7:10], plain[..., 7:10])


def test_passes_end_where_the_error_is_small_enough():
    found = [picture(scene(), spp=spp, error=0.9) for spp in (8, 12)]
    assert np.array_equal(*found)  # the error is first checked after 8 passes
    assert not np.array_equal(found[0], picture(scene(), spp=12))


@pytest.mark.parametrize("parameters", [{"denoise": True}, {"error": 0.1}])
def test_pictures_within_other_integrators_are_not_denoised(parameters):
    nested = mi.load_dict({"type": "aov", "aovs": "depth:depth", "own": {**PLUGIN, **parameters}})
    with pytest.raises(RuntimeError) as refused:
        mi.render(scene(), integrator=nested, spp=1)
    assert "denoise and error need the whole picture" in str(refused.value.__cause__)


@pytest.mark.parametrize(
    "bsdf",
    [{"type": "diffuse"}, {"type": "null"}, {"type": "mask", "opacity": 1.0, "nested": {"type": "diffuse"}}],
    ids=lambda bsdf: bsdf["type"],
)
def test_lamps_on_surfaces_that_let_light_pass_light_as_others_do(bsdf):
    """A square lamp of radiance 1 and half width 1, at half its width above a white floor: its form factor."""
    down = mi.ScalarTransform4f().translate([0, 0, 0.5]).rotate([1, 0, 0], 180)
    area = {"type": "area", "radiance": rgb(1.0)}
    lamp = {"type": "rectangle", "to_world": down, "bsdf": bsdf, "emitter": area}
    white = {"type": "diffuse", "reflectance": rgb(1.0)}
    floor = {"type": "rectangle", "to_world": mi.ScalarTransform4f().scale(10), "bsdf": white}
    sensor = {
        "type": "orthographic", "near_clip": 1e-3, "film": {**camera(size=8)["film"]},
        "to_world": mi.ScalarTransform4f().look_at([0, 0, 0.2], [0, 0, 0], [0, 1, 0]).scale([0.01, 0.01, 1]),
    }  # fmt: skip
    found = picture(load(floor=floor, lamp=lamp, sensor=sensor), spp=64, max_depth=2)
    side = 2 / np.sqrt(5)  # of half the width and the diagonal to the middle of an edge
    assert found.mean() == pytest.approx(4 / np.pi * side * np.arctan(side), rel=0.01)


@pytest.mark.parametrize("lit", ["floor", "fog"])
def test_a_lamp_that_shines_along_one_direction_is_traced_by_all_methods(lit):
    """Paths cannot meet it. A square of irradiance 1 on a white floor; a shaft of thin fog from the side."""
    side, scattering, half = 0.5, 0.01, 1.0
    transform = mi.ScalarTransform4f
    lamp = {
        "type": "rectangle", "to_world": transform().translate([0, 0, 1.5]).rotate([1, 0, 0], 180).scale(side / 2),
        "emitter": {"type": "directionalarea", "radiance": rgb(1.0)},
    }  # fmt: skip
    floor = {
        "type": "rectangle",
        "to_world": transform().scale(3),
        "bsdf": {"type": "diffuse", "reflectance": rgb(1.0)},
    }
    box = {**cube_of(fog(scattering, 1.0)), "to_world": transform().scale(half)}
    origin, up, parts = (
        ([0, 0, 1], [0, 1, 0], {"floor": floor}) if lit == "floor" else ([3, 0, 0], [0, 0, 1], {"box": box})
    )
    sensor = {
        "type": "orthographic", "near_clip": 1e-3, "film": {**camera(size=8)["film"]},
        "to_world": transform().look_at(origin, [0, 0, 0], up).scale([half, half, 1]),
    }  # fmt: skip
    found = picture(load(lamp=lamp, sensor=sensor, **parts), spp=4, max_depth=2, method="paths")
    fraction, shaft = (side / 2 / half) ** 2, scattering / (4 * np.pi) * side * (side / 2 / half)
    assert found.mean() == pytest.approx(fraction / np.pi if lit == "floor" else shaft, rel=0.03)


def test_a_change_of_the_scene_counts_in_a_plug_in_that_has_rendered_it():
    used, changing, pictures = plugin(method="paths"), scene(), []
    for name, value in (
        (None, None),
        ("fog.interior_medium.sigma_t.value.value", mi.Color3f(0.5, 0.6, 0.7)),
        ("sensor.to_world", mi.Transform4f().look_at([0.0, 0.4, 3.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0])),
    ):
        if name:
            parameters = mi.traverse(changing)
            parameters[name] = value
            parameters.update()
        pictures.append(np.array(mi.render(changing, integrator=used, seed=0, spp=1)))
    assert not np.array_equal(pictures[0], pictures[1])
    assert not np.array_equal(pictures[1], pictures[2])
    assert np.array_equal(pictures[2], picture(changing, spp=1, method="paths"))
    assert np.array_equal(np.array(mi.render(scene(), integrator=used, seed=0, spp=1)), pictures[0])
