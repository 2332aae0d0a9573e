"""`photonbeams steady` averages the frames of a film, and keeps what else their files hold."""

import numpy as np
import OpenEXR

from photonbeams.images.files import read_layers
from tests.helpers.commands import fails
from tests.helpers.small_stage import CAMERA, FILL, FLOOR, FOG, write_stage

STILL = FILL.replace(".timeSamples = { 1: (1, 0, 0), 4: (0, 1, 0) }", " = (1, 0, 0)")
FLAGS = ("--res", 40, 48, "--passes", 2, "--beams", 64, "-q")


def written(folder):
    """Return a stage of four frames in which nothing moves."""
    return write_stage(folder / "stage.usda", FOG, CAMERA, STILL, FLOOR, metadata="startTimeCode = 1\nendTimeCode = 4")


def test_frames_change_less_and_layers_still_add_up(call, render, tmp_path, out):
    """Between two frames of three that are averaged, two are the same: of the change, a third is left."""
    stage = written(tmp_path)
    for frame in range(1, 5):  # frames of one seed have the same noise where nothing moves
        flags = ("-f", frame, "--seed", frame, "--denoise", "--stereo", "--interaxial", 0.2)
        assert render(stage, "-o", out / "film.##.exr", *FLAGS, *flags)[0] == 0
    targets = ("-o", out / "steady.##.exr", "-o", out / "steady.##.png")
    code, _, stderr = call("steady", out / "film.##.exr", "-f", "1:4", *targets, "--neighbours", 1)
    assert code == 0 and stderr.splitlines()[-1].endswith(f"wrote {out / 'steady.04.exr'}, {out / 'steady.04.png'}")
    before, after = ([read_layers(out / f"{name}.0{n}.exr", "right") for n in (2, 3)] for name in ("film", "steady"))
    for name in ("surface", "beams"):
        change = [float(np.abs(two[name] - one[name]).mean()) for one, two in (before, after)]
        assert 0 < change[1] < 0.7 * change[0], (name, change)
    np.testing.assert_allclose(after[0]["rgba"][..., :3], after[0]["surface"] + after[0]["beams"], rtol=2e-3, atol=1e-4)
    np.testing.assert_array_equal(after[0]["depth"], before[0]["depth"])
    headers = [[part.header for part in OpenEXR.File(str(out / f"{n}.02.exr")).parts] for n in ("film", "steady")]
    assert [*map(str, headers[0])] == [*map(str, headers[1])]


def test_wrong_files_are_told(call, render, tmp_path, out):
    stage = written(tmp_path)
    assert render(stage, "-o", out / "film.##.exr", *FLAGS, "-f", "1:2")[0] == 0
    film = out / "film.##.exr"
    text = f"film.01.exr would replace {out / 'film.01.exr'}, which is read: expected another file to write to"
    fails(call("steady", film, "-f", "1:2", "-o", film), 1, text)
    fails(call("steady", film, "-f", "1:3", "-o", out / "s.##.exr"), 1,
          f"{out / 'film.03.exr'}: no such file: expected all frames of the film")  # fmt: skip
    assert render(stage, "-o", out / "few.##.exr", *FLAGS, "-f", "1:2", "--layers", "beams")[0] == 0
    text = f"{out / 'few.01.exr'}: has no surface and no depth: expected a frame by `photonbeams render`"
    fails(call("steady", out / "few.##.exr", "-f", "1:2", "-o", out / "s.##.exr"), 1, text)
