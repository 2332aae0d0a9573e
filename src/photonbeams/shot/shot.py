"""Shots: a stage and a camera, rendered into frames, which are written as layered EXRs."""

from __future__ import annotations

import inspect
import os
import weakref
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import fields, replace
from math import log2, pi
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Unpack

from .. import scene
from ..images.frame import Frame, pixels_of
from ..images.plates import Holdout, Plate
from ..runtime.digest import digest
from ..runtime.files import PathLike
from ..usd import stage as stages
from ..usd.authoring.beams import write_beams
from ..usd.authoring.editing import Extent, extent_of
from ..usd.bounds import bounds_at_all_times
from ..usd.cameras.camera import read_shutter
from ..usd.cameras.stereo import EYES, Stereo, check_stereo, read_eyes, views_of
from ..usd.common.motion import Exposure
from ..usd.common.reading import file_of, frame_number
from ..usd.common.warnings import Warnings
from ..usd.groups import groups_at_all_times, makers_at_all_times
from ..usd.layers.frames import check_frames
from ..usd.layers.header import header
from ..usd.looks.look import LookSpec
from ..usd.unread import warn_of_unread

if TYPE_CHECKING:
    from pxr import Usd

    from ..beams.programs import Emitter, Modifier
    from ..beams.sets import BeamSet
    from ..looks import Look
    from ..render.checkpoint import Checkpoint
    from ..render.films.frame_sums import FrameSums
    from ..render.frame import FrameRenderer
    from ..render.passes import PlannedPasses, Progress
    from ..render.settings import Settings, SettingsArguments
    from ..scene import Array
    from .development import Development
    from .request import FrameRequest, Prepared, Snapshot

DEFAULT_WIDTH = 1280

# The most time samples of a stage that are searched for those within the shutter interval.
_MOST_KEYS = 10_000

# The most times on a stage at which emission is guided toward what the camera sees.
_VIEWERS = 9

# The number of times for which the content of the stage is cached until the stage changes.
_CONTENTS = 4

_NOTHING = "nothing makes beams"  # a warning that names the first such frame, and is given once
_DIM = "the suns are dim"  # likewise
_BLACK = 0.03  # an irradiance in which a surface of 18 % grey is below a level of 6 of 255

#: A function that makes a fog from the stage's own, or from None if the stage has none.
Fog = Callable[[scene.Medium | None], scene.Medium | None]


def _opened_scene(
    path: PathLike, camera: str | None, stereo: Stereo | None, looks: Any, groups: Any, beams: Any,
    session_layers: Iterable[PathLike], overrides: Iterable[str], of_stages: Mapping[str, Any],
) -> Shot:  # fmt: skip
    """Return a Mitsuba scene as a shot; SceneError for arguments that only stages take."""
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


def _own_signature(kind: type) -> inspect.Signature:
    """Return the parameters of a class's `__init__`, where Python would show those of `__new__`."""
    signature = inspect.signature(kind.__init__)  # type: ignore[misc]
    return signature.replace(parameters=[*signature.parameters.values()][1:])


def _known(paths: set[str]) -> set[str]:
    """Return paths and the names at their ends: users may name a prim by either."""
    return paths | {path.rpartition("/")[2] for path in paths}


class Shot:
    """A stage seen by one of its cameras, or by two eyes. `Shot.open` makes one from a file.

    Parameters
    ----------
    stage
        An open `Usd.Stage`, a `scene.Scene` that was built in Python, or a scene that Mitsuba has loaded, or a
        dictionary from which `mi.load_dict` makes one.
    camera
        Path or name of a camera of the stage; None, the default: the render settings' camera, or the only one. For a
        `scene.Scene` a `scene.Camera`; for a Mitsuba scene the id or number of a sensor, None: the first.
    medium
        A fog instead of the stage's own; or a function that gets the stage's `Medium`, or None, and returns another.
    stereo
        How the camera becomes two eyes. Default: it does not.
    simulate
        A function of beams and a `PassContext` that changes the beams of each pass, such as `thin` or a `chain`.
    emit
        A function of a `PassContext` that makes beams from nothing: it returns `Beams`, `DrawnBeams`, or several.
    looks
        A look for all beams instead of the stage's looks, or looks by the path or name of a light, of drawn curves, or
        of the stage's PhotonBeamsLook.
    strict
        Whether a warning about the stage is an error. Default False.

    A Mitsuba scene takes only `camera`, `stereo`, `looks`, and, like `Shot.open`, `groups`, `beams`, `session_layers`
    and `parameters`.

    Raises
    ------
    SceneError
        A stage, a camera or another argument of the wrong type.

    Examples
    --------
    >>> lamp = pb.scene.SphereLight("/Lamp", 50.0, center=(0, 2, 0), axis=(0, -1, 0),
    ...                             shaping=pb.scene.Shaping(cone_angle=20))
    >>> content = pb.scene.Scene(lights=lamp, media=pb.Medium(scattering=0.1))
    >>> shot = pb.Shot(content, pb.scene.Camera.look_at(origin=(6, 1, 0), target=(0, 1, 0)))
    >>> frame = shot.render(passes=1, width=32)
    >>> frame.layers["beams"].shape
    (18, 32, 3)

    From a file:

    >>> shot = pb.Shot.open("shot.usda", camera="/Camera")
    >>> shot.render(passes=1, width=32).write("out/shot.exr")
    """

    camera: Any  # the name of a camera on the stage; a scene.Camera for a scene that was built in Python
    __signature__: ClassVar[inspect.Signature]

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls.__signature__ = _own_signature(cls)

    def __new__(cls, stage: Any = None, *_: Any, **__: Any) -> Shot:
        """Return a `Shot`, or the subclass for a Mitsuba scene or for a scene that was built in Python."""
        of_mitsuba = type(stage).__module__.partition(".")[0] == "mitsuba" or (isinstance(stage, Mapping) and stage)
        if cls is Shot and of_mitsuba:
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
            raise scene.SceneError(f"looks is {looks!r}: expected a Look, or a dict of Looks by the names of lights")
        if not (medium is None or callable(medium) or isinstance(medium, scene.Medium)):
            raise scene.SceneError(f"medium is {medium!r}: expected a Medium, or a function of the stage's Medium")
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
        self._lasting: dict[Any, Any] = {}  # what does not change with time on the stage
        self._edited = False  # whether the stage was: until then no time is read twice, and scenes are not cached
        self._contents: dict[Any, scene.Scene] = {}  # scenes that were read last, by times; their looks may be outdated
        self._surfaces: dict[Any, dict[str, Any]] = {}  # the surfaces that were read last, by time
        self._kept: dict[Any, Any] = {}  # the frame of which parts were rendered last
        self._set_content(stage)

    def _set_content(self, stage: Any) -> None:
        """Take what the shot shows; SceneError if that, or the camera, is of the wrong type."""
        stages.check_stage(stage)
        if not (self.camera is None or isinstance(self.camera, str)):
            raise scene.SceneError(f"camera is {self.camera!r}: expected the path or the name of a camera of the stage")
        self.stage: Usd.Stage = stage
        warn_of_unread(stage, self._warnings)
        self._listener = self._listening()

    def _listening(self) -> Any:
        """Return a listener that clears the shot's caches, as far as necessary, when the stage changes."""
        own = weakref.ref(self)  # the shot keeps the listener, which must not keep the shot

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

    def __getstate__(self) -> dict[str, Any]:
        """Raise SceneError: OpenUSD's stages cannot be pickled or copied."""
        raise scene.SceneError(f"{self!r} cannot be pickled: expected Shot.open with its arguments where it is needed")

    def _repr_mimebundle_(
        self, include: Collection[str] | None = None, exclude: Collection[str] | None = None
    ) -> dict[str, str]:  # fmt: skip
        """Return a quick picture for notebooks, or a sentence that says why there is none; never raise.

        `include` and `exclude` are the MIME types that IPython wants and does not want.
        """
        from .notebook import shown

        return shown(self, include, exclude)

    def _own_size(self) -> tuple[int, int]:
        """Return the size in pixels that a render has if none is given."""
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
            Path or name of the camera; None: the render settings' or the only one. For a Mitsuba scene the id or
            number of a sensor; None: the first.
        medium
            A fog instead of the stage's own, or for a stage that has none; or a function that gets the stage's
            `Medium`, or None, and returns another.
        stereo
            How the camera becomes two eyes; None: one picture.
        simulate
            A function of beams and a `PassContext` that changes the beams of each pass, such as `thin`, or a `chain`.
        emit
            A function of a `PassContext` that makes beams from nothing: it returns `Beams`, `DrawnBeams`, or several.
        looks
            Looks of your own instead of the stage's: one for all beams, or a dict by the path or name of a light, of
            drawn curves, or of the PhotonBeamsLook that they refer to. For a Mitsuba scene by the ids of emitters, or
            of their shapes.
        groups
            For a Mitsuba scene: light groups by the same ids.
        beams
            For a Mitsuba scene: settings of beams (portals, gobos, …), which lights of a stage have as attributes, by
            the same ids.
        session_layers
            One layer or several over the stage, the strongest first. Over a Mitsuba scene, prims that are named by the
            ids of emitters carry the attributes that lights of a stage have for their beams.
        overrides
            One value or several, stronger than the layers: "/prim.attribute=value" for a stage, NAME=VALUE for the
            parameters of a Mitsuba scene.
        strict
            Whether a warning about the stage is an error, also one about a part that cannot be read and is left out.
        texture_limit
            For a stage: textures with more pixels than this along a side are scaled down, textures of lights if they
            have more than twice as many; None: 4096.
        variants
            For a stage: one choice of a variant or several, each "/prim{set=choice}".
        mask
            For a stage: paths of the prims that are read, with what is above and below them and what they refer to;
            None: all prims.
        purposes
            For a stage: the purposes that are rendered beside "default"; None: "render".
        complexity
            For a stage: how finely subdivision surfaces are refined, "low", "medium", "high" or "veryhigh"; None:
            "high" for meshes that author a subdivision scheme or creases, none for others.

        Returns
        -------
        Shot
            A `SceneShot` for a Mitsuba scene.

        Raises
        ------
        SceneError
            A file, a camera or an argument that cannot be used; the message says which and why.
        """
        if not isinstance(path, str | os.PathLike) or not os.fspath(path):
            text = "expected the name of a file; pb.Shot(...) takes what is open, or made in Python"
            raise scene.SceneError(f"path is {scene.shown(path)}: {text}")
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
        shot.cameras()  # so that a wrong name is an error now, not after a long read
        return shot

    @property
    def warnings(self) -> Warnings:
        """The warnings about the shot so far."""
        return self._warnings

    def time(self, frame: float | None = None) -> Usd.TimeCode:
        """Return the time code of a `frame`; None is the stage's start or default time."""
        if frame is None:
            return stages.default_time(self.stage)
        return stages.time_code(frame)

    def _check_frame(self, frame: float | None) -> None:
        """Raise SceneError for a frame outside of the stage's range."""
        if frame is not None and not self.time(frame).IsDefault():
            check_frames(self.stage, [self._number(frame)])

    def read(self, frame: float | None = None, base: float | None = None) -> tuple[scene.Scene, scene.Camera]:
        """Return the scene at a frame, with its looks built, and the camera.

        Parameters
        ----------
        frame
            Frame number; None is the stage's start or default time.
        base
            The frame whose shutter is open: velocities move things away from where they are at this frame. None:
            `frame`.
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
        """Return the stage's scene with the medium and the beams that were given in Python."""
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
        key = (None if time.IsDefault() else time.GetValue(), base)  # as text, times that differ little would be one
        known, content = self._contents.get(key), None
        if known is not None:  # at most looks were edited since it was read
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
        """Return the names of everything that makes beams at any time, and of its looks."""
        return makers_at_all_times(self.stage)

    def _check_looks(self, content: scene.Scene) -> None:
        """Raise SceneError if a name in `looks` is that of no beams and of no look."""
        if not isinstance(self.looks, Mapping):
            return
        named = {light.name for light in content.lights} | {drawn.name for drawn in content.drawn} | set(self._looks)
        if not _known(named).issuperset(self.looks):
            named |= self._makers()  # looks may also be for lights that are hidden now
        for name in self.looks:
            if name not in _known(named):
                beams = ", ".join(sorted(named)) or "none"
                raise scene.SceneError(f"{self._place}: no beams are named {name}: expected one of {beams}")

    def _emitted(self, emit: Emitter, frame: float | None, medium: scene.Medium | None) -> list[scene.DrawnBeams]:
        """Return the beams that the function `emit` makes at a frame."""
        from ..beams.programs import PassContext, emitted

        return emitted(emit, PassContext(frame=frame, time=self._number(frame), medium=medium))

    def _media(self, content: scene.Scene) -> tuple[scene.Medium, ...]:
        """Return the stage's media, or the shot's instead; a function replaces only the first homogeneous medium."""
        if not callable(self.medium):
            return content.media if self.medium is None else (self.medium,)
        own = content.medium
        chosen = self.medium(own)
        rest = tuple(each for each in content.media if each is not own)
        return rest if chosen is None else content.media if chosen is own else (chosen, *rest)

    def cameras(self, frame: float | None = None) -> tuple[scene.Camera, ...]:
        """Return the camera at a `frame`, or those of the left and the right eye."""
        if self.stereo is None:
            return (stages.read_camera(self.stage, self.camera, self.time(frame), self._warnings),)
        return read_eyes(self.stage, self.camera, self.stereo, self.time(frame), self._warnings)

    def look_through(self, camera: str | None, stereo: Stereo | None = None) -> None:
        """Change the `camera`, given by its path or name, and its eyes, `stereo`."""
        check_stereo(stereo)
        if (camera, stereo) != (self.camera, self.stereo):
            self.camera, self.stereo, self._sphere = camera, stereo, None

    def exposure(self, frame: float | None = None, blur: bool = True, lens: bool = True) -> Exposure:
        """Return the scene and the cameras over the shutter interval of a frame.

        Parameters
        ----------
        frame
            Frame number; None is the stage's start or default time.
        blur
            If False, the interval is the frame's own time, and nothing moves.
        lens
            If False, lenses have the radius 0, and everything is in focus.
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
            # Computed once, so that beams do not change when something moves elsewhere.
            self._sphere = bounds_at_all_times(
                self.stage, content, self._extent, self.cameras, emits=self.emit is not None
            )
        return self._sphere

    def _extent(self, frame: float | None) -> scene.Scene:
        """Return a scene that is as large as the one at a frame, but is faster to read."""
        return self._with_own(stages.read_extent(self.stage, self.time(frame), self._lasting), frame)

    def _groups_at_all_times(self) -> frozenset[str]:
        if self._groups is None:
            # Computed once, so that all frames have the same layers.
            self._groups = groups_at_all_times(self.stage)
        return self._groups

    def check(self, content: scene.Scene, frame: float | None = None) -> list[str]:
        """Return the names of the layers that a frame of this scene has.

        Warn once if no beams are visible: there is no fog, nothing makes beams now, or all lights are black. That is no
        error, so that a light that fades out does not end a film.

        Parameters
        ----------
        content
            The scene.
        frame
            Its frame number, for messages; None is the stage's start or default time.

        Raises
        ------
        SceneError
            There is nothing to render.
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
            self._warn(f"{self._place}: there is no fog, so no beams are seen: {fog}")
        elif names:
            self._warn(f"{self._place}: no beams have any light: expected some of {names} to shine")
        elif not makers(content) and not content.sky and _NOTHING not in self._warnings.given:
            self._warnings.given.add(_NOTHING)
            idle = ", ".join(light.name for light in content.lights)
            expected = f"photonbeams:enabled on {idle}" if idle else "a light that is on"
            at = f"{self._place}: {_NOTHING} at frame {self._number(frame):.10g}"
            self._warn(f"{at}: expected {expected}; frames without one have no beams")

    def _warn_of_dim_suns(self, content: scene.Scene, cameras: Sequence[scene.Camera]) -> None:
        """Warn if the lights that shine are all suns, in whose light, times the exposure, surfaces look black.

        Without `normalize` an intensity is the radiance of the sun's disc: 0.53 degrees have a 15,000th of it.
        """
        shining = [each for each in content.lights if max(each.radiance) > 0]
        suns = [each for each in shining if isinstance(each, scene.DistantLight)]
        if not suns or len(suns) < len(shining) or content.drawn or _DIM in self._warnings.given:
            return
        total = sum(each.irradiance for each in suns) * max(each.exposure_scale for each in cameras)
        if 0 < total < _BLACK:
            self._warnings.given.add(_DIM)  # frames with other numbers are no news
            sun = max(suns, key=lambda each: each.irradiance)
            disc = f" (a radiance of {max(sun.radiance):.3g} over {sun.angle:.3g} degrees)" if sun.angle > 0 else ""
            more = f"{log2(pi / total):.1f} stops more show them, by --exposure or inputs:exposure"
            text = f"{self._place}: {sun.name} gives an irradiance of {total:.2g}{disc}, in which surfaces look black"
            self._warn(f"{text}: {more}, as does inputs:normalize, if that is off")

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
        known = self._looks.get(spec.name)
        if known is None or digest(known[0]) != digest(spec):
            from ..usd.looks.shading import build_look  # starts Dr.Jit, which readers do not need

            known = self._looks[spec.name] = (spec, build_look(spec))
        return known[1]

    def resolution(
        self,
        width: int | None = None,
        height: int | None = None,
        frame: float | None = None,
        plates: Sequence[Holdout | Plate] = (),
        view: str | None = None,
        pixel_aspect: float = 1.0,
    ) -> tuple[int, int]:
        """Return the width and height of a frame in pixels.

        Parameters
        ----------
        width, height
            Pixels. If one is None, it follows from the other and the camera's aperture. If both are, the size is that
            of the first plate, or else 1280 wide.
        frame
            Frame number; None is the stage's start or default time.
        plates, view
            Holdouts and plates of the frame, and the view, "left" or "right", of which the first one's size is read.
        pixel_aspect
            Width of a pixel over its height.

        Raises
        ------
        SceneError
            A size that is not a whole number from 1 to 65536.
        """
        width, height = (
            None if value is None else scene.whole(value, name, " of pixels")
            for name, value in (("width", width), ("height", height))
        )
        if width is None and height is None and plates:
            width, height = plates[0].size(self._number(frame), views_of(self.stereo, view))
        camera = self.cameras(frame)[0]
        aspect = camera.horizontal_aperture / (camera.vertical_aperture * pixel_aspect)
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
        pixel_aspect: float = 1.0,
        conform: str = "expandAperture",
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
            Pixels; if one is missing it follows from the camera's aperture. Without either the picture is 1280 wide.
        crop
            The part to render: x0, y0, x1, y1 in fractions of the picture from the top left. Numbers below 0 and above
            1 are overscan, which leaves the bits of the picture itself as they are.
        pixel_aspect
            Width of a pixel over its height.
        conform
            How the camera's aperture fits a picture of another aspect, as UsdRenderSettings defines it:
            "expandAperture", "cropAperture", "adjustApertureWidth", "adjustApertureHeight", or
            "adjustPixelAspectRatio", which chooses the `pixel_aspect`.
        progress
            Called with the number of passes done and the statistics so far, before the first pass and after each.
        checkpoint
            A file to which the passes are written every minute. If the same render is started again it continues from
            there, and gives the same bits. The file is not removed: do so once the frame is written. A `Checkpoint`
            describes more.
        snapshot
            Called after each pass with a function that returns the frame so far.
        blur
            If False, there is no motion blur: everything is as at the frame's own time. Nothing in a Mitsuba scene
            moves.
        lens
            If False, there is no depth of field.
        view
            "left" or "right" for one of two eyes; None renders both.
        holdout
            Another renderer's depth. Beams end there instead of at the stage's own surfaces, which are not seen then,
            but still block the light. A file, (H, W) planar depths in scene units, or a `Holdout`.
        over
            A picture of the same size, to which `rgba` adds the beams. A file, (H, W, 3 or 4) scene-linear pixels, or
            a `Plate`.

        Returns
        -------
        Frame
            The layers of the crop window, of each eye if there are two, and the metadata of an EXR's header.

        Raises
        ------
        SceneError
            Something that cannot be read or rendered at this frame: a stage without anything that makes beams; a
            resolution, a crop, a view or settings out of range; a name that is no setting; a holdout or a plate without
            a depth or a picture, or of another size; a checkpoint of another render.
        OSError
            A holdout or a plate that does not exist or may not be read.
        """
        request = self.request(
            frame, passes, settings, given, width=width, height=height, crop=crop, pixel_aspect=pixel_aspect,
            conform=conform, progress=progress, checkpoint=checkpoint, snapshot=snapshot, blur=blur, lens=lens,
            view=view, holdout=holdout, over=over,
        )  # fmt: skip
        done, development = self._render(request)
        return development.frame(done.sums(), done.statistics)

    def render_part(
        self, part: PlannedPasses, frame: float | None = None, *, settings: Settings | None = None, **given: Any
    ) -> FrameSums:
        """Return the sums of some of a frame's passes; the sums of all parts can be joined, and give the frame.

        Parameters
        ----------
        part
            The passes to render.
        frame, settings, **given
            As for `render`.
        """
        from .request import FrameRequest

        names = {each.name for each in fields(FrameRequest)}
        own = {name: given.pop(name) for name in names & given.keys()}
        done, development = self._render(self.request(frame, None, settings, given, part=part, kept=self._kept, **own))
        return replace(done.sums(), development=development.state())

    def request(
        self, frame: float | None, passes: int | None, settings: Settings | None, by_name: Mapping[str, Any], **own: Any
    ) -> FrameRequest:
        """Return the arguments of `render`, checked, as a request.

        Parameters
        ----------
        frame, passes, settings
            As for `render`.
        by_name
            Fields of `Settings`.
        **own
            All other arguments of `render`.
        """
        from ..render.films.denoising import check_denoiser
        from ..render.settings import Settings
        from .request import FrameRequest

        named = {**by_name} if passes is None else {**by_name, "passes": passes}
        chosen = Settings.of(self._settings(frame) if settings is None else settings, named)
        if chosen.denoise:  # checked before hours of rendering
            check_denoiser()
            if chosen.filter_name != "box":
                text = f"the pixel filter {chosen.filter_name} makes noise alike in neighbouring pixels, and much stays"
                self._warn(f"denoise: {text}: expected box")
        return FrameRequest.of(frame, chosen, **own)

    def _settings(self, frame: float | None) -> Settings | None:
        """Return the settings that the shot itself has, or None for the defaults."""
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
        """Return everything that the passes of the frame of a `request` need; raises what `render` does."""
        from ..render.films.film import margin_of, reconstruction_filter
        from ..render.stage_frame import groups_of
        from ..world.cameras.cameras import View, Window
        from .request import Prepared

        frame, number = request.frame, self._number(request.frame)
        self._check_frame(frame)
        plates = [each for each in (request.holdout, request.over) if each is not None]
        size = self.resolution(request.width, request.height, frame, plates, request.view, request.pixel_aspect)
        crop = pixels_of(request.crop, *size, overscan=True)
        window = Window(*size, crop, request.pixel_aspect, request.conform)
        grown = window.grown(margin_of(reconstruction_filter(request.settings.filter_name)))
        names = views_of(self.stereo, request.view)
        depths, pixels = request.read_plates(number, names, window, grown, self._warn)
        exposure = self.exposure(frame, request.blur, request.lens)
        eyes = [EYES.index(name) if name else 0 for name in names]
        content, cameras = exposure(0.0)
        self.check(content, frame)
        self._warn_of_dim_suns(content, cameras)
        settings = self._programmed(request.settings, frame, exposure)
        seen = [View(cameras[eye], grown) for eye in eyes]
        facts = {**self._time_header(frame, exposure), "seed": settings.seed, **window.header()}
        headers = {
            name: {**view.header(), **facts, "camera": view.camera.name} for name, view in zip(names, seen, strict=True)
        }
        development = request.development(groups_of(content), headers, pixels, window, grown)
        ends = [each.seen_by(view) for each, view in zip(depths, seen, strict=False)]
        return Prepared(exposure.shutter(eyes, self._rate()), grown, settings, ends, development)

    def _rate(self) -> float:
        """Return the time codes in a second."""
        return self.stage.GetTimeCodesPerSecond()

    def _time_header(self, frame: float | None, exposure: Exposure) -> dict[str, Any]:
        """Return the metadata of an EXR's header about a frame's time."""
        return header(self.stage, self.time(frame), exposure.duration)

    def content(self, frame: float | None = None) -> str:
        """Return a hash of what a `frame` shows: the stage with its files, the time, and the arguments from Python."""
        from ..usd.layers.digest import stage_digest

        if self._stage_digest is None:
            self._stage_digest = stage_digest(self.stage)
        return digest(self._stage_digest, str(self.time(frame)), self._arguments)

    @property
    def _arguments(self) -> tuple[Any, ...]:
        """What was given in Python beside the content."""
        return self.camera, self.medium, self.stereo, self.simulate, self.emit, self.looks

    def beams(
        self,
        frame: float | None = None,
        *,
        view: str | None = None,
        settings: Settings | None = None,
        **given: Unpack[SettingsArguments],
    ) -> list[BeamSet]:
        """Return the beams of a frame's first pass: a set for each light, and for each set of drawn beams.

        Parameters
        ----------
        frame
            Frame number; None is the stage's start or default time. Everything is where it is at that time.
        view
            "left" or "right" for one of two eyes.
        settings, **given
            As for `render`: beams, seed, overlap.
        """
        from ..render.settings import Settings
        from ..render.stage_frame import simulate
        from ..world.cameras.cameras import Window

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
        """Return the beams of a frame's first pass as plain numbers.

        Parameters
        ----------
        frame, settings, **given
            As for `beams`.
        """
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
        """Write the beams of a frame's first pass as BasisCurves, and return how many there are.

        Parameters
        ----------
        path
            A .usd, .usda or .usdc file; it is written whole or not at all.
        frame, settings, **given
            As for `beams`.

        Raises
        ------
        SceneError
            Another suffix, a file that the stage is read from, or what `beams` raises.
        OSError
            The file cannot be written.
        """
        self._check_target(path)
        found = self.drawn_beams(frame, settings=settings, **given)
        self._write(found, path, frame)
        return sum(len(each.start) for each in found)

    def _check_target(self, path: PathLike) -> None:
        """Raise SceneError for a file that the stage is read from."""
        stages.check_not_read(self.stage, path)

    def _write(self, found: list[scene.DrawnBeams], path: PathLike, frame: float | None) -> None:
        """Write beams, with the units and the looks of the stage."""
        known = {id(look): name for name, (_, look) in self._looks.items()}
        looks = {each.name: known[id(each.look)] for each in found if id(each.look) in known}
        write_beams(found, path, like=self.stage, looks=looks, time=self.time(frame))

    def viewers(self) -> list[scene.Camera]:
        """Return cameras at times all over the shot, to guide emission: guided frame by frame, films would flicker."""
        times: list[float | None] = [*stages.sample_times(self.stage, _VIEWERS)] or [None]
        return [replace(camera, lens_radius=0.0) for time in times for camera in self.cameras(time)]

    def _programmed(self, settings: Settings, frame: float | None, exposure: Exposure) -> Settings:
        """Return settings with the function `simulate` as their program, unless they have one."""
        if self.simulate is None or settings.program is not None:
            return settings
        from ..beams.programs import Program

        return replace(settings, program=Program(self.simulate, frame, exposure.code))

    def check_plates(
        self, plates: Sequence[Holdout | Plate], frame: float | None, width: int, height: int, view: str | None = None
    ) -> None:
        """Raise what `render` would raise about holdouts and plates, as far as their headers show it.

        Parameters
        ----------
        plates
            Holdouts and plates.
        frame, width, height, view
            As for `render`.
        """
        for each in plates:
            each.check(self._number(frame), views_of(self.stereo, view), (width, height))

    def _number(self, frame: float | None) -> float:
        """Return the number of a frame, as it appears in file names."""
        return frame_number(self.time(frame))

    def _warn(self, text: str) -> None:
        """Log a warning about no particular prim, once; raise it as a SceneError if the shot is strict."""
        self._warnings.give(text)


Shot.__signature__ = _own_signature(Shot)
