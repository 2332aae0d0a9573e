"""Check the subjects of commits: `area: what changes`, with at most 72 characters.

Usage: python tools/commits.py, for the commits since the newest tag, the last 20 at most; or python tools/commits.py
FILE, for the message in a file, as git's hook commit-msg calls it.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

LONGEST, MOST = 72, 20
AREA = re.compile(r"[a-z][\w./-]*(, [a-z][\w./-]*)*: \S")
#: What git writes by itself, or rewrites before the commit is shared.
GIT = re.compile(r'(Merge |Revert "|fixup! |squash! |amend! )')


def mistake(subject: str) -> str:
    """Return what is wrong with a subject; empty if nothing is."""
    if GIT.match(subject):
        return ""
    if len(subject) > LONGEST:
        return f"it has {len(subject)} characters: use at most {LONGEST}, and say why in the body"
    return "" if AREA.match(subject) else "use `area: what changes`, such as `usd: one file cannot be read`"


def git(*arguments: str) -> list[str]:
    """Return the lines that git prints; none if it fails."""
    done = subprocess.run(["git", *arguments], capture_output=True, text=True, check=False)
    return done.stdout.splitlines()


def main() -> int:
    """Print wrong subjects; return 1 if there are some."""
    if len(sys.argv) > 1:
        lines = Path(sys.argv[1]).read_text(encoding="utf-8").splitlines()
        subjects = [next((line for line in lines if line.strip() and not line.startswith("#")), "")]
    else:
        tag = git("describe", "--tags", "--abbrev=0")
        span = f"{tag[0]}..HEAD" if tag else "HEAD"
        subjects = git("log", "--no-merges", f"--max-count={MOST}", "--format=%s", span)
    wrong = [f"{subject!r}: {text}" for subject in subjects if (text := mistake(subject))]
    print("\n".join(wrong) if wrong else f"{len(subjects)} commit subjects are as agreed")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
