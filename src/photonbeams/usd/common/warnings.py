"""Warnings about a stage: each is given once, those of one kind together; `strict` turns them into errors."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal, TypeAlias, Union

from ...scene import SceneError, shown
from ...scene.checks import LONGEST, brief, shortened

LOG = logging.getLogger("photonbeams")

_AROUND = len("Warning: ") + len(": ") + len("; ")  # characters of a line beside file, text and what is done instead
_NAMED = 3  # how many prims with the same warning are named
_DIFFERING = re.compile(r"(?:/\w+)+|-?\d[\w.+-]*")  # paths and numbers: texts that differ only in these are of one kind


#: Which warnings are errors: none, all, or those about something that the stage names and that is missing.
Strictness: TypeAlias = Union[bool, Literal["missing"], "Warnings"]


class MissingError(SceneError):
    """Something that the stage names is not there, or cannot be read: at a `frame`, or, if that is None, at all."""

    def __init__(self, text: str, frame: float | None = None) -> None:
        super().__init__(text)
        self.frame = frame


class Warnings:
    """The warnings about a stage, shared between all readings of a shot.

    Attributes
    ----------
    strict
        Which warnings are errors: none, all, or "missing": those that `lack` gives.
    muted
        Whether warnings are collected but not logged.
    given
        The texts given so far; each is logged once.
    missing
        What is missing at a frame and, under None, at all frames.
    causes
        For texts that end with what is done instead, the part before that.
    """

    def __init__(self, strict: bool | Literal["missing"] = False, muted: bool = False) -> None:
        if not isinstance(strict, bool) and not (isinstance(strict, str) and strict == "missing"):
            raise SceneError(f"strict is {shown(strict)}: expected True, False or 'missing'")
        self.strict = strict
        self.muted = muted
        self.given: set[str] = set()
        self.missing: dict[float | None, dict[str, None]] = {}
        self.causes: dict[str, str] = {}
        self._held: dict[tuple[str, ...], list[str]] | None = None

    @classmethod
    def of(cls, strict: Strictness) -> Warnings:
        """Return warnings that were begun when the stage was opened, or new ones."""
        return strict if isinstance(strict, Warnings) else cls(strict)

    def lack(self, text: str, file: str = "", instead: str = "", frame: float | None = None) -> None:
        """Give a warning that something is missing which the stage names, at one frame or, without it, at all."""
        if self.strict:
            raise MissingError(f"{file}: {text}" if file else text, frame)
        self.missing.setdefault(frame, {})[f"{text}; {instead}" if instead else text] = None
        self.give(text, file if frame is None else f"frame {frame:.10g}: {file}", instead)

    def missing_at(self, frame: float) -> list[str]:
        """Return what was missing when a frame was read."""
        return [*self.missing.get(None, ()), *self.missing.get(frame, ())]

    def give(self, text: str, file: str = "", instead: str = "") -> None:
        """Log a warning, unless it was given before; SceneError if warnings are errors.

        Parameters
        ----------
        text, file
            A sentence; or one that begins with the path of a prim or of its attribute, and the file of these.
        instead
            What is done without the unusable part, as the end of the sentence: "it is skipped".
        """
        cause = text
        if instead:
            text = f"{shortened(text, len(brief(file)) + len(instead) + _AROUND)}; {instead}"
        sentence = f"{file}: {text}" if file else text
        if self.strict is True:
            raise SceneError(sentence)
        if sentence in self.given:
            return
        self.given.add(sentence)
        if instead:
            self.causes[sentence] = f"{file}: {cause}" if file else cause
        if self.muted:
            return
        if self._held is None or not file:
            LOG.warning("%s", shortened(sentence))
            return
        place, _, rest = text.partition(" ")
        kind = (file, _DIFFERING.sub("#", f"{place.partition('.')[2]} {rest}"))
        self._held.setdefault(kind, []).append(text)

    def advise(self, sentence: str) -> None:
        """Log once, also where warnings are errors, what a user may want to know of a shot that is sound."""
        if sentence not in self.given:
            self.given.add(sentence)
            if not self.muted:
                LOG.warning("%s", shortened(sentence))

    @contextmanager
    def together(self) -> Iterator[None]:
        """Log the warnings within this context at its end; those of one kind become one, with the number of prims."""
        if self._held is not None:
            yield
            return
        self._held = {}
        try:
            yield
        finally:
            held, self._held = self._held, None
            for (file, _), texts in held.items():
                LOG.warning("%s", _joined(file, texts))


def _joined(file: str, texts: list[str]) -> str:
    """Return one warning for several of one kind."""
    first, *others = texts
    if not others:
        return shortened(f"{file}: {first}")
    names = [_difference(first, text) for text in others[:_NAMED]]
    end = f" (and {len(others):,} more like this: {', '.join(names)}{', …' if len(others) > _NAMED else ''})"
    if len(file) + len(first) + len(end) + 2 > LONGEST:
        end = f" (and {len(others):,} more like this)"
    return shortened(f"{file}: {first}", len(end)) + end


def _difference(first: str, text: str) -> str:
    """Return the prim that a warning is about, or, if the first one is about it, too, the numbers that differ."""
    before, prim = (each.partition(" ")[0].partition(".")[0] for each in (first, text))
    known = _DIFFERING.findall(first) if prim == before else None
    return prim if known is None else ", ".join(each for each in _DIFFERING.findall(text) if each not in known) or prim
