"""Load Mitsuba scenes, also of Mitsuba 0.5 and 0.6, and with an integrator or a sampler that Mitsuba does not have."""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..runtime.device import helping_thread, mitsuba, scene_variants
from ..scene import SceneError
from ..scene.checks import shortened
from .old_scenes import parse, version_of
from .scene_files import OF_DICTIONARIES, check_files, checked_dictionary

LOG = logging.getLogger("photonbeams")

# What replaces plugins that Mitsuba lacks, and the properties that remain. A render uses nothing else of these two.
_REPLACED = {
    "integrator": ("volpath", ("max_depth", "rr_depth", "hide_emitters")),
    "sampler": ("independent", ("sample_count", "seed")),
}
_MISSING = re.compile(rf'({"|".join(_REPLACED)}) plugin of type "([^"]*)": \[PluginManager\] Plugin "\2" not found')

_STAMP = re.compile(r"^[\d-]+ [\d:]+ [A-Z]+ +")  # before what Mitsuba logs
_TRACE = "Traceback (most recent call last):"
_MAKING = re.compile(r': failed to instantiate \w+ plugin of type "(\w+)":$')


def load(path: Path, parameters: Mapping[str, str], merge: bool) -> Any:
    """Return the Mitsuba scene of a file, with values of its own parameters; SceneError for any other file.

    With `merge`, equal plugins become one, and meshes are merged, which then lose their ids.
    """
    mi = mitsuba()
    if not os.path.lexists(path):
        raise SceneError(f"{path}: no such file")
    try:
        check_files(path, parameters)
        with helping_thread(), _logged(path):
            plugin = _load_file(path, parameters, merge)
    except (RuntimeError, UnicodeDecodeError) as error:
        version = version_of(path)
        old = "" if version is None else f"; the scene is of Mitsuba {version}: expected one of Mitsuba 3"
        text = shortened(reason(_message(error), path), len(str(path)) + len(old) + 2)
        raise SceneError(f"{path}: {text}{old}") from None
    if not isinstance(plugin, mi.Scene):
        raise SceneError(f"{path}: holds a {type(plugin).__name__}: expected a scene")
    return plugin


@contextmanager
def _logged(path: Path) -> Iterator[None]:
    """Give what Mitsuba says of a scene to our log within the context, instead of colours and times to the terminal."""
    mi = mitsuba()

    class Forwarding(mi.Appender):  # type: ignore[misc, name-defined]
        def append(self, level: Any, text: str) -> None:
            if level >= mi.LogLevel.Warn:
                text = " ".join(_STAMP.sub("", text).split())
                LOG.warning("%s: %s", path, text)

        def log_progress(self, *_: object) -> None:
            pass

    logger, lines = mi.logger(), Forwarding()
    before = [logger.appender(number) for number in range(logger.appender_count())]
    logger.clear_appenders()
    logger.add_appender(lines)
    try:
        yield
    finally:
        logger.clear_appenders()
        for each in before:
            logger.add_appender(each)


def check_scene(source: Any) -> Any:
    """Return a scene of Mitsuba's, made from a dictionary if it is one; SceneError for anything else."""
    mi = mitsuba()
    if isinstance(source, Mapping):
        try:
            plain = checked_dictionary(source)
            with helping_thread():
                source = mi.load_dict(plain)
        except (RuntimeError, TypeError) as error:
            raise SceneError(shortened(f"{OF_DICTIONARIES}: {reason(str(error))}")) from None
    if not isinstance(source, mi.Object) or source.class_name() != "Scene":
        raise SceneError(f"stage is a {type(source).__name__} of Mitsuba's: expected a Scene")
    if source.variant_name() not in scene_variants():
        expected = " or ".join(scene_variants())
        raise SceneError(f"stage is a Scene of Mitsuba's variant {source.variant_name()}: expected {expected}")
    return source


def _load_file(path: Path, parameters: Mapping[str, str], merge: bool) -> Any:
    """Return what Mitsuba makes of a file, as `mi.load_file` does; RuntimeError from Mitsuba."""
    mi = mitsuba()
    config: Any = mi.parser.ParserConfig(mi.variant())
    config.merge_meshes = config.merge_equivalent = merge
    missing: set[str] = set()
    with _folder(path.parent):
        while True:
            own = parse(path, parameters)
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
                if found[1] == "integrator":  # its name may be a mistake
                    text = (
                        "%s: there is no integrator '%s', such as photon_beams: only the depths of its paths are used"
                    )
                    LOG.warning(text, path, found[2])


def _replace(node: Any) -> None:
    """Replace a plugin that Mitsuba lacks."""
    name, kept = _REPLACED[node.type.name.lower()]
    node.props.set_plugin_name(name)
    for each in [*node.props.keys()]:
        if each not in kept:
            del node.props[each]


def _message(error: RuntimeError | UnicodeDecodeError) -> str:
    """Return Mitsuba's message, which may quote bytes of a broken file that are no valid text."""
    return error.object.decode(errors="replace") if isinstance(error, UnicodeDecodeError) else str(error)


def reason(text: str, path: Path | None = None) -> str:
    """Return Mitsuba's message in one line, without source lines and tracebacks.

    At its beginning, the name of the file at `path`, or of a text, is left out.
    """
    text = re.sub(r"^\[[\w.]+:\d+\]\s*", "", text.strip())
    if path is not None:
        text = re.sub(
            rf"^(?:At|While loading|Error while loading) (?:{re.escape(str(path))}|string) \((.*?)\)", r"\1", text
        )
    text, trace, lines = text.partition(_TRACE)
    text = " ".join(text.split())
    if trace:  # from a plug-in in Python: its last line without indentation is the error, "Class: what is wrong"
        last = [line.partition(": ")[2] for line in lines.splitlines() if re.match(r"[\w.]+: ", line)]
        making = _MAKING.search(text)
        if making is not None:
            own = f"{making[1]}: "
            return shortened(f"{text[: making.start()]}: {own}{''.join(last[-1:]).removeprefix(own)}")
        text = " ".join((text, *last[-1:]))
    return text[:500].strip()


@contextmanager
def _folder(folder: Path) -> Iterator[None]:
    """Let Mitsuba find files in a folder within the context."""
    mi = mitsuba()
    before = mi.file_resolver()
    own = mi.FileResolver(before)
    own.prepend(str(folder))
    mi.set_file_resolver(own)
    try:
        yield
    finally:
        mi.set_file_resolver(before)
