"""Subjects in plain numbers, `scene.Scene`: stages and scenes built in Python, with what arguments of a shot add."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from math import log2, pi
from types import NoneType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .. import scene
from ..images.frame import pixels_of
from ..images.plates import Holdout, Plate
from ..runtime.digest import digest
from ..scene.places import Origin
from ..usd.cameras.stereo import EYES, split, views_of
from ..usd.common.motion import Exposure
from ..usd.common.warnings import Strictness, Warnings
from ..usd.layers.header import origin
from ..usd.looks.look import LookSpec
from .subject import FrameContent, Subject, Viewpoint, looks_by_name, size_of

if TYPE_CHECKING:
    from ..beams.programs import Emitter, Modifier, Program
    from ..beams.sets import BeamSet
    from ..looks import Look
    from ..render.frame import FrameRenderer
    from ..render.settings import Settings
    from ..world.cameras.cameras import Window
    from .request import FrameRequest, Prepared

DEFAULT_WIDTH = 1280

_NOTHING = "nothing makes beams"  # a warning that names the first such frame, and is given once
_DIM = "the suns are dim"  # likewise
_BLACK = 0.03  # an irradiance in which a surface of 18 % grey is below a level of 6 of 255

#: A function that makes a medium from the subject's own, or from None if it has none.
MediumOverride = Callable[[scene.Medium | None], scene.Medium | None]


class ShotBounds(NamedTuple):
    """A sphere around everything in a shot, its centre (3,) and radius, and the point from which it is measured."""

    sphere: tuple[scene.Array, float]
    origin: Origin

    @classmethod
    def of(cls, states: Sequence[scene.Scene], eyes: Sequence[scene.Array]) -> ShotBounds:
        """Return those of states of a scene, seen from `eyes`, (3,) each."""
        from ..world.bounds import bounding_sphere, origin_of

        return cls(bounding_sphere(states, eyes), Origin(origin_of(states, eyes)))


class DescribedSubject(Subject):
    """A subject in plain numbers; its arguments are as for `Shot`."""

    #: Time codes in a second.
    rate = 1.0
    #: The axis along which fog falls with height.
    up = "Y"

    def __init__(
        self, medium: scene.Medium | MediumOverride | None, simulate: Modifier | None, emit: Emitter | None,
        looks: Look | Mapping[str, Look] | None, strict: Strictness,
    ) -> None:  # fmt: skip
        by_name = looks_by_name(looks)
        self.medium, self.simulate, self.emit = medium, simulate, emit
        self.looks = by_name if looks is None or isinstance(looks, Mapping) else looks
        self.warnings = Warnings.of(strict)
        self._looks: dict[str, Any] = {}  # (spec, look) by the names of owners or of looks

    @abstractmethod
    def _content(self, frame: float | None, base: float | None) -> scene.Scene:
        """Return the subject's own scene; velocities move things away from where they are at the frame `base`."""

    @abstractmethod
    def _camera(self, viewpoint: Viewpoint, frame: float | None) -> scene.Camera:
        """Return the camera before it is split into eyes."""

    @abstractmethod
    def _header(self, frame: float | None, duration: float) -> dict[str, Any]:
        """Return the metadata of an EXR's header about a frame's time; the shutter is open for `duration`."""

    @abstractmethod
    def _origin(self, viewpoint: Viewpoint, content: scene.Scene, cameras: Sequence[scene.Camera]) -> Origin:
        """Return the point from which the whole shot is measured, for what it shows at one time."""

    def _groups(self, content: scene.Scene) -> frozenset[str]:
        """Return the light groups of all frames, so that all have the same layers."""
        return content.groups

    def _makers(self) -> set[str]:
        """Return the names of everything that makes beams at another time, and of its looks."""
        return set()

    def _names_fog(self, frame: float | None) -> bool:
        """Return whether there is to be fog, although it may not be readable."""
        return False

    def _viewers(self, viewpoint: Viewpoint) -> Sequence[scene.Camera]:
        """Return cameras at times all over the shot, to guide emission: guided frame by frame, films would flicker."""
        return self.cameras(viewpoint, None)

    def _check_frame(self, frame: float | None) -> None:
        """Raise SceneError for a frame that the subject does not have."""

    def read(
        self, viewpoint: Viewpoint, frame: float | None, base: float | None
    ) -> tuple[scene.Scene, scene.Camera]:  # fmt: skip
        """Return the scene at a frame, with its looks built, and the camera."""
        camera = self._camera(viewpoint, frame)
        content = self._with_arguments(self._content(frame, base), frame)
        content = replace(
            content,
            groups=self._groups(content),
            lights=tuple(self._with_look(light, frame) for light in content.lights),
            drawn=tuple(replace(beams, look=self._look(beams.name, beams.look)) for beams in content.drawn),
        )
        self._check_looks(content)
        return content, camera

    def _with_arguments(self, content: scene.Scene, frame: float | None) -> scene.Scene:
        """Return a scene with the medium and the beams that were given in Python."""
        media = (each.at(self.up, self.number(frame) / self.rate) for each in self._media(content))
        content = replace(content, media=tuple(media))
        if self.emit is None:
            return content
        from ..beams.programs import PassContext, emitted

        made = emitted(self.emit, PassContext(frame=frame, time=self.number(frame), medium=content.medium))
        return replace(content, drawn=(*content.drawn, *made))

    def _media(self, content: scene.Scene) -> tuple[scene.Medium, ...]:
        """Return the scene's media, or the shot's instead; a function replaces only the first homogeneous medium."""
        if not callable(self.medium):
            return content.media if self.medium is None else (self.medium,)
        own = content.medium
        chosen = self.medium(own)
        scene.instance(chosen, "what the function of the medium returns", scene.Medium, NoneType)
        rest = tuple(each for each in content.media if each is not own)
        return rest if chosen is None else content.media if chosen is own else (chosen, *rest)

    def _with_look(self, light: scene.Light, frame: float | None) -> scene.Light:
        """Return a light with its look, and with the filter by which that tints surfaces."""
        look = self._look(light.name, light.look)
        result = replace(light, look=look)
        if look is None:
            return result
        from ..looks.tint import tinted

        number = self.number(frame)
        return tinted(result, light.name, self.warnings.give, (number, number / self.rate), light.frame)

    def _look(self, owner: str, spec: Any) -> Any:
        """Return the look of a light or of curves: the one given in Python, else the one that a spec describes.

        Specs of one prim are built once: their beams share the look, and so its kernels.
        """
        if not isinstance(self.looks, Mapping):
            return self.looks
        for name in (owner, getattr(spec, "name", "")):
            mine = self.looks.get(name) or self.looks.get(name.rpartition("/")[2])
            if mine is not None:
                self._looks.setdefault(name, (None, mine))
                return mine
        if not isinstance(spec, LookSpec):
            return spec
        built = self._looks.get(spec.name)
        if built is None or digest(built[0]) != digest(spec):
            from ..usd.looks.shading import build_look  # starts Dr.Jit, which readers do not need

            built = self._looks[spec.name] = (spec, build_look(spec))
        return built[1]

    def _check_looks(self, content: scene.Scene) -> None:
        """Raise SceneError if a name in `looks` is that of no beams and of no look."""
        if not isinstance(self.looks, Mapping):
            return
        named = {light.name for light in content.lights} | {drawn.name for drawn in content.drawn} | set(self._looks)
        if not _with_ends(named).issuperset(self.looks):
            named |= self._makers()  # looks may also be for lights that are hidden now
        for name in self.looks:
            if name not in _with_ends(named):
                beams = ", ".join(sorted(named)) or "none"
                raise scene.SceneError(f"{self.name}: no beams are named {name}: expected one of {beams}")

    def settings(self, viewpoint: Viewpoint, frame: float | None) -> Settings:
        """Return the defaults."""
        from ..render.settings import Settings

        return Settings()

    def resolution(
        self, viewpoint: Viewpoint, frame: float | None, width: int | None, height: int | None,
        plates: Sequence[Holdout | Plate], view: str | None, pixel_aspect: float,
    ) -> tuple[int, int]:  # fmt: skip
        """Return the width and height of a frame in pixels."""
        if width is None and height is None and plates:
            width, height = plates[0].size(self.number(frame), views_of(viewpoint.stereo, view))
        camera = self.cameras(viewpoint, frame)[0]
        scene.number(pixel_aspect, "pixel_aspect", 1e-3, 1e3)
        aspect = camera.horizontal_aperture / (camera.vertical_aperture * pixel_aspect)
        return size_of(width, height, aspect, DEFAULT_WIDTH)

    def layers(self, viewpoint: Viewpoint, frame: float | None) -> list[str]:
        """Return the names of a frame's layers; SceneError if there is nothing to render."""
        from ..render.stage_frame import layer_names

        content, _ = self.read(viewpoint, frame, None)
        self._check(content, frame)
        return layer_names(content)

    def _check(self, content: scene.Scene, frame: float | None) -> None:
        """Raise SceneError if there is nothing to render, and warn if all of it is dark."""
        from ..render.stage_frame import check

        try:
            check(content)
        except scene.SceneError as error:
            raise scene.SceneError(f"{self.name}: {error}") from None
        self._warn_of_darkness(content, frame)

    def _warn_of_darkness(self, content: scene.Scene, frame: float | None) -> None:
        """Warn once if no beams are visible: there is no fog, nothing makes beams now, or all lights are black.

        That is no error, so that a light that fades out does not end a film. Fog that could not be read had a warning.
        """
        from ..render.stage_frame import black, makers

        name, names = self.name, ", ".join(black(content))
        if not (content.media or self._names_fog(frame)):
            fog = "expected a prim with PhotonBeamsMediumAPI, or a fog given by --scattering"
            self.warnings.give(f"{name}: there is no fog, so no beams are seen: {fog}")
        elif names:
            self.warnings.give(f"{name}: no beams have any light: expected some of {names} to shine")
        elif not makers(content) and not content.sky and _NOTHING not in self.warnings.given:
            self.warnings.given.add(_NOTHING)
            idle = ", ".join(light.name for light in content.lights)
            expected = f"photonbeams:enabled on {idle}" if idle else "a light that is on"
            if any(each.unlit_media for each in content.lights):
                expected += ", and light links that include the fog"
            at = f"{name}: {_NOTHING} at frame {self.number(frame):.10g}"
            self.warnings.give(f"{at}: expected {expected}; frames without one have no beams")

    def windows(self, viewpoint: Viewpoint, request: FrameRequest) -> tuple[Window, Window]:
        """Return what is shown of a frame, and what is rendered."""
        from ..render.films.pixel_filters import margin_of, reconstruction_filter
        from ..world.cameras.cameras import Window

        self._check_frame(request.frame)
        plates = [each for each in (request.holdout, request.over) if each is not None]
        size = self.resolution(
            viewpoint, request.frame, request.width, request.height, plates, request.view, request.pixel_aspect
        )
        crop = pixels_of(request.crop, *size, overscan=True)
        window = Window(*size, crop, request.pixel_aspect, request.conform)
        return window, window.grown(margin_of(reconstruction_filter(request.settings.filter_name)))

    def content(
        self, viewpoint: Viewpoint, request: FrameRequest, window: Window, views: Sequence[str]
    ) -> FrameContent:
        """Return what a frame shows, and warn if that is black."""
        from ..render.seen.surfaces import names_of
        from ..render.stage_frame import groups_of, memory_of, render
        from ..world.cameras.cameras import View

        frame = request.frame
        exposure = self.exposure(viewpoint, frame, request.blur, request.lens)
        content, cameras = exposure(0.0)
        self._check(content, frame)
        _warn_of_dim_suns(content, cameras, self.name, self.warnings)
        eyes, origin = _eyes(views), self._origin(viewpoint, content, cameras)
        time = self._header(frame, exposure.duration)
        shutter = exposure.shutter(eyes, self.rate, origin)

        def viewers() -> Sequence[scene.Camera]:
            return [origin.local(each) for each in self._viewers(viewpoint)]

        def rendered(ready: Prepared) -> FrameRenderer:
            return render(shutter, ready.window, ready.settings, ready.run, ready.holdouts, ready.digest, viewers)

        return FrameContent(
            groups=groups_of(content),
            views=[View(cameras[eye], window) for eye in eyes],
            headers=[{**time, "camera": cameras[eye].name} for eye in eyes],
            render=rendered,
            shutter=shutter,
            viewers=viewers,
            names=lambda: names_of(content.meshes),
            memory=partial(memory_of, content),
            program=self._program(frame, exposure),
        )

    def _program(self, frame: float | None, exposure: Exposure) -> Program | None:
        from ..beams.programs import Program

        return None if self.simulate is None else Program(self.simulate, frame, exposure.code)

    def beams(
        self,
        viewpoint: Viewpoint,
        frame: float | None,
        views: Sequence[str],
        settings: Settings | None,
        given: Mapping[str, Any],
    ) -> list[BeamSet]:
        """Return the beams of a frame's first pass: a set for each light, and for each set of drawn beams."""
        from ..render.settings import Settings
        from ..render.stage_frame import simulate
        from ..world.cameras.cameras import Window

        self._check_frame(frame)
        exposure = self.exposure(viewpoint, frame, blur=False, lens=False)
        content, cameras = exposure(0.0)
        origin = self._origin(viewpoint, content, cameras)
        self._warn_of_darkness(content, frame)
        size = self.resolution(viewpoint, frame, 128, None, (), None, 1.0)
        chosen = Settings.of(settings, given)
        if chosen.program is None:
            chosen = replace(chosen, program=self._program(frame, exposure))
        shutter = exposure.shutter(_eyes(views), origin=origin)
        sets = simulate(
            shutter, Window.full(*size), chosen,
            viewers=lambda: [origin.local(each) for each in self._viewers(viewpoint)],
        )  # fmt: skip
        zero = shutter.at(0.0).scene.zero
        return [each._replace(zero=zero) for each in sets]

    def _arguments(self, viewpoint: Viewpoint) -> tuple[Any, ...]:
        """Return what was given in Python beside the content."""
        return viewpoint.camera, self.medium, viewpoint.stereo, self.simulate, self.emit, self.looks


class BuiltSubject(DescribedSubject):
    """A `scene.Scene`, and the parameters of `DescribedSubject`. Its camera is a `scene.Camera`.

    The frame number is used in file names, by `emit`, and by looks that change with time.
    """

    name = "the scene"

    def __init__(self, content: scene.Scene, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.scene = content

    def __repr__(self) -> str:
        return f"a scene of {len(self.scene.meshes)} meshes and {len(self.scene.lights)} lights"

    def check_viewpoint(self, viewpoint: Viewpoint) -> None:
        """Raise SceneError for a camera that is no `scene.Camera`."""
        if not isinstance(viewpoint.camera, scene.Camera):
            text = "expected a scene.Camera, such as Camera.look_at(...)"
            raise scene.SceneError(f"camera is {viewpoint.camera!r}: {text}")

    def cameras(self, viewpoint: Viewpoint, frame: float | None) -> tuple[scene.Camera, ...]:
        """Return the camera, or those of the left and the right eye."""
        camera, stereo = viewpoint
        return (camera,) if stereo is None else split(camera, stereo, 1.0, f"camera {camera.name}")

    def exposure(self, viewpoint: Viewpoint, frame: float | None, blur: bool, lens: bool) -> Exposure:
        """Return the scene and the cameras, which do not move; if `lens` is False, everything is in focus."""
        cameras = self.cameras(viewpoint, frame)
        if not lens:
            cameras = tuple(replace(each, lens_radius=0.0) for each in cameras)
        content, _ = self.read(viewpoint, frame, None)
        eyes = [np.asarray(each.to_world)[:3, 3] for each in cameras]
        content = content.within(content.bounds or ShotBounds.of([content], eyes).sphere)
        number = self.number(frame)
        return Exposure(lambda _: content, lambda _: cameras, number, number)

    def _origin(self, viewpoint: Viewpoint, content: scene.Scene, cameras: Sequence[scene.Camera]) -> Origin:
        return ShotBounds.of([content], [np.asarray(each.to_world)[:3, 3] for each in cameras]).origin

    def digest(self, viewpoint: Viewpoint, frame: float | None) -> str:
        """Return a hash of what a frame shows."""
        return digest(self.scene, self.number(frame), self._arguments(viewpoint))

    def _content(self, frame: float | None, base: float | None) -> scene.Scene:
        return self.scene

    def _camera(self, viewpoint: Viewpoint, frame: float | None) -> scene.Camera:
        camera: scene.Camera = viewpoint.camera
        return camera

    def _header(self, frame: float | None, duration: float) -> dict[str, Any]:
        return origin("", frame)


def _warn_of_dim_suns(content: scene.Scene, cameras: Sequence[scene.Camera], name: str, warnings: Warnings) -> None:
    """Warn if the lights that shine are all suns, in whose light, times the exposure, surfaces look black.

    Without `normalize` an intensity is the radiance of the sun's disc: 0.53 degrees have a 15,000th of it.
    """
    shining = [light for light in content.lights if max(light.radiance) > 0]
    suns = [light for light in shining if isinstance(light, scene.DistantLight)]
    if not suns or len(suns) < len(shining) or content.drawn or _DIM in warnings.given:
        return
    total = sum(sun.irradiance for sun in suns) * max(camera.exposure_scale for camera in cameras)
    if 0 < total < _BLACK:
        warnings.given.add(_DIM)  # frames with other numbers are no news
        sun = max(suns, key=lambda each: each.irradiance)
        disc = f" (a radiance of {max(sun.radiance):.3g} over {sun.angle:.3g} degrees)" if sun.angle > 0 else ""
        more = f"{log2(pi / total):.1f} stops more show them, by --exposure or inputs:exposure"
        text = f"{name}: {sun.name} gives an irradiance of {total:.2g}{disc}, in which surfaces look black"
        warnings.give(f"{text}: {more}, as does inputs:normalize, if that is off")


def _eyes(views: Sequence[str]) -> list[int]:
    """Return the numbers of the cameras of views."""
    return [EYES.index(name) if name else 0 for name in views]


def _with_ends(paths: set[str]) -> set[str]:
    """Return paths and the names at their ends: users may name a prim by either."""
    return paths | {path.rpartition("/")[2] for path in paths}
