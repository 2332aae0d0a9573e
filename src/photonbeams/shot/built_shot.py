"""Shots of scenes that were built in Python: rendered like stages on which nothing moves."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NoReturn

import numpy as np

from .. import scene
from ..runtime.digest import digest
from ..runtime.files import PathLike
from ..usd.authoring.beams import write_beams
from ..usd.cameras.stereo import Stereo, check_stereo, split
from ..usd.common.motion import Exposure
from ..usd.layers.header import origin
from .shot import Shot


class BuiltShot(Shot):
    """A `scene.Scene` seen by a `scene.Camera`, or by two eyes; it takes the parameters of `Shot`.

    The frame number is used in file names, by `emit`, and by looks that change with time.

    Raises
    ------
    SceneError
        A camera that is no `scene.Camera`, or an argument that `Shot` does not take.
    """

    camera: scene.Camera

    def _set_content(self, stage: Any) -> None:
        if not isinstance(self.camera, scene.Camera):
            raise scene.SceneError(f"camera is {self.camera!r}: expected a scene.Camera, such as Camera.look_at(...)")
        self.scene: scene.Scene = stage

    def __repr__(self) -> str:
        return f"BuiltShot({len(self.scene.meshes)} meshes, {len(self.scene.lights)} lights, {self.camera.name!r})"

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__

    @property
    def stage(self) -> NoReturn:  # type: ignore[override]
        """Raise SceneError: there is no stage."""
        raise scene.SceneError("the scene was built in Python: it has no stage")

    def time(self, frame: float | None = None) -> NoReturn:
        """Raise SceneError: time codes are a stage's."""
        raise scene.SceneError("the scene was built in Python: it has no time codes, only numbers of frames")

    def look_through(self, camera: Any, stereo: Stereo | None = None) -> None:
        """Change the `camera` and its eyes, `stereo`."""
        check_stereo(stereo)
        self.camera, self.stereo = camera, stereo
        self._set_content(self.scene)

    def _read(self, frame: float | None, base: float | None) -> tuple[scene.Scene, scene.Camera]:
        return self.scene, self.camera

    @property
    def _place(self) -> str:
        return "the scene"

    def _makers(self) -> set[str]:
        return set()

    def _groups_at_all_times(self) -> frozenset[str]:
        return self.scene.groups

    def cameras(self, frame: float | None = None) -> tuple[scene.Camera, ...]:
        """Return the camera, or those of the left and the right eye."""
        if self.stereo is None:
            return (self.camera,)
        return split(self.camera, self.stereo, 1.0, f"camera {self.camera.name}")

    def exposure(self, frame: float | None = None, blur: bool = True, lens: bool = True) -> Exposure:
        """Return the scene and the cameras, which do not move; if `lens` is False, everything is in focus."""
        from ..world.bounds import bounding_sphere

        cameras = self.cameras(frame)
        if not lens:
            cameras = tuple(replace(each, lens_radius=0.0) for each in cameras)
        content = self.read(frame)[0]
        eyes = [np.asarray(each.to_world)[:3, 3] for each in cameras]
        content = replace(content, bounds=content.bounds or bounding_sphere([content], eyes))
        number = self._number(frame)
        return Exposure(lambda _: content, lambda _: cameras, number, number)

    def viewers(self) -> list[scene.Camera]:
        """Return the cameras."""
        return list(self.cameras())

    def content(self, frame: float | None = None) -> str:
        """Return a hash of what a `frame` shows."""
        return digest(self.scene, self._number(frame), self._arguments)

    def _check_frame(self, frame: float | None) -> None:
        pass

    def _check_target(self, path: PathLike) -> None:
        pass

    def _write(self, found: list[scene.DrawnBeams], path: PathLike, frame: float | None) -> None:
        write_beams(found, path)

    def _rate(self) -> float:
        return 1.0

    def _time_header(self, frame: float | None, exposure: Exposure) -> dict[str, Any]:
        return origin("", frame)

    def _number(self, frame: float | None) -> float:
        return 0.0 if frame is None else scene.real(frame, "frame")
