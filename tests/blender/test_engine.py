"""The engine in Blender itself, as a module of Python (bpy): what is rendered is what the command renders."""

import numpy as np
import pytest

import photonbeams as pb
from tests.blender.bpy_python import HEIGHT, PYTHON, WIDTH, blender, passes_of, together

pytestmark = pytest.mark.skipif(
    not PYTHON.exists(), reason=f"{PYTHON} is missing: the set-up makes it with Python 3.11"
)


# Cases that one Blender runs in this order; the last ones kill its renderer, hide it, and unregister.
CASES = (
    "frame", "again", "part", "layers", "aspect", "reading", "stereo", "film", "lamps", "over", "killed", "wrong",
    "registered",
)  # fmt: skip


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    return together(CASES, tmp_path_factory.mktemp("cases"))


@pytest.fixture(scope="module")
def frame(cases):
    return cases["frame"].folder


def test_passes_add_up(frame):
    found = passes_of(frame / "frame.exr")
    assert {"Combined", "Depth", "Beams", "Surface", "Transmittance", "Beams key"} <= found.keys()
    assert found["Combined"].shape == (HEIGHT, WIDTH, 4) and np.all(found["Combined"][..., 3] == 1)
    np.testing.assert_allclose(found["Combined"][..., :3], found["Beams"] + found["Surface"], rtol=1e-5, atol=1e-6)
    assert 0 < found["Beams key"].mean() < found["Beams"].mean()
    assert 2 < found["Depth"].min() < 12 and found["Depth"].max() == np.float32(1e10)


def test_the_picture_is_that_of_the_exported_stage(frame):
    """What crosses over without a file, and Blender's own export, are the same scene: the pictures differ by noise."""
    fog = pb.Medium(scattering=0.08)  # the density times the colour
    shot = pb.Shot.open(frame / "frame.usdc", medium=fog)
    given = {"width": WIDTH, "height": HEIGHT, "beams": 1024, "max_depth": 2}
    seeds = [shot.render(seed=seed, passes=8, **given).layers for seed in range(1, 5)]
    found = passes_of(frame / "frame.exr")
    for name, layer in (("Surface", "surface"), ("Beams", "beams")):
        theirs = np.array([each[layer] for each in seeds])
        mean, noise = theirs.mean(axis=0), theirs.std(axis=0, ddof=1)
        # One picture of four passes has about √2 times the noise of one of eight; of blocks of pixels, much less.
        assert found[name].mean() == pytest.approx(mean.mean(), rel=0.02), name
        blocks = np.abs(found[name] - mean)[:24].reshape(3, 8, 6, 8, 3).mean(axis=(1, 3, 4))
        usual = (noise + 0.02 * mean)[:24].reshape(3, 8, 6, 8, 3).mean(axis=(1, 3, 4))
        assert np.all(blocks < 4 * usual + 1e-5), name


def test_a_frame_is_rendered_again_with_the_same_bits_by_the_same_process(cases):
    (found,), folder = cases["again"]
    assert found["same"]
    first, second = (passes_of(folder / f"{name}.exr") for name in ("first", "second"))
    assert all(np.array_equal(each, second[name]) for name, each in first.items())


def test_a_border_is_that_part_of_the_picture(cases):
    folder = cases["part"].folder
    whole, part = (passes_of(folder / f"{name}.exr")["Combined"] for name in ("whole", "part"))
    assert part.shape == (18, 24, 4)
    np.testing.assert_allclose(part, whole[:18, 12:36], rtol=0.02, atol=1e-4)
    drawn = passes_of(folder / "drawn.exr")["Combined"]
    # Blender rounds edges down, from the bottom left: rows 5 to 24 of 27, columns 5 to 37 of 48.
    np.testing.assert_allclose(drawn, whole[27 - 24 : 27 - 5, 5:37], rtol=0.02, atol=1e-4)


def test_each_view_layer_has_its_own_picture(cases):
    found = passes_of(cases["layers"].folder / "layers.exr")
    first, second = (found[f"{layer}Combined"][..., :3].mean() for layer in ("", "Second."))
    assert first > 1.2 * second > 0
    assert found["Beams Key Light"].mean() > 0 and not found["Second.Beams Key Light"].any()


def test_wide_pixels_show_the_same_view(cases):
    folder = cases["aspect"].folder
    square, wide = (passes_of(folder / f"{name}.exr")[""][..., :3] for name in ("square", "wide"))
    pairs = square.reshape(HEIGHT, WIDTH // 2, 2, 3).mean(axis=2)
    blocks = [each[:24].reshape(6, 4, 6, 4, 3).mean(axis=(1, 3)) for each in (pairs, wide)]
    np.testing.assert_allclose(*blocks, rtol=0.15, atol=2e-3)


def test_lights_and_materials_cross_over(cases):
    (found,) = cases["reading"].told
    prims, said = found["prims"], " | ".join(found["said"])

    def light(name):
        own = prims[f"/Lights/{name}"]
        return own["type"], own["inputs:intensity"], own["inputs:normalize"]

    assert light("sun") == ("DistantLight", 3.0, True) and light("bare_sun") == ("DistantLight", 3.0, False)
    assert light("ellipse") == ("DiskLight", pytest.approx(10 / np.pi), True)
    assert light("bare_area") == ("RectLight", pytest.approx(10 / np.pi), False)
    assert light("warm") == ("SphereLight", pytest.approx(20 / np.pi), True)
    red, _, blue = prims["/Lights/warm"]["inputs:color"]
    assert red > 2 * blue
    shader = prims["/Materials/Textured/Shader"]
    assert shader["inputs:transmission_weight"] == 0.25 and shader["inputs:specular_ior"] == pytest.approx(1.3)
    placed = prims["/Materials/Textured/base_color_placed"]
    assert placed["inputs:scale"] == [2, 3] and placed["inputs:rotation"] == pytest.approx(90)
    assert prims["/Materials/Textured/base_color"]["inputs:sourceColorSpace"] == "sRGB" and found["painted"]
    assert "Sheen Weight" in said and "Mapping" not in said
    # A Light Falloff has the strength that it has at 1 m, whatever its own fall is; other nodes are not read.
    strengths = {"Quadratic_0_0": 50, "Quadratic_0_5": 50, "Linear_0_0": 50, "Wavelength_0_0": 7}
    assert {name: light(name)[1] for name in strengths} == pytest.approx(strengths)
    fall = "is not rendered: light falls by the square of the distance, from Strength at 1 m"
    assert f"Linear 0.0: Linear of Light Falloff {fall}" in said
    assert f"Quadratic 0.5: Smooth of Light Falloff {fall}" in said and "Quadratic 0.0" not in said
    assert "Wavelength 0.0: Strength of Emission comes from Wavelength, which is not" in said
    assert "its own value (7) is used" in said
    names = {path: prims[path]["name"] for path in ("/Lights/bare_sun", "/Materials/Textured", "/Fog")}
    assert names == {
        "/Lights/bare_sun": "bare_sun", "/Materials/Textured": "Material Textured", "/Fog": "World > Volume"
    }  # fmt: skip
    assert {name for name in prims if name.startswith("/Objects/Parts/")} == {
        f"/Objects/Parts/Part{k}" for k in range(3)
    }
    assert "Parts has a surface" in said and prims["/Objects/Parts"]["primvars:arnold:visibility:shadow"] is False
    fog = prims["/Objects/Cube/Volume/Shader"]
    assert fog["inputs:scattering"] == [1.0, 0.5, 2.0] and fog["inputs:absorption"] == [1.0, 1.5, 0.0]


def test_two_eyes_see_things_apart(cases):
    folder = cases["stereo"].folder
    left, right = (passes_of(folder / f"stereo_{side}.exr")["Combined"] for side in "LR")
    assert left.shape == right.shape == (HEIGHT, WIDTH, 4)
    assert not np.allclose(left, right, rtol=0.1) and left.mean() == pytest.approx(right.mean(), rel=0.1)


def test_an_animation_has_a_picture_for_each_frame(cases):
    folder = cases["film"].folder
    first, second = (passes_of(folder / f"film_{number:04d}.exr")["Beams key"] for number in (1, 2))
    columns = np.arange(WIDTH) + 0.5
    middles = [(each.sum(axis=(0, 2)) @ columns) / each.sum() for each in (first, second)]
    assert middles[1] > middles[0] + 2  # the lamp moves to the right


def test_a_renderer_that_was_killed_is_started_again(cases):
    (error, spent), folder = cases["killed"]
    assert "the renderer has ended" in error["error"] and spent["seconds"] < 10
    before, after = (passes_of(folder / f"{name}.exr") for name in ("before", "after"))
    assert all(np.array_equal(each, after[name]) for name, each in before.items())


def test_what_cannot_be_rendered_is_a_sentence(cases):
    found = {each["case"]: each["error"] for each in cases["wrong"].told}
    assert "no camera" in found["no camera"] and "/nowhere/python cannot be started" in found["no renderer"]
    assert "light" in found["no light"] and r"camera is Key\x1b[, no camera" in found["a lamp"]
    assert all(len(each.strip()) <= 320 and each.count("Error: ") == 1 for each in found.values())


def test_unregistering_leaves_no_trace(cases):
    (found,) = cases["registered"].told
    assert found["shared"] > 10 and found["left"] == 0 and not found["scene"] and found["traces"] == []


@pytest.fixture(scope="module")
def viewport(tmp_path_factory):
    folder = tmp_path_factory.mktemp("viewport")
    return blender("viewport", folder), np.load(folder / "first.npy")


def test_a_viewport_shows_a_small_picture_at_once_and_then_whole_ones(viewport):
    (first, *_), picture = viewport
    assert first["sizes"] == [160, 320, 320] and first["text"] == "Pass 2 of 2 | 320 × 180"
    assert picture.shape == (180, 320, 4) and np.isfinite(picture).all()


def test_only_what_changed_crosses_and_the_picture_is_that_of_a_new_viewport(viewport):
    edits = {each["edit"]: each for each in viewport[0] if "edit" in each}
    assert all(each["same"] for each in edits.values())
    sent = {name: each["sent"] for name, each in edits.items()}
    assert sent == {
        "size": [["/Camera"], "view"], "light": [["/Lights/Key", "/Lights/Fill"], "view"], "camera": ["view"],
        "lens": [["/Camera"], "view"], "object": [["/Objects/Twin"], "view"],
        "mesh": [["/Objects/Cube", "/Objects/Twin"], "view"], "material": [["/Materials/Floor/Shader"], "view"],
        "deleted": [[], "view"], "border": ["view"],
    }  # fmt: skip
    assert edits["light"]["mean"] == pytest.approx(2 * edits["size"]["mean"], rel=1e-4)


def test_a_border_in_a_viewport_is_that_part_of_the_picture(viewport):
    (found,) = (each for each in viewport[0] if "border" in each)
    assert found == {"border": True, "rest": 0}


def test_a_viewport_whose_renderer_was_killed_says_so_and_goes_on(viewport):
    *_, last = viewport[0]
    assert last["nothing"] and "the renderer has ended" in last["killed"] and last["again"]


@pytest.mark.soak
def test_edits_sizes_and_loads_leak_nothing(tmp_path):
    *found, last = blender("leaks", tmp_path)
    assert [each["what"] for each in found] == ["edits", "sizes", "loads"] and last["processes"] == 1
    for each in found:
        # A leaked picture is 7 kB, a leaked scene over a megabyte, of which there are 16 after the first reading.
        assert np.ptp(np.array(each["used"]), axis=0).max() < 12, each


def test_lamps_light_a_floor_as_in_cycles(cases):
    folder = cases["lamps"].folder
    pictures = sorted(folder.glob("*.PHOTONBEAMS.exr"))
    assert len(pictures) == 16
    for path in pictures:
        ours = passes_of(path)[""][..., :3]
        theirs = passes_of(path.with_name(path.name.replace("PHOTONBEAMS", "CYCLES")))[""][..., :3]
        # The lamp hangs before the camera, unseen. Noise is below .5 % of a picture.
        assert ours.mean() == pytest.approx(theirs.mean(), rel=0.015), path.name
        blocks = [each[:24].reshape(6, 4, 12, 4, 3).mean(axis=(1, 3)) for each in (ours, theirs)]
        assert np.abs(blocks[0] - blocks[1]).max() < 0.06 * theirs.max(), path.name


def test_beams_over_cycles_are_the_surfaces_through_the_fog_and_the_beams(cases):
    (found,), folder = cases["over"]
    assert found == {"engines": ["CYCLES", "PHOTONBEAMS"], "worlds": ["World without Beams", "World"]}
    composite, plate = (passes_of(folder / f"{name}.exr")[""][..., :3] for name in ("composite", "plate"))
    beams, whole = (passes_of(folder / f"{name}.exr") for name in ("beams", "whole"))
    np.testing.assert_allclose(composite, plate + beams["Combined"][..., :3], rtol=1e-3, atol=1e-4)
    # Both renderers have about 2 % of noise in a pixel.
    assert plate.mean() == pytest.approx(whole["Surface"].mean(), rel=0.02)
    assert composite.mean() == pytest.approx(whole["Combined"][..., :3].mean(), rel=0.02)
