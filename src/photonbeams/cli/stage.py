"""`photonbeams render stage.usda`: render frames of a stage."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from .animation import Task, frame_numbers, tasks_of
from .job import Job, layers_with
from .outputs import check_outputs
from .programs import load_looks
from .request import RenderRequest

if TYPE_CHECKING:
    from ..images.plates import Holdout, Plate
    from ..usd.settings import RenderSettings


class StageJob(Job):
    """A stage, and what the flags ask of it; `check` raises KeyboardInterrupt for a delayed Ctrl-C."""

    _own: RenderSettings

    def __init__(self, request: RenderRequest, check: Callable[[], None]) -> None:
        from ..usd.common.warnings import Warnings
        from ..usd.render_passes import apply_pass
        from ..usd.stage import enable_domes, open_stage

        self._request, self._check = request, check
        self._numbers = frame_numbers(request.files.frames, request.outputs)
        check()
        self._warnings = Warnings(request.stage.strict)
        layers = request.looks.session_layer or (), request.looks.overrides or ()
        limit, selection = request.stage.texture_limit, request.stage.selection.selection()
        self._stage = open_stage(request.scene, *layers, self._warnings, limit, selection)
        if request.stage.dome_beams:
            enable_domes(self._stage)
        self._settings_path = request.stage.render_settings
        if request.stage.render_pass is not None:
            own = apply_pass(self._stage, request.stage.render_pass, self._warnings)
            self._settings_path = request.stage.render_settings or own
        self._end, self._plate = request.plates.end(), request.plates.plate()

    def cameras(self) -> list[str]:
        """Return the paths of all cameras."""
        from ..usd.stage import list_cameras

        return list_cameras(self._stage)

    def tasks(self) -> list[Task]:
        """Return the frames and their files, and set `settings` from the render settings and the flags."""
        from ..render.settings import Settings
        from ..shot import Shot
        from ..usd.layers.frames import check_frames

        request = self._request
        check_frames(self._stage, [number for number in self._numbers if number is not None])
        self._check()
        own = self._own = self._render_settings()
        if not request.shown.dry_run:
            check_outputs(request.outputs or own.products)
        self._shot = Shot(
            self._stage, request.views.camera or own.camera, medium=request.stage.fog.over, stereo=request.eyes.eyes(),
            **request.stage.programs.loaded(),
            looks=load_looks("--look", request.looks.look or ()), strict=request.stage.strict,
        )  # fmt: skip
        normals, albedo = (request.wants(layer, own.products) for layer in ("normal", "albedo"))
        self.settings = request.settings.over(Settings(pixel_filter=own.pixel_filter, normals=normals, albedo=albedo))
        anywhere = bool(request.stage.render_settings) or request.stage.allow_paths
        return tasks_of(self._shot, self._numbers, request.outputs, own.products, anywhere=anywhere)

    def _render_settings(self) -> RenderSettings:
        """Return the stage's render settings, without warnings about values that flags replace."""
        from ..usd.settings import PIXEL_FILTER, read_settings

        request = self._request
        flags = {
            "camera": request.views.camera, "resolution": any(request.views.res), "dataWindowNDC": request.views.crop,
            "products": request.outputs, PIXEL_FILTER: "filter" in request.settings.values,
        }  # fmt: skip
        given = [name for name, value in flags.items() if value]
        return read_settings(self._stage, self._settings_path, given, self._warnings)

    def layers(self, first: Task) -> list[str]:
        """Return the names of the layers that a frame has."""
        names = self._shot.subject.layers(self._shot.viewpoint, first.number)
        self._check()
        return layers_with(names, self.settings)

    def check(self, first: Task, todo: Sequence[Task]) -> None:
        """Raise what rendering these frames would raise about the size of the picture and about plates."""
        from ..usd.cameras.stereo import views_of

        plates = [each for each in (self._end, self._plate) if each is not None]
        self._size = self._resolution(first.number, plates)
        views = views_of(self._shot.stereo, self._request.eyes.eye)
        for task in todo:
            for plate in plates:
                plate.check(self._shot.subject.number(task.number), views, self._size)

    def _resolution(self, number: float | None, plates: Sequence[Holdout | Plate]) -> tuple[int, int]:
        """Return width and height in pixels."""
        request, shot = self._request, self._shot
        wanted = request.views.res if any(request.views.res) else self._own.resolution or request.views.res
        aspect = self._own.pixel_aspect
        width, height = shot.resolution(wanted[0] or None, wanted[1] or None, number, plates, request.eyes.eye, aspect)
        scale = request.views.res_scale
        return shot.resolution(max(1, round(scale * width)), max(1, round(scale * height)), number)

    def seen(self, first: Task) -> str:
        """Return a description of the picture: scene, camera and size."""
        width, height = self._size
        seen_by = " and ".join(dict.fromkeys(each.name for each in self._shot.cameras(first.number)))
        return f"{self._request.scene} seen by {seen_by}, {width} x {height} pixels"

    @property
    def _given(self) -> dict[str, Any]:
        """The arguments of `Shot.render` for all frames."""
        (width, height), request, own = self._size, self._request, self._own
        return {
            "settings": self.settings, "width": width, "height": height,
            "crop": request.views.crop_of(width, height, own.crop(width, height)),
            "pixel_aspect": own.pixel_aspect, "conform": own.conform,
            "view": request.eyes.eye, "holdout": self._end, "over": self._plate, "blur": not own.disable_motion_blur,
            "lens": not own.disable_depth_of_field,
        }  # fmt: skip
