"""The flags `--denoise` and `--error` and the layer `albedo` of `photonbeams render`."""

import numpy as np
import pytest

from photonbeams.images.files import read_layers
from tests.helpers.commands import untouched
from tests.helpers.small_stage import CAMERA, FILL, FLOOR, FOG, KEY, write_stage

SMALL = ("--res", 32, 0, "--passes", 2, "--beams", 64)
GROUPS = {"beams_fill", "beams_key", "surface_default", "surface_fill", "surface_key"}
LAYERS = {"rgba", "surface", "beams", *GROUPS, "transmittance", "depth"}
NOISY = {f"noisy_{name}" for name in ("surface", "beams", *GROUPS)}


@pytest.fixture
def stage(tmp_path):
    return write_stage(tmp_path / "stage.usda", FOG, CAMERA, KEY, FILL, FLOOR, metadata="startTimeCode = 1")


def test_a_denoised_file_has_the_layers_of_others_and_the_noisy_ones_if_they_are_asked_for(render, stage, out):
    assert render(stage, "-o", out / "plain.exr", *SMALL)[0] == 0
    assert render(stage, "-o", out / "clean.exr", *SMALL, "--denoise")[0] == 0
    assert render(stage, "-o", out / "both.exr", *SMALL, "--denoise", "--keep-noisy")[0] == 0
    plain, clean, both = (read_layers(out / f"{name}.exr") for name in ("plain", "clean", "both"))
    assert set(plain) == set(clean) == LAYERS and set(both) == LAYERS | NOISY
    assert not np.array_equal(clean["beams_key"], plain["beams_key"])  # the surface has hardly any noise
    for name in NOISY:
        assert np.array_equal(both[name], plain[name.removeprefix("noisy_")])
    for name in LAYERS:
        assert np.array_equal(both[name], clean[name])


def test_beams_over_a_plate_are_denoised_without_guides(render, stage, out):
    """Beams over a holdout are denoised, although no surface is visible that has an albedo or a normal."""
    assert render(stage, "-o", out / "z.exr", *SMALL, "--layers", "rgba,depth")[0] == 0
    assert render(stage, "-o", out / "clean.exr", *SMALL, "--denoise", "--holdout", out / "z.exr")[0] == 0
    assert render(stage, "-o", out / "noisy.exr", *SMALL, "--holdout", out / "z.exr")[0] == 0
    clean, noisy = (read_layers(out / f"{name}.exr")["beams"] for name in ("clean", "noisy"))
    assert noisy.any() and not np.array_equal(clean, noisy)
    assert clean.mean() == pytest.approx(noisy.mean(), rel=0.05)  # denoising keeps the mean


def test_albedos_are_asked_for_by_their_name(render, stage, out):
    flags = (*SMALL, "--layers", "rgba,albedo")
    assert render(stage, "-o", out / "a.exr", *flags, "--picture", f"albedo={out / 'a.png'}")[0] == 0
    layers = read_layers(out / "a.exr")
    assert set(layers) == {"rgba", "albedo"} and (out / "a.png").exists()
    # The floor's material is UsdPreviewSurface's grey, seen in the lower middle of the picture.
    assert np.allclose(layers["albedo"][14, 16], 0.18, rtol=2e-3)


def test_parts_are_denoised_when_they_are_merged(call, render, stage, out):
    flags = (*SMALL, "--denoise", "--keep-noisy")
    assert render(stage, "-o", out / "whole.exr", *flags)[0] == 0
    for part in (1, 2):
        assert render(stage, "-o", out / f"{part}.checkpoint", *flags, "--pass-range", f"{part}/2")[0] == 0
    assert call("merge", out / "*.checkpoint", "-o", out / "joined.exr")[0] == 0
    whole, joined = read_layers(out / "whole.exr"), read_layers(out / "joined.exr")
    assert whole.keys() == joined.keys() and all(np.array_equal(whole[name], joined[name]) for name in whole)


def test_passes_go_on_until_the_error_is_small_enough_and_tell_how_far_they_are(render, stage, out):
    flags = (*SMALL[:3], "--beams", 64, "--error", 0.3, "--progress", "plain")
    code, _, stderr = render(stage, "-o", out / "a.exr", *flags)
    lines = stderr.splitlines()
    assert code == 0
    assert lines[0] == "pass 0" and lines[1] == "pass 1"
    assert any(line.startswith("pass 8, error ") and line.endswith(" % of 30 %") for line in lines)
    assert render(stage, "-o", out / "b.exr", *flags, "--progress", "openjd", "-f", "1:1")[1].startswith(
        "openjd_progress: 0.0\nopenjd_status: pass 0\n"
    )


@pytest.mark.parametrize(
    ("flags", "sentence"),
    [
        (("--error", 0), "--error is 0.0: expected more than 0 and less than 1, such as 0.01"),
        (
            ("--error", 0.1, "--pass-range", "1/2"),
            "--error is for frames that one process renders: expected --passes instead",
        ),
        (("--error", 0.1, "--workers", 2), "--error is for frames that one process renders: expected --passes instead"),
        (("--keep-noisy",), "--keep-noisy keeps the layers before denoising: expected --denoise, too"),
        (("--denoise", "--tile", "1/2"), "--denoise would make the edges of tiles visible: expected --pass-range"),
    ],
)
def test_what_makes_no_sense_is_refused(flags, sentence, render, stage, out):
    name = "a.checkpoint" if "--pass-range" in flags else "a.exr"
    code, _, stderr = render(stage, "-o", out / name, *flags)
    assert code == 2 and sentence in " ".join(stderr.replace("│", " ").split())
    assert untouched(out)


def test_a_mitsuba_scene_is_denoised_through_the_box(render, tmp_path, out):
    scene = tmp_path / "scene.xml"
    scene.write_text("""<scene version="3.0.0">
        <sensor type="perspective"><film type="hdrfilm"><integer name="width" value="24"/>
            <integer name="height" value="16"/><rfilter type="gaussian"/></film></sensor>
        <shape type="rectangle"><transform name="to_world"><translate z="3"/><rotate y="1" angle="180"/></transform>
        </shape>
        <emitter type="point"><rgb name="intensity" value="5"/></emitter></scene>""")
    flags = ("--passes", 2, "--beams", 64, "-q")
    assert render(scene, "-o", out / "clean.exr", *flags, "--denoise", "--keep-noisy")[0] == 0
    assert render(scene, "-o", out / "box.exr", *flags, "--filter", "box")[0] == 0
    clean, box = read_layers(out / "clean.exr"), read_layers(out / "box.exr")
    assert np.array_equal(clean["noisy_surface"], box["surface"])
