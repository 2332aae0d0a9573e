"""Stages made of a few lines of USD."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO
import pytest
from pxr import Usd

from photonbeams.scene import Scene
from photonbeams.usd.stage import default_time, open_stage, read_scene

Opener = Callable[..., Usd.Stage]


@pytest.fixture
def usd(tmp_path: Path) -> Opener:
    """Write and open a stage: its prims, and its metadata."""

    def opened(text: str, metadata: str = "") -> Usd.Stage:
        # OpenUSD keeps the layers that are in use: every stage of a test has a file of its own.
        folder = tmp_path / str(len(list(tmp_path.iterdir())))
        folder.mkdir()
        path = folder / "stage.usda"
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


@pytest.fixture
def image(tmp_path: Path) -> Callable[..., Path]:
    """Write an image of linear or encoded numbers as they are, and return its path."""

    def written(name: str, pixels: list, kind: str = "uint8") -> Path:
        values = np.asarray(pixels, dtype=np.float32)
        path = tmp_path / "images" / name
        path.parent.mkdir(exist_ok=True)
        spec = OpenImageIO.ImageSpec(values.shape[1], values.shape[0], values.shape[2], kind)
        spec.attribute("oiio:UnassociatedAlpha", 1)
        file = OpenImageIO.ImageOutput.create(str(path))
        assert file.open(str(path), spec)
        assert file.write_image(values)
        file.close()
        return path

    return written
