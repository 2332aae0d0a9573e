"""Edits of a stage: values in a layer over it, in steps that can be undone and redone, with an autosave."""

from __future__ import annotations

import json
import logging
import os
import re
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from hashlib import sha256
from itertools import chain, count
from pathlib import Path
from typing import IO, Any, Literal, NamedTuple, TypeAlias, TypeVar
from weakref import finalize

from ..runtime.files import PathLike, locked, place_of, write_bytes
from ..runtime.inputs import content
from ..scene import SceneError
from ..usd.authoring.editing import EMPTY, EditLayer

LOG = logging.getLogger("photonbeams")

#: Seconds from an edit to its autosave.
SOON = 3.0

# The most steps that can be undone.
_MOST = 500

T = TypeVar("T")

#: What `Edits.save` does if another program has changed the file: refuse, merge, or save a copy beside it.
IfChanged: TypeAlias = Literal["ask", "merge", "copy"]

# The line of an autosave that tells what its file held: a hash, and the text that the edits began with.
_OVER = re.compile(r"^# over (\w*) ?(\".*\")?\n", re.MULTILINE)


class ChangedError(SceneError):
    """Another program has changed the file of the edits since it was read or written here."""


def _autosave_path(path: Path) -> Path:
    """Return the path of the autosave for a file of edits: .usda text, as long as some are unsaved."""
    return path.with_name(f"{path.name}.autosave")


def _numbered(path: Path, suffix: str = "") -> Iterator[Path]:
    """Yield a path, and those with the numbers from 2 on behind its name, each with a suffix."""
    return (path.with_name(f"{path.name}{number if number > 1 else ''}{suffix}") for number in count(1))


def _existing(path: Path) -> list[Path]:
    """Return the autosaves that exist for a file of edits, in any order and with gaps."""
    name = re.escape(_autosave_path(path).name)
    return [each for each in path.parent.glob("*") if re.fullmatch(rf"{name}\d*", each.name) and each.exists()]


def _text(path: Path) -> str | None:
    """Return the text of an autosave; None if it cannot be read."""
    with suppress(SceneError, UnicodeError):
        return content(path).decode()
    return None


def _reserved(path: Path) -> bool:
    """Make an empty file where there is none; return whether this did, or whether no file can be made there."""
    try:
        file = locked(path, "xb")
    except OSError as error:
        return not isinstance(error, FileExistsError)  # what is wrong is told when it is written
    if file is not None:
        file.close()
    return True


def _newest(path: Path) -> tuple[Path, str | None]:
    """Return the newest autosave of a file, and its text, None if there is none or it is older than the file."""
    there = [each for each in _existing(path) if _text(each)]
    newest, *others = sorted(there, key=lambda each: each.stat().st_mtime, reverse=True) or [_autosave_path(path)]
    text = _text(newest)
    if text is None:
        return newest, None
    for each in others:
        LOG.warning("%s holds unsaved edits of another studio, which are not restored", each)
    with suppress(OSError):
        if os.path.exists(path) and path.stat().st_mtime > newest.stat().st_mtime:
            LOG.warning("%s is older than %s: its edits are not restored", newest, path.name)
            return newest, None
    return newest, text


def _version(path: Path | None) -> str:
    """Return a hash of a file's content, "" if there is no file."""
    if path is None or not os.path.exists(path):
        return ""
    try:
        return sha256(content(path)).hexdigest()
    except SceneError:  # it is no regular file any more
        return "unreadable"


def _unquoted(text: str | None) -> str:
    """Return a text of an autosave's line, that of an empty layer if it is lacking or damaged."""
    with suppress(ValueError):
        return str(json.loads(text or ""))
    return EMPTY


class _Base(NamedTuple):
    """What edits are made over: a file's text, and a hash of it."""

    version: str
    text: str


class Autosave:
    """Writes and removes the autosave of edits, in a thread of its own.

    `unsaved` returns the file of the edits, None if there is none, and their text, None if everything is saved. Own is
    an autosave that is held here: opened and locked, so that other studios neither write nor remove it while this one
    lives, and the next one can when it is closed or killed.
    """

    def __init__(self, unsaved: Callable[[], tuple[Path | None, str | None]]) -> None:
        self._unsaved = unsaved
        self._timer: threading.Timer | None = None
        self._held: IO[bytes] | None = None
        self._closed, self._failed = False, False
        self._state = threading.Lock()  # of the timer
        #: Held while files are written or removed: no autosave of older edits may be written after the file itself.
        self.files = threading.RLock()

    def soon(self) -> None:
        """Write unsaved edits in a few seconds, with those that are made until then."""
        with self._state:
            if self._timer is None and not self._closed:
                self._timer = threading.Timer(SOON, self._now)
                self._timer.daemon = True
                self._timer.start()

    def _now(self) -> None:
        """Write unsaved edits; if everything is saved, remove the autosave."""
        with self.files:
            with self._state:
                if self._timer is not None:
                    self._timer.cancel()
                self._timer = None
            path, text = (None, None) if self._closed else self._unsaved()
            if path is None or text is None:
                self.remove(path)
                return
            free = filter(_reserved, _numbered(_autosave_path(path)))  # each studio that has the file open has its own
            target = next(chain(self._own(path), free))
            if _text(target) == text:
                return
            self._release()  # some systems replace no file that is open
            try:
                write_bytes(target, text.encode())
            except OSError as error:
                if not self._failed:
                    LOG.warning("unsaved edits cannot be kept in %s: %s", target, error.strerror or error)
                self._failed = True
            self.hold(target)

    def hold(self, autosave: Path) -> None:
        """Make an autosave the own one, unless another studio holds it."""
        self._release()
        with suppress(OSError):  # it is another user's, or could not be written
            self._held = locked(autosave)
        if self._held is not None:
            finalize(self, self._held.close)  # of edits that nobody closes

    def _release(self) -> None:
        if self._held is not None:
            self._held.close()
            self._held = None

    def _own(self, path: Path) -> list[Path]:
        """Return the own autosave of a file of edits, if it exists."""
        if self._held is None:
            return []
        status = os.fstat(self._held.fileno())
        return [each for each in _existing(path) if place_of(each) == (status.st_dev, status.st_ino)]

    def remove(self, *paths: Path | None) -> None:
        """Remove the own autosaves of files, if they exist."""
        with self.files:
            for path in paths:
                for each in () if path is None else self._own(path):
                    with suppress(OSError):
                        each.unlink()

    def close(self) -> None:
        """Write unsaved edits now, and nothing later."""
        with self.files:
            self._now()
            self._closed = True
            self._release()


class Edits:
    """A layer of values over a stage, with undo and redo.

    Unsaved edits are kept beside the file, and the next `Edits` with this file restores them.

    Parameters
    ----------
    layer
        The layer over the stage that holds the values.
    path
        The file to which `save` writes the layer; its present content is laid over the stage.

    Attributes
    ----------
    restored
        Whether the layer began with unsaved edits of an earlier session, which were neither saved nor discarded since.

    Raises
    ------
    SceneError
        A file that cannot be read as USD, or that is the stage's own.
    """

    def __init__(self, layer: EditLayer, path: PathLike | None = None) -> None:
        self._layer, self.path = layer, None if path is None else Path(path)
        self._lock = threading.RLock()  # for the layer, which autosaves read in another thread
        self._autosave = Autosave(self._unsaved)
        if self.path is not None:
            layer.check(self.path)
            if os.path.exists(self.path):
                layer.load(self.path)
        self._past: list[str] = []
        self._future: list[str] = []
        self._step: str | None = None
        self._saved = self._under = _Base(_version(self.path), layer.text())  # restored edits may have an older base
        self.restored = self.path is not None and self._restore(self.path)

    def _restore(self, path: Path) -> bool:
        """Restore the edits of an autosave, as a step that can be undone; return whether there are any."""
        autosave, text = _newest(path)
        if text is None:
            return False
        try:
            self._layer.replace(text)
        except SceneError:
            LOG.warning("%s cannot be read: expected the autosave of unsaved edits", autosave)
            return False
        self._autosave.hold(autosave)
        if self.is_saved:
            return False
        over = _OVER.search(text)
        if over is not None and over[1] != self._saved.version:  # the file was changed while there were unsaved edits
            self._under = _Base(over[1], _unquoted(over[2]))
        self._past = [self._saved.text]
        LOG.warning("unsaved edits are restored from %s", autosave)
        return True

    def set(self, values: Mapping[str, Any], step: str | None = None) -> None:
        """Set values by their paths, "/Prim.attribute"; None leaves the value to the stage again.

        Edits in a row with the same `step`, such as those of a drag, are undone together.

        Raises
        ------
        SceneError
            A prim or an attribute that does not exist, or a value of another type; then nothing is set.
        """

        def set_all(layer: EditLayer) -> None:
            for path, value in values.items():
                layer.set(path, value)

        self.change(set_all, step)

    def change(self, work: Callable[[EditLayer], T], step: str | None = None) -> T:
        """Let a function change the layer in one step, and return what it returns; an error undoes its changes."""
        with self._lock:
            before = self._layer.text()
            self._under = self._saved if self.is_saved else self._under
            try:
                result = work(self._layer)
            except BaseException:
                self._layer.replace(before)
                raise
            if step is None or step != self._step:
                self._past = [*self._past[-_MOST + 1 :], before]
            self._step, self._future = step, []
        self._autosave.soon()
        return result

    def undo(self) -> bool:
        """Undo the last step; return whether there was one."""
        return self._moved(self._past, self._future)

    def redo(self) -> bool:
        """Redo the step that was undone last; return whether there was one."""
        return self._moved(self._future, self._past)

    def revert(self) -> None:
        """Remove all edits, as one step, so that all values are the stage's own again."""
        self._go_to(EMPTY)

    def discard(self) -> None:
        """Go back to what was saved last, as one step."""
        self._go_to(self._saved.text)

    def _go_to(self, text: str) -> None:
        self.change(lambda layer: layer.replace(text))
        self.restored = False
        self._autosave.remove(self.path)

    def _moved(self, source: list[str], target: list[str]) -> bool:
        with self._lock:
            if not source:
                return False
            target.append(self._layer.text())
            self._layer.replace(source.pop())
            self._step = None
        self._autosave.soon()
        return True

    @property
    def can_undo(self) -> bool:
        """Whether there is a step to undo."""
        return bool(self._past)

    @property
    def can_redo(self) -> bool:
        """Whether there is a step to redo."""
        return bool(self._future)

    @property
    def is_saved(self) -> bool:
        """Whether the file holds all edits; without a file, whether there are none."""
        return self._layer.text() == self._saved.text

    def paths(self) -> list[str]:
        """Return the paths of everything that has a value in the layer."""
        return self._layer.paths()

    def text(self) -> str:
        """Return the layer as the text of a .usda file."""
        with self._lock:
            return self._layer.text()

    def _unsaved(self) -> tuple[Path | None, str | None]:
        """Return the file, and the text of the edits or, if they are saved, None."""
        with self._lock:
            over = f"\n# over {self._under.version} {json.dumps(self._under.text)}\n"
            text = self._layer.text().replace("\n", over, 1)
            return self.path, None if self.is_saved else text

    def save(self, path: PathLike | None = None, changed: IfChanged = "ask") -> Path:
        """Write the layer, whole or not at all, and return its file.

        Parameters
        ----------
        path
            Another file for the edits.
        changed
            What is done if another program has changed the file since: "ask" raises ChangedError; "merge" lays the
            edits over what the file holds now, as a step that can be undone; "copy" writes a file beside it, which is
            the file of the edits from then on.

        Raises
        ------
        ChangedError
            Another program has changed the file of the edits.
        SceneError
            No path is given, and no file is known; or what the file holds now cannot be merged.
        OSError
            The file cannot be written.
        """
        target = self.path if path is None else Path(path)
        if target is None:
            raise SceneError("the edits have no file: expected the path of a .usda layer")
        with self._autosave.files, self._lock:
            own = self.path is not None and place_of(target) == place_of(self.path)
            base = self._saved if self.is_saved else self._under
            if own and _version(target) not in ("", base.version):
                if changed == "ask":
                    text = "another program has changed it since: expected changed='merge' or 'copy', or another file"
                    raise ChangedError(f"{target}: {text}")
                if changed == "copy":
                    copies = _numbered(target.with_suffix(".copy"), target.suffix)
                    target = next(copy for copy in copies if not copy.exists())
                else:
                    self.change(lambda layer: layer.merge(base.text, target))
            self._layer.write(target)
            self._autosave.remove(self.path, target)
            self.path, self.restored = target, False
            self._saved = self._under = _Base(_version(target), self._layer.text())
        return target

    def close(self) -> None:
        """Keep unsaved edits for the next time."""
        self._autosave.close()
