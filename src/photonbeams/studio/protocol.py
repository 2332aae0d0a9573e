"""The messages between a page and the studio: JSON texts, and pictures that follow a JSON header.

Types in the page's messages are checked here, their content by the session. The page has the same types in
page/src/protocol.ts, which tools/protocol.py writes.
"""

from __future__ import annotations

from typing import Any, Literal

import msgspec
from msgspec import UNSET, Struct, UnsetType

from ..scene import SceneError

#: Limits: bytes in a message of a page, its messages per second, and values in an edit.
LONGEST, PER_SECOND, MOST_VALUES = 1 << 16, 240, 256


#: A colour or a point; two eyes, by their distance and the distance where they converge, None: the usual; a rectangle.
Triple = tuple[float, float, float]
Eyes = tuple[float | None, float | None]
Area = tuple[float, float, float, float]


class Message(Struct, tag_field="type", forbid_unknown_fields=True):
    """A message from a page."""


class Set(Message, tag="set"):
    """Set values by their paths; None leaves one to the stage. Edits in a row with one `step` are undone together."""

    values: dict[str, Any]
    step: str | None = None


class Apply(Message, tag="apply"):
    """Apply a preset to the look at a path, or give the light at a path a new look with it."""

    preset: str
    path: str


class Keep(Message, tag="keep"):
    """Keep the look at a path in the library, for other shots."""

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
    """Write the edits to their file; if another program has changed it, ask, merge, or write a copy beside it."""

    changed: Literal["ask", "merge", "copy"] = "ask"


class Show(Message, tag="show"):
    """Change what is shown: the view, which all pages share, and this page's layer, eye, exposure and view transform.

    `stereo` holds the distance between the eyes and the distance at which they converge; each may be None: see
    `usd.cameras.stereo.Stereo`. `eye` is "anaglyph", "side-by-side", "left" or "right". `other` is a layer whose
    picture comes before that of `layer`, to be compared with it; None: none.
    """

    size: tuple[int, int] | UnsetType = UNSET
    camera: str | UnsetType | None = UNSET
    pose: list[float] | UnsetType | None = UNSET
    frame: float | UnsetType | None = UNSET
    area: Area | UnsetType | None = UNSET
    lens: bool | UnsetType = UNSET
    blur: bool | UnsetType = UNSET
    denoise: bool | UnsetType = UNSET
    bounces: int | UnsetType | None = UNSET
    stereo: Eyes | UnsetType | None = UNSET
    solo: list[str] | UnsetType = UNSET
    paused: bool | UnsetType = UNSET
    eye: str | UnsetType = UNSET
    layer: str | UnsetType = UNSET
    other: str | UnsetType | None = UNSET
    exposure: float | UnsetType = UNSET
    display: str | UnsetType = UNSET


class Inspect(Message, tag="inspect"):
    """Ask what is in the pixel at a place, in fractions of the picture from the top left."""

    at: tuple[float, float]


class Render(Message, tag="render"):
    """Render the final picture, or those from the first to the last of `frames`.

    `size` is its width and height, None: as shown; `file` is where it is written, from the stage's folder, None: it is
    only handed out.
    """

    passes: int
    frames: tuple[float, float] | None = None
    size: tuple[int, int] | None = None
    denoise: bool = False
    file: str | None = None


class Estimate(Message, tag="estimate"):
    """Estimate what that final render takes; the answer has the same `number`. A page's next one replaces it."""

    number: int
    passes: int
    frames: tuple[float, float] | None = None
    size: tuple[int, int] | None = None
    denoise: bool = False


class Cancel(Message, tag="cancel"):
    """End the final render, or the estimate of one."""

    estimate: bool = False


Messages = Set | Apply | Keep | Undo | Redo | Revert | Discard | Save | Show | Inspect | Render | Estimate | Cancel


class Answer(Struct, tag_field="type"):
    """A message to pages."""


class Ramp(Struct):
    """The value of a ramp; it is stored as three attributes, whose paths are the `parts` of its control."""

    knots: list[float]
    colors: list[Triple]
    interpolation: str


class ControlItem(Struct, rename={"least": "min", "most": "max", "slider": "soft"}):
    """A value that can be edited: see `usd.authoring.controls.Control`. Without what it `needs` it has no effect."""

    path: str
    label: str
    section: str
    kind: Literal[
        "number", "integer", "bool", "color", "choice", "text", "expression", "numbers", "paths", "asset", "ramp"
    ]
    value: Any
    default: Any
    authored: bool
    least: float | None
    most: float | None
    slider: tuple[float, float] | None
    choices: tuple[str, ...]
    unit: str
    doc: str
    parts: dict[str, str]
    needs: dict[str, list[bool | str | None]]


class ControlGroup(Struct):
    """The controls of a prim, and the paths of the looks that it uses."""

    path: str
    kind: Literal["light", "medium", "look"]
    label: str
    type: str
    controls: list[ControlItem]
    uses: tuple[str, ...]


class PresetItem(Struct):
    """A look to start from, or a factor of one: "look", or the section of its controls in small letters."""

    name: str
    label: str
    factor: str


class SceneMessage(Answer, tag="scene"):
    """What can be shown and edited. `focal` is the focal length in widths of the picture.

    `pose` is a camera-to-world matrix: 16 numbers, row by row, for column vectors; it looks along −z with +y up. With
    `pair` the camera is one of a pair on the stage, which cannot be moved apart; `interaxial` is the usual distance.
    `bounces` are those of the picture, and those that the stage or a room usually has.
    """

    name: str
    cameras: list[str]
    frames: tuple[float, float] | None
    fps: float
    layers: list[str]
    displays: list[str]
    controls: list[ControlGroup]
    pose: list[float] | None
    focal: float
    up: Literal["Y", "Z"]
    stereo: Eyes | None
    pair: bool
    interaxial: float
    bounces: tuple[int, int]
    presets: list[PresetItem]


class ValuesMessage(Answer, tag="values"):
    """Values that changed; `restored` edits are those that an earlier studio did not save."""

    values: dict[str, Any]
    authored: dict[str, bool]
    canUndo: bool  # noqa: N815 - a name of JavaScript
    canRedo: bool  # noqa: N815
    saved: bool
    restored: bool


class ProblemText(Struct):
    """Why there is no picture: the attribute, and the column of its text, if they are known."""

    text: str
    path: str | None
    column: int | None


class StateMessage(Answer, tag="state"):
    """How far the picture is."""

    version: int
    passes: int
    planned: int
    seconds: float
    busy: bool
    problem: ProblemText | None


class BeamPart(Struct):
    """The radiance of a light's beams in a pixel, and its fraction of that of all beams."""

    light: str
    group: str
    radiance: Triple
    fraction: float


class RuleCurves(Struct):
    """What one kind of quadrature gives for each number of points in `n`."""

    n: list[int]
    points: list[list[float]]
    values: list[list[float]]
    error: list[float]


class RayIntegral(Struct):
    """How the light of the brightest beam is integrated along a pixel's ray."""

    estimator: Literal["1D", "2D"]
    interval: tuple[float, float]
    radius: tuple[float, float]
    length: float
    s: list[float]
    integrand: list[float]
    gauss: RuleCurves
    riemann: RuleCurves


class PixelMessage(Answer, tag="pixel"):
    """What is in a pixel."""

    at: tuple[float, float]
    layers: dict[str, list[float]]
    beams: list[BeamPart]
    ray: RayIntegral | None


class RenderMessage(Answer, tag="render"):
    """How far the final picture is; then the address of its file, or the path where it was `written`."""

    done: int
    of: int
    file: str | None
    written: str | None
    problem: str | None


class EstimateMessage(Answer, tag="estimate"):
    """About how long all frames take, in seconds, and how much memory, in bytes; or why that is not known."""

    number: int
    seconds: float | None
    memory: float | None
    problem: str | None


class Applied(Answer, tag="applied"):
    """A preset was applied for this page."""

    path: str
    look: str


class Kept(Answer, tag="kept"):
    """The look at a path is in the library now, by a name."""

    path: str
    label: str


class Changed(Answer, tag="changed"):
    """Another program has changed the file of the edits: they are in a copy now or, if that is None, not saved."""

    file: str
    copy: str | None


class Refused(Answer, tag="refused"):
    """What a page asked for was refused."""

    text: str


Answers = (
    SceneMessage
    | ValuesMessage
    | StateMessage
    | PixelMessage
    | RenderMessage
    | EstimateMessage
    | Applied
    | Kept
    | Changed
    | Refused
)


class PictureHeader(Struct):
    """What precedes a picture; with a `scale` below 1 it is a preview, to be drawn as large as the full picture.

    A `compared` one is the other layer of the picture that comes next.
    """

    version: int
    passes: int
    planned: int
    layer: str
    width: int
    height: int
    scale: float
    mime: str
    frame: float | None = None
    compared: bool = False


_DECODER: msgspec.json.Decoder[Messages] = msgspec.json.Decoder(Messages)


class Malformed(Exception):  # noqa: N818 - an error of the page, not of this program
    """A message does not follow the protocol; the text says why."""


def decoded(text: str | bytes) -> Messages:
    """Return the message in a page's JSON; raise Malformed for anything else, and SceneError for text with NUL."""
    if len(text) > LONGEST:
        raise Malformed(f"the message has {len(text):,} bytes: expected {LONGEST:,} at most")
    if "\\u0000" in str(text):
        raise SceneError("a text of the message holds the character NUL, which no name has: expected none")
    try:
        message = _DECODER.decode(text)
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise Malformed(f"the message does not follow the protocol: {error}"[:300]) from None
    if isinstance(message, Set) and len(message.values) > MOST_VALUES:
        raise Malformed(f"the message sets {len(message.values)} values: expected {MOST_VALUES} at most")
    return message


def encoded(message: Answers) -> str:
    """Return a message to pages as JSON; infinite numbers and NaN become null."""
    return msgspec.json.encode(message).decode()


def framed(header: PictureHeader, payload: bytes) -> bytes:
    """Return a picture with its header: 4 bytes of the header's length, the header, and the picture's bytes."""
    text = msgspec.json.encode(header)
    return len(text).to_bytes(4, "little") + text + payload
