"""Drives the built page in Chromium, against the mock, through what a user does.

It needs playwright, what mock.py needs, and axe-core, installed by npm somewhere:
`python page/mock/check.py --chromium /usr/bin/chromium --axe …/axe-core/axe.min.js --shots FOLDER`
"""
# ruff: noqa: D103

from __future__ import annotations

import argparse
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

from playwright.sync_api import Locator, Page, sync_playwright

PORT = 8792
ADDRESS = f"http://127.0.0.1:{PORT}/?token=check"
#: What has the focus, and whether it has an outline. Radio buttons and switches are drawn by other elements.
FOCUS = """() => {
  const focused = document.activeElement;
  const outlined = [focused, focused.parentElement, focused.nextElementSibling].some((each) => {
    const style = each && getComputedStyle(each);
    return style && style.outlineStyle !== 'none' && parseFloat(style.outlineWidth) > 0;
  });
  const name = (focused.getAttribute('aria-label') ?? focused.textContent).trim();
  return [name, outlined || focused.matches('input[type=radio], input[type=checkbox]')];
}"""
failures = 0


def check(fact: bool, what: str) -> None:
    global failures
    failures += not fact
    print("ok  " if fact else "FAIL", what, flush=True)


def serve(*more: str) -> subprocess.Popen:
    server = subprocess.Popen([sys.executable, str(Path(__file__).with_name("mock.py")), str(PORT), *more])
    for _ in range(100):
        try:
            urllib.request.urlopen(ADDRESS).close()
            break
        except OSError:
            time.sleep(0.1)
    return server


def record(page: Page, sent: list[str]) -> None:
    """Collect what the page sends."""
    page.on("websocket", lambda socket: socket.on("framesent", lambda data: sent.append(str(data))))


def drag(page: Page, handle: Locator, dx: float, dy: float, steps: int = 30) -> None:
    box = handle.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + dx, y + dy, steps=steps)
    page.mouse.up()


def value_of(slider: Locator) -> str:
    return slider.get_attribute("aria-valuetext") or ""


def axe(page: Page, source: str | None, where: str) -> None:
    if not source:
        return
    page.evaluate(Path(source).read_text())
    found = page.evaluate("axe.run().then(r => r.violations.map(v => [v.impact, v.id, v.nodes.map(n => n.html)]))")
    for impact, rule, nodes in found:
        print("    ", impact, rule, len(nodes), nodes[0][:160])
    check(not [v for v in found if v[0] in ("serious", "critical")], f"axe finds nothing serious: {where}")


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--chromium")
    parser.add_argument("--axe")
    parser.add_argument("--shots", default="/tmp")
    options = parser.parse_args()
    server = serve("--restored")
    try:
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=options.chromium, args=["--no-sandbox"])
            context = browser.new_context(viewport={"width": 1366, "height": 768}, bypass_csp=False)
            page, other = context.new_page(), context.new_page()
            sent: list[str] = []
            complaints: list[str] = []
            record(page, sent)
            for each in (page, other):
                each.on("console", lambda m: complaints.append(m.text) if m.type in ("error", "warning") else None)
                each.on("pageerror", lambda e: complaints.append(str(e)))

            def shot(name: str) -> None:
                page.screenshot(path=f"{options.shots}/{name}.png")

            page.goto(ADDRESS)
            other.goto(ADDRESS)
            page.get_by_text("of 16 passes").wait_for()
            check('"size"' in "".join(sent), "the page says what it shows")
            other.locator("#group-World-Looks-Shaft").click()

            # Edits of an earlier studio
            page.get_by_text("They are here again").wait_for()
            axe(page, options.axe, "with restored edits")
            sent.clear()
            page.get_by_role("button", name="Back to what was saved").click()
            page.get_by_text("They are here again").wait_for(state="detached")
            check('"discard"' in "".join(sent), "restored edits are given up")

            # A ramp's knot
            page.bring_to_front()
            page.locator("#group-World-Light-Key").click()
            page.locator("#group-World-Looks-Shaft").click()
            sent.clear()
            knot = page.get_by_role("slider", name="Ramp, key 2 of 3, brightness")
            begun = time.monotonic()
            drag(page, knot, 40, -60)
            taken = time.monotonic() - begun
            page.wait_for_timeout(500)
            sets = [each for each in sent if '"set"' in each]
            check(0 < len(sets) <= 31 * taken + 2, f"a drag sends {len(sets)} edits in {taken:.1f} s")
            check(len({each.split('"step":')[1] for each in sets}) == 1, "a drag is one step")
            moved = value_of(knot)
            check("at 0.5" in moved, f"the knot was moved: {moved}")
            there = value_of(other.get_by_role("slider", name="Ramp, key 2 of 3, brightness"))
            check(there == moved, f"the other page shows the same: {there}")
            shot("ramp")
            page.keyboard.press("Control+z")
            page.wait_for_timeout(400)
            check("at 0.4" in value_of(knot), f"undone in one step: {value_of(knot)}")
            page.keyboard.press("Control+Shift+Z")
            page.wait_for_timeout(400)
            check(value_of(knot) == moved, "and redone")

            # Keys of the ramp by the keyboard
            key = page.get_by_role("slider", name="Ramp, key 2 of 3, position")
            key.focus()
            before = key.get_attribute("aria-valuenow")
            page.keyboard.press("ArrowRight")
            check(key.get_attribute("aria-valuenow") != before, "arrow keys move a key")
            page.keyboard.press("Delete")
            page.wait_for_timeout(200)
            check(page.get_by_text("of 2 at").count() == 1, "Del deletes a key")
            focused = page.evaluate("document.activeElement.getAttribute('aria-label') ?? ''")
            check("key 1 of 2" in focused, "the focus stays")
            bar = page.get_by_title("Click to add a key", exact=True).bounding_box()
            page.mouse.click(bar["x"] + 100, bar["y"] + 8)
            page.wait_for_timeout(200)
            check(page.get_by_text("of 3 at").count() == 1, "a click adds a key")

            # A wrong expression
            field = page.get_by_role("textbox", name="Expression")
            field.focus()
            page.keyboard.press("End")
            page.keyboard.type(" * (0.5 + @")
            page.locator("mark").wait_for()
            page.wait_for_timeout(500)
            shot("expression")
            check(page.locator("mark").inner_text() == "@", "the mistake is marked")
            check(page.locator("canvas").is_visible(), "the picture stays")
            axe(page, options.axe, "with a problem")
            page.keyboard.press("Control+z")
            page.wait_for_timeout(600)
            check(field.input_value() == "smoothstep(0, 1, s)", "typing is undone: " + field.input_value())
            check(page.locator("mark").count() == 0, "and the problem is gone")

            # A colour
            page.get_by_role("searchbox").fill("key color")
            page.get_by_role("button", name="Color: ").click()
            page.wait_for_timeout(400)
            intensity = page.get_by_role("spinbutton", name="Intensity, exact")
            intensity.fill("4")
            intensity.press("Enter")
            page.wait_for_timeout(300)
            shot("color")
            axe(page, options.axe, "with the colour picker")
            page.keyboard.press("Escape")
            check(page.get_by_text("× 4").count() > 0, "colours exceed 1")
            page.get_by_role("button", name="Reset Color to its default").click()
            page.wait_for_timeout(400)
            check(page.get_by_text("× 4").count() == 0, "and go back to the default")
            page.get_by_role("button", name="Clear the search").click()

            # Presets: of a factor, one after the other; and a new look of a light
            page.bring_to_front()
            sent.clear()
            page.get_by_role("button", name="Presets of Shaft, along").click()
            ice = page.get_by_role("dialog").get_by_role("button", name="Ice")
            ice.wait_for()
            page.wait_for_timeout(1500)
            loaded = page.evaluate("[...document.querySelectorAll('[role=dialog] img')].map(i => i.naturalWidth)")
            check(loaded == [144, 144], f"presets have thumbnails: {loaded}")
            shot("presets")
            axe(page, options.axe, "with presets")
            ice.click()
            page.get_by_role("dialog").get_by_role("button", name="Ember").click()
            page.wait_for_timeout(300)
            applied = [each for each in sent if '"apply"' in each]
            check(len(applied) == 2 and '"along-ember"' in applied[1], f"a click applies a preset: {applied}")
            check("at 0.5" in value_of(page.get_by_role("slider", name="Ramp, key 2 of 3, brightness")), "at once")
            page.keyboard.press("Escape")
            page.locator("#group-World-Light-Key").click()
            page.get_by_role("button", name="New look of Key").click()
            page.get_by_role("dialog").get_by_role("button", name="Ice").click()
            page.wait_for_timeout(500)
            check('"path":"/World/Light/Key"' in sent[-1], "a light gets a new look")
            focused = page.evaluate("document.activeElement.id")
            check(focused == "group-World-Looks-Shaft", f"which has the focus: {focused}")
            page.locator("#group-World-Light-Key").click()
            for _ in range(3):
                page.keyboard.press("Control+z")
            page.wait_for_timeout(500)

            # Two eyes, and noise
            sent.clear()
            page.get_by_label("Eyes", exact=True).select_option("anaglyph")
            page.get_by_role("button", name="Distances").click()
            distance = page.get_by_role("spinbutton", name="Distance between the eyes")
            distance.fill("0.1")
            distance.press("Enter")
            page.wait_for_timeout(200)
            check('"stereo":[null,null]' in sent[0] and '"eye":"anaglyph"' in sent[0], f"two eyes: {sent[0]}")
            check('"stereo":[0.1,null]' in sent[-1], f"and their distance: {sent[-1]}")
            shot("stereo")
            axe(page, options.axe, "with two eyes")
            page.keyboard.press("Escape")
            page.get_by_label("Eyes", exact=True).select_option("one")
            page.get_by_label("Denoise").locator("..").click()
            page.wait_for_timeout(200)
            check('"stereo":null' in "".join(sent) and '"denoise":false' in sent[-1], "one eye again, and noise")
            page.get_by_label("Denoise").locator("..").click()

            # Orbit, fly, back through the camera
            picture = page.get_by_role("application")
            sent.clear()
            begun = time.monotonic()
            drag(page, picture, 150, 40, 60)
            taken = time.monotonic() - begun
            page.wait_for_timeout(200)
            shows = [each for each in sent if '"pose"' in each]
            check(0 < len(shows) <= 31 * taken + 2, f"orbiting sends {len(shows)} poses in {taken:.1f} s")
            for what, key in (("fly", "w"), ("turn", "ArrowLeft")):
                sent.clear()
                page.keyboard.down(key)
                page.wait_for_timeout(400)
                page.keyboard.up(key)
                page.wait_for_timeout(200)
                check(len([each for each in sent if '"pose"' in each]) > 3, f"keys {what}")
            sent.clear()
            page.mouse.wheel(0, 300)
            page.wait_for_timeout(200)
            check('"pose"' in "".join(sent), "the wheel dollies")
            sent.clear()
            page.mouse.down(button="middle")
            page.mouse.move(600, 300, steps=5)
            page.mouse.up(button="middle")
            page.wait_for_timeout(200)
            check('"pose"' in "".join(sent), "the middle button pans")
            page.get_by_role("button", name="Through the camera").click()
            page.wait_for_timeout(100)
            check('"pose":null' in sent[-1], "back through the camera")

            # Solo, exposure, area, wipe, pixel
            page.get_by_role("button", name="Solo Key").click()
            page.wait_for_timeout(300)
            check('"solo":["/World/Light/Key"]' in sent[-1], "solo")
            page.get_by_role("button", name="Keep picture").click()
            page.get_by_role("button", name="Solo: 1 light").click()
            line = page.get_by_role("slider", name="Wipe line")
            drag(page, line, -120, 0)
            line.focus()
            page.keyboard.press("ArrowRight")
            page.get_by_role("radio", name="Area").locator("..").click()
            drag(page, picture, 200, 120)
            page.wait_for_timeout(200)
            check('"area":[0.' in sent[-1], f"a rectangle is drawn: {sent[-1]}")
            page.wait_for_timeout(1500)
            shot("wipe")
            axe(page, options.axe, "with wipe and rectangle")
            page.get_by_role("button", name="Clear area").click()
            picture.focus()
            for key in ("Enter", "ArrowRight", "Shift+ArrowDown"):
                page.keyboard.press(key)
            page.wait_for_timeout(200)
            check('"area":[0.27,0.25,0.77,0.77]' in sent[-1], "a rectangle by the keyboard")
            page.get_by_role("button", name="Clear area").click()
            page.get_by_role("radio", name="Inspect").locator("..").click()
            picture.click(position={"x": 300, "y": 250})
            page.get_by_text("The quadrature at work").wait_for()
            page.get_by_role("radio", name="4").locator("..").click()
            page.wait_for_timeout(300)
            shot("pixel")
            axe(page, options.axe, "with a pixel")
            page.get_by_role("tab", name="Controls").click()
            page.get_by_role("radio", name="Move").locator("..").click()

            # Time
            sent.clear()
            drag(page, page.get_by_role("slider", name="Frame"), 300, 0)
            page.wait_for_timeout(200)
            check('"frame":10' in sent[-1], f"scrubbed: {sent[-1]}")
            sent.clear()
            page.get_by_role("button", name="Play").click()
            page.wait_for_timeout(1500)
            page.get_by_role("button", name="Pause", exact=True).click()
            played = [each for each in sent if '"frame"' in each]
            check(2 < len(played) <= 40, f"played {len(played)} frames in 1.5 s")

            # Save, revert, render
            page.keyboard.press("Control+s")
            page.wait_for_timeout(300)
            check(page.get_by_text("not saved").count() == 0, "saved")
            page.get_by_role("button", name="Revert").click()
            page.get_by_role("dialog").get_by_role("button", name="Revert").click()
            page.wait_for_timeout(500)
            check(page.get_by_text("not saved").count() == 1, "reverted")
            page.get_by_role("button", name="Render this…").click()
            page.get_by_role("checkbox", name="Several frames").check()
            page.wait_for_timeout(300)
            shot("render")
            axe(page, options.axe, "the render dialog")
            page.get_by_role("button", name="Render", exact=True).click()
            page.get_by_role("button", name="Cancel").click()
            page.get_by_role("button", name="Render this…").click()
            passes = page.get_by_role("spinbutton", name="Passes")
            passes.fill("4")
            passes.press("Enter")
            page.get_by_role("link", name="Download the picture").wait_for()
            check(True, "rendered, with a link")

            # Keyboard help
            page.get_by_role("application").focus()
            page.keyboard.press("?")
            page.get_by_role("dialog").wait_for()
            page.wait_for_timeout(300)
            shot("help")
            axe(page, options.axe, "the keyboard help")
            page.keyboard.press("Escape")

            # By the keyboard alone: everything has a place in the order of the tab key, and shows its focus
            page.wait_for_timeout(300)
            page.evaluate("document.activeElement.blur()")
            reached, blind = [], []
            for _ in range(80):
                page.keyboard.press("Tab")
                name, seen = page.evaluate(FOCUS)
                if "photonbeams studio" in name:  # the end: the whole page
                    continue
                reached.append(name)
                if not seen:
                    blind.append(name)
            names = " | ".join(reached)
            wanted = ["Save", "Motion", "Layer", "Exposure in stops", "Keep picture", "Picture.", "Frame", "Search the"]
            missing = [each for each in wanted if each not in names]
            check(not missing, f"the tab key reaches everything, but {missing}")
            check(not blind, f"and the focus is seen, but on {blind}")

            # The server is gone, and comes back
            server.terminate()
            server.wait()
            page.get_by_role("alert").wait_for()
            page.wait_for_timeout(300)
            shot("lost")
            axe(page, options.axe, "without a connection")
            sent.clear()
            server = serve()
            page.get_by_role("alert").wait_for(state="detached", timeout=15000)
            page.wait_for_timeout(500)
            said = "".join(sent)
            check('"layer"' in said and '"frame":10' in said, "the page comes back and says what it shows")

            own = [c for c in complaints if "WebSocket" not in c and "ERR_CONNECTION" not in c]
            check(not own, f"no complaints in the console: {own}")
            browser.close()
    finally:
        server.terminate()
    print("failures:", failures)
    return int(failures > 0)


if __name__ == "__main__":
    sys.exit(main())
