"""What a page of markdown offers to a reader's hands: commands, code, files to save, links.

The renders of docs/ and the tests of its pages take them from the text itself, so that neither can drift from it.
"""

from __future__ import annotations

import re
import shlex
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1]
ROOT = DOCS.parent


def blocks(text: str, language: str) -> list[str]:
    """Return the fenced blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)


def commands(text: str) -> list[list[str]]:
    """Return the commands of the `sh` blocks as words, without comments, continued lines joined."""
    lines = "".join(blocks(text, "sh")).replace("\\\n", " ").splitlines()
    # Not shlex's own comments: they begin at any #, also at that of a frame number.
    return [words for line in lines if (words := shlex.split(re.sub(r"(^|\s)#.*", "", line)))]


def saved_files(text: str) -> dict[str, str]:
    """Return the blocks that the reader is told to save, by name: "Save this as `NAME`:", then the block."""
    told = r"^Save this as `([^`]+)`[^\n]*:\n\n```\w+\n(.*?)^```$"
    return dict(re.findall(told, text, re.DOTALL | re.MULTILINE))


def links(text: str) -> list[tuple[str, str]]:
    """Return what links and pictures point to in this repository: file ("" is the page itself) and heading."""
    found = re.findall(r"\]\(([^)\s]+)\)", re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE))
    local = [target.partition("#") for target in found if not re.match(r"\w+:", target)]
    return [(path, anchor) for path, _, anchor in local]


def anchors(text: str) -> set[str]:
    """Return the names that GitHub gives to a page's headings."""
    headings = re.findall(r"^#+ (.+)$", re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading).strip().lower().replace(" ", "-") for heading in headings}
