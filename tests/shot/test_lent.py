"""The view and the light of stages and scenes that have none, by numbers: what is seen, and how bright it is."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import photonbeams as pb
from photonbeams.shot.lent import LIGHTS, VIEW, view_of
from tests.helpers.usda import material

PLACE = st.floats(-1e4, 1e4, width=32)
SIZE = st.floats(0, 1e3, width=32)
CAMERA = '\ndef Camera "C" {\n}'
LAMP = '\ndef DistantLight "L" {\n}'


@given(st.tuples(PLACE, PLACE, PLACE), st.tuples(SIZE, SIZE, SIZE), st.sampled_from("YZ"))
def test_the_view_shows_all_of_a_box_upright_and_fills_the_picture(low, sizes, up):
    low, high = np.array(low), np.array(low) + sizes
    camera = view_of((low, high), up)
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * (high - low) + low
    local = (corners - camera.to_world[:3, 3]) @ camera.to_world[:3, :3]
    assert np.allclose(camera.to_world[:3, 1], [0, 1, 0] if up == "Y" else [0, 0, 1])
    if max(sizes) < 1e-3 * max(1, np.abs(low).max()):  # a point: rounding of its place is larger than it
        return
    half = np.array([camera.horizontal_aperture, camera.vertical_aperture]) / 2 / camera.focal_length
    seen = np.abs(local[:, :2] / -local[:, 2:]) / half
    assert np.all(local[:, 2] < 0)
    assert np.max(seen) <= 1
    flat = [sizes[0], sizes[1 if up == "Y" else 2]]
    if max(flat) > 0.01 * max(sizes):  # the front face is a 20th smaller than the picture, rounded as its place is
        assert np.max(seen) == pytest.approx(1 / 1.05, rel=0.02)


def square(name, low, high, axis, at):
    """Return a square across an axis, of the matt material below."""
    corners = [(low, low), (high, low), (high, high), (low, high)]
    points = ", ".join(str(tuple(np.insert(np.array(each, dtype=float), axis, at).tolist())) for each in corners)
    return f"""
def Mesh "{name}" (prepend apiSchemas = ["MaterialBindingAPI"]) {{
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [{points}]
    uniform token subdivisionScheme = "none"
    rel material:binding = </Matt>
}}
"""


MATT = material(
    "Matt", "color3f inputs:diffuseColor = (0.6, 0.4, 0.2)", "int inputs:useSpecularWorkflow = 1",
    "color3f inputs:specularColor = (0, 0, 0)",
)  # fmt: skip


def surface(shot):
    """Return the mean and four standard errors of the middle of a picture."""
    middle = shot.render(passes=4, width=32).layers["surface"][8:16, 10:22].reshape(-1, 3)
    return middle.mean(axis=0), 4 * middle.std(axis=0) / np.sqrt(len(middle)) + 1e-4


@pytest.mark.parametrize(("up", "axis"), [("Y", 2), ("Z", 1)])
def test_paper_that_faces_the_view_has_its_albedo_as_radiance(usd, up, axis, caplog):
    shot = pb.Shot(usd(square("Paper", -2, 2, axis, 7) + MATT, f'upAxis = "{up}"'))
    mean, error = surface(shot)
    assert np.all(np.abs(mean - [0.6, 0.4, 0.2]) < error)
    assert shot.cameras()[0].name == VIEW
    for what in ("camera: the default view shows all of it", "light: a white one, from the sky"):
        assert caplog.text.count(f"there is no {what}") == 1


def test_a_closed_room_has_the_half_that_comes_from_the_camera(usd):
    walls = "".join(square(f"W{axis}{at:+d}".replace("+", "p").replace("-", "m"), -2, 2, axis, at)
                    for axis in range(3) for at in (-2, 2))  # fmt: skip
    mean, _ = surface(pb.Shot(usd(walls + MATT + CAMERA)))
    assert mean == pytest.approx([0.3, 0.2, 0.1], rel=1e-3)  # half of the albedo: no sample varies


@given(st.booleans(), st.booleans(), st.booleans(), st.sampled_from("YZ"))
def test_what_a_stage_has_is_used_and_what_it_lacks_is_lent(camera, light, old, up):
    from pxr import Usd

    lamp = LAMP.replace("{\n", f"{{\n float {'' if old else 'inputs:'}intensity = 3\n") if light else ""
    metadata = f'#usda 1.0\n(\n upAxis = "{up}"\n)\n'
    with TemporaryDirectory() as folder:
        path = Path(folder, "a.usda")
        path.write_text(f'{metadata}def Sphere "S" {{\n}}{CAMERA if camera else ""}{lamp}')
        shot = pb.Shot(Usd.Stage.Open(str(path)))
    shot.subject.warnings.muted = True
    content, seen = shot.read()
    assert seen.name == ("/C" if camera else VIEW)
    assert [each.name for each in content.lights] == (["/L"] if light else [*LIGHTS])
    if light:
        assert content.lights[0].radiance == (3, 3, 3)
    said = [name for name in ("camera", "light") if any(f"there is no {name}" in each for each in shot.warnings.given)]
    assert said == ["camera"] * (not camera) + ["light"] * (not light)


def test_an_edit_that_adds_a_camera_or_a_light_ends_the_loan(usd):
    shot = pb.Shot(usd('def Sphere "S" {\n}'))
    assert (shot.cameras()[0].name, len(shot.read()[0].lights)) == (VIEW, 2)
    shot.stage.DefinePrim("/C", "Camera")
    shot.stage.DefinePrim("/L", "SphereLight")
    assert (shot.cameras()[0].name, [each.name for each in shot.read()[0].lights]) == ("/C", ["/L"])


def test_one_view_shows_what_moves_at_all_times_and_has_two_eyes(usd):
    moving = 'def Sphere "S" {\n double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 9: (40, 0, 0) }\n'
    moving += ' uniform token[] xformOpOrder = ["xformOp:translate"]\n}'
    shot = pb.Shot(usd(moving, "startTimeCode = 1\nendTimeCode = 9"))
    first, last = (shot.cameras(frame)[0].to_world for frame in (1, 9))
    assert np.array_equal(first, last)
    assert first[:3, 3] == pytest.approx([20, 0, first[2, 3]], abs=1e-5)
    left, right = pb.Shot(shot.stage, stereo=pb.Stereo(interaxial=2)).cameras()
    assert (right.to_world - left.to_world)[0, 3] == pytest.approx(2)


def test_one_view_shows_what_turns_between_two_samples(usd):
    """A turntable's first and last pose are the same."""
    turning = 'def Xform "T" {\n float xformOp:rotateY.timeSamples = { 1: 0, 9: 360 }\n'
    turning += ' uniform token[] xformOpOrder = ["xformOp:rotateY"]\n def Sphere "S" {\n'
    turning += ' double3 xformOp:translate = (40, 0, 0)\n uniform token[] xformOpOrder = ["xformOp:translate"]\n}\n}'
    shot = pb.Shot(usd(turning, "startTimeCode = 1\nendTimeCode = 9"))
    low, high = np.array([-41, -1, -41]), np.array([41, 1, 41])
    assert shot.cameras(1)[0].to_world == pytest.approx(view_of((low, high), "Y").to_world, abs=0.2)


def test_what_no_light_would_show_is_still_refused(usd):
    hidden = LAMP.replace("{\n", '{\n token visibility = "invisible"\n')
    with pytest.raises(pb.SceneError, match="there is no light, and the picture would be black"):
        pb.Shot(usd('def Sphere "S" {\n}' + CAMERA + hidden)).render(passes=1, width=8)
    with pytest.raises(pb.SceneError, match="has no camera, and nothing that a view of all could show"):
        pb.Shot(usd("")).render(passes=1, width=8)


def test_a_mitsuba_scene_without_a_sensor_is_seen_whole(caplog):
    scene = {"type": "scene", "light": {"type": "constant"}, "ball": {"type": "sphere", "center": [50, 0, 0]}}
    shot = pb.Shot(scene)
    alpha = shot.render(passes=1, width=48, hide_emitters=True).layers["rgba"][..., 3] > 0.5
    rows, columns = np.nonzero(alpha)
    assert caplog.text.count("there is no sensor: the default view shows all of it") == 1
    # Its silhouette is as wide as high, in the middle, and fills the height but for a 20th and the perspective.
    assert np.ptp(rows) == pytest.approx(np.ptp(columns), abs=1)
    assert abs(columns.mean() - 23.5) < 1
    assert 0.8 * 36 < np.ptp(rows) + 1 <= 36
