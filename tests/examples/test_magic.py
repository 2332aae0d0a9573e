"""The strands of light: the stage is what its script writes, joints are invisible, pulses travel, strands grow."""

import runpy
from pathlib import Path

import numpy as np
import pytest

import photonbeams as pb

FOLDER = Path(__file__).parents[2] / "examples" / "magic"
STAGE, GROW = FOLDER / "magic.usda", FOLDER / "grow.usda"
TINY = {"passes": 1, "width": 64}


def test_the_stage_and_its_layer_are_what_the_script_writes(tmp_path):
    runpy.run_path(str(FOLDER / "model.py"))["model"](tmp_path)
    for path in (STAGE, GROW):
        assert (tmp_path / path.name).read_bytes() == path.read_bytes()


@pytest.fixture(scope="module")
def shot():
    return pb.Shot.open(STAGE)


def test_it_renders_by_its_own_settings_to_beams_of_two_groups(shot):
    assert str(shot.stage.GetMetadata("renderSettingsPrimPath")) == "/Render/Settings"
    layers = shot.render(**TINY).layers
    assert all(np.isfinite(layers[name]).all() for name in ("rgba", "beams", "surface"))
    assert layers["beams_strands"].any() and layers["beams_glow"].any() and layers["surface"].any()
    # The fog affects only beams.
    assert np.all(layers["transmittance"] == 1)


def test_the_light_of_a_strand_goes_on_over_its_joints(shot):
    content, _ = shot.read(1)
    (strands,) = (each for each in content.drawn if each.group == "strands")
    longest = np.argmax(np.bincount(strands.id.astype(int)))
    mine = strands.id == longest
    beams = pb.Beams(**{name: value[mine] for name, value in strands.arrays().items()})
    joints = np.flatnonzero(mine)[40:-120:5]
    assert len(joints) > 50
    # Rays cross the axis along a normal of the curve, a thousandth of a radius before and behind each joint.
    axis = strands.end_tangent[joints]
    across = np.cross(axis, (0.3, 0.5, 0.8))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    step = 1e-3 * strands.radius_end[joints, None] * axis
    # Rays begin close to the strand, because the same curve also passes elsewhere.
    origin = strands.end[joints] - 3 * strands.radius_end[joints, None] * across
    look = pb.Look(along=pb.looks.Expression("0.4 + random + s"), angle=pb.looks.Isotropic(), eye=1.0)
    fog = pb.Medium((0.05, 0.05, 0.05))
    before, behind = (
        pb.estimate(beams, origin + sign * step, across, look=look, medium=fog, estimator="frustum").numpy()[:, 0]
        for sign in (-1, 1)
    )
    assert before.min() > 0
    # Over so short a distance, the light itself changes by the order of the step. Segments with perpendicular ends
    # would leave a gap or an overlap, and segments with their own ids would change `random`: both by tenths.
    assert np.abs(behind / before - 1).max() < 0.02


def test_pulses_travel_along_the_strands(shot):
    first, again, later = (shot.render(frame, **TINY).layers["beams_strands"].sum(axis=-1) for frame in (1, 25, 7))
    lit = first > 0.1 * first.max()
    assert lit.sum() > 50
    # After a second, a full period, the pulses are where they were; after a quarter of it they are elsewhere.
    assert np.abs(again - first)[lit].max() < 1e-3 * first.max()
    assert np.median(np.abs(later - first)[lit] / first[lit]) > 0.1


def test_strands_grow_under_the_layer(shot):
    grown = pb.Shot.open(STAGE, session_layers=[GROW])
    sums = [grown.render(frame, **TINY).layers["beams"].sum() for frame in (1, 16, 32, 48)]
    assert 0 < sums[0] < 0.1 * sums[1] and sums[1] < sums[2] < sums[3]
    whole = shot.render(48, **TINY).layers["beams"].sum()
    assert sums[3] == pytest.approx(whole, rel=0.01)
