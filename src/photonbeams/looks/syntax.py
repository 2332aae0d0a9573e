"""Expressions as Python syntax trees. Texts that cannot be expressions are refused before Python's parser sees them."""

from __future__ import annotations

import ast
import warnings

from ..scene import SceneError

LONGEST = 4096  # characters
DEEPEST = 64  # parts within parts
_WIDTH = 60  # characters of a text in a message


class ExpressionError(SceneError):
    """An expression is wrong. The error's text is one sentence for the artist. It is a `SceneError`.

    Attributes
    ----------
    text
        The expression.
    column
        Column of the mistake, counted from 1.
    reason
        What is wrong there, and what was expected.

    Examples
    --------
    >>> try:
    ...     pb.looks.Expression("1 - rr")
    ... except pb.looks.ExpressionError as error:
    ...     print(f"column {error.column}: {error.reason.split(':')[0]}")
    column 5: rr is not a name
    """

    def __init__(self, text: str, column: int, reason: str) -> None:
        super().__init__(text, column, reason)
        self.text, self.column, self.reason = text, column, reason

    def __str__(self) -> str:
        return f'expression "{excerpt(self.text, self.column)}", column {self.column}: {self.reason}'


def excerpt(text: str, column: int) -> str:
    """Return the part of a text around a column, printable and on one line."""
    first = max(0, min(column - 1 - _WIDTH // 2, len(text) - _WIDTH))
    part = "".join(c if c.isprintable() else "�" for c in text[first : first + _WIDTH])
    return f"{'…' if first else ''}{part}{'…' if len(text) > first + _WIDTH else ''}"


_PUNCTUATION = frozenset("_+-*/%.,()[]<>=! ")
EXPECTED = "expected numbers, names, operators and functions"
#: Characters of other languages, and what is expected instead.
_FOREIGN = {
    "^": "expected ** for powers",
    "&": "expected and",
    "|": "expected or",
    "~": "expected not, or 1 - x",
    "?": "expected a if condition else b",
    ":": "expected a if condition else b",
    "$": "expected names without it",
    ";": "expected a single expression",
    "\n": "expected a single line",
    "\r": "expected a single line",
    "\t": "expected spaces",
    "#": "expected no comments",
    "'": "expected numbers, since there are no strings",
    '"': "expected numbers, since there are no strings",
    "{": "expected round or square brackets",
    "}": "expected round or square brackets",
}
_CLOSING = {")": "(", "]": "["}


def _check_characters(text: str) -> None:
    """Refuse texts that cannot be expressions before Python's parser sees them, since its limits are others."""
    if not text:
        raise ExpressionError(text, 1, "the expression is empty: expected an expression, such as 1 - s")
    if len(text) > LONGEST:
        reason = f"the expression has {len(text)} characters: expected at most {LONGEST}"
        raise ExpressionError(text, LONGEST + 1, reason)
    opened: list[tuple[str, int]] = []
    for column, character in enumerate(text, 1):
        if character not in _PUNCTUATION and not (character.isascii() and character.isalnum()):
            shown = repr(character) if character.isprintable() else f"a character of code {ord(character)}"
            raise ExpressionError(text, column, f"{shown} has no meaning here: {_FOREIGN.get(character, EXPECTED)}")
        if character in "([":
            opened.append((character, column))
            if len(opened) > DEEPEST:
                raise ExpressionError(text, column, f"brackets are nested too deep: expected at most {DEEPEST}")
        elif character in _CLOSING and (not opened or opened.pop()[0] != _CLOSING[character]):
            raise ExpressionError(text, column, f"{character} closes nothing: expected {_CLOSING[character]} before it")
    if opened:
        character, column = opened[-1]
        closing = {"(": ")", "[": "]"}[character]
        raise ExpressionError(text, column, f"{character} is never closed: expected {closing} after it")


def tree(text: str) -> ast.expr:
    """Return the syntax tree of a text; raise ExpressionError if it is not an expression."""
    _check_characters(text)
    try:
        with warnings.catch_warnings():
            # "1if" is a warning in some versions of Python, and an error in others.
            warnings.simplefilter("error")
            return ast.parse(text, mode="eval").body
    except SyntaxError as error:
        if not error.offset:
            raise ExpressionError(text, len(text) + 1, "the expression ends too early: expected a value here") from None
        reason = "this cannot be read: expected one expression, such as 1 - s * s"
        raise ExpressionError(text, min(error.offset, len(text) + 1), reason) from None
    except (RecursionError, MemoryError):
        raise ExpressionError(text, 1, too_deep()) from None
    except (ValueError, OverflowError, Warning):
        raise ExpressionError(text, 1, f"this cannot be read: {EXPECTED}") from None


def too_deep() -> str:
    """Return the reason of the error for too many levels of nesting."""
    return f"parts are nested too deep: expected at most {DEEPEST} within each other"
