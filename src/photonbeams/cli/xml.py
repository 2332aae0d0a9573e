"""`photonbeams render scene.xml`: a Mitsuba scene by photon beams."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import typer

from .animation import Task
from .asked import Asked
from .outputs import check_outputs

if TYPE_CHECKING:
    from ..images.frame import Frame
    from ..render.checkpoint import Checkpoint
    from ..render.passes import Progress
    from ..render.settings import Settings

LAYERS = ("rgba", "surface", "beams", "depth")

#: Flags that a Mitsuba scene has a use for; the others are about stages.
FLAGS = {
    "scene", "output", "picture", "layers", "camera", "list_cameras", "res", "res_scale", "crop", "passes",
    "time_limit", "beams", "bounces", "estimator", "rule", "order", "pixel_filter", "overrides", "exposure", "seed",
    "threads", "device", "progress", "dry_run", "quiet", "verbose", "skip_existing", "checkpoint", "resume",
}  # fmt: skip


def check_given(context: typer.Context) -> None:
    """Refuse flags that are about stages."""
    flags = {each.name: each.opts[0] for each in context.command.params}
    for name in context.params:
        source = getattr(context.get_parameter_source(name), "name", "")
        if source == "COMMANDLINE" and name not in FLAGS:
            raise typer.BadParameter(f"{flags[name]} is for stages: a Mitsuba scene (.xml) has no use for it")


class MitsubaJob:
    """A Mitsuba scene, and what the flags ask of it."""

    settings: Settings
    _size: tuple[int, int]

    def __init__(self, asked: Asked, check: Callable[[], None]) -> None:
        from ..shot.mitsuba import MitsubaScene

        self._asked = asked
        self._scene = MitsubaScene(asked.path, asked.camera, _parameters(asked.overrides))

    def cameras(self) -> list[str]:
        """Return the names of all sensors."""
        return self._scene.cameras

    def tasks(self) -> list[Task]:
        """Return the one frame and its files; `settings` are known then."""
        asked = self._asked
        if not asked.dry_run:
            check_outputs(asked.outputs)
        width, height = self._scene.resize(asked.res[0] or None, asked.res[1] or None)
        scale = asked.res_scale
        self._size = self._scene.resize(max(1, round(scale * width)), max(1, round(scale * height)), asked.crop)
        self.settings = asked.quality.over(self._scene.settings)
        return [Task(None, asked.path.stem, tuple(asked.outputs))]

    def layers(self, first: Task) -> Sequence[str]:
        """Return the names of the layers that a frame has."""
        return LAYERS

    def check(self, first: Task, todo: Sequence[Task]) -> None:
        """Raise, of a dry run, what rendering would raise; else that is soon enough known."""
        if self._asked.dry_run:
            self._scene.check(self.settings)

    def seen(self, first: Task) -> str:
        """Return what is rendered, by which sensor, and how large."""
        (width, height), scene = self._size, self._scene
        return f"{self._asked.path} seen by {scene.sensor.id() or scene.cameras[0]}, {width} x {height} pixels"

    def render(self, task: Task, progress: Progress, checkpoint: Checkpoint | None) -> Frame:
        """Return the frame."""
        return self._scene.render(self.settings, progress, checkpoint)


def _parameters(texts: Sequence[str]) -> dict[str, str]:
    """Return the file's parameters that flags give."""
    result = {}
    for text in texts:
        name, _, value = text.partition("=")
        if not name or not _:
            raise typer.BadParameter(f"--set is {text}: expected NAME=VALUE, a parameter of the .xml")
        result[name] = value
    return result
