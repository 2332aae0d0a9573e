"""The studio in a browser: every user action on its page has its effect, with the real server.

Chromium draws the page with a sixth of the usual pixels, so pictures are small; the layout keeps its size.
"""

import base64
import io
import json
import os
import re
import shutil
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from PIL import Image
from playwright.sync_api import sync_playwright

import photonbeams as pb
from photonbeams.cli.render import PROGRAM_BYTES
from photonbeams.images.display import viewed
from photonbeams.images.files import read_layers
from photonbeams.render.memory import BEAM_BYTES, PIXEL_BYTES
from tests.studio.proxying import PREFIX, Proxy
from tests.studio.serving import TOKEN, Served, asked

NAMES = ("chromium", "chromium-browser", "google-chrome")
CHROMIUM = next((found for name in NAMES if (found := shutil.which(name))), None)
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason=f"none of {', '.join(NAMES)} is on PATH")

ROOT = Path(__file__).resolve().parents[2]
PASSES = 2  # of finished pictures
SCALE = 0.16  # pixels of a picture per pixel of the page
LIMIT = 120.0  # seconds for each wait: the machine may be busy, and kernels may have to be compiled

STAGE = """#usda 1.0
(
    defaultPrim = "World"
    startTimeCode = 1
    endTimeCode = 5
    timeCodesPerSecond = 24
)
def Xform "World"
{
    def Camera "Camera"
    {
        double3 xformOp:translate = (0, 0, 4)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def SphereLight "Lamp" (prepend apiSchemas = ["PhotonBeamsLightAPI"])
    {
        float inputs:radius = 0.05
        float inputs:intensity.timeSamples = { 1: 200, 5: 800 }
        int photonbeams:count = 300
        rel photonbeams:look = </World/Look>
    }
    def PhotonBeamsLook "Look"
    {
        float[] photonbeams:along:ramp:knots = [0, 0.4, 1]
        color3f[] photonbeams:along:ramp:colors = [(1, 0.8, 0.5), (1, 0.3, 0.1), (0.1, 0.1, 0.6)]
        string photonbeams:along:expression = "0.5 + s"
    }
    def Sphere "Ball"
    {
        double radius = 0.3
        double3 xformOp:translate = (0.8, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Cube "Fog" (prepend apiSchemas = ["PhotonBeamsMediumAPI"])
    {
        color3f photonbeams:scattering = (0.4, 0.4, 0.4)
    }
}
"""
INTENSITY = "/World/Lamp.inputs:intensity"
RAMP, EXPRESSION = "/World/Look.photonbeams:along:ramp", "/World/Look.photonbeams:along:expression"

#: Marks everything that the tab key must reach with its number, and returns the names.
TABBABLE = """() => [...document.querySelectorAll('a[href], button, input, select, textarea, [tabindex]')]
  .filter((each) => !each.disabled && each.tabIndex >= 0 && each.checkVisibility({ visibilityProperty: true })
    && !(each.type === 'radio' && !each.checked))
  .map((each, number) => {
    each.dataset.tab = number;
    return (each.getAttribute('aria-label') ?? each.textContent).trim();
  })"""
#: Returns the focused element's number and name, and whether it or what is drawn in its place has an outline.
FOCUSED = """() => {
  const focused = document.activeElement;
  const drawn = [focused, focused.nextElementSibling, focused.parentElement, focused.parentElement?.parentElement];
  const outlined = drawn.some((each) => {
    const style = each && getComputedStyle(each);
    return style && style.outlineStyle !== 'none' && parseFloat(style.outlineWidth) > 0;
  });
  const name = (focused.getAttribute('aria-label') ?? focused.labels?.[0]?.textContent ?? focused.textContent).trim();
  return [focused === document.body ? null : Number(focused.dataset.tab), name, outlined];
}"""


class Window:
    """A page of the studio in the browser: what it shows, what it receives, and its errors and warnings."""

    def __init__(self, context, address, session=None):
        self.page, self._session = context.new_page(), session
        self.complaints, self.header, self._payload, self.sent = [], {}, b"", []
        self.page.on("console", lambda text: text.type in ("error", "warning") and self.complaints.append(text.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("websocket", self._connected)
        self.page.set_default_timeout(1000 * LIMIT)
        self.page.goto(address)

    def _connected(self, socket):
        self.header, self.sent = {}, []
        socket.on("framereceived", self._take)
        socket.on("framesent", lambda data: self.sent.append(data))

    def _take(self, data):
        if isinstance(data, bytes):
            length = int.from_bytes(data[:4], "little")
            self.header, self._payload = json.loads(data[4 : 4 + length]), data[4 + length :]

    def wait(self, wanted):
        """Wait until `wanted` returns something true."""
        end = time.monotonic() + LIMIT
        while not wanted():
            assert time.monotonic() < end, f"the page shows {self.page.locator('body').inner_text()[:500]}"
            self.page.wait_for_timeout(50)  # events are handled meanwhile

    def canvas(self):
        data = self.page.evaluate("document.querySelector('canvas').toDataURL().split(',')[1]")
        return pixels_of(base64.b64decode(data))

    def received(self):
        return pixels_of(self._payload)

    def picture(self):
        """Return the finished picture of the session's current version, once the canvas shows it."""
        self.wait(lambda: self._is_whole() and self.is_newest())
        self.wait(lambda: are_alike(self.canvas(), self.received()))
        return self.received()

    def is_newest(self):
        """Return whether the last picture is the finished one of the session's current version."""
        version = self.header.get("version") if self._session is None else self._session.version
        return self.header.get("mime") == "image/png" and self.header["version"] == version

    def _is_whole(self):
        """Return whether the last picture is as large as the page wants it now."""
        size = self.page.evaluate("document.querySelector('[role=application]').clientWidth * devicePixelRatio")
        return abs(self.header.get("width", 0) - size) < 1

    def choose(self, tool):
        self.page.get_by_role("radio", name=tool).locator("..").click()

    def place(self, x, y):
        """Return the position on the page of a point of the picture, given in fractions."""
        box = self.page.locator("canvas").bounding_box()
        return box["x"] + x * box["width"], box["y"] + y * box["height"]

    def drag(self, begin, end):
        mouse = self.page.mouse
        mouse.move(*begin)
        mouse.down()
        mouse.move(*end, steps=8)
        mouse.up()

    def drag_by(self, handle, dx, dy):
        box = handle.bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        self.drag((x, y), (x + dx, y + dy))

    def press(self, *keys):
        for key in keys:
            self.page.keyboard.press(key)

    def control(self, role, words, **given):
        """Return a control of the panel, found by words in its name or path."""
        self.page.get_by_role("searchbox").fill(words)
        found = self.page.locator("aside").get_by_role(role, **given)
        self.wait(lambda: found.count() == 1)
        return found

    def tab_to(self, name):
        """Press the tab key until the focus is on an element whose name begins with `name`."""
        for _ in range(300):
            self.press("Tab")
            if self.page.evaluate(FOCUSED)[1].startswith(name):
                return
        raise AssertionError(f"the tab key does not reach {name!r}")

    def assert_accessible(self):
        """Assert that axe-core finds nothing serious in what the page shows."""
        # Elements that are still fading in do not have their contrast yet.
        self.page.wait_for_timeout(50)
        self.wait(
            lambda: not self.page.evaluate("document.getAnimations().some((each) => each instanceof CSSTransition)")
        )
        found = Axe().run(self.page).response["violations"]
        grave = [each for each in found if each["impact"] in ("serious", "critical")]
        assert grave == [], [(each["id"], [node["html"] for node in each["nodes"]]) for each in grave]


def pixels_of(data):
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))


def difference(some, others):
    """Return the mean difference of two pictures in levels of 255."""
    return np.abs(some.astype(float) - others).mean()


def are_alike(shown, received, columns=slice(None)):
    """Return whether a picture is shown as it was received; if it is scaled to less room, nearly so."""
    if shown.shape == received.shape:
        return np.array_equal(shown[:, columns], received[:, columns])
    scaled = np.asarray(Image.fromarray(received).resize(shown.shape[1::-1], Image.Resampling.BILINEAR))
    return difference(shown[:, columns], scaled[:, columns]) < 4


@pytest.fixture(scope="module")
def browser():
    with sync_playwright() as playwright:
        # Chromium's own sandbox refuses to work for root.
        arguments = ["--no-sandbox"] if os.geteuid() == 0 else []
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=arguments)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def proxy():
    proxy = Proxy()
    yield proxy
    proxy.close()


@pytest.fixture(scope="module")
def everybodys(tmp_path_factory, proxy):
    folder = tmp_path_factory.mktemp("studio")
    (folder / "shot.usda").write_text(STAGE)
    served = Served(folder / "shot.usda", f"{proxy.address}{PREFIX}/", layer=folder / "look.usda")
    proxy.port = served.port
    yield served
    served.close()


@pytest.fixture
def served(everybodys):
    """Return the server, without pages, at the first frame, and without edits in the session or on disk."""
    everybodys.wait_until_left()
    session = everybodys.session
    session.show(frame=None)
    session.revert()
    session.edits.save().unlink()
    return everybodys


@pytest.fixture
def visit(browser):
    """Let a test open pages side by side; none may log an error or a warning, about the page's policy for instance."""
    context = browser.new_context(viewport={"width": 1366, "height": 768}, device_scale_factor=SCALE)
    windows = []

    def opened(address, session=None):
        windows.append(Window(context, address, session))
        return windows[-1]

    yield opened
    context.close()
    assert [each.complaints for each in windows] == [[]] * len(windows)


@pytest.fixture
def window(visit, served):
    return visit(address_of(served), served.session)


def address_of(served):
    return f"http://127.0.0.1:{served.port}/?token={TOKEN}"


def value(session, path):
    """Return the current value of a control."""
    return next(each.value for group in session.controls() for each in group.controls if each.path == path)


def rendered(path, picture, passes=PASSES, **given):
    """Return the layers of a render of the size of a picture."""
    height, width = picture.shape[:2]
    return pb.Shot.open(path, **given).render(passes=passes, width=width, height=height).layers


def test_the_page_shows_the_picture_of_a_render(window, served):
    shown = window.picture()
    window.assert_accessible()
    assert window.page.title() == "shot.usda – photonbeams studio"
    path = served.session.edits.path.with_name("shot.usda")
    assert np.array_equal(shown, viewed(rendered(path, shown)["rgba"]))
    assert shown.max() > 200 and shown.min() < 20


def test_dragging_a_knot_changes_the_picture_and_is_one_step(window, served):
    before = window.picture()
    knot = window.control("slider", "look along:ramp", name="Ramp, key 2 of 3, brightness")
    window.drag_by(knot, 80, -50)
    window.wait(lambda: value(served.session, RAMP)["knots"][1] > 0.5)
    after = window.picture()
    assert difference(before, after) > 1
    moved = value(served.session, RAMP)
    assert moved["knots"][::2] == [0, 1] and moved["colors"][1][0] > 1.1
    assert knot.get_attribute("aria-valuetext").endswith(f"at {moved['knots'][1]:.4g}")
    window.page.get_by_role("application").focus()
    window.press("Control+z")
    window.wait(lambda: value(served.session, RAMP)["knots"] == [0, 0.4, 1])
    assert np.array_equal(window.picture(), before)
    window.page.get_by_role("button", name="Redo").click()
    window.wait(lambda: value(served.session, RAMP) == moved)
    assert np.array_equal(window.picture(), after)


def test_a_wrong_expression_is_marked_at_its_column_and_the_picture_stays(window, served):
    before = window.picture()
    field = window.control("textbox", "look along:expression")
    field.fill("0.5 + s * (1 + @ s)")
    window.page.locator("mark", has_text="@").wait_for()
    column = len("0.5 + s * (1 + @")
    message = window.page.get_by_label("Viewport").get_by_role("status")
    message.get_by_text(f"column {column}").wait_for()
    marked = window.page.locator("pre", has=window.page.locator("mark"))
    assert marked.evaluate("each => each.firstChild.textContent") == "0.5 + s * (1 + "
    assert are_alike(window.canvas(), before)
    window.assert_accessible()
    field.fill("0.2 + 3 * s")
    window.wait(lambda: value(served.session, EXPRESSION) == "0.2 + 3 * s")
    assert difference(window.picture(), before) > 1
    assert window.page.locator("mark").count() == 0 and message.inner_text() == ""


def test_what_is_saved_is_there_again_and_opens_in_python(window, served):
    before = window.picture()
    field = window.control("spinbutton", "lamp inputs:intensity")
    field.fill("700")
    field.press("Enter")
    window.page.get_by_text("not saved").wait_for()
    assert window.page.title().startswith("• ")
    window.press("Control+s")
    window.page.get_by_text("not saved").wait_for(state="hidden")
    after, layer = window.picture(), served.session.edits.path
    assert difference(before, after) > 1 and layer.exists()
    window.page.reload()
    assert np.array_equal(window.picture(), after)
    assert window.control("spinbutton", "lamp inputs:intensity").input_value() == "700"
    layers = rendered(layer.with_name("shot.usda"), after, session_layers=[layer])
    assert np.array_equal(after, viewed(layers["rgba"]))


def test_a_file_that_another_program_changed_is_merged_when_the_user_says_so(window, served):
    layer = served.session.edits.path
    field = window.control("spinbutton", "lamp inputs:intensity")
    field.fill("700")
    field.press("Enter")
    window.page.get_by_text("not saved").first.wait_for()
    layer.write_text('#usda 1.0\nover "Nobody" {\n}\n')
    window.press("Control+s")
    window.page.get_by_text(f"another program has changed {layer.name}").wait_for()
    assert "700" not in layer.read_text()
    window.page.get_by_role("button", name="Merge").click()
    window.page.get_by_text("another program has changed").wait_for(state="hidden")
    assert "700" in layer.read_text() and "Nobody" in layer.read_text()


def test_two_pages_see_each_others_edits_and_choose_their_layer_themselves(window, visit, served):
    other = visit(address_of(served), served.session)
    before = window.picture()
    assert np.array_equal(other.picture(), before)
    theirs = other.control("spinbutton", "lamp inputs:intensity")
    field = window.control("spinbutton", "lamp inputs:intensity")
    field.fill("700")
    field.press("Enter")
    window.wait(lambda: theirs.input_value() == "700")
    after = window.picture()
    assert difference(before, after) > 1 and np.array_equal(other.picture(), after)
    other.page.get_by_label("Layer", exact=True).select_option("beams")
    other.wait(lambda: other.header["layer"] == "beams")
    assert difference(other.picture(), after) > 0.1 and np.array_equal(window.picture(), after)
    other.page.get_by_role("button", name="Undo").click()
    window.wait(lambda: field.input_value() == "200")
    assert np.array_equal(window.picture(), before)


def test_one_page_scrubs_while_another_one_watches(window, visit, served):
    other = visit(address_of(served), served.session)
    window.picture(), other.picture()
    theirs = other.control("spinbutton", "lamp inputs:intensity")
    other.sent.clear()
    window.drag_by(window.page.get_by_role("slider", name="Frame"), 3000, 0)
    window.wait(lambda: theirs.input_value() == "800")
    assert not any('"frame"' in each for each in other.sent)
    assert np.array_equal(other.picture(), window.picture())


def test_scrubbing_and_playing_show_other_frames(window, served):
    before = window.picture()
    field = window.control("spinbutton", "lamp inputs:intensity")
    assert field.input_value() == "200"
    window.drag_by(window.page.get_by_role("slider", name="Frame"), 3000, 0)
    window.wait(lambda: served.session.view.frame == 5 and field.input_value() == "800")
    assert window.picture().mean() > 1.2 * before.mean()
    seen = set()
    window.page.get_by_role("button", name="Play").click()
    window.wait(lambda: seen.add(served.session.view.frame) or len(seen) > 2)
    window.page.get_by_role("button", name="Pause", exact=True).click()
    frame = window.page.get_by_role("spinbutton", name="Frame, exact")
    frame.fill("1")
    frame.press("Enter")
    window.wait(lambda: served.session.view.frame == 1)
    assert np.array_equal(window.picture(), before)


def test_only_the_area_is_rendered(window, served):
    window.picture()
    before = window.canvas()
    window.choose("Area")
    window.drag(window.place(0.25, 0.25), window.place(0.75, 0.75))
    window.wait(lambda: served.session.view.area is not None)
    np.testing.assert_allclose(served.session.view.area, [0.25, 0.25, 0.75, 0.75], atol=0.02)
    field = window.control("spinbutton", "lamp inputs:intensity")
    field.fill("700")
    field.press("Enter")
    window.wait(lambda: value(served.session, INTENSITY) == 700 and window.is_newest())
    window.wait(lambda: difference(window.canvas(), before) > 0)
    after = window.canvas()
    window.page.get_by_role("button", name="Clear area").click()
    window.wait(lambda: served.session.view.area is None)
    window.picture()
    whole, (height, width) = window.canvas(), before.shape[:2]
    outside, rows, columns = slice(height // 5), *(slice(int(0.3 * each), int(0.7 * each)) for each in (height, width))
    assert after[outside].max() == 0 or np.array_equal(after[outside], before[outside])
    assert difference(after[rows, columns], whole[rows, columns]) < 3
    assert difference(before[rows, columns], whole[rows, columns]) > 3


def test_side_by_side_both_eyes_are_shown_and_no_pixel_is_inspected(window, served):
    window.picture()
    window.choose("Inspect")
    window.page.get_by_role("button", name="View…").click()
    eyes = window.page.get_by_role("combobox", name="Eyes")
    eyes.select_option(label="Side by side")
    window.wait(lambda: served.session.view.stereo is not None and window.is_newest())
    tools = {name: window.page.get_by_role("radio", name=name) for name in ("Move", "Inspect", "Area")}
    window.wait(lambda: tools["Move"].is_checked())
    assert tools["Inspect"].is_disabled() and tools["Area"].is_disabled()
    between = window.page.get_by_role("spinbutton", name="Distance between the eyes")
    between.fill("0.2")  # the default, 6.5 cm, is too large for the stage
    between.press("Enter")
    height = window.canvas().shape[0]

    def is_half_as_large():
        shown = window.canvas()
        return shown[: height // 5].max() == 0 < shown[height // 4 : 3 * height // 4].max()

    window.wait(is_half_as_large)
    eyes.select_option(label="One eye")
    window.wait(lambda: tools["Inspect"].is_enabled())


def test_the_wipe_shows_a_kept_picture_beside_the_present_one(window, served):
    before = window.picture()
    window.page.get_by_role("button", name="Keep picture").click()
    field = window.control("spinbutton", "lamp inputs:intensity")
    field.fill("900")
    field.press("Enter")
    window.wait(lambda: value(served.session, INTENSITY) == 900 and window.is_newest())
    after = window.received()
    assert difference(after, before) > 1

    def is_wiped(at):
        """Return whether the kept picture is shown on the left of a place, and the present one on the right."""
        shown, line = window.canvas(), int(at * before.shape[1])
        aside = np.abs(np.arange(shown.shape[1]) - at * shown.shape[1]) > 2
        return are_alike(shown, np.concatenate([before[:, :line], after[:, line:]], axis=1), aside)

    window.wait(lambda: is_wiped(0.5))
    line = window.page.get_by_role("slider", name="Wipe line")
    window.drag_by(line, -0.25 * window.page.locator("canvas").bounding_box()["width"], 0)
    window.wait(lambda: is_wiped(0.25))
    window.assert_accessible()
    window.page.get_by_role("button", name="Drop").click()
    assert np.array_equal(window.picture(), after)


def test_a_pixel_tells_its_values_its_beams_and_how_they_are_integrated(window):
    shown = window.picture()
    window.choose("Inspect")
    window.page.mouse.click(*window.place(0.4, 0.5))
    drawing = window.page.get_by_role("img", name="Integrand along the ray")
    drawing.wait_for()
    assert drawing.locator("circle").count() == 2
    window.choose("4")
    window.wait(lambda: drawing.locator("circle").count() == 4)
    cells = window.page.get_by_role("row", name="rgba").get_by_role("cell").all_inner_texts()
    height, width = shown.shape[:2]
    nearby = shown[int(0.5 * height) - 1 : int(0.5 * height) + 2, int(0.4 * width) - 1 : int(0.4 * width) + 2]
    assert np.abs(viewed(np.array([[[float(each) for each in cells]]])).astype(int) - nearby).max(axis=2).min() <= 1
    assert window.page.locator("li", has_text="Lamp").inner_text().split()[-2:] == ["100.0", "%"]
    gauss, riemann = (float(each.split()[-1]) for each in window.page.locator("aside dd").all_inner_texts())
    assert gauss < 0.1 * riemann
    window.assert_accessible()


def test_the_final_picture_is_downloaded_and_is_that_of_the_command(window, served, tmp_path):
    shown = window.picture()
    window.page.get_by_role("button", name="Render this…").click()
    passes = window.page.get_by_role("spinbutton", name="Passes")
    passes.fill("1")
    window.page.get_by_role("checkbox", name="Several frames").wait_for()
    window.assert_accessible()
    width, height = (window.page.get_by_role("spinbutton", name=name) for name in ("Width", "Height"))
    assert [int(each.input_value()) for each in (width, height)] == [*shown.shape[1::-1]]
    estimate = window.page.get_by_role("dialog").get_by_role("status")
    memory = f"{(PROGRAM_BYTES + PIXEL_BYTES * shown[..., 0].size + BEAM_BYTES * 300) / 1e9:.1f} GB"
    estimate.get_by_text(re.compile(rf"^About \d+ s, {re.escape(memory)}$")).wait_for()
    passes.press("Tab")
    several = window.page.get_by_role("checkbox", name="Several frames")
    several.check()
    estimate.get_by_text("Estimating…").wait_for()
    estimate.get_by_text("About").wait_for()
    several.uncheck()
    passes.fill("70000")
    passes.press("Tab")
    passes.fill("1")
    passes.press("Tab")
    estimate.get_by_text("About").wait_for()
    sent = [json.loads(each) for each in window.sent]
    wanted = [(each["passes"], each["frames"]) for each in sent if each["type"] == "estimate"]
    assert wanted[-2:] == [(1, [1, 5]), (1, None)]  # and not what was there for a moment
    window.page.get_by_role("button", name="Render", exact=True).click()
    link = window.page.get_by_role("link", name="Download the picture")
    with window.page.expect_download() as download:
        link.click()
    assert download.value.suggested_filename == "shot.0001.exr"
    download.value.save_as(tmp_path / "final.exr")
    wanted = rendered(served.session.edits.path.with_name("shot.usda"), shown, passes=1)
    layers = read_layers(tmp_path / "final.exr")
    np.testing.assert_allclose(layers["rgba"], wanted["rgba"], rtol=2**-11, atol=2**-25)  # the file has half floats
    assert difference(viewed(layers["rgba"]), shown) < 5 < shown.mean()

    window.page.get_by_role("button", name="Render this…").click()
    width.fill("32")
    width.press("Tab")
    assert int(height.input_value()) == round(32 * shown.shape[0] / shown.shape[1])
    window.page.get_by_role("checkbox", name="Denoise").check()
    window.page.get_by_role("textbox", name="File").fill("out/small.exr")
    window.page.get_by_role("button", name="Render", exact=True).click()
    window.page.get_by_text("Written: small.####.exr").wait_for()
    written = read_layers(served.session.edits.path.with_name("out") / "small.0001.exr")
    assert written["rgba"].shape[1] == 32


def test_the_tab_key_reaches_everything_in_order_and_its_place_is_seen(window):
    window.picture()
    window.page.locator("#group-World-Look").click()
    window.choose("Area")
    window.page.get_by_role("application").focus()
    window.press("Enter")
    window.page.get_by_role("button", name="Clear area").wait_for()
    window.page.get_by_role("button", name="Keep picture").click()
    window.page.get_by_role("button", name="Solo Lamp").click()
    window.page.get_by_role("button", name="Solo: 1 light").wait_for()
    names, reached, blind = window.page.evaluate(TABBABLE), [], []
    for _ in range(len(names) + 1):  # once around, including the body, which has no number
        window.press("Tab")
        number, name, outlined = window.page.evaluate(FOCUSED)
        if number is not None:
            reached.append(number)
            blind += [] if outlined else [name]
    first = reached.index(0)
    assert [names[number] for number in reached[first:] + reached[:first]] == names and len(names) > 80
    assert blind == []


def test_everything_is_done_by_the_keyboard_alone(window, served):
    session = served.session
    window.picture()
    window.tab_to("Search the controls")
    window.page.keyboard.type("look along:ramp")
    window.tab_to("Ramp, key 2 of 3, position")
    window.press(*["ArrowRight"] * 5)
    window.wait(lambda: value(session, RAMP)["knots"][1] == pytest.approx(0.45))
    window.press("Delete")
    window.wait(lambda: len(value(session, RAMP)["knots"]) == 2)
    window.press("Control+z")
    window.wait(lambda: len(value(session, RAMP)["knots"]) == 3)
    window.press("Control+s")
    window.page.get_by_text("not saved").wait_for(state="hidden")
    window.wait(session.edits.path.exists)

    window.tab_to("Picture.")
    window.page.keyboard.down("w")
    window.wait(lambda: session.view.pose is not None and session.view.pose[2, 3] < 3.9)
    window.page.keyboard.up("w")
    window.press("?")
    window.page.get_by_role("dialog", name="Keys").wait_for()
    window.assert_accessible()
    window.press("Escape")
    window.page.get_by_role("dialog").wait_for(state="hidden")
    window.tab_to("Through the camera")
    window.press("Enter")
    window.wait(lambda: session.view.pose is None)

    window.tab_to("Move")
    window.press("ArrowRight", "ArrowRight")
    window.tab_to("Picture.")
    window.press("Enter", "ArrowRight", "Shift+ArrowDown")
    window.wait(lambda: session.view.area == (0.27, 0.25, 0.77, 0.77))
    window.tab_to("Clear area")
    window.press("Enter")
    window.wait(lambda: session.view.area is None)
    window.tab_to("Render this…")
    window.press("Enter")
    window.page.get_by_role("dialog", name="Render this").wait_for()
    window.wait(lambda: window.page.evaluate(FOCUSED)[1] == "Passes")
    window.press("Escape")
    window.wait(lambda: window.page.evaluate(FOCUSED)[1] == "Render this…")


def test_the_toolbar_is_one_row_and_no_word_in_it_is_cut(window, served):
    window.picture()
    bar = window.page.get_by_role("group", name="View", exact=True)
    bar.get_by_role("slider", name="Exposure in stops").focus()
    window.press("ArrowRight")
    bar.get_by_role("button", name="Reset the exposure").wait_for()
    cut = """bar => [bar, ...bar.querySelectorAll('*')]
        .filter((each) => each.scrollWidth > each.clientWidth + 1 && getComputedStyle(each).display !== 'inline'
          && !each.closest('svg, [class*=Slider]') && each.type !== 'radio')
        .map((each) => each.outerHTML.slice(0, 200))"""
    assert bar.evaluate(cut) == [] and bar.bounding_box()["height"] < 40
    right = bar.bounding_box()["x"] + bar.bounding_box()["width"]
    assert window.page.get_by_role("button", name="View…").bounding_box()["x"] + 40 < right
    # Neither a double click on a word nor a drag over the panel selects text; fields can still be selected.
    window.page.get_by_text("Exposure", exact=True).first.dblclick()
    window.drag(window.place(0.5, 0.5), (1200, 600))
    assert window.page.evaluate("getSelection().toString()") == ""
    field = window.page.get_by_role("searchbox")
    field.fill("ramp")
    field.dblclick()
    assert window.page.evaluate("getSelection().toString()") == "ramp"
    served.session.show(pose=None)


def test_controls_say_auto_and_those_without_an_effect_are_hidden(window, served):
    window.picture()
    panel = window.page.get_by_role("tabpanel")
    count = panel.get_by_role("spinbutton", name="Bounces, exact")
    assert count.input_value() == "" and count.get_attribute("placeholder") == "auto"
    count.fill("2")
    count.press("Enter")
    window.wait(lambda: value(served.session, "/World/Lamp.photonbeams:bounces") == 2)
    count.fill("auto")
    count.press("Enter")
    window.wait(lambda: value(served.session, "/World/Lamp.photonbeams:bounces") is None)
    kelvin = panel.get_by_role("spinbutton", name="Color temperature in K, exact")
    assert kelvin.count() == 0
    panel.get_by_role("switch", name="Enable color temperature").focus()
    window.press("Space")
    kelvin.wait_for()
    panel.get_by_role("switch", name="Enabled", exact=True).focus()
    window.press("Space")
    panel.get_by_role("spinbutton", name="Count, exact").wait_for(state="hidden")
    assert window.control("spinbutton", "lamp photonbeams:count").count() == 1  # a search finds it nevertheless


def test_lights_and_looks_lead_to_each_other_and_files_groups_and_objects_are_chosen(window, served):
    window.picture()
    folder = served.session.edits.path.parent
    Image.new("RGB", (2, 2)).save(folder / "window.png")
    served.session.edit({"/World/Lamp.photonbeams:lightGroup": "key"})
    window.page.reload()
    window.picture()
    panel = window.page.get_by_role("tabpanel")
    panel.get_by_role("button", name="Look", exact=True).click()
    heading = window.page.locator("#group-World-Look")
    window.wait(lambda: heading.evaluate("each => each === document.activeElement"))
    panel.get_by_text("Used by:").locator("..").get_by_role("button", name="Lamp").click()
    window.wait(lambda: window.page.locator("#group-World-Lamp").evaluate("each => each === document.activeElement"))
    for name, chosen, path, wanted in [
        ("Gobo", "window.png", "/World/Lamp.photonbeams:gobo", str((folder / "window.png").resolve())),
        ("Light group", "key", "/World/Lamp.photonbeams:lightGroup", "key"),
        ("Portal", "Ball", "/World/Lamp.photonbeams:portal", ["/World/Ball"]),
    ]:
        panel.get_by_role("textbox", name=name, exact=True).or_(
            panel.get_by_role("combobox", name=name, exact=True)
        ).first.click()
        window.page.get_by_role("option", name=chosen, exact=True).click()
        window.wait(lambda path=path, wanted=wanted: value(served.session, path) == wanted)
        window.press("Escape")


def test_the_page_works_through_a_proxy_at_another_port_with_a_path_of_its_own(visit, served, proxy):
    for root in (f"{proxy.address}{PREFIX}/", f"{proxy.address}/"):  # as nginx has it, and as `ssh -L` does
        window = visit(f"{root}?token={TOKEN}", served.session)
        assert window.picture().max() > 200
        window.page.get_by_role("button", name="New look of Lamp").click()
        thumbnail = window.page.get_by_role("dialog", name="New look of Lamp").locator("img").first
        window.wait(lambda thumbnail=thumbnail: thumbnail.evaluate("each => each.naturalWidth") > 0)
        window.page.close()
    origin = {"origin": proxy.address}
    for path in ("/", f"{PREFIX}/"):  # a proxy may leave its path in the request
        assert asked(served, f"{path}?token={TOKEN}", **origin)[0] == 200
        assert asked(served, f"{path}?token={TOKEN}", origin="http://127.0.0.1:1")[0] == 403
        assert asked(served, path, **origin)[0] == 403


def test_a_flipbook_collects_frames_and_plays_two_layers_beside_each_other(window, served):
    window.picture()
    window.page.get_by_label("Compare with").select_option("A: surface")
    window.page.get_by_role("slider", name="Wipe line").wait_for()
    window.wait(lambda: window.header.get("layer") == "rgba" and '"other":"surface"' in "".join(window.sent))
    left, right = np.s_[:, 5:40], np.s_[:, -40:-5]
    window.wait(lambda: 2 * window.canvas()[left].mean() < window.received()[left].mean())  # surfaces without beams
    assert difference(window.canvas()[right], window.received()[right]) < 4
    book = window.page.get_by_role("button", name="Flipbook")
    book.click()
    window.wait(lambda: book.inner_text() == "Flipbook 5/5")
    window.assert_accessible()
    version = served.session.version
    seen, halves = set(), []
    window.page.get_by_role("button", name="Play").click()
    frame = window.page.get_by_role("slider", name="Frame")

    def has_played():
        seen.add(int(frame.get_attribute("aria-valuenow")))
        halves.append((window.canvas()[left].mean(), window.canvas()[right].mean()))
        return len(seen) == 5

    window.wait(has_played)
    assert served.session.version == version  # nothing is rendered for it
    assert max(one for one, _ in halves) < min(each for _, each in halves)
    window.page.get_by_role("button", name="Pause", exact=True).click()
    field = window.control("spinbutton", "lamp inputs:radius")
    field.fill("0.06")
    field.press("Enter")
    window.wait(lambda: book.inner_text() in ("Flipbook 0/5", "Flipbook 1/5"))  # edits make it out of date
    book.click()
    window.page.get_by_label("Compare with").select_option("")
    served.session.show(frame=1)


def test_a_look_that_is_kept_is_among_the_presets_of_another_shot(window, visit, served, tmp_path):
    window.picture()
    panel = window.page.get_by_role("tabpanel")
    panel.get_by_role("button", name="Look", exact=True).click()
    panel.get_by_role("button", name="Keep look").click()
    panel.get_by_text("kept as Look").wait_for()
    library = served.session.edits.path.with_name("looks")
    (tmp_path / "other.usda").write_text(STAGE.replace("rel photonbeams:look = </World/Look>", ""))
    other = Served(tmp_path / "other.usda", layer=tmp_path / "look.usda", looks=library)
    try:
        page = visit(address_of(other), other.session).page
        page.get_by_role("button", name="New look of Lamp").click()
        page.get_by_role("dialog").get_by_role("button", name="Look", exact=True).click()
        window.wait(lambda: len(value(other.session, "/World/Lamp.photonbeams:look")) == 1)
        (look,) = value(other.session, "/World/Lamp.photonbeams:look")
        assert value(other.session, f"{look}.photonbeams:along:expression") == value(served.session, EXPRESSION)
        assert value(other.session, f"{look}.photonbeams:along:ramp") == value(served.session, RAMP)
        page.close()
    finally:
        other.close()


@contextmanager
def studio(*arguments):
    """Run the command; yield the process and the address that it prints."""
    words = [sys.executable, "-m", "photonbeams", "studio", *map(str, arguments), "--no-browser"]
    environment = os.environ | {"PHOTONBEAMS_STUDIO_TOKEN": TOKEN}
    process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True, env=environment)
    try:
        yield process, process.stdout.readline().strip()
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def test_a_page_outlives_a_studio_that_is_killed_and_started_again(visit, tmp_path):
    stage = ROOT / "examples" / "keyhole" / "keyhole.usda"
    words = [stage, "--layer", tmp_path / "look.usda", "--passes", PASSES]
    with studio(*words) as (process, address):
        window = visit(address)
        before = window.picture()
        process.kill()
        notice = window.page.get_by_role("alert")
        notice.get_by_text("The connection to the studio is lost").wait_for()
        assert are_alike(window.canvas(), before) and before.max() > 100  # the notice leaves it less room
        window.assert_accessible()
    with studio(*words, "--port", re.search(r":(\d+)/", address)[1]) as (_, again):
        assert again == address
        notice.wait_for(state="detached")
        after = window.picture()
        assert np.array_equal(after, before)
    window.complaints[:] = [each for each in window.complaints if not each.startswith("WebSocket connection to")]


def test_bounces_are_switched_on_and_off(window, served):
    window.picture()
    window.page.get_by_role("button", name="View…").click()
    switch = window.page.get_by_role("switch", name="Bounces")
    assert not switch.is_checked()  # the ball and its fog are no room
    for bounces in (3, 0):
        switch.focus()
        window.press("Space")
        window.wait(lambda wanted=bounces: served.session.view.bounces == wanted)
        window.picture()
        assert switch.is_checked() == (bounces > 0)
