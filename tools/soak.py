"""Run all tests, with the whole of long sweeps, and note in `tests/soak.json` that they passed: `make soak` calls it.

The file says of the last run that passed at which commit it was, when, for how long, how many tests there were, and
what pytest was told: with `-m soak`, those cases alone ran that `make test` leaves out.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path
from time import monotonic

ROOT = Path(__file__).parents[1]
NOTE = ROOT / "tests" / "soak.json"


def git(*arguments: str) -> str:
    """Return what a command of git prints."""
    return subprocess.run(["git", *arguments], cwd=ROOT, check=True, capture_output=True, text=True).stdout.strip()


def passed(output: str) -> int:
    """Return how many tests passed, by the last lines of pytest."""
    counts = re.findall(r"(\d+) passed", output)
    return int(counts[-1]) if counts else 0


def main() -> int:
    """Run pytest with these arguments, and write the note if all tests pass; return pytest's exit code."""
    commit, changed = git("rev-parse", "--short", "HEAD"), bool(git("status", "--porcelain", "--untracked-files=no"))
    begun, lines = monotonic(), list[str]()
    command = [sys.executable, "-m", "pytest", "--soak", *sys.argv[1:]]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as tests:
        assert tests.stdout is not None
        for line in tests.stdout:
            sys.stdout.write(line)
            sys.stdout.flush()
            lines.append(line)
    if tests.returncode == 0:
        note = {
            "commit": f"{commit}, with changes" if changed else commit,
            "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
            "minutes": round((monotonic() - begun) / 60, 1),
            "passed": passed("".join(lines)),
            "arguments": " ".join(sys.argv[1:]),
        }
        NOTE.write_text(json.dumps(note, indent=2) + "\n", encoding="utf-8")
        print(f"soak: passed in {note['minutes']} minutes; commit {NOTE.relative_to(ROOT)}")
    return tests.returncode


if __name__ == "__main__":
    sys.exit(main())
