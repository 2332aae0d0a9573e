"""The documentation's site is built without a warning, and its links lead somewhere."""

import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

import photonbeams as pb
from photonbeams import looks

DOCS = Path(__file__).parents[2] / "docs"


class Page(HTMLParser):
    """The links, the pictures and the anchors of a page."""

    def __init__(self, path):
        super().__init__()
        self.links, self.anchors = set(), set()
        self.feed(path.read_text())

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self.anchors |= {given[name] for name in ("id", "name") if given.get(name)}
        self.links |= {given[name] for name in ("href", "src") if given.get(name)}


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", "-d", folder / "trees"]
    done = subprocess.run([*command, DOCS, folder / "html"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    return folder / "html"


def test_every_link_of_the_site_leads_somewhere(site):
    pages = {path: Page(path) for path in site.rglob("*.html")}
    assert len(pages) > 60
    astray = set()
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            lost = not target.exists()
            anchor = unquote(parts.fragment)
            if lost or (anchor and target in pages and anchor not in pages[target].anchors):
                astray.add(f"{path.relative_to(site)}: {link}")
    assert astray == set()


def test_the_reference_has_every_public_name(site):
    shown = {path.stem.removeprefix("photonbeams.") for path in (site / "reference" / "generated").glob("*.html")}
    not_objects = {"__version__", "looks", "scene"}
    assert {*pb.__all__} - not_objects <= shown
    factors = {name for name in looks.__all__ if isinstance(getattr(looks, name), type) and name != "Look"}
    assert {f"looks.{name}" for name in factors} <= shown


def test_no_picture_of_the_gallery_is_missing(site):
    page = Page(site / "gallery.html")
    pictures = {link for link in page.links if link.endswith((".png", ".webp"))}
    assert len(pictures) >= 18
    assert all((site / link).exists() for link in pictures)
