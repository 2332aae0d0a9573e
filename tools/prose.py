"""Check the prose of README.md and docs/ with proselint; `make lint` calls it.

Code, tables and the targets of links are removed first, because they are not prose.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = [*(ROOT / "docs").rglob("*.md"), *(ROOT / f"{name}.md" for name in ("README", "CONTRIBUTING", "CHANGELOG"))]
# Not checked: quotes and dots, which code and prose share; spelling, which codespell checks; and repeated words,
# because a heading and the first word under it may be the same.
OFF = ("typography", "spelling", "lexical_illusions")


def prose(text: str) -> str:
    """Return a page with only its prose; lines keep their numbers."""

    def emptied(found: re.Match[str]) -> str:
        return "\n" * found[0].count("\n")

    text = re.sub(r"^(```|:::+).*?^\1`*:*$", emptied, text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"^( {4}|\|).*$", "", text, flags=re.MULTILINE)
    text = re.sub(r"<!--.*?-->", emptied, text, flags=re.DOTALL)
    text = re.sub(r"`[^`]*`", "this", text)
    return re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)


def main() -> int:
    """Print what proselint finds; return 1 if it finds something."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for page in PAGES:
            if not {"_build", "generated"} & set(page.parts):
                copy = folder / page.relative_to(ROOT)
                copy.parent.mkdir(parents=True, exist_ok=True)
                copy.write_text(prose(page.read_text()))
        settings = folder / "proselint.json"
        settings.write_text(json.dumps({"checks": dict.fromkeys(OFF, False)}))
        command = [Path(sys.executable).parent / "proselint", "check", "--config", settings, folder]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    sys.stdout.write(done.stdout.replace(f"{name}/", ""))
    sys.stderr.write(done.stderr)
    return int(bool(done.stdout.strip()) or done.returncode > 1)


if __name__ == "__main__":
    sys.exit(main())
