"""The trees that are compared: this one, and another commit's in a work tree of git that is removed afterwards."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[2]
# Digits of a commit's name, as git shortens it in a repository of this size.
DIGITS = 8


def commit_of(name: str) -> str | None:
    """Return the commit that a name stands for, or None."""
    parsed = _git("rev-parse", "--verify", "--quiet", "--end-of-options", f"{name}^{{commit}}")
    return parsed.stdout.strip() or None


def described() -> str:
    """Return what this tree is: its commit, with + where files differ from it."""
    commit = _git("rev-parse", "HEAD").stdout.strip()[:DIGITS]
    return f"{commit}+" if _git("status", "--porcelain", "--", "src", "examples").stdout.strip() else commit


@contextmanager
def work_tree(commit: str) -> Iterator[Path]:
    """Have a work tree of a commit within the context; it is removed however that ends."""
    with tempfile.TemporaryDirectory(prefix="photonbeams-compare-") as folder:
        tree = Path(folder) / "tree"
        try:
            added = _git("worktree", "add", "--detach", str(tree), commit)
            if added.returncode:
                raise OSError(f"git makes no work tree of {commit}: {added.stderr.strip()}")
            yield tree
        finally:
            _git("worktree", "remove", "--force", str(tree))


def _git(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
