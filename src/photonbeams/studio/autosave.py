"""Autosave: edits are written beside their file soon after they are made, in case the studio ends unexpectedly.

The file has the name of the edits' file with ".autosave" appended, and is .usda text. It exists as long as there are
unsaved edits.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from ..runtime.files import write_bytes
from ..runtime.inputs import why_unreadable

LOG = logging.getLogger("photonbeams")

#: Seconds from an edit to its autosave.
SOON = 3.0


def autosave_path(path: Path) -> Path:
    """Return the path of the autosave for a file of edits."""
    return path.with_name(f"{path.name}.autosave")


class Autosave:
    """Writes and removes the autosave of edits, in a thread of its own.

    `unsaved` returns the file of the edits, None if there is none, and their text, None if everything is saved.
    """

    def __init__(self, unsaved: Callable[[], tuple[Path | None, str | None]]) -> None:
        self._unsaved = unsaved
        self._timer: threading.Timer | None = None
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
                self._timer = None
            path, text = self._unsaved()
            if path is None or text is None:
                self.remove(path)
                return
            try:
                write_bytes(autosave_path(path), text.encode())
            except OSError as error:
                if not self._failed:
                    LOG.warning("unsaved edits cannot be kept in %s: %s", autosave_path(path), error.strerror or error)
                self._failed = True

    def found(self, path: Path) -> str | None:
        """Return the text of a file's autosave, None if there is none or it is older than the file."""
        kept = autosave_path(path)
        if not kept.exists() or why_unreadable(kept):
            return None
        with suppress(OSError, UnicodeError):
            if path.exists() and path.stat().st_mtime > kept.stat().st_mtime:
                LOG.warning("%s is older than %s: its edits are not restored", kept, path.name)
                return None
            return kept.read_text(encoding="utf-8")
        return None

    def remove(self, *paths: Path | None) -> None:
        """Remove the autosaves of files, if they exist."""
        with self.files:
            for path in paths:
                if path is not None:
                    with suppress(OSError):
                        autosave_path(path).unlink()

    def close(self) -> None:
        """Write unsaved edits now, and nothing later."""
        with self._state:
            timer, self._timer, self._closed = self._timer, None, True
        if timer is not None:
            timer.cancel()
            self._now()
