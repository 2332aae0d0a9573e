"""Load Mitsuba scenes, also of Mitsuba 0.5 and 0.6, and with an integrator or a sampler that Mitsuba does not have."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from .old_scenes import converted

# What replaces plugins that Mitsuba lacks, and the properties that remain. A render uses nothing else of these two.
_REPLACED = {
    "integrator": ("volpath", ("max_depth", "rr_depth", "hide_emitters")),
    "sampler": ("independent", ("sample_count", "seed")),
}
_MISSING = re.compile(rf'({"|".join(_REPLACED)}) plugin of type "([^"]*)": \[PluginManager\] Plugin "\2" not found')


def load(path: Path, parameters: Mapping[str, str], merge: bool) -> Any:
    """Return what Mitsuba makes of a file, as `mi.load_file` does.

    Parameters
    ----------
    path
        The .xml file.
    parameters
        Values of the file's own parameters ($name).
    merge
        Whether equal plugins become one, and meshes are merged, which then lose their ids.

    Raises
    ------
    RuntimeError
        From Mitsuba: something that it cannot read or make.
    """
    from ..runtime.device import mitsuba

    mi = mitsuba()
    config: Any = mi.parser.ParserConfig(mi.variant())
    config.merge_meshes = config.merge_equivalent = merge
    missing: set[str] = set()
    with _folder(path.parent):
        while True:
            own = parsed(path, parameters)
            for node in own.state.nodes:
                if node.props.plugin_name() in missing:
                    _replace(node)
            mi.parser.transform_all(config, own.state)
            try:
                return mi.parser.instantiate(config, own.state)
            except RuntimeError as error:
                found = _MISSING.search(str(error))
                if found is None or found[2] in missing:
                    raise
                missing.add(found[2])


class Parsed(NamedTuple):
    """Mitsuba's parsed form of a scene, and the text in which its messages count lines: it must live as long."""

    state: Any
    text: str | None


def parsed(path: Path, parameters: Mapping[str, str]) -> Parsed:
    """Return a file as Mitsuba has parsed it; RuntimeError if Mitsuba cannot."""
    from ..runtime.device import mitsuba

    parser, variant = mitsuba().parser, mitsuba().variant()
    text = converted(path)
    config = parser.ParserConfig(variant)
    if text is None:
        return Parsed(parser.parse_file(config, str(path), **parameters), None)
    return Parsed(parser.parse_string(config, text, **parameters), text)


def _replace(node: Any) -> None:
    """Replace a plugin that Mitsuba lacks."""
    name, kept = _REPLACED[node.type.name.lower()]
    node.props.set_plugin_name(name)
    for each in [*node.props.keys()]:
        if each not in kept:
            del node.props[each]


@contextmanager
def _folder(folder: Path) -> Iterator[None]:
    """Let Mitsuba find files in a folder within the context."""
    from ..runtime.device import mitsuba

    mi = mitsuba()
    before = mi.file_resolver()
    own = mi.FileResolver(before)
    own.prepend(str(folder))
    mi.set_file_resolver(own)
    try:
        yield
    finally:
        mi.set_file_resolver(before)
