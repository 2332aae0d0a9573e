"""`photonbeams render scene.xml`: render a Mitsuba scene with photon beams."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import typer

from ..images.numbering import PLACEHOLDER
from .animation import Task, frame_numbers
from .job import Job, layers_with
from .outputs import check_outputs
from .programs import load_looks
from .request import RenderRequest


class MitsubaJob(Job):
    """A Mitsuba scene, and what the flags ask of it."""

    def __init__(self, request: RenderRequest, check: Callable[[], None]) -> None:
        from ..shot import Shot
        from ..shot.scene_subject import SceneSubject

        self._request = request
        self._numbers = frame_numbers(request.files.frames, request.outputs)
        if len(self._numbers) > 1 and not PLACEHOLDER.search(request.scene.name):
            raise typer.BadParameter(
                f"--frames is {request.files.frames}: expected one run of # in {request.scene.name}, too"
            )
        self._scene = SceneSubject(
            request.scene, load_looks("--look", request.looks.look or ()), _pairs("--group", request.looks.group or ()),
            parameters=_pairs("--set", request.looks.overrides or ()), session_layers=request.looks.session_layer or (),
        )  # fmt: skip
        self._shot = Shot(self._scene, request.views.camera or None, stereo=request.eyes.eyes())
        self._camera, _ = self._scene.sensor(self._shot.viewpoint, self._numbers[0])

    def cameras(self) -> list[str]:
        """Return the names of all sensors."""
        return [*self._scene.sensors(self._numbers[0])]

    def tasks(self) -> list[Task]:
        """Return the frames and their files, and set `settings`."""
        request = self._request
        if not request.shown.dry_run:
            check_outputs(request.outputs)
        self._size = self._resolution()
        self.settings = replace(
            request.settings.over(self._shot.settings(self._numbers[0])),
            normals=request.wants("normal"),
            albedo=request.wants("albedo"),
        )
        return [self._task(number) for number in self._numbers]

    def _task(self, number: float | None) -> Task:
        name = self._request.scene.stem if number is None else f"{number:.10g}"
        return Task(number, name, tuple(each.numbered(number or 0.0) for each in self._request.outputs))

    def _resolution(self) -> tuple[int, int]:
        request = self._request
        size = request.views.res
        width, height = self._shot.resolution(size[0] or None, size[1] or None, self._numbers[0])
        return max(1, round(request.views.res_scale * width)), max(1, round(request.views.res_scale * height))

    def layers(self, first: Task) -> Sequence[str]:
        """Return the names of the layers that a frame has."""
        return layers_with(self._scene.layers(self._shot.viewpoint, first.number), self.settings)

    def check(self, first: Task, todo: Sequence[Task]) -> None:
        """In a dry run, raise what rendering would raise; otherwise rendering itself raises it early enough."""
        if self._request.shown.dry_run:
            self._scene.check(self._shot.viewpoint, first.number, self.settings)

    def seen(self, first: Task) -> str:
        """Return a description of the picture: scene, sensor and size."""
        width, height = self._size
        return f"{self._request.scene} seen by {self._camera}, {width} x {height} pixels"

    @property
    def _given(self) -> dict[str, Any]:
        """The arguments of `Shot.render` for all frames."""
        (width, height), request = self._size, self._request
        return {
            "settings": self.settings, "width": width, "height": height, "crop": request.views.crop_of(width, height),
            "view": request.eyes.eye, "holdout": request.plates.end(), "over": request.plates.plate(),
        }  # fmt: skip


def _pairs(flag: str, texts: Sequence[str]) -> dict[str, str]:
    """Return the values that a flag gives, by name."""
    result = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not name or not equals:
            expected = "NAME=VALUE, a parameter of the .xml" if flag == "--set" else "EMITTER=NAME, such as lamp=key"
            raise typer.BadParameter(f"{flag} is {text}: expected {expected}")
        result[name] = value
    return result
