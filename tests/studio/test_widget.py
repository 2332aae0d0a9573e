"""The widget, by the protocol of Jupyter's widgets: what a browser sends, and the pictures that it receives."""

import gc
import importlib
import re
import sys
import threading
from dataclasses import replace
from io import BytesIO

import comm
import numpy as np
import pytest
from comm.base_comm import BaseComm
from PIL import Image

import photonbeams as pb
from photonbeams.images.display import viewed
from photonbeams.render.passes import Statistics
from photonbeams.scene import SceneError
from photonbeams.studio.navigation import moved, orbited
from photonbeams.studio.session import Picture, Session, SessionView
from photonbeams.studio.widget import Widget
from tests.studio.sessions import INTENSITY, STAGE

VIEW = SessionView(width=32, height=18, passes=2, denoise=False)
PAUSED = SessionView(width=32, height=18, passes=2, paused=True, denoise=False)  # tests report in its place
EXPRESSION = "/World/Look.photonbeams:along:expression"
STILL = [0.0] * 6


class Wire(BaseComm):
    """The connection between a widget and its browser, which records what the browser receives."""

    def __init__(self, *given, **named):
        self.told, self.state, self._came = [], {}, threading.Condition()
        super().__init__(*given, **named)

    def publish_msg(self, msg_type, data=None, metadata=None, buffers=None, **keys):
        """Take a message as the browser does: `state` is the state of its model."""
        with self._came:
            if msg_type == "comm_close":
                self.state = None
            elif data.get("method", "update") == "update":
                state = data["state"]
                for path, buffer in zip(data["buffer_paths"], buffers or [], strict=True):
                    inner = state
                    for step in path[:-1]:
                        inner = inner[step]
                    inner[path[-1]] = bytes(buffer)
                self.state |= state
                self.told.append(state)
            self._came.notify_all()

    def send_back(self, **state):
        """Send what a browser sends when a user changes something in it."""
        self.handle_msg({"content": {"data": {"method": "update", "state": state, "buffer_paths": []}}, "buffers": []})

    def wait(self, wanted):
        """Wait until `wanted` accepts the browser's state, and return the state."""
        with self._came:
            assert self._came.wait_for(lambda: wanted(self.state), timeout=120), {**self.state, "_esm": "", "_css": ""}
            return dict(self.state)

    def finished(self, wanted=lambda picture: True):
        """Return the pixels of the next finished picture that `wanted` accepts."""
        found = self.wait(lambda state: state["picture"].get("mime") == "image/png" and wanted(state["picture"]))
        return pixels_of(found["picture"])


def pixels_of(picture):
    with Image.open(BytesIO(picture["data"])) as image:
        return np.asarray(image.convert("RGB"))


@pytest.fixture
def shown(monkeypatch):
    """Return a function that makes a widget and the connection to its browser."""
    made = []

    def make(*given, **named):
        monkeypatch.setattr(comm, "create_comm", Wire)
        made.append(Widget(*given, **named))
        return made[-1], made[-1].comm

    yield make
    for each in made:
        each.close()


def picture(passes=2, scale=1.0, brightness=0.5, **layers):
    """Return a picture as a session reports it, of two planned passes; its layers are gradients."""
    shape = round(18 * scale), round(32 * scale)
    ramp = np.linspace(0, brightness, shape[1], dtype=np.float32) * np.ones((*shape[:1], 1), np.float32)
    rgb = ramp[..., None] * np.array([1, 0.5, 0.2], np.float32)
    own = {"rgba": np.dstack([rgb, ramp]), "beams": rgb[:, ::-1], "depth": ramp[..., None], **layers}
    return Picture(0, own, passes, 2, scale, Statistics(), is_first=scale < 1)


def test_the_widget_follows_its_session(stage, shown):
    """The widget shows the picture of `Shot.render`, then the problem of an edit, and then the picture of the next."""
    widget, browser = shown(stage, view=VIEW)
    layers = pb.Shot.open(stage).render(passes=2, width=32, height=18).layers
    first = browser.finished()
    np.testing.assert_array_equal(first, viewed(layers["rgba"]))
    assert browser.state["layers"] == widget.layers == list(layers) and browser.state["problem"] == ""
    widget.session.edit({EXPRESSION: "1 + )"})
    assert "column 5" in browser.wait(lambda state: state["problem"])["problem"]
    widget.session.edit({EXPRESSION: None, INTENSITY: 200.0})
    browser.wait(lambda state: not state["problem"])
    assert browser.finished(lambda found: not np.array_equal(pixels_of(found), first)).mean() > first.mean()


def test_the_picture_has_the_aspect_of_the_camera(stage, shown):
    view = shown(stage)[0].session.view
    assert (view.width, view.height) == (480, round(480 * 15.2908 / 20.955))  # the apertures of UsdGeomCamera


def test_first_pictures_are_small_and_lossy_and_say_how_large_the_finished_one_is(stage, shown):
    widget, browser = shown(stage, view=PAUSED)
    assert browser.state["picture"] == {}
    widget.session._tell(picture(passes=1, scale=0.5))
    found = browser.state["picture"]
    assert pixels_of(found).shape == (9, 16, 3) and found["mime"] == "image/jpeg"
    assert [found[name] for name in ("width", "height", "whole", "passes", "planned")] == [16, 9, [32, 18], 0, 2]
    widget.session._tell(picture())
    found = browser.state["picture"]
    np.testing.assert_array_equal(pixels_of(found), viewed(picture().layers["rgba"]))
    assert [found[name] for name in ("width", "height", "whole", "passes", "planned")] == [32, 18, [32, 18], 2, 2]


def test_the_browser_chooses_layer_and_exposure_and_nothing_is_rendered_for_it(stage, shown):
    widget, browser = shown(stage, view=PAUSED)
    widget.session._tell(picture())
    version, layers = widget.session.version, picture().layers
    browser.send_back(layer="beams")
    np.testing.assert_array_equal(browser.finished(), viewed(layers["beams"]))
    browser.send_back(exposure=1.5)
    np.testing.assert_array_equal(browser.finished(), viewed(layers["beams"], exposure=1.5))
    widget.session._tell(picture(brightness=0.1))
    np.testing.assert_array_equal(browser.finished(), viewed(picture(brightness=0.1).layers["beams"], exposure=1.5))
    widget.layer, widget.exposure = "depth", 0.0
    np.testing.assert_array_equal(browser.finished(), viewed(np.repeat(picture(brightness=0.1).layers["depth"], 3, 2)))
    widget.layer = "beams_gone"  # of a light group that an edit removed
    np.testing.assert_array_equal(browser.finished(), viewed(picture(brightness=0.1).layers["rgba"]))
    assert widget.session.version == version and browser.state["layers"] == ["rgba", "beams", "depth"]


def test_pictures_that_follow_too_fast_are_left_out_but_for_first_and_finished_ones(stage, shown, monkeypatch):
    monkeypatch.setattr("photonbeams.studio.widget._PAUSE", 1e9)
    widget, browser = shown(stage, view=PAUSED)
    for number in range(1, 10):
        widget.session._tell(replace(picture(passes=number), planned=9))
    assert [each["picture"]["passes"] for each in browser.told if each.get("picture")] == [1, 9]


@pytest.mark.parametrize("axis", ["Y", "Z"])
def test_a_drag_orbits_about_the_stages_up_axis_and_goes_on_from_there(stage, shown, axis):
    stage.write_text(STAGE.replace('"World"\n)', f'"World"\n    upAxis = "{axis}"\n)', 1))
    widget, browser = shown(stage, view=PAUSED)
    pose, up = np.eye(4), {"Y": np.array([0.0, 1, 0]), "Z": np.array([0.0, 0, 1])}[axis]
    pose[:3, 3] = 0, 0, 4
    browser.send_back(gesture=[0, 0.3, 0, 0, 0, 0])
    browser.send_back(gesture=[0, 0.3, 0.2, 0, 0, 0])  # gestures are sums: their increase is a movement
    expected = orbited(orbited(pose, up, 4, 0.3, 0), up, 4, 0, 0.2)
    np.testing.assert_allclose(widget.session.view.pose, expected, atol=1e-12)
    browser.send_back(gesture=[1, 0, 0, 0, 0, 0])
    assert widget.session.view.pose is None
    # One message resets the camera and moves it: the movement starts from the stage's camera.
    browser.send_back(gesture=[2, 0.1, 0, 0, 0, 0])
    np.testing.assert_allclose(widget.session.view.pose, orbited(pose, up, 4, 0.1, 0), atol=1e-12)


def test_the_wheel_dollies_toward_the_point_and_a_pan_moves_it_with_the_mouse(stage, shown):
    widget, browser = shown(stage, view=PAUSED)
    pose = np.eye(4)
    pose[:3, 3] = 0, 0, 4
    browser.send_back(gesture=[0, 0, 0, 0, 0, np.log(2)])
    np.testing.assert_allclose(widget.session.view.pose, moved(pose, 0, 0, 2), atol=1e-12)
    browser.send_back(gesture=[0, 0, 0, 1, -0.5, np.log(2)])
    # At the point, 2 in front of the camera, the picture is 2 · aperture / focal length = 2 · 20.955 / 50 wide.
    width = 2 * 20.955 / 50
    np.testing.assert_allclose(widget.session.view.pose, moved(pose, width, -width / 2, 2), rtol=1e-6)
    browser.send_back(gesture=[0, 0, 0, 1, -0.5, 1e9])  # as near as cameras get
    assert widget.session.view.pose[2, 3] == pytest.approx(0.001)


@pytest.mark.parametrize("state", [{"gesture": [1.0]}, {"gesture": [0, "left", 0, 0, 0, 0]}, {"exposure": 65.0}])
def test_what_is_no_state_is_not_taken(stage, shown, state, caplog, capsys):
    widget, browser = shown(stage, view=PAUSED)
    browser.send_back(**state)
    assert widget.gesture == STILL and widget.exposure == 0 and widget.session.view.pose is None
    assert "TraitError" in "".join(capsys.readouterr()) + caplog.text  # ipywidgets reports it


def test_a_widget_closes_the_session_that_it_opened(stage, shown):
    widget, browser = shown(stage, view=PAUSED)
    assert widget.session._thread.is_alive()
    widget.close()
    assert not widget.session._thread.is_alive() and browser.state is None
    widget.close()


def test_a_session_that_it_was_given_goes_on_and_has_other_widgets(stage, shown):
    with Session(stage, view=PAUSED) as session:
        (one, its_browser), (other, browser) = shown(session), shown(session)
        session._tell(picture())
        np.testing.assert_array_equal(its_browser.finished(), browser.finished())
        one.close()
        session._tell(picture(brightness=0.1))
        assert session._thread.is_alive() and its_browser.state is None
        np.testing.assert_array_equal(browser.finished(), viewed(picture(brightness=0.1).layers["rgba"]))
        assert other.session is one.session is session


def test_what_is_no_stage_is_an_error_and_leaves_nothing_behind(stage, shown):
    before = threading.active_count()
    with pytest.raises(SceneError, match="there is no such file"):
        shown(stage.with_name("gone.usda"))
    with pytest.raises(SceneError, match="camera: expected only with the path"), Session(stage, view=PAUSED) as session:
        shown(session, camera="/World/Camera")
    gc.collect()  # this closes a half-made widget, which must not fail
    assert threading.active_count() == before


def test_the_browsers_side_knows_no_other_traits_than_the_widget(stage, shown):
    source = str(Widget._esm)
    named = set(re.findall(r'(?:model\.get|\bset)\("(\w+)"', source)) | set(re.findall(r'"change:(\w+)"', source))
    assert named == {"gesture", "layer", "layers", "exposure", "picture", "problem"}
    _, browser = shown(stage, view=PAUSED)
    assert named < browser.state.keys() and "export default { render }" in browser.state["_esm"]
    assert ".photonbeams" in browser.state["_css"]


def test_without_anywidget_the_message_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "anywidget", None)
    monkeypatch.delitem(sys.modules, "photonbeams.studio.widget")
    with pytest.raises(ImportError, match=r"pip install 'photonbeams\[notebook\]'"):
        importlib.import_module("photonbeams.studio.widget")
