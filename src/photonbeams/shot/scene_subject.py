"""Scenes in Mitsuba's own format as subjects of shots; their frames are like those of stages."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import scene
from ..images.frame import pixels_of
from ..images.numbering import PLACEHOLDER, numbered
from ..images.plates import Holdout, Plate
from ..looks.tint import tinted
from ..render import scene_frame
from ..render.films.layers import layer_names
from ..render.films.pixel_filters import margin_of, reconstruction_filter
from ..render.seen.surfaces import names_of, wholes
from ..render.settings import Settings
from ..runtime.device import mitsuba
from ..runtime.digest import digest
from ..runtime.files import PathLike
from ..scene import SceneError
from ..scene.cameras import CONFORM_POLICIES
from ..usd.cameras.stereo import EYES, split
from ..usd.common.reading import LOG
from ..usd.common.warnings import Warnings
from ..usd.layers.header import origin
from ..usd.looks.shading import build_look
from ..usd.scene_layers import SceneLayers
from ..usd.stage import files_of
from ..world.bounds import box_around
from ..world.cameras.cameras import Window
from ..world.cameras.sensors import Sensor, camera_of, window_of
from ..world.emitters import mitsuba_scene
from ..world.shutter import Shutter
from .lent import lent_view
from .scene_files import named_files
from .scene_loading import check_scene, load
from .subject import FrameContent, Subject, Viewpoint, looks_by_name, several, size_of

if TYPE_CHECKING:
    from ..beams.sets import BeamSet
    from ..looks import Look
    from ..render.frame import FrameRenderer
    from .request import FrameRequest, Prepared

# The max_depth of Mitsuba's integrators that do not limit the length of paths.
_ANY_DEPTH = 0xFFFFFFFF


class SceneSubject(Subject):
    """A Mitsuba scene; its cameras are ids or numbers of sensors, None is the first.

    `source` is a scene that Mitsuba has loaded, a dictionary for `mi.load_dict`, or an .xml file; a run of # in the
    name is its frame number. The rest is as for `Shot`; arguments are stronger than layers.
    """

    def __init__(
        self,
        source: Any,
        looks: Look | Mapping[str, Look] | None = None,
        groups: Mapping[str, str] | None = None,
        beams: Mapping[str, scene.BeamSettings] | None = None,
        parameters: Mapping[str, str] | None = None,
        session_layers: PathLike | Iterable[PathLike] = (),
    ) -> None:
        self.path = Path(source) if isinstance(source, str | os.PathLike) else None
        self.name = str(self.path or "the scene")
        self.warnings = Warnings()
        self._source = source if self.path or isinstance(source, Mapping) else None  # from which it can be loaded
        self._parameters = dict(parameters or {})
        self._arguments = looks, groups or {}, beams or {}
        self._beams = _beams(*self._arguments, self.warnings.give)
        self._session_layers = several(session_layers)
        self._layers = SceneLayers(self._session_layers) if self._session_layers else None
        self._layered: tuple[Path | None, float | None] | None = None  # file and frame for which the layers were read
        self._looks: dict[str, Look] = {}
        self._open: tuple[Path | None, Any] = (None, None if self.path else check_scene(source))
        self._lent: tuple[Any, Any] = (None, None)  # the sensor that a scene without one gets, and this scene

    def __repr__(self) -> str:
        return repr(str(self.path or "a Mitsuba scene"))

    def __reduce__(self) -> Any:
        """Return how a copy is made: by loading the scene again. SceneError for one that only Mitsuba has."""
        if self._source is None:
            raise SceneError("a scene that Mitsuba has loaded cannot be pickled: expected Shot.open of its file")
        return type(self), (self._source, *self._arguments, self._parameters, self._session_layers)

    def load(self, frame: float | None = None) -> Any:
        """Return Mitsuba's scene of a frame, and set the variant in which it was loaded."""
        path = self.path and numbered(self.path, self.number(frame))
        if self._open[1] is None or self._open[0] != path:
            assert path is not None
            # Mitsuba's optimization merges meshes, which then lose their ids.
            named = self._layers is not None or any(isinstance(each.portal, str) for each in self._beams.values())
            self._open = path, load(path, self._parameters, merge=not named)
        plugin = self._open[1]
        mitsuba(plugin.variant_name())
        if self._layers is not None and self._layered != (path, frame):
            settings = self._layer_settings(plugin, self._layers, frame)
            self._beams = _beams(*self._arguments, self.warnings.give, settings)
            self._layered = path, frame
        return plugin

    def _layer_settings(
        self, plugin: Any, layers: SceneLayers, frame: float | None
    ) -> dict[str, scene.BeamSettings]:  # fmt: skip
        """Return the beam settings of layers by the ids of emitters; equal looks are built once, and share kernels."""
        names = [name for each in plugin.emitters() for name in mitsuba_scene.names_of(each)]
        result = {}
        for name, fields in layers.read(frame, names, [each.id() for each in plugin.shapes()]).items():
            spec = fields.pop("look")
            key = digest(spec)
            if spec is not None and key not in self._looks:
                self._looks[key] = build_look(spec)
            result[name] = scene.BeamSettings(**fields, look=self._looks.get(key))
        return result

    def sensors(self, frame: float | None = None) -> dict[str, Any]:
        """Return the sensors by their ids."""
        sensors = self.load(frame).sensors() or [self._view(frame)]
        return {sensor.id() or f"sensor {index}": sensor for index, sensor in enumerate(sensors)}

    def _view(self, frame: float | None) -> Any:
        """Return the sensor that is lent to a scene without one, which sees all of it."""
        plugin = self.load(frame)
        if self._lent[0] is not plugin:
            mi, box = mitsuba(), box_around(plugin)
            corners = [np.array(each, dtype=float) for each in (box.min, box.max)]
            view = lent_view(self, "sensor", corners if box.valid() else None)
            away = float(np.linalg.norm(view.to_world[:3, 3] - 0.5 * (corners[0] + corners[1])))
            to_world = mi.ScalarTransform4f(view.to_world @ np.diag([-1.0, 1.0, -1.0, 1.0]))
            clipping = {"near_clip": 1e-4 * away, "far_clip": 1e4 * away}
            fov = 2 * np.degrees(np.arctan(0.5 * view.horizontal_aperture / view.focal_length))
            self._lent = (
                plugin,
                mi.load_dict({"type": "perspective", "id": view.name, "fov": fov, "to_world": to_world, **clipping}),
            )
        return self._lent[1]

    def sensor(self, viewpoint: Viewpoint, frame: float | None = None) -> tuple[str, Any]:
        """Return the sensor of a viewpoint, and its id."""
        sensors, name = self.sensors(frame), viewpoint.camera
        ids = [*sensors]
        if name is None:
            name = ids[0]
        by_name = {**{str(index): each for index, each in enumerate(ids)}, **{each: each for each in ids}}
        name = str(name)
        if name not in by_name:
            numbers = " or its number, 0" + (f" to {len(ids) - 1}" if ids[1:] else "")
            expected = f"{'one of ' if ids[1:] else ''}{', '.join(ids)},{numbers}"
            raise SceneError(f"{self.name}: has no sensor '{name}': expected {expected}")
        sensor = sensors[by_name[name]]
        width, height = sensor.film().size()
        size_of(int(width), int(height), 1, 1)  # refuses a film without pixels, of which there is no camera
        return by_name[name], sensor

    def check_viewpoint(self, viewpoint: Viewpoint) -> None:
        """Load the scene, unless its file depends on the frame, and find the sensor."""
        if self.path is None or not PLACEHOLDER.search(self.path.name):
            self.sensor(viewpoint)

    def settings(self, viewpoint: Viewpoint, frame: float | None) -> Settings:
        """Return the settings of the scene's integrator, with its sampler's passes.

        If it is not `photon_beams`, or is nested in `aov` or `moment`, only the depths are taken, from its text form.
        """
        _, sensor = self.sensor(viewpoint, frame)
        integrator = self.load(frame).integrator()
        own = getattr(integrator, "settings", None)
        if own is None:
            shown = re.findall(r"\b(max_depth|rr_depth) = (\d+)", str(integrator))
            depths: dict[str, Any] = {name: -1 if int(number) == _ANY_DEPTH else int(number) for name, number in shown}
            own = Settings(**depths, hide_emitters=bool(getattr(integrator, "hide_emitters", False)))
            LOG.info("%s: its integrator is not photon_beams: only the depths of its paths are used", self.path)
        return replace(own, passes=int(sensor.sampler().sample_count()))

    def cameras(self, viewpoint: Viewpoint, frame: float | None) -> tuple[scene.Camera, ...]:
        """Return the sensor as a camera, or the cameras of two eyes; SceneError for a sensor that is no camera."""
        name, sensor = self.sensor(viewpoint, frame)
        camera = camera_of(sensor)
        if camera is None:
            raise SceneError(f"sensor {name}: is no camera: expected a perspective one")
        if viewpoint.stereo is None:
            return (camera,)
        return split(camera, viewpoint.stereo, 1.0, f"sensor {camera.name}")

    def camera_names(self, viewpoint: Viewpoint, frame: float | None) -> list[str]:
        """Return the id of the sensor."""
        return [self.sensor(viewpoint, frame)[0]]

    def resolution(
        self, viewpoint: Viewpoint, frame: float | None, width: int | None, height: int | None,
        plates: Sequence[Holdout | Plate], view: str | None, pixel_aspect: float,
    ) -> tuple[int, int]:  # fmt: skip
        """Return the size in pixels; a missing one follows from the film, both are the film's."""
        columns, rows = (int(each) for each in self.sensor(viewpoint, frame)[1].film().size())
        return size_of(width, height, Fraction(columns, rows), columns)

    def layers(self, viewpoint: Viewpoint, frame: float | None) -> list[str]:
        """Return the names of a frame's layers."""
        return layer_names(scene_frame.groups_of(self.load(frame), self._beams))

    def windows(self, viewpoint: Viewpoint, request: FrameRequest) -> tuple[Window, Window]:
        """Return the film's own crop window, unless a size or a crop is asked for, and what is rendered for that."""
        if (request.pixel_aspect, request.conform) != (1.0, CONFORM_POLICIES[0]):
            raise SceneError("pixel_aspect and conform are for stages: a Mitsuba scene (.xml) has square pixels")
        _, sensor = self.sensor(viewpoint, request.frame)
        if not (request.width or request.height or request.crop is not None):
            window = window_of(sensor.film())
            return window, window
        size = self.resolution(viewpoint, request.frame, request.width, request.height, (), None, 1.0)
        window = Window(*size, pixels_of(request.crop, *size))
        if request.crop is None:
            return window, window
        reconstruction = reconstruction_filter(request.settings.filter_name, sensor.film().rfilter())
        return window, window.grown(margin_of(reconstruction))

    def content(
        self, viewpoint: Viewpoint, request: FrameRequest, window: Window, views: Sequence[str]
    ) -> FrameContent:  # fmt: skip
        """Return what a frame shows in the rendered window."""
        if request.settings.motion:
            raise SceneError("motion is a layer of stages: a Mitsuba scene (.xml) does not say how things move")
        plugin, (name, sensor) = self.load(request.frame), self.sensor(viewpoint, request.frame)
        cameras: Sequence[scene.Camera] = ()  # which replace the sensor
        with _resized(sensor, Window.full(window.width, window.height)):  # a camera's aperture is that of a whole film
            if viewpoint.stereo or not request.lens or camera_of(sensor):
                both = self.cameras(viewpoint, request.frame)
                cameras = [both[EYES.index(view) if view else 0] for view in views]
        if not request.lens:
            cameras = [replace(camera, lens_radius=0.0) for camera in cameras]
        with _resized(sensor, window):
            seen = [Sensor(sensor, camera).view for camera in cameras] or [Sensor(sensor).view]
        beams, warned = self._beams, self.warnings.given

        def rendered(ready: Prepared) -> FrameRenderer:
            extras = scene_frame.Extras(beams, cameras, ready.holdouts)
            with _resized(sensor, ready.window):
                return scene_frame.render(plugin, sensor, ready.settings, ready.run, ready.digest, warned, extras)

        header = {**origin(self.path.name if self.path else "", request.frame), "camera": name}
        still = Shutter.still(scene.Scene(), *cameras)
        return FrameContent(
            groups=scene_frame.groups_of(plugin, beams),
            views=seen,
            headers=[header] * len(views),
            render=rendered,
            shutter=still,
            viewers=lambda: cameras,
            names=lambda: names_of(wholes(plugin)),
            memory=lambda window, chosen: scene_frame.memory_of(plugin, window, chosen, beams),
        )

    def beams(
        self, viewpoint: Viewpoint, frame: float | None, views: Sequence[str], settings: Settings | None,
        given: Mapping[str, Any],
    ) -> list[BeamSet]:  # fmt: skip
        """Return the beams of a frame's first pass. The light of all emitters is traced, unless `method` says else."""
        own = self.settings(viewpoint, frame) if settings is None else settings
        eyes = [self.cameras(viewpoint, frame)[EYES.index(view)] for view in views if view]
        begun = self._begun(viewpoint, frame, Settings.of(own, {"method": "beams", **given}), eyes)
        return begun.light.traced(0, lambda: None).sets

    def check(self, viewpoint: Viewpoint, frame: float | None, settings: Settings) -> None:
        """Raise SceneError if something in the scene cannot be rendered with these settings; no pilot runs."""
        method = "paths" if settings.method == "auto" else settings.method
        self._begun(viewpoint, frame, replace(settings, guiding=False, method=method))

    def _begun(
        self, viewpoint: Viewpoint, frame: float | None, settings: Settings, eyes: Sequence[scene.Camera] = ()
    ) -> FrameRenderer:  # fmt: skip
        """Return a frame without passes."""
        _, sensor = self.sensor(viewpoint, frame)
        extras = scene_frame.Extras(self._beams, eyes)
        return scene_frame.begin(self.load(frame), sensor, settings, self.warnings.given, extras)

    def digest(self, viewpoint: Viewpoint, frame: float | None) -> str:
        """Return a hash of the file of a frame, its parameters, and the files that they name; "" without a file."""
        if self.path is None:
            return ""
        path = numbered(self.path, self.number(frame))
        return digest(self._parameters, [each.read_bytes() for each in named_files(path, self._parameters).files])

    def files(self, frames: Iterable[float | None]) -> Iterator[PathLike]:
        """Yield the files from which the scene is read at some frames, and those of its layers."""
        paths = {numbered(self.path, self.number(frame)) for frame in frames} if self.path else ()
        for path in filter(os.path.exists, paths):
            yield from named_files(path, self._parameters).files
        if self._layers is not None:
            yield from files_of(self._layers.stage)


@contextmanager
def _resized(sensor: Any, window: Window) -> Iterator[None]:
    """Change the size of a sensor's film in pixels, and which part of it is rendered, within the context."""
    parameters = mitsuba().traverse(sensor)
    names = "film.size", "film.crop_size", "film.crop_offset"
    own = [list(map(int, parameters[name])) for name in names]
    wanted = [[window.width, window.height], [*window.shape[::-1]], [*window.crop[:2]]]

    def change(values: Sequence[Sequence[int]]) -> None:
        for name, value in zip(names, values, strict=True):
            parameters[name] = list(value)
        parameters.update()

    if wanted == own:
        yield
        return
    try:
        change(wanted)
        yield
    finally:
        change(own)


def _beams(
    looks: Look | Mapping[str, Look] | None,
    groups: Mapping[str, str],
    beams: Mapping[str, scene.BeamSettings],
    warn: Callable[[str], None],
    layers: Mapping[str, scene.BeamSettings] | None = None,
) -> dict[str, scene.BeamSettings]:
    """Return the beam settings by the ids of emitters; those given in Python are stronger than those of layers."""
    by_name = looks_by_name(looks)
    for name, said in beams.items():
        if not isinstance(said, scene.BeamSettings):
            raise SceneError(f"beams of {name or 'all'} are {said!r}: expected BeamSettings")
    result = {**(layers or {}), **beams}
    for name in {*by_name, *groups, *result}:
        own = result.get(name, scene.BeamSettings())
        chosen = by_name.get(name) or own.look or by_name.get("")
        result[name] = replace(own, look=chosen, group=groups.get(name, own.group))
        if chosen is not None:
            result[name] = tinted(result[name], name or "every emitter", warn)
    return result


def values_by_name(
    texts: Iterable[str], before: str, expected: str = "NAME=VALUE, a parameter of the .xml"
) -> dict[str, str]:
    """Return the values of texts NAME=VALUE, by name; SceneError, which begins with `before`, for another text."""
    result = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not name or not equals:
            raise SceneError(f"{before} {text}: expected {expected}")
        result[name] = value
    return result
