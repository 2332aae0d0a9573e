"""`photonbeams render scene.xml` as its users call it."""

import os
import re
import signal
import subprocess
import sys

import numpy as np
import OpenEXR
import pytest

from photonbeams import cli
from photonbeams.cli.animation import FrameError
from photonbeams.cli.farm import Request, open_scene
from photonbeams.cli.request import RenderRequest
from photonbeams.images.files import read_image, read_layers
from photonbeams.render import scene_frame as frame
from photonbeams.render.checkpoint import Checkpoint
from photonbeams.render.films.frame_sums import FrameSums
from photonbeams.render.frame import FrameRenderer
from photonbeams.transport.guiding.lines import LightLines
from tests.helpers.commands import fails, untouched

SENSOR = """<sensor type="perspective" id="{name}">
        <float name="fov" value="40"/>
        <float name="near_clip" value="0.001"/>
        <transform name="to_world"><lookat origin="{origin}" target="0, 0, 0" up="0, 1, 0"/></transform>
        <sampler type="independent"><integer name="sample_count" value="3"/></sampler>
        <film type="hdrfilm">
            <integer name="width" value="16"/><integer name="height" value="12"/><rfilter type="box"/>
        </film>
    </sensor>
    """
FRONT, SIDE = (SENSOR.format(name=n, origin=o) for n, o in (("front", "0, 0.5, 4"), ("side", "4, 0.5, 1")))
INTEGRATOR = """<integrator type="photon_beams">
    <integer name="paths" value="300"/><string name="method" value="beams"/>
</integrator>"""
SCENE = f"""<scene version="3.0.0">
    <default name="density" value="0.5"/>
    {INTEGRATOR}
    {FRONT}{SIDE}<shape type="cube">
        <bsdf type="null"/>
        <medium name="interior" type="homogeneous"><float name="sigma_t" value="$density"/></medium>
    </shape>
    <shape type="rectangle"><transform name="to_world"><translate z="-1.5"/></transform></shape>
    <emitter type="point"><point name="position" x="0.3" y="0.4" z="0"/><rgb name="intensity" value="3"/></emitter>
</scene>
"""
LAYERS = ["rgba", "surface", "beams", "transmittance", "depth"]


@pytest.fixture
def scene(tmp_path):
    """Return a function that writes the scene, with one text replaced by another."""

    def written(old="", new="", name="scene.xml"):
        assert old in SCENE
        (tmp_path / name).write_text(SCENE.replace(old, new))
        return tmp_path / name

    return written


def header(path):
    with OpenEXR.File(str(path), header_only=True) as file:
        return dict(file.parts[0].header)


# -- normal use ------------------------------------------------------------------------------------------------------


def test_all_outputs_are_written_and_summed_up(render, scene, out):
    code, stdout, stderr = render(
        scene(), "-o", out / "a.exr", "-o", out / "new" / "b.png", "--picture", f"beams={out / 'c.png'}"
    )
    assert (code, stdout) == (0, "")
    layers = read_layers(out / "a.exr")
    assert list(layers) == LAYERS
    assert all(not np.isnan(pixels).any() for pixels in layers.values())
    np.testing.assert_allclose(layers["rgba"][..., :3], layers["beams"] + layers["surface"], rtol=2e-3, atol=1e-4)
    assert layers["beams"].max() > 0 and layers["surface"].max() > 0
    assert not np.array_equal(read_image(out / "new" / "b.png"), read_image(out / "c.png"))
    lines = stderr.splitlines()
    assert lines[:2] == ["pass 0 of 3", "pass 1 of 3"]  # an error needs two passes
    assert all(re.fullmatch(rf"pass {number} of 3, error [\d.]+ %", lines[number]) for number in (2, 3))
    assert re.fullmatch(r"3 passes, [\d,]+ beams, \d+ million ray-beam tests", lines[4])
    assert re.fullmatch(r"error [\d.]+ %", lines[6])
    assert lines[7:] == [f"wrote {out / name}" for name in ("a.exr", "new/b.png", "c.png")]
    found = header(out / "a.exr")
    assert (found["scene"], found["camera"], found["passes"]) == ("scene.xml", "front", 3)


def test_a_worker_of_a_farm_opens_it(scene, out):
    usual = {each.name: each.default for each in RenderRequest.options()}
    request = RenderRequest.of({**usual, "scene": scene(), "output": [out / "a.exr"], "passes": 1, "quiet": True})
    sums = FrameSums.of(open_scene(Request(request, 0, None))(0, range(1), 1))
    assert sums.ranges() == [range(1)] and sums.beams > 0


@pytest.mark.parametrize(
    ("flags", "size"),
    [
        # Pictures of one tile, as most here: those of several tiles have other kernels.
        (("--res", 14, 10), (10, 14)),
        (("--res", 12, 0), (9, 12)),
        (("--res", 0, 6), (6, 8)),
        (("--res-scale", 0.5), (6, 8)),
    ],
)
def test_the_size_is_what_is_given(render, scene, out, flags, size):
    assert render(scene(), "-o", out / "a.exr", "--passes", 1, *flags)[0] == 0
    assert read_layers(out / "a.exr")["rgba"].shape == (*size, 4)


def test_a_crop_has_its_place_in_the_header_and_the_pixels_of_the_whole(render, scene, out):
    assert render(scene(), "-o", out / "whole.exr", "-q") == (0, "", "")
    assert render(scene(), "-o", out / "part.exr", "--crop", 0.25, 0.5, 0.75, 1)[0] == 0
    whole, part = (read_layers(out / name) for name in ("whole.exr", "part.exr"))
    assert all(np.array_equal(part[name], whole[name][6:12, 4:12]) for name in LAYERS)
    window = header(out / "part.exr")["dataWindow"]
    assert [list(each) for each in window] == [[4, 6], [11, 11]]


def test_cameras_are_listed_and_chosen(render, scene, out):
    assert render(scene(), "--list-cameras") == (0, "front\nside\n", "")
    for name in ("side", "1"):
        assert render(scene(), "-o", out / "a.exr", "-cam", name)[0] == 0
        assert header(out / "a.exr")["camera"] == "side"
    fails(render(scene(), "-o", out / "b.exr", "-cam", "top"), 1,
          "has no sensor 'top': expected one of front, side, or its number, 0 to 1")  # fmt: skip
    fails(render(scene(SIDE, ""), "-o", out / "b.exr", "-cam", "1"), 1,
          "has no sensor '1': expected front, or its number, 0")  # fmt: skip


def scattered_once(density, count=1 << 16):
    """Return the mean over the front camera's film of the fog's single scattering, times a constant.

    It is ∫ σ exp(−σ (d + s)) / (d² t² cos³ θ) dV over the fog that the film sees: d is the distance to the lamp, t that
    to the eye, and s the part of t in the fog. Points are uniform in direction and distance from the lamp: d² cancels.
    """
    u = np.random.default_rng(0).random((count, 3))
    z, turn = 2 * u[:, 0] - 1, 2 * np.pi * u[:, 1]
    way = np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], axis=1)
    lamp, eye, ahead = np.array([0.3, 0.4, 0]), np.array([0, 0.5, 4]), np.array([0, -0.5, -4]) / np.hypot(0.5, 4)
    longest = ((np.sign(way) - lamp) / way).min(axis=1)
    d = u[:, 2] * longest
    point = lamp + d[:, None] * way
    t = np.linalg.norm(point - eye, axis=1)
    s = t * (1 - point[:, 2]) / (4 - point[:, 2])  # the eye looks into the cube through its front, z = 1
    depth = (point - eye) @ ahead
    right, up = point[:, 0] / depth, (point - eye) @ np.cross([1, 0, 0], ahead) / depth
    seen = (np.abs(right) < np.tan(np.radians(20))) & (np.abs(up) < 12 / 16 * np.tan(np.radians(20)))
    return (seen * longest * density * np.exp(-density * (d + s)) * t / depth**3).mean()


def test_parameters_of_the_file_are_set(render, scene, out):
    # Guiding would send different light paths through the two fogs.
    more = '<integer name="max_depth" value="2"/><boolean name="guiding" value="false"/><integer'
    once = scene(INTEGRATOR, INTEGRATOR.replace("<integer", more))
    for name, density in (("a", 0.5), ("b", 0.25)):
        assert render(once, "-o", out / f"{name}.exr", "--set", f"density={density}")[0] == 0
    a, b = (read_layers(out / f"{name}.exr")["beams"].mean() for name in "ab")
    # Both fogs have the same light paths: over four seeds, the ratio had a spread of 0.3 %.
    assert b / a == pytest.approx(scattered_once(0.25) / scattered_once(0.5), rel=0.015)
    fails(render(scene(), "-o", out / "c.exr", "--set", "densitz=1"), 1, "densitz")
    fails(render(scene(), "-o", out / "c.exr", "--set", "density=thick"), 1, "thick")
    fails(render(scene(), "-o", out / "c.exr", "--set", "density"), 2, "--set is density: expected NAME=VALUE")


def test_flags_are_over_the_integrator_and_the_rest_is_its_own(render, scene, out, monkeypatch):
    seen = []
    monkeypatch.setattr(frame, "begin", lambda *given: seen.append(given[2]) or 1 / 0)
    text = ('<integrator type="photon_beams"><integer name="paths" value="77"/><integer name="order" value="3"/>'
            '<integer name="max_depth" value="5"/><string name="estimator" value="frustum"/></integrator>')  # fmt: skip
    flags = ("--passes", 9, "--beams", 50, "--seed", 4, "--estimator", "billboard", "--order", 2, "--time-limit", 60,
             "--bounces", 1, "--filter", "mitchell")  # fmt: skip
    for more in ((), flags, ("--rule", "riemann")):
        with pytest.raises(FrameError):
            cli.main(["render", *map(str, (scene(INTEGRATOR, text), "-o", out / "a.exr", *more))])
    own, asked, summed = seen
    assert (own.passes, own.beams, own.seed, own.estimator, len(own.rule.points)) == (3, 77, 0, "frustum", 3)
    assert (asked.passes, asked.beams, asked.seed, len(asked.rule.points)) == (9, 50, 4, 2)
    assert asked.estimator == "billboard"
    assert (own.max_depth, own.time_limit, own.pixel_filter) == (5, None, None)
    assert (asked.max_depth, asked.time_limit, asked.pixel_filter) == (3, 60, "mitchell")
    assert repr(summed.rule) == "riemann(3)"  # the file's number of points


def test_a_scene_for_another_integrator_has_our_defaults(render, scene, out):
    other = scene(INTEGRATOR, '<integrator type="volpath"/>')
    code, _, stderr = render(other, "-o", out / "a.exr", "--beams", 100, "--passes", 1, "-v")
    assert code == 0 and "is not photon_beams" in stderr


def test_a_dry_run_says_that_all_is_well_and_writes_nothing(render, scene, out):
    code, stdout, stderr = render(scene(), "-o", out / "new" / "a.exr", "--dry-run", "--res-scale", 2)
    assert (code, stdout) == (0, "")
    assert "Ready to render" in stderr and "seen by front, 32 x 24 pixels" in stderr and "a.exr" in stderr
    assert untouched(out)
    fails(render(scene('value="$density"', 'value="-1"'), "-o", out / "a.exr", "--dry-run"), 1, "sigma_t")


def test_a_dry_run_runs_no_pilot(render, scene, out, monkeypatch):
    monkeypatch.setattr(LightLines, "to_fog", lambda *_: pytest.fail("a pilot ran"))
    code, *_ = render(scene('value="beams"', 'value="auto"'), "-o", out / "a.exr", "--dry-run")
    assert code == 0


def test_a_time_limit_ends_a_render_with_what_there_is(render, scene, out):
    assert render(scene(), "-o", out / "a.exr", "--passes", 10**6, "--time-limit", 0.2)[0] == 0
    assert 1 <= header(out / "a.exr")["passes"] < 10**6


def test_layers_are_chosen_and_files_that_are_there_skipped(render, scene, out):
    assert render(scene(), "-o", out / "a.exr", "--layers", "beams")[0] == 0
    assert list(read_layers(out / "a.exr")) == ["rgba", "beams"]
    fails(render(scene(), "-o", out / "b.exr", "--layers", "glow"), 2, "'glow'", ", ".join(LAYERS))
    code, _, stderr = render(scene(), "-o", out / "a.exr", "--skip-existing")
    assert code == 0 and "1 skipped" in stderr


# -- checkpoints -----------------------------------------------------------------------------------------------------


def interrupted(monkeypatch, after):
    """Send the signal of Ctrl-C when so many passes are done."""
    add_pass = FrameRenderer.add_pass

    def pressed(self, number):
        add_pass(self, number)
        if number + 1 == after:
            os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(FrameRenderer, "add_pass", pressed)


def test_ctrl_c_keeps_a_checkpoint_from_which_the_render_goes_on(render, scene, out, monkeypatch):
    flags = ("--passes", 5, "--progress", "none")
    assert render(scene(), "-o", out / "whole.exr", *flags)[0] == 0
    with monkeypatch.context() as patched:
        interrupted(patched, 2)
        result = render(scene(), "-o", out / "a.exr", *flags, "--checkpoint", 1000)
    kept = out / "a.checkpoint"
    assert result == (130, "", f"Interrupted; {kept} has 2 passes: --resume goes on from there\n")
    assert kept.exists() and not (out / "a.exr").exists()
    fails(render(scene(), "-o", out / "a.exr", "--resume", "--seed", 8), 1, str(kept), "of another scene")
    other = scene('x="0.3"', 'x="0.2"')
    fails(render(other, "-o", out / "a.exr", "--resume"), 1, "of another scene or of other settings")
    assert render(scene(), "-o", out / "a.exr", *flags, "--resume")[0] == 0
    for name, layer in read_layers(out / "whole.exr").items():
        assert np.array_equal(layer, read_layers(out / "a.exr")[name]), name
    assert not kept.exists()


def test_a_file_that_the_scene_names_is_a_part_of_it(render, scene, out, monkeypatch):
    (out / "quad.obj").write_text("v -1 -1 -1.5\nv 1 -1 -1.5\nv 1 1 -1.5\nf 1 2 3\n")
    mesh = '<shape type="obj"><string name="filename" value="out/quad.obj"/></shape>'
    asked = (scene('<shape type="cube">', f'{mesh}<shape type="cube">'), "-o", out / "a.exr", "--progress", "none")
    with monkeypatch.context() as patched:
        interrupted(patched, 1)
        assert render(*asked, "--checkpoint", 1000)[0] == 130
    (out / "quad.obj").write_text((out / "quad.obj").read_text().replace("1 1 -1.5", "1 2 -1.5"))
    fails(render(*asked, "--resume"), 1, "of another scene or of other settings")


def test_ctrl_c_without_a_checkpoint_leaves_nothing(render, scene, out, monkeypatch):
    interrupted(monkeypatch, 1)
    result = render(scene(), "-o", out / "old.exr", "--progress", "none")
    assert result == (130, "", "Interrupted; nothing was written\n")
    assert untouched(out)


def test_checkpoints_are_written_on_the_way(render, scene, out, monkeypatch):
    saved = []
    monkeypatch.setattr(Checkpoint, "save", lambda self, _: self.due and saved.append(self.path.name))
    assert render(scene(), "-o", out / "a.exr", "--checkpoint", 1e-9)[0] == 0
    assert saved == ["a.checkpoint"] * 2  # not after the last pass
    assert render(scene(), "-o", out / "a.exr", "--resume")[0] == 0  # without a checkpoint, it starts anew


def test_a_file_that_is_no_checkpoint_is_named(render, scene, out):
    (out / "a.checkpoint").write_bytes(b"nothing")
    fails(render(scene(), "-o", out / "a.exr", "--resume", "-q"), 1, "a.checkpoint", "expected a checkpoint")
    assert (out / "a.checkpoint").read_bytes() == b"nothing"


# -- bad input -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("flags", "parts"),
    [
        (("--scattering", 0.1), ("--scattering is for stages",)),
        (("-f", "1:3"), ("one file for 3 frames",)),
        (("--look", "a.py:b"), ("a.py",)),
        (("--group", "lamp"), ("--group is lamp", "EMITTER=NAME")),
        (("--beams", 0), ("--beams is 0",)),
        (("--crop", 0, 0, 2, 1), ("--crop is 0 0 2 1",)),
        (("--checkpoint", -1), ("--checkpoint is -1.0: expected a positive",)),
        (("--picture", "glow=b.png"), ("'glow'",)),
        (("--picture", "depth=b.png"), ("'depth', which has no colours",)),
    ],
)
def test_wrong_flags_are_refused(render, scene, out, flags, parts):
    fails(render(scene(), "-o", out / "old.exr", *flags), 2, *parts)
    assert untouched(out)


def test_an_output_is_asked_for(render, scene):
    fails(render(scene()), 2, "expected at least one output")


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ("</scene>", "", ("mismatch", "line")),
        ('type="cube"', 'type="cubist"', ('"cubist" not found',)),
        ("paths", "pathz", ('unreferenced property in integrator plugin of type "photon_beams"', '"pathz": 300')),
        ('value="300"', 'value="-1"',
         ("scene.xml: line 3, col 6: photon_beams: paths is -1: expected 1 to 100000000",)),
        ('<integer name="paths" value="300"/>', '<string name="beams" value="medium"/>',
         ("beams is 'medium': expected one of long, short",)),
        ('<integer name="paths" value="300"/>', '<float name="paths" value="2048.5"/>',
         ("paths is 2048.5: expected a whole number",)),
        ('<integer name="paths" value="300"/>', '<string name="guiding" value="false"/>',
         ('guiding is "false": expected true or false',)),
        ('value="$density"', 'value="-1"', ("medium", "sigma_t.value.value has numbers below 0")),
        ('<lookat origin="0, 0.5, 4" target="0, 0, 0" up="0, 1, 0"/>', '<translate y="1e39"/>',
         ("sensor front", "not finite")),
    ],
)  # fmt: skip
def test_what_cannot_be_rendered_is_named(render, scene, out, old, new, parts):
    path = scene(old, new)
    fails(render(path, "-o", out / "old.exr", "--progress", "none"), 1, *parts)
    assert untouched(out)


def test_files_that_are_no_scenes_are_named(render, out, tmp_path):
    fails(render(tmp_path / "gone.xml", "-o", out / "old.exr"), 1, "gone.xml: no such file")
    for content, part in ((b"\xff\xfe\x00nothing", "failed"), (b'<bsdf version="3.0.0" type="diffuse"/>', "a scene")):
        (tmp_path / "a.xml").write_bytes(content)
        fails(render(tmp_path / "a.xml", "-o", out / "old.exr"), 1, "a.xml", part)
    assert untouched(out)


def test_a_folder_that_cannot_be_written_is_named(render, scene, out):
    fails(render(scene(), "-o", out / "old.exr" / "a.exr"), 1, "old.exr")
    assert untouched(out)


def test_the_command_ends_as_a_process_too(scene, out):
    arguments = [sys.executable, "-m", "photonbeams", "render", scene(), "-o", out / "a.exr", "--passes", "39",
                 "--checkpoint", "1000"]  # fmt: skip
    # With at most 39 passes, each pass prints a line.
    with subprocess.Popen(arguments, stderr=subprocess.PIPE, text=True, start_new_session=True) as process:
        try:
            for line in process.stderr:
                if re.match(r"pass [1-9]", line):
                    break
            process.send_signal(signal.SIGINT)
            _, stderr = process.communicate(timeout=60)
        finally:
            process.kill()
    assert process.returncode == 130
    assert re.search(r"Interrupted; .*a\.checkpoint has [\d,]+ passes", stderr.splitlines()[-1])
