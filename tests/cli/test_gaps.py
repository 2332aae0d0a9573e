"""`photonbeams render` of frames for which something is missing that the stage names."""

import OpenEXR

from tests.helpers.commands import fails
from tests.helpers.small_stage import CAMERA, FOG, LAMP, write_stage


def test_a_frame_without_what_the_stage_names_is_counted_or_fails(render, call, tmp_path, out):
    """As husk and usdrecord do, the command renders it; a farm asks for a failure."""
    files = "asset inputs:shaping:ies:file.timeSamples = {7: @@, 8: @gone.ies@, 9: @@}\n    float inputs:radius"
    stage = write_stage(tmp_path / "stage.usda", FOG, CAMERA, LAMP.replace("float inputs:radius", files))
    small = ("--res", 8, 0, "--passes", 1, "--beams", 16)
    code, _, stderr = render(stage, "-o", out / "a.#.exr", "-f", "7:9", *small)
    warning, summary = next(line for line in stderr.splitlines() if "gone" in line), stderr.splitlines()[-1]
    assert code == 0
    assert warning.startswith(f"Warning: frame 8: {stage}: /Lamp.inputs:shaping:ies:file names gone.ies")
    assert summary.endswith("; 1 frame without something that the stage names, as warned")
    part = out / "a.8.checkpoint"  # what is missing stays with the passes, wherever they are joined
    assert render(stage, "-o", part, "-f", "8", *small, "--pass-range", "1/1", "-q")[0] == 0
    assert call("merge", part, "-o", out / "joined.exr", "-q")[0] == 0
    for name, missing in (("a.7", False), ("a.8", True), ("a.9", False), ("joined", True)):
        with OpenEXR.File(str(out / f"{name}.exr"), header_only=True) as file:
            assert ("missing" in file.parts[0].header) == missing
    fails(render(stage, "-o", out / "b.#.exr", "-f", "7:9", *small, "--fail-missing", "-q"), 1, "frame 8: ", "gone.ies")
    assert (out / "b.7.exr").exists()
    assert not (out / "b.8.exr").exists()
