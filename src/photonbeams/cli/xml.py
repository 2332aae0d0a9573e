"""`photonbeams render scene.xml`: render a Mitsuba scene with photon beams."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import typer

from ..images.numbering import PLACEHOLDER
from .animation import Task, frame_numbers
from .asked import Asked
from .job import Job, layers_with
from .outputs import check_outputs
from .programs import load_looks

if TYPE_CHECKING:
    from ..shot.scene_shot import SceneShot

#: Flags for Mitsuba scenes; all others are only for stages.
FLAGS = {
    "scene", "output", "picture", "layers", "frames", "camera", "list_cameras", "res", "res_scale", "crop", "tile",
    "passes", "time_limit", "error", "denoise", "keep_noisy", "beams", "bounces", "estimator", "rule", "order",
    "gather", "gather_error", "pixel_filter", "overrides", "exposure", "auto_exposure",
    "seed", "threads", "device", "progress", "dry_run", "quiet", "verbose", "skip_existing", "checkpoint", "resume",
    "snapshot", "pass_range", "workers", "scheduler", "tls_ca", "tls_cert", "tls_key", "look", "group",
    "session_layer", "stereo", "interaxial", "convergence", "view", "holdout", "holdout_channel", "holdout_depth",
    "holdout_scale", "over", "over_fog",
}  # fmt: skip


def check_given(context: typer.Context) -> None:
    """Refuse flags that are only for stages."""
    flags = {each.name: each.opts[0] for each in context.command.params}
    for name in context.params:
        source = getattr(context.get_parameter_source(name), "name", "")
        if source == "COMMANDLINE" and name not in FLAGS:
            raise typer.BadParameter(f"{flags[name]} is for stages: a Mitsuba scene (.xml) has no use for it")


class MitsubaJob(Job):
    """A Mitsuba scene, and what the flags ask of it."""

    _shot: SceneShot

    def __init__(self, asked: Asked, check: Callable[[], None]) -> None:
        from ..shot.scene_shot import SceneShot

        self._asked = asked
        self._numbers = frame_numbers(asked.frames, asked.outputs)
        if len(self._numbers) > 1 and not PLACEHOLDER.search(asked.path.name):
            raise typer.BadParameter(f"--frames is {asked.frames}: expected one run of # in {asked.path.name}, too")
        self._shot = SceneShot(
            asked.path, asked.camera, asked.stereo, load_looks("--look", asked.looks), _pairs("--group", asked.groups),
            parameters=_pairs("--set", asked.overrides), session_layers=asked.session_layers,
        )  # fmt: skip
        self._shot.load(self._numbers[0])

    def cameras(self) -> list[str]:
        """Return the names of all sensors."""
        return self._shot.names

    def tasks(self) -> list[Task]:
        """Return the frames and their files, and set `settings`."""
        asked = self._asked
        if not asked.dry_run:
            check_outputs(asked.outputs)
        self._size = self._resolution()
        self.settings = replace(
            asked.quality.over(self._shot.settings()), normals=asked.wants("normal"), albedo=asked.wants("albedo")
        )
        return [self._task(number) for number in self._numbers]

    def _task(self, number: float | None) -> Task:
        name = self._asked.path.stem if number is None else f"{number:.10g}"
        return Task(number, name, tuple(each.numbered(number or 0.0) for each in self._asked.outputs))

    def _resolution(self) -> tuple[int, int]:
        asked = self._asked
        width, height = self._shot.size(asked.res[0] or None, asked.res[1] or None)
        return max(1, round(asked.res_scale * width)), max(1, round(asked.res_scale * height))

    def layers(self, first: Task) -> Sequence[str]:
        """Return the names of the layers that a frame has."""
        return layers_with(self._shot.layer_names(), self.settings)

    def check(self, first: Task, todo: Sequence[Task]) -> None:
        """In a dry run, raise what rendering would raise; otherwise rendering itself raises it early enough."""
        if self._asked.dry_run:
            self._shot.check_scene(self.settings)

    def seen(self, first: Task) -> str:
        """Return a description of the picture: scene, sensor and size."""
        (width, height), shot = self._size, self._shot
        return f"{self._asked.path} seen by {shot.sensor.id() or shot.names[0]}, {width} x {height} pixels"

    @property
    def _given(self) -> dict[str, Any]:
        """The arguments of `Shot.render` for all frames."""
        (width, height), asked = self._size, self._asked
        return {
            "settings": self.settings, "width": width, "height": height, "crop": asked.crop_of(width, height),
            "view": asked.view, "holdout": asked.plates.end(), "over": asked.plates.plate(),
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
