"""Take the pictures of docs/studio.md: the keyhole in the studio, as Chromium shows it. `make pictures` calls it.

A picture is taken when the studio's own has enough passes. The film shows the first whole picture of each step for a
tenth of a second, however long it took.
"""

from __future__ import annotations

import io
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Any

import numpy as np
from pages import DOCS, ROOT
from PIL import Image, ImageDraw
from playwright.sync_api import Locator, Page, sync_playwright
from renders import keep

PICTURES = DOCS / "pictures"
STAGE = ROOT / "examples" / "keyhole" / "keyhole.usda"
WIDTH, HEIGHT, PASSES, ENOUGH = 1366, 768, 64, 12
MOST_OF_FILM = 2_000_000  # bytes
FILM_WIDTH, STEP = 854, 100  # pixels, milliseconds
LIMIT = 300.0  # seconds, of each thing that is waited for


class Screen:
    """The studio's page: what it receives, and what can be done there and seen."""

    def __init__(self, page: Page, address: str) -> None:
        self.page, self._header, self._cursor = page, {"version": -1, "width": 0}, (900.0, 420.0)
        page.set_default_timeout(1000 * LIMIT)
        page.on("websocket", lambda socket: socket.on("framereceived", self._take))
        page.goto(address)
        page.mouse.move(*self._cursor)
        room = page.get_by_role("application").evaluate("each => each.clientWidth")
        self._wait(lambda: self._header["width"] == room and self._is_finished())

    def _take(self, data: str | bytes) -> None:
        if isinstance(data, bytes):
            self._header = json.loads(data[4 : 4 + int.from_bytes(data[:4], "little")])

    def _wait(self, wanted: Callable[[], bool]) -> None:
        end = monotonic() + LIMIT
        while not wanted():
            if monotonic() > end:
                raise TimeoutError(f"the studio sends no other picture than {self._header}")
            self.page.wait_for_timeout(10)

    def _is_finished(self) -> bool:
        return self._header["scale"] == 1 and self._header["passes"] >= ENOUGH

    @contextmanager
    def following(self, finished: bool = True) -> Iterator[None]:
        """Do something, and wait for its picture: the finished one, or the first whole one."""
        before = self._header["version"]
        yield
        self._wait(lambda: self._header["version"] > before and self._header["scale"] == 1)
        if finished:
            self._wait(self._is_finished)
        self.page.wait_for_timeout(150)  # until it is drawn

    def settle(self) -> None:
        """Wait for the finished picture of what was done last."""
        self._wait(self._is_finished)
        self.page.wait_for_timeout(150)

    def tool(self, name: str) -> None:
        """Choose one of a row of buttons."""
        self.page.get_by_role("radio", name=name, exact=True).locator("..").click()

    def open(self, prim: str) -> None:
        """Open or close what belongs to a prim."""
        self.page.locator(f"#group{prim.replace('/', '-')}").click()

    def scroll_to(self, control: Locator) -> None:
        """Bring a control to the top of its list, below the name of its prim."""
        control.evaluate("each => { each.style.scrollMarginTop = '34px'; each.scrollIntoView(); }")

    def point(self, x: float, y: float) -> None:
        """Move the pointer."""
        self.page.mouse.move(x, y)
        self._cursor = x, y

    def place(self, x: float, y: float) -> tuple[float, float]:
        """Return where a place of the picture, in fractions, is on the page."""
        return _within(self.page.locator("canvas"), x, y)

    def shoot(self, name: str) -> None:
        """Write what is seen as a picture."""
        self.page.wait_for_timeout(400)  # what fades in, or is drawn anew, is there then
        keep(self._seen(), f"studio{name}")

    def _seen(self) -> Image.Image:
        return Image.open(io.BytesIO(self.page.screenshot())).convert("RGB")

    def frame(self) -> Image.Image:
        """Return what is seen, with the pointer, as a frame of the film."""
        image = self._seen()
        x, y = self._cursor
        arrow = [(x + dx, y + dy) for dx, dy in ((0, 0), (0, 21), (5, 16), (9, 25), (13, 23), (9, 15), (16, 15))]
        ImageDraw.Draw(image).polygon(arrow, fill="white", outline="black", width=2)
        return image.resize((FILM_WIDTH, FILM_WIDTH * HEIGHT // WIDTH), Image.Resampling.LANCZOS)


def _within(element: Locator, x: float = 0.5, y: float = 0.5) -> tuple[float, float]:
    """Return a place of an element, in fractions, on the page."""
    box: Any = element.bounding_box()
    return box["x"] + x * box["width"], box["y"] + y * box["height"]


@contextmanager
def studio() -> Iterator[str]:
    """Run the studio, and yield its address."""
    with tempfile.TemporaryDirectory() as folder:
        words = [sys.executable, "-m", "photonbeams", "studio", str(STAGE), "--layer", f"{folder}/look.usda"]
        words += ["--passes", str(PASSES), "--no-browser", "--quiet"]
        process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
        try:
            yield process.stdout.readline().strip()  # type: ignore[union-attr]
        finally:
            process.terminate()
            process.wait()


def pictures(screen: Screen) -> None:
    """Write the pictures of the page."""
    page = screen.page
    screen.shoot("")
    page.get_by_label("Compare with").select_option("A: beams")
    page.get_by_role("slider", name="Wipe line").wait_for()
    page.get_by_role("button", name="View…").click()
    screen.shoot("-layers")
    page.keyboard.press("Escape")
    page.get_by_label("Compare with").select_option("")
    screen.open("/World/Light/Key")
    screen.open("/World/Looks/Keyhole")
    expression = page.get_by_role("textbox", name="Expression").first
    expression.fill("0.6 + 0.4 * sin(20 * s")
    page.locator("mark").wait_for()
    screen.scroll_to(page.get_by_role("group", name="Ramp").first)
    screen.shoot("-expression")
    with screen.following():
        page.get_by_role("button", name="Keep picture").click()
        expression.fill("[0.4, 0.7, 2] * (0.4 + pulse(9 * s, 0.5))")
    line = page.get_by_role("slider", name="Wipe line").bounding_box()
    page.mouse.move(line["x"] + 1, line["y"] + 400)
    page.mouse.down()
    page.mouse.move(line["x"] - 130, line["y"] + 400, steps=4)
    page.mouse.up()
    screen.shoot("-wipe")
    page.get_by_role("button", name="Drop").click()
    with screen.following():
        expression.fill("")
    screen.tool("Inspect")
    page.mouse.click(*screen.place(0.4, 0.55))
    screen.tool("3")
    page.get_by_role("img", name="Errors").scroll_into_view_if_needed()
    screen.shoot("-pixel")
    page.get_by_role("tab", name="Controls").click()
    screen.tool("Move")


def film(screen: Screen) -> list[tuple[Image.Image, int]]:
    """Return the frames of the film, each with its milliseconds: somebody drags a knot, then flies into the beams."""
    page, frames = screen.page, []

    def take(milliseconds: int = STEP) -> None:
        frames.append((screen.frame(), milliseconds))

    page.get_by_role("button", name="View…").click()
    page.get_by_role("spinbutton", name="Speed of flight").fill("0.4")
    page.keyboard.press("Escape")
    screen.tool("B")
    knot = page.get_by_role("slider", name="Ramp, key 3 of 5, blue")
    screen.scroll_to(page.get_by_role("group", name="Ramp").first)
    take(600)
    begin, end, old = _within(knot), _within(knot), screen.place(0.9, 0.4)
    end = begin[0] - 12, begin[1] - 70
    for part in np.linspace(0, 1, 8):
        screen.point(*(a + part * (b - a) for a, b in zip(old, begin, strict=True)))
        take(60)
    page.mouse.down()
    for part in np.linspace(0, 1, 25)[1:]:
        with screen.following(finished=False):
            screen.point(*(a + part * (b - a) for a, b in zip(begin, end, strict=True)))
        take()
    page.mouse.up()
    screen.settle()
    take(700)
    page.get_by_role("application").focus()
    screen.point(*screen.place(0.8, 0.85))
    for keys in [("w",)] * 24 + [("w", "ArrowLeft")] * 9:
        with screen.following(finished=False):
            for key in keys:
                page.keyboard.down(key)
            page.wait_for_timeout(60)
            for key in keys:
                page.keyboard.up(key)
        take()
    screen.settle()
    take(1500)
    return frames


def write_film(frames: list[tuple[Image.Image, int]]) -> None:
    """Write the film, as good as it may be."""
    images, durations = [image for image, _ in frames], [each for _, each in frames]
    path = PICTURES / "studio-film.webp"
    for quality in (80, 70, 60, 50, 40, 30):
        options = {"quality": quality, "method": 4, "minimize_size": True, "loop": 0}
        images[0].save(path, save_all=True, append_images=images[1:], duration=durations, **options)
        if path.stat().st_size <= MOST_OF_FILM:
            return


def main() -> None:
    """Write all pictures of the studio, and the film."""
    names = ("chromium", "chromium-browser", "google-chrome")
    chromium = next(found for name in names if (found := shutil.which(name)))
    with studio() as address, sync_playwright() as playwright:
        # Chromium's own sandbox refuses to work for root.
        arguments = ["--no-sandbox"] if os.geteuid() == 0 else []
        browser = playwright.chromium.launch(executable_path=chromium, args=arguments)
        screen = Screen(browser.new_page(viewport={"width": WIDTH, "height": HEIGHT}), address)
        pictures(screen)
        write_film(film(screen))
        browser.close()


if __name__ == "__main__":
    main()
