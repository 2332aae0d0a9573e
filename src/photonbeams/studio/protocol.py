"""The messages between a page and the studio: JSON texts, and pictures that follow a JSON header.

Types in the page's messages are checked here, their content by the session.
"""

from __future__ import annotations

from typing import Any

import msgspec

#: Limits: bytes in a message of a page, its messages per second, and values in an edit.
LONGEST, PER_SECOND, MOST_VALUES = 1 << 16, 240, 256


class Message(msgspec.Struct, tag_field="type", forbid_unknown_fields=True):
    """A message from a page."""


class Set(Message, tag="set"):
    """Set values by their paths; None leaves one to the stage. Edits in a row with one `step` are undone together."""

    values: dict[str, Any]
    step: str | None = None


class Apply(Message, tag="apply"):
    """Apply a preset to the look at a path, or give the light at a path a new look with it."""

    preset: str
    path: str


class Undo(Message, tag="undo"):
    """Undo the last step."""


class Redo(Message, tag="redo"):
    """Redo the step that was undone last."""


class Revert(Message, tag="revert"):
    """Remove all edits."""


class Discard(Message, tag="discard"):
    """Go back to the edits that were saved last."""


class Save(Message, tag="save"):
    """Write the edits to their file."""


class Show(Message, tag="show"):
    """Change what is shown: the view, which all pages share, and this page's layer, eye, exposure and view transform.

    `stereo` holds the distance between the eyes and the distance at which they converge; each may be None: see
    `usd.stereo.Stereo`. `eye` is "anaglyph", "side-by-side", "left" or "right".
    """

    size: tuple[int, int] | msgspec.UnsetType = msgspec.UNSET
    camera: str | msgspec.UnsetType | None = msgspec.UNSET
    pose: list[float] | msgspec.UnsetType | None = msgspec.UNSET
    frame: float | msgspec.UnsetType | None = msgspec.UNSET
    area: tuple[float, float, float, float] | msgspec.UnsetType | None = msgspec.UNSET
    lens: bool | msgspec.UnsetType = msgspec.UNSET
    blur: bool | msgspec.UnsetType = msgspec.UNSET
    denoise: bool | msgspec.UnsetType = msgspec.UNSET
    stereo: tuple[float | None, float | None] | msgspec.UnsetType | None = msgspec.UNSET
    solo: list[str] | msgspec.UnsetType = msgspec.UNSET
    paused: bool | msgspec.UnsetType = msgspec.UNSET
    eye: str | msgspec.UnsetType = msgspec.UNSET
    layer: str | msgspec.UnsetType = msgspec.UNSET
    exposure: float | msgspec.UnsetType = msgspec.UNSET
    display: str | msgspec.UnsetType = msgspec.UNSET


class Inspect(Message, tag="inspect"):
    """Ask what is in the pixel at a place, in fractions of the picture from the top left."""

    at: tuple[float, float]


class Render(Message, tag="render"):
    """Render the final picture, or those from the first to the last of `frames`."""

    passes: int
    frames: tuple[float, float] | None = None


class Cancel(Message, tag="cancel"):
    """End the final render."""


Messages = Set | Apply | Undo | Redo | Revert | Discard | Save | Show | Inspect | Render | Cancel

_DECODER: msgspec.json.Decoder[Messages] = msgspec.json.Decoder(Messages)


class Malformed(Exception):  # noqa: N818 - an error of the page, not of this program
    """A message does not follow the protocol; the text says why."""


def decoded(text: str | bytes) -> Messages:
    """Return the message in a page's JSON; raise Malformed for anything else."""
    if len(text) > LONGEST:
        raise Malformed(f"the message has {len(text):,} bytes: expected {LONGEST:,} at most")
    try:
        message = _DECODER.decode(text)
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise Malformed(f"the message does not follow the protocol: {error}"[:300]) from None
    if isinstance(message, Set) and len(message.values) > MOST_VALUES:
        raise Malformed(f"the message sets {len(message.values)} values: expected {MOST_VALUES} at most")
    return message


def encoded(kind: str, **content: Any) -> str:
    """Return a message to pages as JSON; infinite numbers and NaN become null."""
    return msgspec.json.encode({"type": kind, **content}).decode()


def framed(header: dict[str, Any], payload: bytes) -> bytes:
    """Return a picture with its header: 4 bytes of the header's length, the header, and the picture's bytes."""
    text = msgspec.json.encode(header)
    return len(text).to_bytes(4, "little") + text + payload
