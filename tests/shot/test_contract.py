"""The contract of shots: each public name works for each kind of subject, or says in a sentence why it does not."""

import numpy as np
import pytest

import photonbeams as pb
from photonbeams.render.checkpoint import Checkpoint
from photonbeams.render.passes import PlannedPasses
from photonbeams.runtime.device import mitsuba

pytestmark = pytest.mark.usefixtures("helping_thread")

SMALL = {"width": 16, "height": 12}
FEW = {"beams": 100, "guiding": False}
STAGE = """#usda 1.0
def Camera "Eye" {
    float focalLength = 50
    float horizontalAperture = 40
    float verticalAperture = 30
    double3 xformOp:translate = (0, 0, 5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def SphereLight "Lamp" {
    float inputs:radius = 0.25
    double3 xformOp:translate = (0.5, 1, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Scope "Fog" {
    color3f photonbeams:scattering = (0.1, 0.1, 0.1)
}
"""
SCENE = """<scene version="3.0.0">
  <integrator type="volpath"/>
  <sensor type="perspective" id="eye">
    <float name="fov" value="40"/><transform name="to_world"><lookat origin="0, 0, 5" target="0, 0, 0" up="0, 1, 0"/>
    </transform><film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="12"/></film>
  </sensor>
  <shape type="cube"><bsdf type="null"/><medium name="interior" type="homogeneous">
    <rgb name="sigma_t" value="0.1"/><rgb name="albedo" value="0.9"/></medium></shape>
  <emitter type="point" id="lamp"><point name="position" x="0.5" y="0.5" z="0"/><rgb name="intensity" value="3"/>
  </emitter>
</scene>
"""


def of_stage(folder, **given):
    (folder / "x.usda").write_text(STAGE)
    return pb.Shot.open(folder / "x.usda", **given)


def of_file(folder, **given):
    (folder / "x.xml").write_text(SCENE)
    return pb.Shot.open(folder / "x.xml", **given)


def of_mitsuba(folder, **given):
    return pb.Shot(mitsuba().load_string(SCENE), **given)


def of_python(folder, **given):
    lamp = pb.scene.SphereLight("/Lamp", 1.0, center=(0.5, 1, 0), radius=0.25)
    content = pb.scene.Scene(lights=lamp, media=pb.Medium(0.1))
    return pb.Shot(content, pb.scene.Camera.look_at((0, 0, 5), (0, 0, 0), aspect=4 / 3), **given)


SUBJECTS = (of_stage, of_file, of_mitsuba, of_python)


def film(shot):
    with shot.film():
        return [shot.render(passes=1, **SMALL, **FEW).layers["beams"] for _ in range(2)]


#: How each public name of a shot is used, and what is true of the result.
USES = {
    "stage": (lambda shot: shot.stage, lambda found: found.GetPrimAtPath("/Eye")),
    "warnings": (lambda shot: shot.warnings.given, lambda found: isinstance(found, set)),
    "viewpoint": (lambda shot: shot.viewpoint, lambda found: found.stereo is None),
    "settings": (lambda shot: shot.settings(), lambda found: found.passes > 0),
    "time": (lambda shot: shot.time(3), lambda found: found.GetValue() == 3),
    "read": (lambda shot: shot.read(), lambda found: len(found[0].lights) == 1 and found[1].focal_length > 0),
    "exposure": (lambda shot: shot.exposure(), lambda found: len(found(0.0)[0].lights) == 1 and not found.moving),
    "cameras": (lambda shot: shot.cameras(), lambda found: [type(each) for each in found] == [pb.scene.Camera]),
    "resolution": (lambda shot: shot.resolution(width=8), lambda found: found == (8, 6)),
    "render": (lambda shot: shot.render(passes=1, **SMALL, **FEW), lambda found: found.layers["beams"].any()),
    "film": (film, lambda found: found[0].any() and (found[0] == found[1]).all()),
    "estimate": (lambda shot: shot.estimate(passes=1, **SMALL, **FEW), lambda found: found.size == (16, 12)),
    "render_part": (
        lambda shot: shot.render_part(PlannedPasses(range(1, 2), 2), **SMALL, **FEW), lambda found: len(found) == 1
    ),
    "beams": (lambda shot: shot.beams(**FEW), lambda found: sum(len(each.beams) for each in found) >= 50),
    "drawn_beams": (lambda shot: shot.drawn_beams(**FEW), lambda found: sum(len(each.start) for each in found) >= 50),
}  # fmt: skip

#: What these subjects do not have, and say so.
LACKING = {
    of_stage: set(), of_python: {"stage", "time"}, of_file: {"stage", "time", "read", "exposure"},
    of_mitsuba: {"stage", "time", "read", "exposure"},
}  # fmt: skip


@pytest.fixture(scope="module", params=SUBJECTS, ids=lambda each: each.__name__)
def subject(request, tmp_path_factory):
    return request.param, request.param(tmp_path_factory.mktemp("shot"))


@pytest.mark.parametrize("name", USES)
def test_what_a_shot_offers_works_or_says_why_not(subject, name):
    kind, shot = subject
    use, holds = USES[name]
    if name in LACKING[kind]:
        with pytest.raises(pb.SceneError, match="it has no ") as refused:
            use(shot)
        assert "\n" not in str(refused.value)
    else:
        assert holds(use(shot))


def test_the_contract_is_of_all_public_names(subject):
    public = {name for name in dir(pb.Shot) if not name.startswith("_")}
    assert public == {*USES, "open", "write_beams"} and type(subject[1]) is pb.Shot


def test_beams_are_written_and_read(subject, tmp_path):
    _, shot = subject
    count = shot.write_beams(tmp_path / "beams.usda", **FEW)
    text = (tmp_path / "beams.usda").read_text()
    assert count >= 50 and "BasisCurves" in text
    reader = pb.Shot.open(of_stage_with(tmp_path, "beams.usda"))
    assert sum(len(each.start) for each in reader.read()[0].drawn) >= 50


def of_stage_with(folder, file):
    """Return a stage with a camera, on which a file of beams lies."""
    text = STAGE.replace("#usda 1.0", f"#usda 1.0\n( subLayers = [@{file}@] )")
    (folder / "y.usda").write_text(text)
    return folder / "y.usda"


@pytest.mark.parametrize(
    ("kind", "given"),
    [
        (of_stage, {"groups": {"Lamp": "key"}}),
        (of_python, {"beams": {"Lamp": pb.scene.BeamSettings()}}),
        (of_python, {"session_layers": ["a.usda"]}),
        (of_file, {"medium": pb.Medium(0.1)}),
        (of_mitsuba, {"emit": len}),
    ],
)
def test_what_a_subject_has_no_use_for_is_refused(kind, given, tmp_path):
    (name,) = given
    with pytest.raises(pb.SceneError, match=f"^{name} is for (stages|Mitsuba scenes): "):
        kind(tmp_path, **given)


def test_the_picture_of_a_mitsuba_scene_is_as_large_as_its_film(tmp_path):
    assert of_file(tmp_path).resolution() == (16, 12)


def test_two_eyes_have_two_cameras(subject, tmp_path):
    kind, _ = subject
    shot = kind(tmp_path, stereo=pb.Stereo(interaxial=0.2, convergence=4))
    left, right = shot.cameras()
    assert np.isclose(right.to_world[0][3] - left.to_world[0][3], 0.2)
    assert len(shot.beams(view="left", **FEW)) == 1


def test_a_checkpoint_keeps_what_the_user_said(tmp_path):
    checkpoint = Checkpoint(tmp_path / "kept", every=1e-9)
    before = dict(vars(checkpoint))
    of_stage(tmp_path).render(passes=3, checkpoint=checkpoint, **SMALL, **FEW)
    changed = {name for name, value in vars(checkpoint).items() if before.get(name, ...) != value}
    assert changed <= {"passes", "source", "_written"} and checkpoint.passes == 2  # its own account of the file
    again = of_stage(tmp_path).render(passes=3, checkpoint=tmp_path / "kept", **SMALL, **FEW)
    assert again.layers["beams"].any()
