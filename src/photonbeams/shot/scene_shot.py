"""Shots of scenes in Mitsuba's own format, seen by a sensor or by two eyes; their frames are like those of stages."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, Unpack

from .. import scene
from ..images.frame import pixels_of
from ..images.numbering import PLACEHOLDER, numbered
from ..runtime.digest import digest
from ..runtime.files import PathLike
from ..runtime.messages import reason
from ..scene import SceneError
from ..scene.cameras import CONFORM_POLICIES
from ..scene.checks import shortened
from ..usd.authoring.beams import write_beams
from ..usd.cameras.stereo import EYES, Stereo, check_stereo, split, views_of
from ..usd.common.reading import LOG
from ..usd.common.warnings import Warnings
from ..usd.layers.header import origin
from ..usd.scene_layers import SceneLayers
from ..usd.stage import check_not_read
from .old_scenes import version_of
from .scene_files import check_files
from .scene_loading import load
from .shot import Shot

if TYPE_CHECKING:
    from ..beams.sets import BeamSet
    from ..images.plates import Holdout, Plate
    from ..looks import Look
    from ..render.frame import FrameRenderer
    from ..render.settings import Settings, SettingsArguments
    from ..world.cameras.cameras import Window
    from .development import Development
    from .request import FrameRequest

# The max_depth of Mitsuba's integrators that do not limit the length of paths.
_ANY_DEPTH = 0xFFFFFFFF


class SceneShot(Shot):
    """A Mitsuba scene seen by one of its sensors, or by two eyes.

    Parameters
    ----------
    subject
        A scene that Mitsuba has loaded, a dictionary for `mi.load_dict`, or an .xml file; a run of # in its name is the
        frame number.
    camera
        Name (id) or number of the sensor; None is the first.
    stereo
        How the sensor becomes two eyes; None: one picture.
    looks, groups
        Looks by the ids of emitters or of their shapes, or one look for all; light groups by the same ids.
    beams
        All settings of beams, by the same ids: see `scene.BeamSettings`.
    session_layers
        USD layers with the same settings, on prims that are named by these ids; arguments are stronger.
    parameters
        Values of the file's own parameters ($name).

    Raises
    ------
    SceneError
        A file that Mitsuba cannot read, or a scene without sensors or without the one that was asked for.
    """

    def __init__(
        self,
        subject: Any,
        camera: str | None = None,
        stereo: Stereo | None = None,
        looks: Look | Mapping[str, Look] | None = None,
        groups: Mapping[str, str] | None = None,
        beams: Mapping[str, scene.BeamSettings] | None = None,
        parameters: Mapping[str, str] | None = None,
        session_layers: PathLike | Iterable[PathLike] = (),
    ) -> None:
        check_stereo(stereo)
        self.path = Path(subject) if isinstance(subject, str | os.PathLike) else None
        self._subject = subject if self.path or isinstance(subject, Mapping) else None  # from which it can be loaded
        if self.path is None:
            subject = _opened(subject)
        self.camera, self.stereo, self._parameters = camera, stereo, dict(parameters or {})
        self._given = looks, groups or {}, beams or {}
        self._beams = _beams(*self._given)
        layers = [session_layers] if isinstance(session_layers, str | os.PathLike) else [*session_layers]
        self._session_layers = layers
        self._layers = SceneLayers(layers) if layers else None
        self._layered: tuple[Path | None, float | None] | None = None  # file and frame for which the layers were read
        self._looks: dict[str, Look] = {}
        self._open: tuple[Path | None, Any] = (None, None if self.path else subject)
        self._warnings = Warnings()
        self._kept = {}
        if self.path is None or not PLACEHOLDER.search(self.path.name):
            self.load()

    def __repr__(self) -> str:
        what = self.path or "a Mitsuba scene"
        return f"SceneShot({str(what)!r}, camera={self.camera!r})"

    def __reduce__(self) -> Any:
        """Return how a copy is made: by loading the scene again. SceneError for one that only Mitsuba has."""
        if self._subject is None:
            raise SceneError("a scene that Mitsuba has loaded cannot be pickled: expected Shot.open of its file")
        own = self.camera, self.stereo, *self._given, self._parameters, self._session_layers
        return type(self), (self._subject, *own)

    def load(self, frame: float | None = None) -> Any:
        """Load the Mitsuba scene of a `frame` and its sensors, and return it."""
        path = self.path and numbered(self.path, self._number(frame))
        if self._open[1] is None or self._open[0] != path:
            assert path is not None
            self._open = path, self._loaded(path)
        self.plugin = self._open[1]
        self.names = [each.id() or f"sensor {index}" for index, each in enumerate(self.plugin.sensors())]
        self.sensor = self.plugin.sensors()[self._index(self.camera)]
        if self._layers is not None and self._layered != (path, frame):
            self._beams = _beams(*self._given, self._layer_settings(self._layers, frame))
            self._layered = path, frame
        return self.plugin

    def _layer_settings(self, layers: SceneLayers, frame: float | None) -> dict[str, scene.BeamSettings]:
        """Return the beam settings of layers by the ids of emitters; equal looks are built once, and share kernels."""
        from ..usd.looks.shading import build_look
        from ..world.emitters.scene_lamps import names_of

        names = [name for each in self.plugin.emitters() for name in names_of(each)]
        result = {}
        for name, fields in layers.read(frame, names, [each.id() for each in self.plugin.shapes()]).items():
            spec = fields.pop("look")
            key = digest(spec)
            if spec is not None and key not in self._looks:
                self._looks[key] = build_look(spec)
            result[name] = scene.BeamSettings(**fields, look=self._looks.get(key))
        return result

    def _loaded(self, path: Path) -> Any:
        from ..runtime.device import helping_thread, mitsuba

        mi = mitsuba()
        if not os.path.lexists(path):
            raise SceneError(f"{path}: no such file")
        try:
            check_files(path, self._parameters)
            # Mitsuba's optimization merges meshes, which then lose their ids.
            named = self._layers is not None or any(isinstance(each.portal, str) for each in self._beams.values())
            with helping_thread():
                plugin = load(path, self._parameters, merge=not named)
        except (RuntimeError, UnicodeDecodeError) as error:
            version = version_of(path)
            old = "" if version is None else f"; the scene is of Mitsuba {version}: expected one of Mitsuba 3"
            text = shortened(reason(_message(error), path), len(str(path)) + len(old) + 2)
            raise SceneError(f"{path}: {text}{old}") from None
        if not isinstance(plugin, mi.Scene):
            raise SceneError(f"{path}: holds a {type(plugin).__name__}: expected a scene")
        return plugin

    def _index(self, camera: str | None) -> int:
        if not self.names:
            raise SceneError(f"{self.path or 'the scene'}: has no sensor: expected one")
        if camera is None:
            return 0
        names = {**{str(index): index for index in range(len(self.names))},
                 **{name: index for index, name in enumerate(self.names)}}  # fmt: skip
        if camera not in names:
            numbers = " or its number, 0" + (f" to {len(self.names) - 1}" if self.names[1:] else "")
            expected = f"{'one of ' if self.names[1:] else ''}{', '.join(self.names)},{numbers}"
            raise SceneError(f"{self.path or 'the scene'}: has no sensor '{camera}': expected {expected}")
        return names[camera]

    def content(self, frame: float | None = None) -> str:
        """Return a hash of the file of a `frame`, its parameters, and the files that they name; "" without a file."""
        if self.path is None:
            return ""
        path = numbered(self.path, self._number(frame))
        return digest(self._parameters, _contents(path, self._parameters.values()))

    def settings(self) -> Settings:
        """Return the settings of the scene's integrator, with its sampler's passes.

        If it is not `photon_beams`, or is nested in `aov` or `moment`, only the depths are taken, from its text form.
        """
        from ..render.settings import Settings

        integrator = self.plugin.integrator()
        own = getattr(integrator, "settings", None)
        if own is None:
            shown = re.findall(r"\b(max_depth|rr_depth) = (\d+)", str(integrator))
            depths: dict[str, Any] = {name: -1 if int(number) == _ANY_DEPTH else int(number) for name, number in shown}
            own = Settings(**depths, hide_emitters=bool(getattr(integrator, "hide_emitters", False)))
            LOG.info("%s: its integrator is not photon_beams: only the depths of its paths are used", self.path)
        return replace(own, passes=int(self.sensor.sampler().sample_count()))

    @property
    def stage(self) -> NoReturn:  # type: ignore[override]
        """Raise SceneError: there is no stage."""
        raise self._refusal("a stage")

    def time(self, frame: float | None = None) -> NoReturn:
        """Raise SceneError: time codes are a stage's."""
        raise self._refusal("time codes, only numbers of frames")

    def read(self, frame: float | None = None, base: float | None = None) -> NoReturn:
        """Raise SceneError: the content is Mitsuba's."""
        raise self._refusal("content in plain numbers, which read returns of stages and of scenes built in Python")

    def exposure(self, frame: float | None = None, blur: bool = True, lens: bool = True) -> NoReturn:
        """Raise SceneError: nothing moves."""
        raise self._refusal("a shutter, which exposure needs: nothing in it moves")

    def check(self, content: scene.Scene, frame: float | None = None) -> NoReturn:
        """Raise SceneError: the content is Mitsuba's."""
        raise self._refusal("content in plain numbers, which check needs; check_scene checks Mitsuba's")

    def prepared(self, request: FrameRequest) -> NoReturn:
        """Raise SceneError: frames are prepared as they are rendered."""
        raise self._refusal("frames that are prepared before they are rendered")

    def _refusal(self, lacking: str) -> SceneError:
        return SceneError(f"{self.path or 'the scene'} is a Mitsuba scene: it has no {lacking.removeprefix('a ')}")

    def cameras(self, frame: float | None = None) -> tuple[scene.Camera, ...]:
        """Return the sensor as a camera, or the cameras of two eyes; SceneError for a sensor that is no camera."""
        self.load(frame)
        return (*self.eyes(),) or (_camera(self.sensor),)

    def viewers(self) -> list[scene.Camera]:
        """Return the cameras."""
        return [replace(camera, lens_radius=0.0) for camera in self.cameras()]

    def look_through(self, camera: str | None, stereo: Stereo | None = None) -> None:
        """Change the `camera`, the id or number of a sensor, and its eyes, `stereo`."""
        check_stereo(stereo)
        self.sensor = self.load().sensors()[self._index(camera)]
        self.camera, self.stereo = camera, stereo

    def resolution(
        self, width: int | None = None, height: int | None = None, frame: float | None = None,
        plates: Sequence[Holdout | Plate] = (), view: str | None = None, pixel_aspect: float = 1.0,
    ) -> tuple[int, int]:  # fmt: skip
        """Return the width and height of a frame in pixels, as of a stage; without either the film's."""
        self.load(frame)
        return self.size(width, height)

    def beams(
        self, frame: float | None = None, *, view: str | None = None, settings: Settings | None = None,
        **given: Unpack[SettingsArguments],
    ) -> list[BeamSet]:  # fmt: skip
        """Return the beams of a frame's first pass. The light of all emitters is traced, unless `method` says else."""
        from ..render.scene_frame import Extras, begin
        from ..render.settings import Settings

        own = self._settings(frame) if settings is None else settings
        chosen = Settings.of(own, {"method": "beams", **given})
        eyes = [self.eyes()[EYES.index(each)] for each in views_of(self.stereo, view) if each]
        extras = Extras(self._beams, eyes)
        return begin(self.plugin, self.sensor, chosen, self._warnings.given, extras).light.traced(0, lambda: None).sets

    def _check_target(self, path: PathLike) -> None:
        """Raise SceneError for a file that the scene's layers are read from."""
        if self._layers is not None:
            check_not_read(self._layers.stage, path)

    def _write(self, found: list[scene.DrawnBeams], path: PathLike, frame: float | None) -> None:
        write_beams(found, path)

    def size(self, width: int | None = None, height: int | None = None) -> tuple[int, int]:
        """Return the size in pixels: `width` and `height`; a missing one follows from the film, both are the film's."""
        own = [int(each) for each in self.sensor.film().size()]
        if not width and not height:
            return own[0], own[1]
        return (
            width or max(1, round((height or 0) * own[0] / own[1])),
            height or max(1, round((width or 0) * own[1] / own[0])),
        )

    def _own_size(self) -> tuple[int, int]:
        self.load()
        return self.size()

    def _window(self, width: int | None, height: int | None, crop: Sequence[float] | None) -> Window:
        """Return the window to render: the film's own crop window, unless a size or a crop is given."""
        from ..world.cameras.cameras import Window
        from ..world.cameras.sensors import window_of

        if width or height or crop is not None:
            size = self.size(width, height)
            return Window(*size, pixels_of(crop, *size))
        return window_of(self.sensor.film())

    @contextmanager
    def _resized(self, window: Window) -> Iterator[None]:
        """Change the film's size in pixels, and which part of it is rendered, within the context."""
        from ..runtime.device import mitsuba

        parameters = mitsuba().traverse(self.sensor)
        names = "film.size", "film.crop_size", "film.crop_offset"
        own = [list(map(int, parameters[name])) for name in names]
        asked = [[window.width, window.height], [*window.shape[::-1]], [*window.crop[:2]]]

        def change(values: Sequence[Sequence[int]]) -> None:
            for name, value in zip(names, values, strict=True):
                parameters[name] = list(value)
            parameters.update()

        if asked == own:
            yield
            return
        try:
            change(asked)
            yield
        finally:
            change(own)

    def check_scene(self, settings: Settings) -> None:
        """Raise SceneError if something in the scene cannot be rendered with these `settings`."""
        from ..render.scene_frame import Extras, begin

        begin(self.plugin, self.sensor, replace(settings, guiding=False), None, Extras(self._beams))

    def layer_names(self) -> list[str]:
        """Return the names of a frame's layers, in order."""
        from ..render.films.film import layer_names
        from ..render.scene_frame import groups_of

        return layer_names(groups_of(self.plugin, self._beams))

    def eyes(self) -> list[scene.Camera]:
        """Return the cameras of two eyes, which replace the sensor; without stereo, none."""
        from ..world.cameras.sensors import camera_of

        if self.stereo is None:
            return []
        camera = camera_of(self.plugin.sensors()[self._index(self.camera)])
        if camera is None:
            name = self.camera or self.names[0]
            raise SceneError(f"sensor {name}: is no camera: expected a perspective one, to be split in two")
        return list(split(camera, self.stereo, 1.0, f"sensor {camera.name}"))

    def _settings(self, frame: float | None) -> Settings:
        self.load(frame)
        return self.settings()

    def _render(self, request: FrameRequest) -> tuple[FrameRenderer, Development]:
        from ..render.films.film import margin_of
        from ..render.scene_frame import Extras, groups_of, render
        from ..world.cameras.cameras import Window
        from ..world.cameras.sensors import Sensor, camera_of

        frame, settings = request.frame, request.settings
        self.load(frame)
        number, names = self._number(frame), views_of(self.stereo, request.view)
        if (request.pixel_aspect, request.conform) != (1.0, CONFORM_POLICIES[0]):
            raise SceneError("pixel_aspect and conform are for stages: a Mitsuba scene (.xml) has square pixels")
        window = self._window(request.width, request.height, request.crop)
        grown = window if request.crop is None else window.grown(margin_of(self._filter(settings)))
        depths, pixels = request.read_plates(number, names, window, grown, self._warn)
        with self._resized(Window.full(window.width, window.height)):  # a camera's aperture is that of the whole film
            eyes = self.eyes()
            own = camera_of(self.sensor)
            shown = [eyes[EYES.index(name)] for name in names] if eyes else [own] if own else []
            if not request.lens:
                shown = [replace(each, lens_radius=0.0) for each in shown or [_camera(self.sensor)]]
        with self._resized(grown):
            sensors = [Sensor(self.sensor, each) for each in shown] or [Sensor(self.sensor)]
            ends = [each.seen_by(_view(sensor)) for each, sensor in zip(depths, sensors, strict=False)]
            extras = Extras(self._beams, shown, ends)
            views = {
                name: {**self._header(sensor, settings, frame), **window.header()}
                for name, sensor in zip(names, sensors, strict=True)
            }
            groups = groups_of(self.plugin, self._beams)
            development = request.development(groups, views, pixels, window, grown)
            run = request.run_options(development)
            about = self.content(frame) if run.named else ""
            done = render(self.plugin, self.sensor, settings, run, about, self._warnings.given, extras)
        return done, development

    def _number(self, frame: float | None) -> float:
        return 0.0 if frame is None else float(frame)

    def _header(self, sensor: Any, settings: Settings, frame: float | None) -> dict[str, Any]:
        """Return the metadata of a view for an EXR's header."""
        return {
            **(sensor.view.header() if sensor.view is not None else {}),
            **origin(self.path.name if self.path else "", frame),
            "camera": self.sensor.id() or self.names[0],
            "seed": settings.seed,
        }

    def _filter(self, settings: Settings) -> Any:
        """Return the pixel filter; None is the box filter."""
        from ..render.films.film import reconstruction_filter

        return reconstruction_filter(settings.filter_name, self.sensor.film().rfilter())


def _opened(subject: Any) -> Any:
    """Return a scene of Mitsuba's, made from a dictionary if it is one; SceneError for anything else."""
    from ..runtime.device import helping_thread, mitsuba

    mi = mitsuba()
    if isinstance(subject, Mapping):
        try:
            with helping_thread():
                subject = mi.load_dict(dict(subject))
        except (RuntimeError, TypeError) as error:
            raise SceneError(f"a scene's dictionary: {reason(str(error))}") from None
    if not isinstance(subject, mi.Scene):
        raise SceneError(f"stage is a {type(subject).__name__} of Mitsuba's: expected a Scene")
    return subject


def _beams(
    looks: Look | Mapping[str, Look] | None,
    groups: Mapping[str, str],
    beams: Mapping[str, scene.BeamSettings],
    layers: Mapping[str, scene.BeamSettings] | None = None,
) -> dict[str, scene.BeamSettings]:
    """Return the beam settings by the ids of emitters; those given in Python are stronger than those of layers."""
    by_name = looks if isinstance(looks, Mapping) else {} if looks is None else {"": looks}
    for name, look in by_name.items():
        if not hasattr(look, "bind"):
            raise SceneError(f"looks is {look!r}{f' for {name}' if name else ''}: expected a Look")
    for name, said in beams.items():
        if not isinstance(said, scene.BeamSettings):
            raise SceneError(f"beams of {name or 'all'} are {said!r}: expected BeamSettings")
    result = {**(layers or {}), **beams}
    for name in {*by_name, *groups, *result}:
        own = result.get(name, scene.BeamSettings())
        chosen = by_name.get(name) or own.look or by_name.get("")
        result[name] = replace(own, look=chosen, group=groups.get(name, own.group))
    return result


def _camera(sensor: Any) -> scene.Camera:
    from ..world.cameras.sensors import camera_of

    camera = camera_of(sensor)
    if camera is None:
        raise SceneError(f"sensor {sensor.id()}: is no camera: expected a perspective one, whose lens can be left out")
    return camera


def _view(sensor: Any) -> Any:
    if sensor.view is None:
        raise SceneError("the sensor is no camera: expected a perspective or an orthographic one for a holdout")
    return sensor.view


def _contents(path: Path, more: Iterable[str]) -> list[bytes]:
    """Return the bytes of a scene's file, and of the files that it names: textures, volumes, meshes, other scenes."""
    todo, found = [path, *(path.parent / each for each in sorted(more))], dict[Path, bytes]()
    for place in todo:  # which grows meanwhile
        if place in found or not os.path.isfile(place):  # Path.is_file raises an error for some strings
            continue
        found[place] = place.read_bytes()
        if place.suffix == ".xml":
            names = re.findall(rb'"([^"<>]+)"', found[place])
            todo += [path.parent / name.decode("utf-8", "replace") for name in names]
    return [*found.values()]


def _message(error: RuntimeError | UnicodeDecodeError) -> str:
    """Return Mitsuba's message, which may quote bytes of a broken file that are no valid text."""
    return error.object.decode(errors="replace") if isinstance(error, UnicodeDecodeError) else str(error)
