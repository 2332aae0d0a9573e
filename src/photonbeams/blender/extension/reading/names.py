"""Names that USD and light groups allow, for names in Blender, which may be any text."""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import count


def free_path(parent: str, name: str, taken: Callable[[str], object]) -> str:
    """Return the path of a prim, which has a number if it is taken otherwise."""
    valid = re.sub(r"\W", "_", name, flags=re.ASCII)
    valid = valid if valid[:1].isalpha() or valid[:1] == "_" else f"_{valid}"
    return next(path for k in count() if not taken(path := f"{parent}/{valid}_{k}" if k else f"{parent}/{valid}"))


def group_name(name: str) -> str:
    """Return the name of a light group."""
    return re.sub(r"[^A-Za-z0-9_-]", "_", name)
