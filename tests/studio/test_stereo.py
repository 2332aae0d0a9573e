"""Two eyes in the studio: pictures equal those of `render --stereo`, bit for bit, and the page shows an anaglyph."""

from dataclasses import replace

import numpy as np
import pytest

import photonbeams as pb
from photonbeams.images.display import anaglyph, viewed
from photonbeams.studio.encoding import beside
from photonbeams.studio.session import Session, SessionView
from photonbeams.usd.cameras.stereo import Stereo
from tests.studio.serving import Served
from tests.studio.sessions import STAGE, VIEW, Watched, are_equal

#: The stage with a pair of cameras beside its own.
PAIR = STAGE.replace(
    '    def SphereLight "Lamp"',
    """    def Camera "Right"
    {
        uniform token stereoRole = "right"
        double3 xformOp:translate = (0.3, 0, 4)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Camera "Left"
    {
        uniform token stereoRole = "left"
        double3 xformOp:translate = (0.1, 0, 4)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def SphereLight "Lamp\"""",
    1,
)
EYES = Stereo(interaxial=0.2, convergence=4.0)
ONE = replace(VIEW, passes=1)


@pytest.fixture
def stage(tmp_path):
    path = tmp_path / "shot.usda"
    path.write_text(PAIR)
    return path


def both_eyes(stage, stereo, camera=None):
    frame = pb.Shot.open(stage, camera, stereo=stereo).render(passes=1, width=48, height=27)
    return {name: layers for name, (layers, _) in frame.views.items()}


def finished(shown, version):
    return shown.wait(version, lambda each: each.is_finished).views


def are_pairs_equal(some, others):
    return list(some) == ["left", "right"] and all(are_equal(some[eye], others[eye]) for eye in others)


def test_both_eyes_are_those_of_a_render_and_one_eye_is_as_before(stage):
    with Watched(stage, view=ONE) as shown:
        session = shown.session
        plain = shown.finished()
        split = finished(shown, session.show(stereo=EYES))
        assert are_pairs_equal(split, both_eyes(stage, EYES))
        assert not np.array_equal(split["left"]["rgba"], split["right"]["rgba"])
        # The pair of prims is another camera, so the sphere around the whole scene is another one, too.
        pair = finished(shown, session.show(camera="/World/Left", stereo=Stereo()))
        assert session.has_pair() and are_pairs_equal(pair, both_eyes(stage, Stereo(), "/World/Left"))
        assert are_equal(shown.finished(session.show(camera=None, stereo=None)), plain)


def test_a_free_pair_stands_where_its_middle_is_put(stage):
    """Two renders from one place have equal depths, up to the rounding of the poses' product."""
    pose = np.eye(4)
    pose[:3, 3] = 0.3, 0.1, 3.0
    with Watched(stage, view=replace(ONE, stereo=EYES)) as shown:
        session = shown.session
        np.testing.assert_allclose(np.asarray(session.camera().to_world)[:3, 3], [0, 0, 4], atol=1e-12)
        free = finished(shown, session.show(pose=pose))
        there = finished(shown, session.edit({"/World/Camera.xformOp:translate": [0.3, 0.1, 3.0]}))
        for eye in ("left", "right"):
            np.testing.assert_allclose(free[eye]["depth"], there[eye]["depth"], rtol=1e-6)


@pytest.mark.parametrize(
    "changes, message",
    [({"stereo": Stereo(100.0, 0.1)}, "expected a convergence of at least"), ({"stereo": 3}, "expected a Stereo"),
     ({"camera": "/World/Left", "stereo": Stereo()}, "expected the same for both eyes")],
)  # fmt: skip
def test_eyes_that_cannot_be_are_refused_and_nothing_is_changed(tmp_path, changes, message):
    path = tmp_path / "shot.usda"
    path.write_text(
        PAIR.replace('token stereoRole = "left"', 'token stereoRole = "left"\n        float focalLength = 20')
    )
    with Session(path, view=VIEW) as session:
        version = session.version
        with pytest.raises(pb.SceneError, match=message):
            session.show(**changes)
        assert (session.view, session.version) == (VIEW, version)


def test_a_session_begins_with_two_eyes_or_says_why_it_cannot(stage):
    view = replace(VIEW, paused=True)
    with Session(stage, view=view, stereo=EYES) as session:
        assert session.view.stereo == EYES
    with pytest.raises(pb.SceneError, match="expected a convergence of at least"):
        Session(stage, view=view, stereo=Stereo(100.0, 0.1))


def test_a_page_finds_a_scene_whose_camera_was_edited_into_none(stage):
    served = Served(stage, view=ONE)
    try:
        with served.page() as page:
            assert page.told("scene")["pose"] is not None
            page.send("set", values={"/World/Camera.focalLength": 0.0})
            assert page.wait(lambda each: each.get("type") == "state" and each["problem"])
        with served.page() as page:
            assert page.told("scene")["pose"] is None
    finally:
        served.close()


def test_the_final_render_has_both_eyes(stage):
    view = SessionView(48, 27, passes=2, paused=True, denoise=False, camera="/World/Camera")
    with Session(stage, view=replace(view, stereo=EYES)) as session:
        flags = ["--camera", "/World/Camera", "--res", "48", "27", "--passes", "2"]
        assert session.wanted(2).flags == [*flags, "--stereo", "--interaxial", "0.2", "--convergence", "4.0"]
        session.show(stereo=None)
        assert session.wanted(2).flags == flags


@pytest.mark.parametrize(("width", "height"), [(8, 6), (7, 5), (1, 1), (2, 1)])
def test_eyes_are_side_by_side_in_the_middle_of_a_picture_of_their_size(width, height):
    left, right = (np.full((height, width, 3), level, np.uint8) for level in (50, 200))
    both = beside(left, right)
    assert both.shape == left.shape
    wide, high = max(1, width // 2), max(1, height // 2)
    top = (height - high) // 2
    lit = both[top : top + high]
    assert np.all(lit[:, -wide:] == 200) and np.all(lit[:, : min(wide, width - wide)] == 50)
    rest = np.delete(both, slice(top, top + high), axis=0), lit[:, wide : width - wide]
    assert all(not np.any(each) for each in rest)


def test_a_page_is_shown_both_eyes_or_one_of_them(stage):
    layers = both_eyes(stage, EYES)
    left, right = (viewed(layers[eye]["rgba"]) for eye in ("left", "right"))
    served = Served(stage, view=ONE)
    try:
        with served.page() as page:
            scene = page.told("scene")
            assert scene["stereo"] is None and scene["pair"] is False and scene["up"] == "Y"
            assert scene["interaxial"] == pytest.approx(6.5)  # 65 mm in centimetres, USD's default
            page.send("show", stereo=[0.2, 4.0], eye="anaglyph")
            page.wait(lambda each: each.get("type") == "state" and each["version"] >= served.session.version)
            shown = {"anaglyph": anaglyph(left, right), "side-by-side": beside(left, right)}
            for eye, wanted in (*shown.items(), ("right", right), ("left", left)):
                page.send("show", eye=eye)
                while True:  # pictures of the previous eye may still arrive
                    _, pixels = page.finished(served.session.version)
                    if np.array_equal(pixels, wanted):
                        break
            page.send("show", eye="third")
            assert "the eye is 'third': expected one of" in page.told("refused")["text"]
            page.send("show", stereo=[-1.0, None])
            assert "interaxial" in page.told("refused")["text"]
            page.send("show", stereo=[None, None], camera="/World/Left")
            assert page.wait(lambda each: each.get("type") == "scene" and each["pair"])["stereo"] == [None, None]
    finally:
        served.close()
