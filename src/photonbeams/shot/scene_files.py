"""Checks of files that Mitsuba scenes refer to, before Mitsuba reads them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..scene import SceneError
from ..volumes.bytes import opened
from ..volumes.vol import vol_shape


def check_grids(path: Path, parameters: Mapping[str, str]) -> None:
    """Check the .vol files that a scene refers to: some, such as a grid without cells, make Mitsuba end the process.

    Files that do not exist here are left to Mitsuba, which also looks in other folders.

    Raises
    ------
    SceneError
        A file that is broken, or that holds no grid of 1, 3 or 6 channels.
    RuntimeError
        From Mitsuba: a scene that cannot be parsed.
    """
    from ..runtime.device import mitsuba

    mi = mitsuba()
    parsed: Any = mi.parser.parse_file(mi.parser.ParserConfig(mi.variant()), str(path), **parameters)
    for node in parsed.nodes:
        properties = node.props
        if properties.plugin_name() != "gridvolume" or "filename" not in properties:
            continue
        file = path.parent / str(properties["filename"])
        if not file.exists():
            continue
        try:
            with opened(file) as data:
                vol_shape(data)
        except SceneError as error:
            raise SceneError(f"{path}: names {file}: expected a grid that can be read ({error})") from None
