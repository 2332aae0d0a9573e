"""Subjects of shots: a stage, a scene built in Python, or a Mitsuba scene, and what each shows in a frame."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from ..images.color_spaces import USUAL_SPACES, ColorSpaces
from ..looks import Look
from ..runtime.files import PathLike, check_kept
from ..scene import MOST_PIXELS, SceneError, instance, number, shown, whole
from ..usd.authoring.beams import write_beams

if TYPE_CHECKING:
    from pxr import Usd

    from .. import scene
    from ..beams.programs import Program
    from ..beams.sets import BeamSet
    from ..images.plates import Holdout, Plate
    from ..render.frame import FrameRenderer
    from ..render.settings import Settings
    from ..usd.cameras.stereo import Stereo
    from ..usd.common.motion import Exposure
    from ..usd.common.warnings import Warnings
    from ..world.cameras.cameras import View, Window
    from ..world.shutter import Shutter
    from .request import FrameRequest, Prepared


T = TypeVar("T", bound=PathLike)

#: Why arguments are refused.
FOR_STAGES = "is for stages: a Mitsuba scene (.xml) has no use for it"
FOR_SCENES = "is for Mitsuba scenes: expected attributes of a stage's lights, such as photonbeams:lightGroup"


def looks_by_name(looks: Look | Mapping[str, Look] | None) -> dict[str, Look]:
    """Return looks by the names or paths that they are for, "" being all; SceneError for anything else."""
    by_name = looks if isinstance(looks, Mapping) else {} if looks is None else {"": looks}
    for name, look in by_name.items():
        if not isinstance(look, Look):
            expected = "a Look" if name else "a Look, or a dict of Looks by the names of lights"
            raise SceneError(f"looks is {shown(look)}{f' for {name}' if name else ''}: expected {expected}")
    return {str(name): look for name, look in by_name.items()}


class Viewpoint(NamedTuple):
    """A camera of a subject, by name or as it is, and how it becomes two eyes; None: it does not."""

    camera: Any
    stereo: Stereo | None


@dataclass(frozen=True)
class FrameContent:
    """What a subject shows in a frame: from here on a frame is rendered without asking which subject it is of."""

    groups: Mapping[str, str]  # the layer of each light group
    views: Sequence[View | None]  # cameras within the rendered window; None for a sensor that is no camera
    headers: Sequence[Mapping[str, Any]]  # metadata for each view, beside those of its camera, the window and the seed
    render: Callable[[Prepared], FrameRenderer]  # returns the frame with its passes
    shutter: Shutter  # of a Mitsuba scene, the cameras alone
    viewers: Callable[[], Sequence[scene.Camera]]  # returns the cameras of all frames, for which emission is guided
    names: Callable[[], Mapping[str, Sequence[str]]]  # returns the names in cryptomattes, by their layers
    memory: Callable[[Window, Settings], int]  # returns the bytes of a pass; SceneError if there are fewer
    program: Program | None = None


class Subject(ABC):
    """What a shot shows. Frames are numbers; None is a stage's start or default time. Methods raise SceneError."""

    name: str  # the beginning of messages about the whole
    warnings: Warnings  # about it so far

    @property
    def spaces(self) -> ColorSpaces:
        """The colour space in which light is computed, and that of files which name none."""
        return USUAL_SPACES

    @abstractmethod
    def check_viewpoint(self, viewpoint: Viewpoint) -> None:
        """Raise SceneError for a camera that is of the wrong type."""

    def number(self, frame: float | None) -> float:
        """Return the number of a frame, as it appears in file names."""
        return 0.0 if frame is None else number(frame, "frame")

    @abstractmethod
    def settings(self, viewpoint: Viewpoint, frame: float | None) -> Settings:
        """Return the settings that the subject itself has."""

    @abstractmethod
    def cameras(self, viewpoint: Viewpoint, frame: float | None) -> tuple[scene.Camera, ...]:
        """Return the camera, or those of the left and the right eye."""

    def camera_names(self, viewpoint: Viewpoint, frame: float | None) -> list[str]:
        """Return the name of the camera, or the different names of two eyes."""
        return [*dict.fromkeys(each.name for each in self.cameras(viewpoint, frame))]

    def check(  # noqa: B027 (most subjects have nothing to check)
        self, viewpoint: Viewpoint, frame: float | None, settings: Settings
    ) -> None:  # fmt: skip
        """Raise SceneError if something cannot be rendered with these settings, as far as a quick look can tell."""

    @abstractmethod
    def resolution(
        self, viewpoint: Viewpoint, frame: float | None, width: int | None, height: int | None,
        plates: Sequence[Holdout | Plate], view: str | None, pixel_aspect: float,
    ) -> tuple[int, int]:  # fmt: skip
        """Return the width and height of a frame in pixels."""

    @abstractmethod
    def layers(self, viewpoint: Viewpoint, frame: float | None) -> list[str]:
        """Return the names of a frame's layers, in order; raise or warn if they would be black."""

    @abstractmethod
    def windows(self, viewpoint: Viewpoint, request: FrameRequest) -> tuple[Window, Window]:
        """Return what is shown of a frame, and what is rendered: the pixel filter needs more around it."""

    @abstractmethod
    def content(
        self, viewpoint: Viewpoint, request: FrameRequest, window: Window, views: Sequence[str]
    ) -> FrameContent:  # fmt: skip
        """Return what a frame shows in the rendered window, and warn of what is hardly meant so."""

    @abstractmethod
    def beams(
        self, viewpoint: Viewpoint, frame: float | None, views: Sequence[str], settings: Settings | None,
        given: Mapping[str, Any],
    ) -> list[BeamSet]:  # fmt: skip
        """Return the beams of a frame's first pass, with the `settings` and those `given` by name."""

    @abstractmethod
    def digest(self, viewpoint: Viewpoint, frame: float | None) -> str:
        """Return a hash of what a frame shows, with the files that it names."""

    def write_beams(self, beams: Sequence[scene.DrawnBeams], path: PathLike, frame: float | None) -> None:
        """Write beams with the subject's units and looks, if it has any."""
        write_beams(beams, path)

    def files(self, frames: Iterable[float | None]) -> Iterable[PathLike]:
        """Return the files from which the subject is read at some frames."""
        return ()

    def check_targets(self, paths: Iterable[PathLike], frame: float | None = None) -> None:
        """Raise SceneError for a file that the subject is read from."""
        check_kept(paths, self.files([frame]))

    # What only some subjects have.

    @property
    def stage(self) -> Usd.Stage:
        """The OpenUSD stage."""
        raise self._lacking("stage")

    def time(self, frame: float | None) -> Usd.TimeCode:
        """Return the time code of a frame."""
        raise self._lacking("time codes, which only stages have")

    def read(
        self, viewpoint: Viewpoint, frame: float | None, base: float | None
    ) -> tuple[scene.Scene, scene.Camera]:  # fmt: skip
        """Return the scene at a frame, with its looks built, and the camera."""
        raise self._lacking("content in plain numbers, as stages and scenes built in Python have")

    def exposure(self, viewpoint: Viewpoint, frame: float | None, blur: bool, lens: bool) -> Exposure:
        """Return the scene and the cameras over the shutter interval of a frame."""
        raise self._lacking("shutter: nothing in it moves")

    def _lacking(self, what: str) -> SceneError:
        return SceneError(f"{self.name}: it has no {what}")


def size_of(width: int | None, height: int | None, aspect: float | Fraction, usual: int) -> tuple[int, int]:
    """Return a size in pixels; what is None follows from the `aspect`, width over height, or is the `usual` width."""
    width, height = (
        None if value is None else whole(value, name, " of pixels")
        for name, value in (("width", width), ("height", height))
    )
    if width is None:
        width = usual if height is None else max(1, round(min(max(height, 0), MOST_PIXELS + 1) * aspect))
    if height is None:
        height = max(1, round(min(max(width, 0), MOST_PIXELS + 1) / aspect))
    if not (1 <= width <= MOST_PIXELS and 1 <= height <= MOST_PIXELS):
        raise SceneError(f"the resolution is {width} x {height}: expected 1 to {MOST_PIXELS} pixels each way")
    return width, height


def refuse(why: str, **given: Any) -> None:
    """Raise SceneError for arguments that a subject has no use for."""
    for name, value in given.items():
        if value:
            raise SceneError(f"{name} {why}")


def several(given: T | Iterable[T]) -> list[T]:
    """Return the texts or paths of an argument that may be a single one; SceneError for anything else."""
    found = [*given] if isinstance(given, Iterable) and not isinstance(given, str) else [given]
    for each in found:
        instance(each, "one of several arguments", str, os.PathLike)
    return found  # type: ignore[return-value]
