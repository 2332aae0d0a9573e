"""Stages made of a few lines of USD."""

from collections.abc import Callable
from pathlib import Path

import pytest
from pxr import Usd

from photonbeams.scene import Scene
from photonbeams.shot.stage import default_time, open_stage, read_scene

Opener = Callable[..., Usd.Stage]


@pytest.fixture
def usd(tmp_path: Path) -> Opener:
    """Write and open a stage: its prims, and its metadata."""

    def opened(text: str, metadata: str = "") -> Usd.Stage:
        path = tmp_path / "stage.usda"
        body = text.replace(" }", "\n}")  # USD ends a statement at the line's end alone
        path.write_text(f"#usda 1.0\n(\n{metadata}\n)\n{body}\n")
        return open_stage(path)

    return opened


@pytest.fixture
def scene(usd: Opener) -> Callable[..., Scene]:
    """Write, open and read a stage."""

    def read(text: str, metadata: str = "") -> Scene:
        stage = usd(text, metadata)
        return read_scene(stage, default_time(stage))

    return read
