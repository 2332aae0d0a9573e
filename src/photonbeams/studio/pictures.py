"""What a session shows, and what its listeners get: pictures, or why there is none."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ..images.color_spaces import REC709
from ..scene import Array, SceneError, whole
from ..scene.declared import typed
from ..usd.cameras.stereo import Stereo

if TYPE_CHECKING:
    from ..render.passes import Statistics

# The most that a view may ask for: a page must not be able to fill the memory.
_MOST_PIXELS, _MOST_PASSES, _MOST_BOUNCES = 1 << 23, 1 << 16, 1 << 16


@typed
@dataclass(frozen=True)
class SessionView:
    """What a session shows; a page may set all of it.

    Attributes
    ----------
    width, height
        Pixels of the whole picture.
    frame
        The frame number; None: the stage's start.
    camera
        The camera's path; None: the shot's own.
    pose
        (4, 4) transform to the world of a free camera; None: the camera is where the stage has it.
    area
        x0, y0, x1, y1 in fractions of the picture from the top left: the part that is rendered; None: all. The rest of
        the picture stays as it was, or is black.
    lens, blur
        As for `Shot.render`.
    solo
        Paths of the only lights that shine; empty: all shine.
    paused
        Whether rendering is paused.
    passes
        Passes of the finished picture.
    stereo
        How the camera becomes two eyes; None: it does not.
    denoise
        Whether pictures are denoised; after 16 passes, only every eighth is shown then. The finished one never is.
    bounces
        As `--bounces`, -1: no limit; None: those of the stage, or 3 if it has none and the first picture is of a room.
    """

    width: int = 480
    height: int = 270
    frame: float | None = None
    camera: str | None = None
    pose: Array | None = None
    area: tuple[float, float, float, float] | None = None
    lens: bool = True
    blur: bool = True
    solo: tuple[str, ...] = ()
    paused: bool = False
    passes: int = 64
    stereo: Stereo | None = None
    denoise: bool = True
    bounces: int | None = None

    def check(self) -> None:
        """Raise SceneError for numbers out of range."""
        if self.width * self.height > _MOST_PIXELS:
            raise SceneError(f"the size is {self.width} x {self.height}: expected {_MOST_PIXELS:,} pixels at most")
        if not 1 <= whole(self.passes, "passes") <= _MOST_PASSES:
            raise SceneError(f"passes is {self.passes}: expected 1 to {_MOST_PASSES}")
        if self.bounces is not None and not -1 <= whole(self.bounces, "bounces") <= _MOST_BOUNCES:
            raise SceneError(f"bounces is {self.bounces}: expected 0 to {_MOST_BOUNCES}, or -1 for no limit")


@dataclass(frozen=True)
class Picture:
    """A picture of a session, as listeners get it.

    Attributes
    ----------
    version
        The number of the edit or change of view that the picture shows, as `Session.edit` and `Session.show` return it.
    layers
        (H, W, C) float32 by name, as in a `Frame`; for two eyes those of the left one.
    passes, planned
        How many passes the picture has, and how many the finished one will have.
    scale
        Its width over that of the finished picture, up to 1.
    statistics
        How it was rendered.
    views
        For two eyes the layers of each, by the names "left" and "right". Empty for a single camera.
    is_first
        Whether it is the quick first picture after an edit, of few pixels and few light paths.
    frame
        The frame number that it shows, as in its view.
    space
        The linear colour space of the layers.

    Examples
    --------
    >>> from photonbeams.render.passes import Statistics
    >>> layers = {"rgba": np.zeros((18, 32, 4), np.float32)}
    >>> picture = pb.studio.Picture(version=3, layers=layers, passes=8, planned=64, scale=1.0, statistics=Statistics())
    >>> picture.is_finished
    False

    A session makes them: see `Session`.
    """

    version: int
    layers: Mapping[str, Array]
    passes: int
    planned: int
    scale: float
    statistics: Statistics
    views: Mapping[str, Mapping[str, Array]] = field(default_factory=dict)
    is_first: bool = False
    frame: float | None = None
    space: str = REC709

    @property
    def is_finished(self) -> bool:
        """Whether this is the last picture of its version."""
        return not self.is_first and self.passes == self.planned


@dataclass(frozen=True)
class Problem:
    """Why a version has no picture.

    Attributes
    ----------
    version, text
        The version, and a sentence that says what is wrong.
    path, column
        The attribute that the sentence is about, and the column in its expression that is wrong, from 1; None: unknown.
    """

    version: int
    text: str
    path: str | None = None
    column: int | None = None

    @classmethod
    def of(cls, version: int, text: str, edited: Sequence[str]) -> Problem:
        """Return the problem that `text` describes; it may name one of the attributes that were `edited`."""
        path = max((each for each in edited if each in text), key=len, default=None)
        column = re.search(r"column (\d+)", text)
        return cls(version, text, path, None if column is None else int(column[1]))
