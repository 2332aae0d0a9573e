"""`photonbeams render stage.usda`: render frames of a stage."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from .animation import Task, frame_numbers, tasks_of
from .asked import Asked
from .job import Job, layers_with
from .outputs import check_outputs
from .programs import load_function, load_looks

if TYPE_CHECKING:
    from ..images.plates import Holdout, Plate
    from ..usd.settings import RenderSettings


class StageJob(Job):
    """A stage, and what the flags ask of it; `check` raises KeyboardInterrupt for a delayed Ctrl-C."""

    _own: RenderSettings

    def __init__(self, asked: Asked, check: Callable[[], None]) -> None:
        from ..usd.common.warnings import Warnings
        from ..usd.render_passes import apply_pass
        from ..usd.stage import enable_domes, open_stage

        self._asked, self._check = asked, check
        self._numbers = frame_numbers(asked.frames, asked.outputs)
        check()
        self._warnings = Warnings(asked.strict)
        self._stage = open_stage(
            asked.path, asked.session_layers, asked.overrides, self._warnings, asked.texture_limit,
            asked.selection.selection(),
        )  # fmt: skip
        if asked.dome_beams:
            enable_domes(self._stage)
        self._settings_path = asked.render_settings
        if asked.render_pass is not None:
            own = apply_pass(self._stage, asked.render_pass, self._warnings)
            self._settings_path = asked.render_settings or own
        self._end, self._plate = asked.plates.end(), asked.plates.plate()

    def cameras(self) -> list[str]:
        """Return the paths of all cameras."""
        from ..usd.stage import list_cameras

        return list_cameras(self._stage)

    def tasks(self) -> list[Task]:
        """Return the frames and their files, and set `settings` from the render settings and the flags."""
        from ..render.settings import Settings
        from ..shot import Shot
        from ..usd.layers.frames import check_frames

        asked = self._asked
        check_frames(self._stage, [number for number in self._numbers if number is not None])
        self._check()
        own = self._own = self._render_settings()
        if not asked.dry_run:
            check_outputs(asked.outputs or own.products)
        self._shot = Shot(
            self._stage, asked.camera or own.camera, medium=asked.fog.over, stereo=asked.stereo,
            simulate=load_function("--simulate", asked.simulate), emit=load_function("--emit", asked.emit),
            looks=load_looks("--look", asked.looks), strict=asked.strict,
        )  # fmt: skip
        normals, albedo = (asked.wants(layer, own.products) for layer in ("normal", "albedo"))
        self.settings = asked.quality.over(Settings(pixel_filter=own.pixel_filter, normals=normals, albedo=albedo))
        anywhere = bool(asked.render_settings) or asked.allow_paths
        return tasks_of(self._shot, self._numbers, asked.outputs, own.products, anywhere=anywhere)

    def _render_settings(self) -> RenderSettings:
        """Return the stage's render settings, without warnings about values that flags replace."""
        from ..usd.settings import PIXEL_FILTER, read_settings

        asked = self._asked
        flags = {
            "camera": asked.camera, "resolution": any(asked.res), "dataWindowNDC": asked.crop,
            "products": asked.outputs, PIXEL_FILTER: asked.quality.pixel_filter,
        }  # fmt: skip
        given = [name for name, value in flags.items() if value]
        return read_settings(self._stage, self._settings_path, given, self._warnings)

    def layers(self, first: Task) -> list[str]:
        """Return the names of the layers that a frame has."""
        content, _ = self._shot.read(first.number)
        self._check()
        return layers_with(self._shot.check(content, first.number), self.settings)

    def check(self, first: Task, todo: Sequence[Task]) -> None:
        """Raise what rendering these frames would raise about the size of the picture and about plates."""
        plates = [each for each in (self._end, self._plate) if each is not None]
        self._size = self._resolution(first.number, plates)
        for task in todo:
            self._shot.check_plates(plates, task.number, *self._size, self._asked.view)

    def _resolution(self, number: float | None, plates: Sequence[Holdout | Plate]) -> tuple[int, int]:
        """Return width and height in pixels."""
        asked, shot = self._asked, self._shot
        wanted = asked.res if any(asked.res) else self._own.resolution or asked.res
        aspect = self._own.pixel_aspect
        width, height = shot.resolution(wanted[0] or None, wanted[1] or None, number, plates, asked.view, aspect)
        scale = asked.res_scale
        return shot.resolution(max(1, round(scale * width)), max(1, round(scale * height)), number)

    def seen(self, first: Task) -> str:
        """Return a description of the picture: scene, camera and size."""
        width, height = self._size
        seen_by = " and ".join(dict.fromkeys(each.name for each in self._shot.cameras(first.number)))
        return f"{self._asked.path} seen by {seen_by}, {width} x {height} pixels"

    @property
    def _given(self) -> dict[str, Any]:
        """The arguments of `Shot.render` for all frames."""
        (width, height), asked, own = self._size, self._asked, self._own
        return {
            "settings": self.settings, "width": width, "height": height,
            "crop": asked.crop_of(width, height, own.crop(width, height)),
            "pixel_aspect": own.pixel_aspect, "conform": own.conform,
            "view": asked.view, "holdout": self._end, "over": self._plate, "blur": not own.disable_motion_blur,
            "lens": not own.disable_depth_of_field,
        }  # fmt: skip
