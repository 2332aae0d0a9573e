"""Scenes in Mitsuba's own format, rendered by the plug-in `photon_beams`, written as frames of shots are."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..images.frame import Frame
from ..runtime.digest import digest
from ..runtime.files import PathLike
from ..scene import SceneError
from ..usd.reading import LOG

if TYPE_CHECKING:
    from ..render.checkpoint import Checkpoint
    from ..render.passes import Progress
    from ..render.settings import Settings


class MitsubaScene:
    """A Mitsuba scene and one of its sensors.

    Parameters
    ----------
    path
        The .xml file.
    camera
        Name (id) or number of the sensor; None is the first.
    parameters
        Values of the file's own parameters ($name).

    Raises
    ------
    SceneError
        A file that Mitsuba cannot read, without sensors, or without the one that is asked for.
    """

    def __init__(self, path: PathLike, camera: str | None = None, parameters: Mapping[str, str] | None = None) -> None:
        from ..runtime.device import mitsuba

        mi = mitsuba()
        self.path, self._parameters = Path(path), dict(parameters or {})
        if not self.path.is_file():
            raise SceneError(f"{path}: no such file")
        try:
            self.plugin = mi.load_file(str(path), **(parameters or {}))
        except RuntimeError as error:
            raise SceneError(f"{path}: {_reason(str(error))}") from error
        if not isinstance(self.plugin, mi.Scene):
            raise SceneError(f"{path}: holds a {type(self.plugin).__name__}: expected a scene")
        self.cameras = [each.id() or f"sensor {index}" for index, each in enumerate(self.plugin.sensors())]
        self.sensor = self.plugin.sensors()[self._index(camera)]

    def _index(self, camera: str | None) -> int:
        if not self.cameras:
            raise SceneError(f"{self.path}: has no sensor: expected one")
        if camera is None:
            return 0
        names = {**{str(index): index for index in range(len(self.cameras))},
                 **{name: index for index, name in enumerate(self.cameras)}}  # fmt: skip
        if camera not in names:
            numbers = " or its number, 0" + (f" to {len(self.cameras) - 1}" if self.cameras[1:] else "")
            expected = f"{'one of ' if self.cameras[1:] else ''}{', '.join(self.cameras)},{numbers}"
            raise SceneError(f"{self.path}: has no sensor '{camera}': expected {expected}")
        return names[camera]

    def content(self) -> str:
        """Return a hash of the file, its parameters, and the files that they name."""
        return digest(self._parameters, _contents(self.path, self._parameters.values()))

    @property
    def settings(self) -> Settings:
        """The settings of the scene's own integrator, if that is `photon_beams`, with its sampler's passes."""
        from ..render.settings import Settings

        integrator = self.plugin.integrator()
        own = getattr(integrator, "settings", None)
        if own is None:
            LOG.info("%s: its integrator is not photon_beams, whose defaults are used instead", self.path)
        return replace(own or Settings(), passes=int(self.sensor.sampler().sample_count()))

    def resize(self, width: int | None, height: int | None, crop: Sequence[float] | None = None) -> tuple[int, int]:
        """Change the film's size in pixels, and which part of it (in fractions) is rendered; return the size."""
        from ..runtime.device import mitsuba

        mi = mitsuba()
        parameters = mi.traverse(self.sensor)
        size = [int(each) for each in parameters["film.size"]]
        if width or height:
            size = [width or max(1, round((height or 0) * size[0] / size[1])),
                    height or max(1, round((width or 0) * size[1] / size[0]))]  # fmt: skip
            parameters["film.size"] = size
            parameters["film.crop_size"], parameters["film.crop_offset"] = size, [0, 0]
        if crop is not None:
            x0, y0, x1, y1 = (each * size[number % 2] for number, each in enumerate(crop))
            left, top = int(x0), int(y0)
            parameters["film.crop_offset"] = [left, top]
            parameters["film.crop_size"] = [max(1, round(x1) - left), max(1, round(y1) - top)]
        parameters.update()
        return size[0], size[1]

    def check(self, settings: Settings) -> None:
        """Raise SceneError where something in the scene cannot be rendered."""
        from ..render.scene_frame import SceneFrame

        SceneFrame(self.plugin, self.sensor, replace(settings, guiding=False))

    def render(
        self,
        settings: Settings,
        progress: Progress | None = None,
        checkpoint: PathLike | Checkpoint | None = None,
    ) -> Frame:
        """Render a frame: layers rgba, surface, beams and depth; see `Shot.render` for the checkpoint."""
        from importlib.metadata import version

        from ..render.checkpoint import Checkpoint
        from ..render.scene_frame import render
        from ..world.sensors import Sensor

        kept = Checkpoint.of(checkpoint)
        content = "" if kept is None else self.content()
        passes = render(self.plugin, self.sensor, settings, progress, kept, content)
        film = self.sensor.film()
        (width, height), (left, top) = (tuple(map(int, each)) for each in (film.size(), film.crop_offset()))
        crop = [int(each) for each in film.crop_size()]
        view = Sensor(self.sensor).view
        metadata: dict[str, Any] = {
            **(view.matrices() if view is not None else {}),
            "software": f"photonbeams {version('photonbeams')}",
            "scene": self.path.name,
            "camera": self.sensor.id() or self.cameras[0],
            "seed": settings.seed,
            "passes": passes.statistics.passes,
            "displayWindow": (0, 0, width - 1, height - 1),
            "dataWindow": (left, top, left + crop[0] - 1, top + crop[1] - 1),
        }
        return Frame(passes.layers(), metadata, passes.statistics)


def _contents(path: Path, more: Iterable[str]) -> list[bytes]:
    """Return the bytes of a scene's file, and of the files that it names: textures, volumes, meshes, other scenes."""
    todo, found = [path, *(path.parent / each for each in sorted(more))], dict[Path, bytes]()
    for place in todo:  # which grows
        if place in found or not os.path.isfile(place):  # of what is no name at all, Path.is_file raises an error
            continue
        found[place] = place.read_bytes()
        if place.suffix == ".xml":
            names = re.findall(rb'"([^"<>]+)"', found[place])
            todo += [path.parent / name.decode("utf-8", "replace") for name in names]
    return [*found.values()]


def _reason(text: str) -> str:
    """Return what Mitsuba says of a file in one line, without where in its own code or in ours that was."""
    text = re.sub(r"^\[[\w.]+:\d+\]\s*", "", text.strip())
    text, _, trace = text.partition("Traceback (most recent call last):")
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    if trace:  # of a plug-in in Python: its last line that is not indented is the error, "Class: what is wrong"
        last = [line for line in trace.splitlines() if re.match(r"[\w.]+: ", line)]
        lines.append(last[-1].partition(": ")[2] if last else "")
    return " ".join(lines)[:500].strip()
