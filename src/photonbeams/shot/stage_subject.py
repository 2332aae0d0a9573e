"""Stages as subjects of shots: read once for each time, and again as far as an edit of the stage demands."""

from __future__ import annotations

import weakref
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import scene
from ..images.color_spaces import ColorSpaces
from ..runtime.digest import digest
from ..runtime.files import PathLike
from ..usd import stage as stages
from ..usd.authoring.beams import write_beams
from ..usd.authoring.editing import Extent, extent_of
from ..usd.cameras.camera import read_shutter
from ..usd.cameras.stereo import read_eyes, split
from ..usd.common.color_spaces import spaces_of
from ..usd.common.motion import Exposure
from ..usd.common.openusd import UsdGeom
from ..usd.common.reading import Reading, file_of, frame_number
from ..usd.common.textures import FILES
from ..usd.groups import groups_at_all_times, makers_at_all_times, names_fog
from ..usd.layers.frames import check_frames
from ..usd.layers.header import header
from ..usd.media.volumes import warn_of_velocities
from ..usd.unread import warn_of_unread
from .described_subject import DescribedSubject, ShotBounds
from .lent import lent_view, lit
from .subject import Viewpoint

if TYPE_CHECKING:
    from pxr import Usd

    from ..scene.places import Origin

# The most time samples of a stage that are searched for those within the shutter interval.
_MOST_KEYS = 10_000

# The most times on a stage at which emission is guided toward what the camera sees.
_VIEWERS = 9

# The number of times for which the content of the stage is cached until the stage changes.
_CONTENTS = 4


class StageSubject(DescribedSubject):
    """A `Usd.Stage`, and the parameters of `DescribedSubject`. Its camera is the path or the name of a prim."""

    def __init__(self, stage: Any, *arguments: Any) -> None:
        super().__init__(*arguments)
        stages.check_stage(stage)
        self._stage: Usd.Stage = stage
        warn_of_unread(stage, self.warnings)
        self._stage_digest: str | None = None
        self._all_groups: frozenset[str] | None = None
        self._bounds: dict[Viewpoint, ShotBounds] = {}  # of everything at all times
        self._view: scene.Camera | None = None  # that is lent to a stage without a camera
        self._lasting: dict[Any, Any] = {}  # what does not change with time on the stage
        self._edited = False  # whether the stage was: until then no time is read twice, and scenes are not cached
        self._contents: dict[Any, scene.Scene] = {}  # scenes that were read last, by times; their looks may be outdated
        self._current: set[Any] = set()  # times of those that are not, and that nothing was wrong with
        self._surfaces: dict[Any, dict[str, Any]] = {}  # the surfaces that were read last, by time
        self._listener = self._listening()

    def _listening(self) -> Any:
        """Return a listener that clears the caches, as far as necessary, when the stage changes."""
        own = weakref.ref(self)  # the subject keeps the listener, which must not keep the subject

        def forget(notice: Any, stage: Any) -> None:
            subject, extent = own(), extent_of(notice, stage)
            if subject is None:
                return
            subject._stage_digest, subject._edited = None, True
            subject._current.clear()
            if extent >= Extent.VALUES:
                subject._all_groups = None
                subject._contents.clear()
            if extent >= Extent.PLACES:
                subject._bounds.clear()
                subject._view = None
            if extent >= Extent.SURFACES:
                subject._surfaces = {}
            if extent >= Extent.ALL:
                subject._lasting.clear()

        return forget, stages.listener(self.stage, forget)  # which does not keep `forget`

    def __repr__(self) -> str:
        return repr(Path(self.name).name)

    def __getstate__(self) -> dict[str, Any]:
        """Raise SceneError: OpenUSD's stages cannot be pickled or copied."""
        raise scene.SceneError(f"{self!r} cannot be pickled: expected Shot.open with its arguments where it is needed")

    @property
    def stage(self) -> Usd.Stage:
        """The OpenUSD stage."""
        return self._stage

    @property
    def name(self) -> str:  # type: ignore[override]
        """The name of the stage's file, with its folder."""
        return file_of(self.stage)

    @property
    def rate(self) -> float:  # type: ignore[override]
        """Time codes in a second."""
        return float(self.stage.GetTimeCodesPerSecond())

    @property
    def up(self) -> str:  # type: ignore[override]
        """The name of the stage's up axis, "Y" or "Z"."""
        return stages.up_axis_name(self.stage)

    def check_viewpoint(self, viewpoint: Viewpoint) -> None:
        """Raise SceneError for a camera that is no name."""
        if not (viewpoint.camera is None or isinstance(viewpoint.camera, str)):
            text = "expected the path or the name of a camera of the stage"
            raise scene.SceneError(f"camera is {viewpoint.camera!r}: {text}")

    def time(self, frame: float | None) -> Usd.TimeCode:
        """Return the time code of a frame."""
        return stages.default_time(self.stage) if frame is None else stages.time_code(frame)

    def number(self, frame: float | None) -> float:
        """Return the number of a frame, as it appears in file names."""
        return frame_number(self.time(frame))

    def cameras(self, viewpoint: Viewpoint, frame: float | None) -> tuple[scene.Camera, ...]:
        """Return the camera, or those of the left and the right eye."""
        if viewpoint.stereo is None:
            return (self._camera(viewpoint, frame),)
        if self._lends_view(viewpoint):
            meters = float(UsdGeom.GetStageMetersPerUnit(self.stage))
            return split(self._camera(viewpoint, frame), viewpoint.stereo, meters, self.name)
        return read_eyes(self.stage, viewpoint.camera, viewpoint.stereo, self.time(frame), self.warnings)

    def exposure(self, viewpoint: Viewpoint, frame: float | None, blur: bool, lens: bool) -> Exposure:
        """Return the scene and the cameras over the shutter interval of a frame."""
        time = self.time(frame)
        begin, end = (0.0, 0.0) if self._lends_view(viewpoint) else read_shutter(self.stage, viewpoint.camera, time)
        base = frame_number(time)

        def read(code: float) -> scene.Scene:
            content, _ = self.read(viewpoint, None, None) if time.IsDefault() else self.read(viewpoint, code, base)
            return content.within(self._bounds_of(viewpoint, content).sphere)

        def cameras(code: float) -> tuple[scene.Camera, ...]:
            found = self.cameras(viewpoint, None if time.IsDefault() else code)
            return found if lens else tuple(replace(camera, lens_radius=0.0) for camera in found)

        # Without blur the shutter is the interval [0, 0], as UsdRenderSettings has it.
        start, stop = (base + begin, base + end) if blur else (base, base)
        keys = stages.sample_times(self.stage, _MOST_KEYS) if start < stop else []
        keys = [code for code in keys if start < code <= stop]
        if start < stop:
            warn_of_velocities(self.stage, self.warnings)
        return Exposure(read, cameras, start, stop, keys)

    def digest(self, viewpoint: Viewpoint, frame: float | None) -> str:
        """Return a hash of what a frame shows: the stage with its files, the time, and the arguments from Python."""
        if self._stage_digest is None:
            self._stage_digest = stages.stage_digest(self.stage)
        return digest(self._stage_digest, str(self.time(frame)), self._arguments(viewpoint))

    def files(self, frames: Iterable[float | None]) -> Iterable[PathLike]:
        """Return the files from which the stage is read at any time, and images that were read so far."""
        return chain(stages.files_of(self.stage), self._lasting.get(FILES, ()))

    def write_beams(self, beams: Sequence[scene.DrawnBeams], path: PathLike, frame: float | None) -> None:
        """Write beams, with the units and the looks of the stage."""
        names = {id(look): name for name, (_, look) in self._looks.items()}
        looks = {each.name: names[id(each.look)] for each in beams if id(each.look) in names}
        write_beams(beams, path, like=self.stage, looks=looks, time=self.time(frame))

    def _content(self, frame: float | None, base: float | None) -> scene.Scene:
        time = self.time(frame)
        if not self._edited:
            return stages.read_scene(self.stage, time, self.warnings, base, self._lasting)
        key = (None if time.IsDefault() else time.GetValue(), base)  # as text, times that differ little would be one
        last, content = self._contents.get(key), None
        if last is not None and key in self._current:
            return last
        before = len(self.warnings.given)
        if last is not None:  # at most looks were edited since it was read
            content = stages.with_looks(self.stage, time, last, self.warnings)
        if content is None:
            if key not in self._surfaces:
                self._surfaces = {key: {}}
            surfaces = self._surfaces[key]
            content = stages.read_scene(self.stage, time, self.warnings, base, self._lasting, surfaces)
        self._contents = {**dict([*self._contents.items()][-_CONTENTS:]), key: content}
        if len(self.warnings.given) == before:  # else they are given again: what is wrong stays wrong
            self._current = {*self._current, key} & self._contents.keys()
        return content

    def read(
        self, viewpoint: Viewpoint, frame: float | None, base: float | None
    ) -> tuple[scene.Scene, scene.Camera]:  # fmt: skip
        """Return the scene at a frame, with its looks built, and the camera; a light is lent where there is none."""
        content, camera = super().read(viewpoint, frame, base)
        if self.emit is None:
            content = lit(Reading(self.stage, self.time(frame), self.warnings), content, camera)
        return content, camera

    def _lends_view(self, viewpoint: Viewpoint) -> bool:
        return viewpoint.camera is None and not stages.list_cameras(self.stage)

    def _camera(self, viewpoint: Viewpoint, frame: float | None) -> scene.Camera:
        if self._lends_view(viewpoint):
            if self._view is None:  # one for all frames, which sees them all
                from ..world.bounds import box_of_states

                states, _ = stages.states_at_all_times(
                    self.stage, self._outlines(None), self._outlines, lambda _: (), emits=self.emit is not None
                )
                self._view = lent_view(self, "camera", box_of_states(states), self.up)
            return self._view
        return stages.read_camera(self.stage, viewpoint.camera, self.time(frame), self.warnings)

    def _bounds_of(self, viewpoint: Viewpoint, content: scene.Scene) -> ShotBounds:
        if viewpoint not in self._bounds:
            # Computed once, so that beams do not change when something moves elsewhere.
            self._bounds[viewpoint] = ShotBounds.of(*stages.states_at_all_times(
                self.stage, content, self._outlines, lambda frame: self.cameras(viewpoint, frame),
                emits=self.emit is not None,
            ))  # fmt: skip
        return self._bounds[viewpoint]

    def _origin(self, viewpoint: Viewpoint, content: scene.Scene, cameras: Sequence[scene.Camera]) -> Origin:
        return self._bounds_of(viewpoint, content).origin

    def _outlines(self, frame: float | None) -> scene.Scene:
        """Return a scene that is as large as the one at a frame, but is faster to read."""
        return self._with_arguments(stages.read_extent(self.stage, self.time(frame), self._lasting), frame)

    def _groups(self, content: scene.Scene) -> frozenset[str]:
        if self._all_groups is None:
            self._all_groups = groups_at_all_times(self.stage)
        return self._all_groups

    def _makers(self) -> set[str]:
        return makers_at_all_times(self.stage)

    def _names_fog(self, frame: float | None) -> bool:
        return names_fog(self.stage, self.time(frame))

    def _viewers(self, viewpoint: Viewpoint) -> list[scene.Camera]:
        times: list[float | None] = [*stages.sample_times(self.stage, _VIEWERS)] or [None]
        return [replace(camera, lens_radius=0.0) for time in times for camera in self.cameras(viewpoint, time)]

    def _check_frame(self, frame: float | None) -> None:
        if frame is not None and not self.time(frame).IsDefault():
            check_frames(self.stage, [self.number(frame)])

    @property
    def spaces(self) -> ColorSpaces:
        """Those of the stage: see `spaces_of`."""
        return spaces_of(self.stage)

    def _header(self, frame: float | None, duration: float) -> dict[str, Any]:
        return header(self.stage, self.time(frame), duration)
