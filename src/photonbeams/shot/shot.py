"""A shot: a stage and a camera, rendered into frames, written as layered EXR."""

from __future__ import annotations

import os
import weakref
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from .. import scene
from ..images.frame import Frame, pixels_of
from ..images.plates import Holdout, Plate
from ..runtime.digest import digest
from ..runtime.files import PathLike
from ..usd import stage as stages
from ..usd.bounds import bounds_at_all_times
from ..usd.camera import read_shutter
from ..usd.editing import Extent, extent_of
from ..usd.export import write_beams
from ..usd.frames import check_frames
from ..usd.groups import groups_at_all_times, makers_at_all_times
from ..usd.header import header
from ..usd.looks import LookSpec
from ..usd.motion import Exposure
from ..usd.reading import file_of, frame_number
from ..usd.stereo import EYES, Stereo, check_stereo, read_eyes, views_of
from ..usd.unread import warn_of_unread
from ..usd.warnings import Warnings

if TYPE_CHECKING:
    from pxr import Usd

    from ..beams.programs import Emitter, Modifier
    from ..beams.sets import BeamSet
    from ..looks import Look
    from ..render.checkpoint import Checkpoint
    from ..render.frame import FrameRenderer
    from ..render.frame_sums import FrameSums
    from ..render.passes import PlannedPasses, Progress
    from ..render.settings import Settings, SettingsArguments
    from ..scene import Array
    from .development import Development
    from .request import FrameRequest, Prepared, Snapshot

DEFAULT_WIDTH = 1280

# Time samples on a stage that are looked at, at most, to learn whether a shutter sees any.
_MOST_KEYS = 10_000

# Times on a stage, at most, at which emission is guided toward what the camera sees.
_VIEWERS = 9

# Times at which the content of the stage is kept until it changes.
_CONTENTS = 4

_NOTHING = "nothing makes beams"  # said of the first frame where it is so

#: A fog that is made of the stage's own, or of None where it has none.
Fog = Callable[[scene.Medium | None], scene.Medium | None]


def _opened_scene(
    path: PathLike, camera: str | None, stereo: Stereo | None, looks: Any, groups: Any, beams: Any,
    session_layers: Iterable[PathLike], overrides: Iterable[str], of_stages: Mapping[str, Any],
) -> Shot:  # fmt: skip
    """Return a Mitsuba scene as a shot; SceneError for what stages alone have."""
    from .scene_shot import SceneShot

    for name, value in of_stages.items():
        if value:
            raise scene.SceneError(f"{name} is for stages: a Mitsuba scene (.xml) has no use for it")
    parameters = {}
    for text in overrides:
        key, equals, value = text.partition("=")
        if not key or not equals:
            raise scene.SceneError(f"cannot set '{text}': expected NAME=VALUE, a parameter of the .xml")
        parameters[key] = value
    return SceneShot(path, camera, stereo, looks, groups, beams, parameters, session_layers)


def _known(paths: set[str]) -> set[str]:
    """Return paths and their last names, by either of which a user may name a prim."""
    return paths | {path.rpartition("/")[2] for path in paths}


class Shot:
    """A stage seen by one of its cameras, or by two eyes. `Shot.open` makes one, also of a Mitsuba scene.

    `Shot(mitsuba_scene, camera=..., stereo=..., looks=..., groups=...)` is a `SceneShot`, and
    `Shot(scene.Scene(...), scene.Camera(...))` a `BuiltShot`.
    """

    camera: Any  # the name of one on the stage; a scene.Camera of a scene that was built in Python

    def __new__(cls, stage: Any = None, *_: Any, **__: Any) -> Shot:
        """Return a shot of a stage, of a Mitsuba scene, or of a scene that was built in Python."""
        if cls is Shot and type(stage).__module__.partition(".")[0] == "mitsuba":
            from .scene_shot import SceneShot

            return super().__new__(SceneShot)
        if cls is Shot and isinstance(stage, scene.Scene):
            from .built_shot import BuiltShot

            return super().__new__(BuiltShot)
        return super().__new__(cls)

    def __init__(
        self,
        stage: Usd.Stage | scene.Scene,
        camera: str | scene.Camera | None = None,
        medium: scene.Medium | Fog | None = None,
        stereo: Stereo | None = None,
        simulate: Modifier | None = None,
        emit: Emitter | None = None,
        looks: Look | Mapping[str, Look] | None = None,
        strict: bool = False,
    ) -> None:
        if not (looks is None or isinstance(looks, Mapping) or hasattr(looks, "bind")):
            raise scene.SceneError(f"looks is {looks!r}: expected a Look, or Looks by the names of lights")
        if not (medium is None or callable(medium) or isinstance(medium, scene.Medium)):
            raise scene.SceneError(f"medium is {medium!r}: expected a Medium, or a function of the stage's own")
        for name, function in (("simulate", simulate), ("emit", emit)):
            if function is not None and not callable(function):
                raise scene.SceneError(f"{name} is {function!r}: expected a function")
        check_stereo(stereo)
        self.camera, self.medium, self.stereo = camera, medium, stereo
        self.simulate, self.emit, self.looks = simulate, emit, looks or {}
        self._sphere: tuple[Array, float] | None = None
        self._groups: frozenset[str] | None = None
        self._stage_digest: str | None = None
        self._warnings = Warnings(strict)
        self._looks: dict[str, Any] = {}
        self._lasting: dict[Any, Any] = {}  # what of the stage is the same at all times
        self._edited = False  # whether the stage was: who renders a film need not keep what the next frame lacks
        self._contents: dict[Any, scene.Scene] = {}  # what was read last, by times; looks may be others now
        self._surfaces: dict[Any, dict[str, Any]] = {}  # the surfaces that were read last, by their time
        self._kept: dict[Any, Any] = {}  # the frame whose parts were rendered last
        self._set_content(stage)

    def _set_content(self, stage: Any) -> None:
        """Take what the shot shows; SceneError where that is of another kind."""
        stages.check_stage(stage)
        if not (self.camera is None or isinstance(self.camera, str)):
            raise scene.SceneError(f"camera is {self.camera!r}: expected the path or the name of a camera of the stage")
        self.stage: Usd.Stage = stage
        warn_of_unread(stage, self._warnings)
        self._listener = self._listening()

    def _listening(self) -> Any:
        """Return a listener that clears what the shot has cached of all times when the stage changes."""
        own = weakref.ref(self)  # kept by the shot, it must not keep the shot

        def forget(notice: Any, stage: Any) -> None:
            shot, extent = own(), extent_of(notice, stage)
            if shot is None:
                return
            shot._stage_digest, shot._edited = None, True
            if extent >= Extent.VALUES:
                shot._groups = None
                shot._contents.clear()
            if extent >= Extent.PLACES:
                shot._sphere = None
            if extent >= Extent.SURFACES:
                shot._surfaces = {}
            if extent >= Extent.ALL:
                shot._lasting.clear()

        return forget, stages.listener(self.stage, forget)  # which does not keep `forget`

    def __repr__(self) -> str:
        return f"Shot({Path(file_of(self.stage)).name!r}, camera={self.camera!r})"

    def _repr_mimebundle_(
        self, include: Collection[str] | None = None, exclude: Collection[str] | None = None
    ) -> dict[str, str]:  # fmt: skip
        """Return a quick picture for notebooks, or the sentence that says why there is none: raises nothing."""
        from .notebook import shown

        return shown(self, include, exclude)

    def _own_size(self) -> tuple[int, int]:
        """Return the size in pixels where none is asked for."""
        return self.resolution()

    @classmethod
    def open(
        cls,
        path: PathLike,
        camera: str | None = None,
        *,
        medium: scene.Medium | Fog | None = None,
        stereo: Stereo | None = None,
        simulate: Modifier | None = None,
        emit: Emitter | None = None,
        looks: Look | Mapping[str, Look] | None = None,
        groups: Mapping[str, str] | None = None,
        beams: Mapping[str, scene.BeamSettings] | None = None,
        session_layers: PathLike | Iterable[PathLike] = (),
        overrides: str | Iterable[str] = (),
        strict: bool = False,
        texture_limit: int | None = None,
        variants: str | Iterable[str] = (),
        mask: str | Iterable[str] | None = None,
        purposes: str | Iterable[str] | None = None,
        complexity: str | None = None,
    ) -> Shot:
        """Open a USD stage, or a Mitsuba scene.

        Parameters
        ----------
        path
            A .usd, .usda, .usdc or .usdz file; or a Mitsuba .xml, in whose name a run of # is the frame number.
        camera
            Path or name of the camera; None: the render settings' or the only one. Of a Mitsuba scene its sensor's id
            or number; None: the first.
        medium
            A fog instead of the stage's own, or for a stage that has none; or a function of the stage's own.
        stereo
            For two eyes, how the camera becomes two of them; None: one picture.
        simulate
            A function of beams and a `PassContext` that changes the beams of each pass, such as `thin`, or a `chain`.
        emit
            A function of a `PassContext` that makes beams from nothing: it returns `Beams`, `DrawnBeams`, or several.
        looks
            Looks of your own instead of the stage's: one for all beams, or by the path or the name of a light, of
            drawn curves, or of the PhotonBeamsLook that they name. Of a Mitsuba scene by the ids of its emitters, or of
            their shapes.
        groups
            Of a Mitsuba scene: light groups by the same ids.
        beams
            Of a Mitsuba scene: all that the lights of a stage say of their beams (portals, gobos, …), by the same ids.
        session_layers, overrides
            Layers over the stage, and values "/prim.attribute=value" over those, or NAME=VALUE for the parameters of a
            Mitsuba scene; one, or several. Over a Mitsuba scene, prims named by the ids of emitters say of their beams
            what they would say of lights.
        strict
            Whether a warning about the stage is an error, also that a part of it cannot be read and is left out.
        texture_limit
            Pixels a side beyond which textures of a stage are scaled down, those of lights beyond twice as many; None:
            4096.
        variants
            Of a stage: choices of variants, each "/prim{set=choice}".
        mask, purposes
            Of a stage: the prims that are read, with what is above and below them and what they refer to, None: all;
            and the purposes that are rendered beside "default", None: "render".
        complexity
            Of a stage: how finely subdivision surfaces are refined, "low", "medium", "high" or "veryhigh"; None: those
            that say of themselves that they are, "high".

        Raises
        ------
        SceneError
            What cannot be read, in one sentence.
        """
        session_layers = [session_layers] if isinstance(session_layers, str | os.PathLike) else session_layers
        overrides = [overrides] if isinstance(overrides, str) else overrides
        if Path(path).suffix.lower() == ".xml":
            of_stages = {
                "medium": medium, "simulate": simulate, "emit": emit, "strict": strict, "variants": variants,
                "mask": mask, "purposes": purposes, "complexity": complexity,
            }  # fmt: skip
            return _opened_scene(path, camera, stereo, looks, groups, beams, session_layers, overrides, of_stages)
        for name, given, expected in (("groups", groups, "lightGroup"), ("beams", beams, "…")):
            if given is not None:
                text = f"expected photonbeams:{expected} on the lights of a stage"
                raise scene.SceneError(f"{name} are for Mitsuba scenes: {text}")
        if texture_limit is not None and scene.whole(texture_limit, "texture_limit", " of pixels") < 1:
            raise scene.SceneError(f"texture_limit is {texture_limit}: expected at least 1 pixel")
        selection = stages.Selection.of(mask, purposes, variants, complexity)
        stage = stages.open_stage(path, session_layers, overrides, Warnings(strict), texture_limit, selection)
        shot = cls(stage, camera, medium, stereo, simulate, emit, looks, strict)
        shot.cameras()  # a wrong name is an error now, not after a long read
        return shot

    @property
    def warnings(self) -> Warnings:
        """The warnings that were given of the shot so far."""
        return self._warnings

    def time(self, frame: float | None = None) -> Usd.TimeCode:
        """Return the time code of a frame; None is the stage's start or default time."""
        if frame is None:
            return stages.default_time(self.stage)
        return stages.time_code(frame)

    def _check_frame(self, frame: float | None) -> None:
        """Raise SceneError for a frame that the stage does not have."""
        if frame is not None and not self.time(frame).IsDefault():
            check_frames(self.stage, [self._number(frame)])

    def read(self, frame: float | None = None, base: float | None = None) -> tuple[scene.Scene, scene.Camera]:
        """Return the scene at a frame, with its looks built, and the camera.

        Velocities carry on what the stage holds at `base`, the frame whose shutter is open; None: at the frame itself.
        """
        content, camera = self._read(frame, base)
        content = self._with_own(content, frame)
        content = replace(
            content,
            groups=self._groups_at_all_times(),
            lights=tuple(replace(light, look=self._look(light.name, light.look)) for light in content.lights),
            drawn=tuple(replace(beams, look=self._look(beams.name, beams.look)) for beams in content.drawn),
        )
        self._check_looks(content)
        return content, camera

    def _with_own(self, content: scene.Scene, frame: float | None) -> scene.Scene:
        """Return the stage's scene with the shot's own medium and beams."""
        content = replace(content, media=self._media(content))
        if self.emit is not None:
            made = self._emitted(self.emit, frame, content.medium)
            content = replace(content, drawn=(*content.drawn, *made))
        return content

    def _read(self, frame: float | None, base: float | None) -> tuple[scene.Scene, scene.Camera]:
        """Return the stage's own scene and its camera."""
        time = self.time(frame)
        camera = stages.read_camera(self.stage, self.camera, time, self._warnings)
        if not self._edited:
            return stages.read_scene(self.stage, time, self._warnings, base, self._lasting), camera
        key = (None if time.IsDefault() else time.GetValue(), base)  # in text, times that differ a little are one
        known, content = self._contents.get(key), None
        if known is not None:  # no more than looks were edited since
            content = stages.with_looks(self.stage, time, known, self._warnings)
        if content is None:
            if key not in self._surfaces:
                self._surfaces = {key: {}}
            content = stages.read_scene(
                self.stage, time, self._warnings, base, self._lasting, self._surfaces[key]
            )  # fmt: skip
        self._contents = {**dict([*self._contents.items()][-_CONTENTS:]), key: content}
        return content, camera

    @property
    def _place(self) -> str:
        """The beginning of messages about the whole shot."""
        return file_of(self.stage)

    def _makers(self) -> set[str]:
        """Return the names of all that ever makes beams, and of its looks."""
        return makers_at_all_times(self.stage)

    def _check_looks(self, content: scene.Scene) -> None:
        """Raise SceneError for a look that the user names for no beams of the stage."""
        if not isinstance(self.looks, Mapping):
            return
        named = {light.name for light in content.lights} | {drawn.name for drawn in content.drawn} | set(self._looks)
        if not _known(named).issuperset(self.looks):
            named |= self._makers()  # of those that are hidden now, looks may be, too
        for name in self.looks:
            if name not in _known(named):
                beams = ", ".join(sorted(named)) or "none"
                raise scene.SceneError(f"{self._place}: no beams are of {name}: expected one of {beams}")

    def _emitted(self, emit: Emitter, frame: float | None, medium: scene.Medium | None) -> list[scene.DrawnBeams]:
        """Return the beams that the shot's `emit` function makes at a time."""
        from ..beams.programs import PassContext, emitted

        return emitted(emit, PassContext(frame=frame, time=self._number(frame), medium=medium))

    def _media(self, content: scene.Scene) -> tuple[scene.Medium, ...]:
        """Return the stage's media, or the shot's instead of them; a function of the first one changes that alone."""
        if not callable(self.medium):
            return content.media if self.medium is None else (self.medium,)
        own = content.medium
        chosen = self.medium(own)
        rest = tuple(each for each in content.media if each is not own)
        return rest if chosen is None else content.media if chosen is own else (chosen, *rest)

    def cameras(self, frame: float | None = None) -> tuple[scene.Camera, ...]:
        """Return the camera at a frame, or the left and the right eye's."""
        if self.stereo is None:
            return (stages.read_camera(self.stage, self.camera, self.time(frame), self._warnings),)
        return read_eyes(self.stage, self.camera, self.stereo, self.time(frame), self._warnings)

    def look_through(self, camera: str | None, stereo: Stereo | None = None) -> None:
        """Take another camera, by its path or name, or other eyes; what depends on its place is found anew."""
        check_stereo(stereo)
        if (camera, stereo) != (self.camera, self.stereo):
            self.camera, self.stereo, self._sphere = camera, stereo, None

    def exposure(self, frame: float | None = None, blur: bool = True, lens: bool = True) -> Exposure:
        """Return the scene and the cameras over the shutter interval of a frame.

        `blur` and `lens` may be turned off: all is then as at the frame's own time, and in focus.
        """
        time = self.time(frame)
        begin, end = read_shutter(self.stage, self.camera, time)
        base = frame_number(time)

        def read(code: float) -> scene.Scene:
            content = (self.read() if time.IsDefault() else self.read(code, base))[0]
            return replace(content, bounds=self._bounds(content))

        def cameras(code: float) -> tuple[scene.Camera, ...]:
            found = self.cameras(None if time.IsDefault() else code)
            return found if lens else tuple(replace(camera, lens_radius=0.0) for camera in found)

        # Without blur the shutter is the interval [0, 0], as UsdRenderSettings has it.
        start, stop = (base + begin, base + end) if blur else (base, base)
        keys = stages.sample_times(self.stage, _MOST_KEYS) if start < stop else []
        keys = [code for code in keys if start < code <= stop]
        return Exposure(read, cameras, start, stop, keys)

    def _bounds(self, content: scene.Scene) -> tuple[Array, float]:
        if self._sphere is None:
            # Once: beams must not change with what moves elsewhere.
            self._sphere = bounds_at_all_times(
                self.stage, content, self._extent, self.cameras, emits=self.emit is not None
            )
        return self._sphere

    def _extent(self, frame: float | None) -> scene.Scene:
        """Return how far the scene reaches at a frame."""
        return self._with_own(stages.read_extent(self.stage, self.time(frame), self._lasting), frame)

    def _groups_at_all_times(self) -> frozenset[str]:
        if self._groups is None:
            # Once: all frames have the same layers.
            self._groups = groups_at_all_times(self.stage)
        return self._groups

    def check(self, content: scene.Scene, frame: float | None = None) -> list[str]:
        """Return the names of the layers that a frame of this content has; SceneError where there is nothing to see.

        Warns once where no beams are seen: there is no fog, nothing makes beams now, or what does has no light. A light
        that fades out must not end a film.
        """
        from ..render.stage_frame import check, layer_names

        try:
            check(content)
        except scene.SceneError as error:
            raise scene.SceneError(f"{self._place}: {error}") from None
        self._warn_of_darkness(content, frame)
        return layer_names(content)

    def _warn_of_darkness(self, content: scene.Scene, frame: float | None) -> None:
        from ..render.stage_frame import black, makers

        names = ", ".join(black(content))
        if not content.media:
            fog = "expected a prim with PhotonBeamsMediumAPI, or a fog given by --scattering"
            self._warn(f"{self._place}: there is no fog, in which beams would be seen: {fog}")
        elif names:
            self._warn(f"{self._place}: no beams have any light: expected some of {names} to shine")
        elif not makers(content) and not content.sky and _NOTHING not in self._warnings.given:
            self._warnings.given.add(_NOTHING)
            idle = ", ".join(light.name for light in content.lights)
            expected = f"photonbeams:enabled on {idle}" if idle else "a light that is on"
            at = f"{self._place}: {_NOTHING} at frame {self._number(frame):.10g}"
            self._warn(f"{at}: expected {expected}; where none is, there are no beams")

    def _look(self, owner: str, spec: Any) -> Any:
        """Return the look of a light or of curves: the user's, or that of a spec.

        Those that share a prim share it, and so its kernels.
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
        known = self._looks.get(spec.name)
        if known is None or digest(known[0]) != digest(spec):
            from ..usd.shading import build_look  # starts Dr.Jit, which readers do not need

            known = self._looks[spec.name] = (spec, build_look(spec))
        return known[1]

    def resolution(
        self,
        width: int | None = None,
        height: int | None = None,
        frame: float | None = None,
        plates: Sequence[Holdout | Plate] = (),
        view: str | None = None,
    ) -> tuple[int, int]:
        """Return (width, height): what is given, and the rest from the camera's aperture.

        Where neither is given, they are those of the first of `plates`, if there are any, for the view `view`.
        """
        width, height = (
            None if value is None else scene.whole(value, name, " of pixels")
            for name, value in (("width", width), ("height", height))
        )
        if width is None and height is None and plates:
            width, height = plates[0].size(self._number(frame), views_of(self.stereo, view))
        camera = self.cameras(frame)[0]
        aspect = camera.horizontal_aperture / camera.vertical_aperture
        if width is None:
            width = DEFAULT_WIDTH if height is None else max(1, round(height * aspect))
        if height is None:
            height = max(1, round(width / aspect))
        most = scene.MOST_PIXELS
        if not (1 <= width <= most and 1 <= height <= most):
            raise scene.SceneError(f"the resolution is {width} x {height}: expected 1 to {most} pixels each way")
        return width, height

    def render(
        self,
        frame: float | None = None,
        passes: int | None = None,
        *,
        settings: Settings | None = None,
        width: int | None = None,
        height: int | None = None,
        crop: Sequence[float] | None = None,
        progress: Progress | None = None,
        checkpoint: PathLike | Checkpoint | None = None,
        snapshot: Snapshot | None = None,
        blur: bool = True,
        lens: bool = True,
        view: str | None = None,
        holdout: PathLike | Array | Holdout | None = None,
        over: PathLike | Array | Plate | None = None,
        **given: Unpack[SettingsArguments],
    ) -> Frame:
        """Render a frame.

        Parameters
        ----------
        frame
            Frame number; None is the stage's start or default time. Of a Mitsuba scene it chooses the file, where the
            shot's name has a run of #.
        passes, settings, **given
            How to render: fields of `Settings` by name (time_limit, beams, seed, pixel_filter, …), all of
            them at once as `settings`, or both; None: the defaults.
        width, height
            Pixels; what is not given comes from the aperture, and without either the picture is 1280 wide.
        crop
            x0, y0, x1, y1 in fractions of the picture from the top left: the part to render.
        progress
            Called with the passes done and the statistics so far, before the first pass and after each.
        checkpoint
            A file for the passes that are done, written every minute: the same render goes on from there, to the same
            bits. It stays, and is to be removed once the frame is written. Or what `Checkpoint` describes.
        snapshot
            Called after each pass with a function that returns the frame so far.
        blur, lens
            Whether what moves while the shutter is open blurs, or all is as at the frame's own time; and whether what
            is out of focus blurs. Nothing in a Mitsuba scene moves.
        view
            "left" or "right" for one of two eyes; None renders both.
        holdout
            Another renderer's depth, at which beams end instead of at the stage's own surfaces, which are not seen
            then; they still stop the light. A file, (H, W) planar depths in scene units, or what `Holdout` describes.
        over
            A picture of the same size: `rgba` is then that plus beams. A file, (H, W, 3 or 4) scene-linear pixels, or
            a `Plate`.

        Returns
        -------
        Frame
            The layers of the crop window, for two eyes of each, and what an EXR's header says of them.

        Raises
        ------
        SceneError
            What cannot be read or rendered at this frame: of the stage, also one on which nothing makes beams; a
            resolution, a crop, a view or settings out of range; a name that is no setting; a holdout or a plate without
            a depth or a picture, or of another size; a checkpoint of something else.
        OSError
            A holdout or a plate that is not there, or may not be read.
        """
        request = self.request(
            frame, passes, settings, given, width=width, height=height, crop=crop, progress=progress,
            checkpoint=checkpoint, snapshot=snapshot, blur=blur, lens=lens, view=view, holdout=holdout, over=over,
        )  # fmt: skip
        done, development = self._render(request)
        return development.frame(done.sums(), done.statistics)

    def render_part(
        self, part: PlannedPasses, frame: float | None = None, *, settings: Settings | None = None, **given: Any
    ) -> FrameSums:
        """Return the sums of some of a frame's passes, which join to those of all; arguments are those of `render`."""
        from .request import FrameRequest

        names = {each.name for each in fields(FrameRequest)}
        own = {name: given.pop(name) for name in names & given.keys()}
        done, development = self._render(self.request(frame, None, settings, given, part=part, kept=self._kept, **own))
        return replace(done.sums(), development=development.state())

    def request(
        self, frame: float | None, passes: int | None, settings: Settings | None, by_name: Mapping[str, Any], **own: Any
    ) -> FrameRequest:
        """Return the request that arguments of `render` make: settings are in `by_name`, all else is in `own`."""
        from ..render.denoising import check_denoiser
        from ..render.settings import Settings
        from .request import FrameRequest

        named = {**by_name} if passes is None else {**by_name, "passes": passes}
        chosen = Settings.of(self._settings(frame) if settings is None else settings, named)
        if chosen.denoise:  # known before hours of rendering
            check_denoiser()
            if chosen.filter_name != "box":
                text = f"through the pixel filter {chosen.filter_name} the noise of neighbours is alike, and much stays"
                self._warn(f"denoise: {text}: expected box")
        return FrameRequest.of(frame, chosen, **own)

    def _settings(self, frame: float | None) -> Settings | None:
        """Return the shot's own settings, or None for the defaults."""
        return None

    def _render(self, request: FrameRequest) -> tuple[FrameRenderer, Development]:
        """Return the passes of a frame, and how they become a picture."""
        from ..render.stage_frame import render

        ready = self.prepared(request)
        run = request.run_options(ready.development)
        about = self.content(request.frame) if run.named else ""
        done = render(
            ready.shutter, ready.window, ready.settings, run, ready.holdouts, about, self.viewers
        )  # fmt: skip
        return done, ready.development

    def prepared(self, request: FrameRequest) -> Prepared:
        """Return all that the passes of a frame need; raises what `render` does."""
        from ..render.film import margin_of, reconstruction_filter
        from ..render.stage_frame import groups_of
        from ..world.cameras import View, Window
        from .request import Prepared

        frame, number = request.frame, self._number(request.frame)
        self._check_frame(frame)
        plates = [each for each in (request.holdout, request.over) if each is not None]
        size = self.resolution(request.width, request.height, frame, plates, request.view)
        window = Window(size[0], size[1], pixels_of(request.crop, *size))
        grown = window.grown(margin_of(reconstruction_filter(request.settings.filter_name)))
        names = views_of(self.stereo, request.view)
        depths, pixels = request.read_plates(number, names, size, self._warn)
        exposure = self.exposure(frame, request.blur, request.lens)
        eyes = [EYES.index(name) if name else 0 for name in names]
        content, cameras = exposure(0.0)
        self.check(content, frame)
        settings = self._programmed(request.settings, frame, exposure)
        seen = [View(cameras[eye], grown) for eye in eyes]
        facts = {**self._time_header(frame, exposure), "seed": settings.seed, **window.header()}
        headers = {
            name: {**view.matrices(), **facts, "camera": view.camera.name}
            for name, view in zip(names, seen, strict=True)
        }
        development = request.development(groups_of(content), headers, pixels, window, grown)
        ends = [each.seen_by(view) for each, view in zip(depths, seen, strict=False)]
        return Prepared(exposure.shutter(eyes, self._rate()), grown, settings, ends, development)

    def _rate(self) -> float:
        """Return the time codes in a second."""
        return self.stage.GetTimeCodesPerSecond() or 1.0

    def _time_header(self, frame: float | None, exposure: Exposure) -> dict[str, Any]:
        """Return what an EXR's header says of a frame's time."""
        return header(self.stage, self.time(frame), exposure.duration)

    def content(self, frame: float | None = None) -> str:
        """Return a hash of the shot's content: the stage with its files, and the arguments from Python."""
        from ..usd.digest import stage_digest

        if self._stage_digest is None:
            self._stage_digest = stage_digest(self.stage)
        return digest(self._stage_digest, str(self.time(frame)), self._arguments)

    @property
    def _arguments(self) -> tuple[Any, ...]:
        """What Python gave beside the content."""
        return self.camera, self.medium, self.stereo, self.simulate, self.emit, self.looks

    def beams(
        self,
        frame: float | None = None,
        *,
        view: str | None = None,
        settings: Settings | None = None,
        **given: Unpack[SettingsArguments],
    ) -> list[BeamSet]:
        """Return the beams that the first pass of a frame has: of each light, and of each set of drawn beams.

        Parameters
        ----------
        frame
            Frame number; None is the stage's start or default time. What moves is where it is at that time.
        view
            "left" or "right" for one of two eyes.
        settings, **given
            As for `render`: beams, seed, overlap.
        """
        from ..render.settings import Settings
        from ..render.stage_frame import simulate
        from ..world.cameras import Window

        self._check_frame(frame)
        exposure = self.exposure(frame, blur=False, lens=False)
        self._warn_of_darkness(exposure(0.0)[0], frame)
        size = self.resolution(128, None, frame)
        eyes = [EYES.index(name) if name else 0 for name in views_of(self.stereo, view)]
        chosen = self._programmed(Settings.of(settings, given), frame, exposure)
        return simulate(exposure.shutter(eyes), Window.full(*size), chosen, viewers=self.viewers)

    def drawn_beams(
        self, frame: float | None = None, *, settings: Settings | None = None, **given: Unpack[SettingsArguments]
    ) -> list[scene.DrawnBeams]:
        """Return those beams as plain numbers, as `write_beams` takes them."""
        return [
            scene.DrawnBeams(each.name, **each.beams.arrays(), group=each.group, look=each.look)
            for each in self.beams(frame, settings=settings, **given)
        ]

    def write_beams(
        self,
        path: PathLike,
        frame: float | None = None,
        *,
        settings: Settings | None = None,
        **given: Unpack[SettingsArguments],
    ) -> int:
        """Write those beams as BasisCurves to a .usd, .usda or .usdc file, whole or not at all; return how many."""
        self._check_target(path)
        found = self.drawn_beams(frame, settings=settings, **given)
        self._write(found, path, frame)
        return sum(len(each.start) for each in found)

    def _check_target(self, path: PathLike) -> None:
        """Raise SceneError for a file that the stage is read from."""
        stages.check_not_read(self.stage, path)

    def _write(self, found: list[scene.DrawnBeams], path: PathLike, frame: float | None) -> None:
        """Write beams with the stage's units and looks."""
        known = {id(look): name for name, (_, look) in self._looks.items()}
        looks = {each.name: known[id(each.look)] for each in found if id(each.look) in known}
        write_beams(found, path, like=self.stage, looks=looks, time=self.time(frame))

    def viewers(self) -> list[scene.Camera]:
        """Return cameras at times all over the shot: frames that learned from their own would flicker."""
        times: list[float | None] = [*stages.sample_times(self.stage, _VIEWERS)] or [None]
        return [replace(camera, lens_radius=0.0) for time in times for camera in self.cameras(time)]

    def _programmed(self, settings: Settings, frame: float | None, exposure: Exposure) -> Settings:
        """Return settings with the shot's own program, unless they have one."""
        if self.simulate is None or settings.program is not None:
            return settings
        from ..beams.programs import Program

        return replace(settings, program=Program(self.simulate, frame, exposure.code))

    def check_plates(
        self, plates: Sequence[Holdout | Plate], frame: float | None, width: int, height: int, view: str | None = None
    ) -> None:
        """Raise what `render` would raise about the plates of a frame, as far as their headers tell."""
        for each in plates:
            each.check(self._number(frame), views_of(self.stereo, view), (width, height))

    def _number(self, frame: float | None) -> float:
        """Return the number of a frame, as file names have it."""
        return frame_number(self.time(frame))

    def _warn(self, text: str) -> None:
        """Log a warning once that concerns no prim; SceneError where warnings are errors."""
        self._warnings.give(text)
