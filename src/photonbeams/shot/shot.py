"""Shots: a subject and a camera, rendered into frames, which are written as layered EXRs."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from .. import scene
from ..beams.programs import Emitter, Modifier
from ..images.frame import Frame
from ..images.plates import Holdout, Plate
from ..runtime.device import kept_variant
from ..runtime.files import PathLike
from ..scene.places import moved
from ..setting import Setting
from ..usd import stage as stages
from ..usd.cameras.stereo import Stereo, check_stereo, views_of
from ..usd.common.warnings import Strictness, Warnings
from .described_subject import BuiltSubject, MediumOverride
from .stage_subject import StageSubject
from .subject import FOR_SCENES, FOR_STAGES, Subject, Viewpoint, refuse, several

if TYPE_CHECKING:
    from pxr import Usd

    from ..beams.sets import BeamSet
    from ..looks import Look
    from ..render.checkpoint import Checkpoint
    from ..render.films.frame_sums import FrameSums
    from ..render.passes import PlannedPasses, Progress
    from ..render.reuse import FilmMemory
    from ..render.settings import Settings, SettingsArguments
    from ..scene import Array
    from ..usd.common.motion import Exposure
    from .estimate import RenderEstimate
    from .request import Prepared, Snapshot


_TEXTURE_LIMIT = Setting(kind=int, least=1, most=scene.MOST_PIXELS)


class Shot:
    """A stage, a scene built in Python or a Mitsuba scene, seen by a camera or two eyes. `Shot.open` opens a file.

    Parameters
    ----------
    stage
        An open `Usd.Stage`, a `scene.Scene` that was built in Python, or a scene that Mitsuba has loaded, or a
        dictionary from which `mi.load_dict` makes one.
    camera
        Path or name of a camera of the stage; None: the render settings' camera, or the only one. For a `scene.Scene` a
        `scene.Camera`; for a Mitsuba scene the id or number of a sensor, None: the first.
    medium
        A fog instead of the stage's own, or for a stage that has none; or a function that gets the stage's `Medium`, or
        None, and returns another.
    stereo
        How the camera becomes two eyes; None: one picture.
    simulate
        A function of beams and a `PassContext` that changes the beams of each pass, such as `thin` or a `chain`.
    emit
        A function of a `PassContext` that makes beams from nothing: it returns `Beams`, `DrawnBeams`, or several.
    looks
        Looks of your own instead of the stage's: one for all beams, or a dict by the path or name of a light, of drawn
        curves, or of the PhotonBeamsLook that they refer to. For a Mitsuba scene by the ids of emitters, or of their
        shapes.
    strict
        Whether a warning about the stage is an error, also one about a part that cannot be read and is left out; or
        "missing": a warning that something is missing which the stage names, such as a file.
    groups, beams
        For a Mitsuba scene, by the same ids: light groups, and settings of beams (portals, gobos, …), which lights of a
        stage have as attributes. It takes no `medium`, `simulate`, `emit` and `strict`.
    session_layers, parameters
        For a Mitsuba scene: layers as for `open`, and values of parameters of a file.

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
    >>> shot.render(passes=1, width=32).layers["beams"].shape
    (18, 32, 3)

    From a file:

    >>> shot = pb.Shot.open("shot.usda", camera="/Camera")
    >>> shot.render(passes=1, width=32).write("out/shot.exr")
    """

    @kept_variant()
    @scene.arguments
    def __init__(
        self, stage: Usd.Stage | scene.Scene | Mapping[str, Any] | Subject, camera: str | scene.Camera | None = None,
        medium: scene.Medium | MediumOverride | None = None, stereo: Stereo | None = None,
        simulate: Modifier | None = None, emit: Emitter | None = None, looks: Look | Mapping[str, Look] | None = None,
        strict: Strictness = False, *, groups: Mapping[str, str] | None = None,
        beams: Mapping[str, scene.BeamSettings] | None = None, session_layers: PathLike | Iterable[PathLike] = (),
        parameters: Mapping[str, str] | None = None,
    ) -> None:  # fmt: skip
        check_stereo(stereo)
        self.subject: Subject
        if isinstance(stage, Subject):
            self.subject = stage
        elif type(stage).__module__.partition(".")[0] == "mitsuba" or (isinstance(stage, Mapping) and stage):
            from .scene_subject import SceneSubject

            refuse(FOR_STAGES, medium=medium, simulate=simulate, emit=emit, strict=strict)
            self.subject = SceneSubject(stage, looks, groups, beams, parameters, session_layers)
        else:
            refuse(FOR_SCENES, groups=groups, beams=beams, session_layers=session_layers, parameters=parameters)
            kind: Callable[..., Subject] = BuiltSubject if isinstance(stage, scene.Scene) else StageSubject
            self.subject = kind(stage, medium, simulate, emit, looks, strict)
        self.camera, self.stereo = camera, stereo
        self._kept: dict[Any, Any] = {}  # the frame of which parts were rendered last
        self._film: FilmMemory | None = None  # what the frames of a film have in common
        self.subject.check_viewpoint(self.viewpoint)

    def __repr__(self) -> str:
        return f"Shot({self.subject!r}, camera={getattr(self.camera, 'name', self.camera)!r})"

    def __getstate__(self) -> dict[str, Any]:
        """Return what is pickled; SceneError if the subject cannot be."""
        return {**self.__dict__, "_kept": {}, "_film": None}

    def _repr_mimebundle_(
        self, include: Collection[str] | None = None, exclude: Collection[str] | None = None
    ) -> dict[str, str]:  # fmt: skip
        """Return a quick picture for notebooks, or a sentence that says why there is none; never raise."""
        from .notebook import shown

        return shown(self, include, exclude)

    @classmethod
    @kept_variant()
    @scene.arguments
    def open(
        cls, path: PathLike, camera: str | None = None, *, medium: scene.Medium | MediumOverride | None = None,
        stereo: Stereo | None = None, simulate: Modifier | None = None, emit: Emitter | None = None,
        looks: Look | Mapping[str, Look] | None = None, groups: Mapping[str, str] | None = None,
        beams: Mapping[str, scene.BeamSettings] | None = None, session_layers: PathLike | Iterable[PathLike] = (),
        overrides: str | Iterable[str] = (), strict: Strictness = False, texture_limit: int | None = None,
        variants: str | Iterable[str] = (), mask: str | Iterable[str] | None = None,
        purposes: str | Iterable[str] | None = None, complexity: str | None = None, working_space: str | None = None,
        color_space: str | None = None,
    ) -> Shot:  # fmt: skip
        """Open a USD stage, or a Mitsuba scene.

        Parameters
        ----------
        path
            A .usd, .usda, .usdc or .usdz file; or a Mitsuba .xml, in whose name a run of # is the frame number.
        camera, medium, stereo, simulate, emit, looks, groups, beams, strict
            As for `Shot`.
        session_layers
            One layer or several over the stage, the strongest first. Over a Mitsuba scene, prims that are named by the
            ids of emitters carry the attributes that lights of a stage have for their beams.
        overrides
            One value or several, stronger than the layers: "/prim.attribute=value" for a stage, NAME=VALUE for the
            parameters of a Mitsuba scene.
        texture_limit
            For a stage: textures with more pixels than this along a side are scaled down, textures of lights if they
            have more than twice as many; None: 4096.
        variants, mask
            For a stage: one choice of a variant or several, each "/prim{set=choice}". Paths of the prims that are read,
            with what is above and below them and what they refer to; None: all prims.
        purposes, complexity
            For a stage: the purposes that are rendered beside "default"; None: "render". How finely subdivision
            surfaces are refined, "low", "medium", "high" or "veryhigh"; None: "high" for meshes that author a
            subdivision scheme or creases, none for others.
        working_space, color_space
            For a stage: the linear colour space in which light is computed, such as "ACEScg"; None: that of the stage's
            render settings, or linear Rec. 709. And the space of colours and images that name none.

        Raises
        ------
        SceneError
            A file, a camera or an argument that cannot be used; the message says which and why.
        """
        if not isinstance(path, str | os.PathLike) or not (path := os.fsdecode(path)):
            text = "expected the name of a file; pb.Shot(...) takes what is open, or made in Python"
            raise scene.SceneError(f"path is {scene.shown(path)}: {text}")
        if Path(path).suffix.lower() == ".xml":
            refuse(
                FOR_STAGES, medium=medium, simulate=simulate, emit=emit, strict=strict, variants=variants, mask=mask,
                purposes=purposes, complexity=complexity, working_space=working_space, color_space=color_space,
            )  # fmt: skip
            from .scene_subject import SceneSubject, values_by_name

            parameters = values_by_name(several(overrides), "cannot set")
            subject = SceneSubject(path, looks, groups, beams, parameters, session_layers)
            return cls(subject, camera, stereo=stereo)
        refuse(FOR_SCENES, groups=groups, beams=beams)
        if texture_limit is not None:
            texture_limit = _TEXTURE_LIMIT.checked(texture_limit, "texture_limit")
        selection = stages.Selection.of(mask, purposes, variants, complexity)
        layers = several(session_layers), several(overrides)
        warnings = Warnings.of(strict)
        stage = stages.open_stage(path, *layers, warnings, texture_limit, selection, working_space, color_space)
        shot = cls(
            stage=stage,
            camera=camera,
            medium=medium,
            stereo=stereo,
            simulate=simulate,
            emit=emit,
            looks=looks,
            strict=warnings,
        )
        shot.cameras()  # so that a wrong name is an error now, not after a long read
        return shot

    @property
    def viewpoint(self) -> Viewpoint:
        """The camera and its eyes."""
        return Viewpoint(self.camera, self.stereo)

    @property
    def stage(self) -> Usd.Stage:
        """The OpenUSD stage, which may be edited; SceneError if the subject is none."""
        return self.subject.stage

    @property
    def warnings(self) -> Warnings:
        """The warnings about the shot so far."""
        return self.subject.warnings

    @kept_variant()
    def settings(self, frame: float | None = None) -> Settings:
        """Return the settings of a Mitsuba scene's integrator at a `frame`; of other subjects the defaults."""
        return self.subject.settings(self.viewpoint, frame)

    def time(self, frame: float | None = None) -> Usd.TimeCode:
        """Return the stage's time code of a `frame`; None is its start or default time."""
        return self.subject.time(frame)

    @scene.arguments
    def read(self, frame: float | None = None, base: float | None = None) -> tuple[scene.Scene, scene.Camera]:
        """Return the scene at a `frame`, with its looks built, and the camera. SceneError for a Mitsuba scene.

        Parameters
        ----------
        base
            The frame whose shutter is open: velocities move things away from where they are at this frame. None:
            `frame`.
        """
        return self.subject.read(self.viewpoint, frame, None if base is None else scene.number(base, "base"))

    @kept_variant()
    def cameras(self, frame: float | None = None) -> tuple[scene.Camera, ...]:
        """Return the camera at a `frame`, or those of the left and the right eye."""
        return self.subject.cameras(self.viewpoint, frame)

    @kept_variant()
    @scene.arguments
    def exposure(self, frame: float | None = None, blur: bool = True, lens: bool = True) -> Exposure:
        """Return the scene and the cameras over the shutter interval of a `frame`. SceneError for a Mitsuba scene.

        Without `blur` the interval is the frame's own time; without `lens` everything is in focus.
        """
        return self.subject.exposure(self.viewpoint, frame, blur, lens)

    @kept_variant()
    @scene.arguments
    def resolution(
        self, width: int | None = None, height: int | None = None, frame: float | None = None,
        plates: Sequence[Holdout | Plate] = (), view: str | None = None, pixel_aspect: float = 1.0,
    ) -> tuple[int, int]:  # fmt: skip
        """Return the width and height of a frame in pixels.

        Parameters
        ----------
        width, height
            Pixels. If one is None, it follows from the other and the camera's aperture. If both are, the size is that
            of a Mitsuba scene's film, or that of the first plate, or else 1280 wide.
        frame, pixel_aspect
            As for `render`.
        plates, view
            Holdouts and plates of the frame, and the view, "left" or "right", of which the first one's size is read.

        SceneError for a size that is not a whole number from 1 to 65536.
        """
        return self.subject.resolution(self.viewpoint, frame, width, height, tuple(plates), view, pixel_aspect)

    @kept_variant()
    def render(
        self, frame: float | None = None, passes: int | None = None, *, settings: Settings | None = None,
        width: int | None = None, height: int | None = None, crop: Sequence[float] | None = None,
        pixel_aspect: float = 1.0, conform: str = "expandAperture", progress: Progress | None = None,
        checkpoint: PathLike | Checkpoint | None = None, snapshot: Snapshot | None = None, blur: bool = True,
        lens: bool = True, view: str | None = None, holdout: PathLike | Array | Holdout | None = None,
        over: PathLike | Array | Plate | None = None, **given: Unpack[SettingsArguments],
    ) -> Frame:  # fmt: skip
        """Render a frame: the layers of the crop window, of each eye if there are two, and an EXR's metadata.

        Parameters
        ----------
        frame
            Frame number; None is the stage's start or default time. Of a Mitsuba scene it chooses the file, where the
            shot's name has a run of #.
        passes, settings, **given
            How to render: fields of `Settings` by name (time_limit, beams, seed, pixel_filter, …), all of them at once
            as `settings`, or both; None: the defaults.
        width, height
            Pixels; if one is missing it follows from the camera's aperture. Without either the picture is 1280 wide.
        crop
            The part to render: x0, y0, x1, y1 in fractions of the picture from the top left. Numbers below 0 and above
            1 are overscan, which leaves the bits of the picture itself as they are.
        pixel_aspect, conform
            Width of a pixel over its height; and how the camera's aperture fits a picture of another aspect, as
            UsdRenderSettings defines it: "expandAperture", "cropAperture", "adjustApertureWidth",
            "adjustApertureHeight", or "adjustPixelAspectRatio", which chooses the `pixel_aspect`.
        progress, snapshot
            `progress` is called with the number of passes done and the statistics so far, before the first pass and
            after each; `snapshot` after each, with a function that returns the frame so far.
        checkpoint
            A file to which the passes are written every minute. If the same render is started again it continues from
            there, and gives the same bits. Remove it once the frame is written. A `Checkpoint` describes more.
        blur, lens, view
            False: no motion blur, everything is as at the frame's own time; no depth of field. "left" or "right": only
            this eye.
        holdout
            Another renderer's depth. Beams end there instead of at the stage's own surfaces, which are not seen then,
            but still block the light. A file, (H, W) planar depths in scene units, or a `Holdout`.
        over
            A picture of the same size, to which `rgba` adds the beams. A file, (H, W, 3 or 4) scene-linear pixels, or
            a `Plate`.

        Raises
        ------
        SceneError
            Something that cannot be read or rendered at this frame: a stage without anything that makes beams; an
            argument out of range, or no setting; a holdout or a plate that cannot be read, is without a depth or a
            picture, or of another size; a checkpoint of another render.
        """
        return self._prepared(
            frame, passes, settings, width=width, height=height, crop=crop, pixel_aspect=pixel_aspect, conform=conform,
            progress=progress, checkpoint=checkpoint, snapshot=snapshot, blur=blur, lens=lens, view=view,
            holdout=holdout, over=over, film=self._film, **given,
        ).frame()  # fmt: skip

    @kept_variant()
    def estimate(
        self, frame: float | None = None, passes: int | None = None, *, settings: Settings | None = None, **given: Any
    ) -> RenderEstimate:  # fmt: skip
        """Return how long a frame takes and how much memory, from a few passes: see `shot.estimate.RenderEstimate`.

        Parameters
        ----------
        frame, passes, settings, **given
            As for `render`, without its callbacks and its checkpoint.

        Raises
        ------
        SceneError
            What `render` raises before its first pass, also if a pass takes more memory than there is.

        Examples
        --------
        >>> found = pb.Shot.open("shot.usda", camera="/Camera").estimate(passes=16, width=64)
        >>> found.size, found.passes, found.seconds > 0
        ((64, 47), 16, True)
        """
        from .estimate import estimate
        from .request import RenderCall

        return estimate(RenderCall(self.subject, self.viewpoint, frame, passes, settings, given))

    @contextmanager
    def film(self) -> Iterator[None]:
        """Keep what frames have in common, while they are rendered one after the other; they have the same bits.

        As long as only the camera moves, the scene is built once, and the light of each pass is traced once, as far as
        two million beams and photons go. At the end it is forgotten.

        Examples
        --------
        >>> shot = pb.Shot.open("shot.usda", camera="/Camera")
        >>> with shot.film():
        ...     for frame in (1, 2):
        ...         shot.render(frame, passes=1, width=32).write(f"out/shot.{frame:04d}.exr")
        """
        from ..render.reuse import FilmMemory

        self._film = FilmMemory()
        try:
            yield
        finally:
            self._film = None

    def _prepared(
        self, frame: float | None, passes: int | None, settings: Settings | None, **given: Any
    ) -> Prepared:  # fmt: skip
        """Return what the passes of a frame need."""
        from .request import RenderCall, prepare

        return prepare(RenderCall(self.subject, self.viewpoint, frame, passes, settings, given))

    @kept_variant()
    def render_part(
        self, part: PlannedPasses, frame: float | None = None, *, settings: Settings | None = None, **given: Any
    ) -> FrameSums:
        """Return the sums of some of a frame's passes; the sums of all parts can be joined, and give the frame.

        `part` are the passes to render; `frame`, `settings` and `given` are as for `render`, and `film` among these is
        what frames whose parts are rendered have in common.
        """
        ready = self._prepared(frame, None, settings, part=part, kept=self._kept, **given)
        return replace(ready.render().sums(), development=ready.development.state())

    @kept_variant()
    def beams(
        self, frame: float | None = None, *, view: str | None = None, settings: Settings | None = None,
        **given: Unpack[SettingsArguments],
    ) -> list[BeamSet]:  # fmt: skip
        """Return the beams of a frame's first pass: a set for each light, and for each set of drawn beams.

        The light of all emitters of a Mitsuba scene is traced, unless `method` says otherwise.

        Parameters
        ----------
        frame, view
            As for `render`. Everything is where it is at the frame's own time.
        settings, **given
            As for `render`: beams, seed, overlap.
        """
        found = self.subject.beams(self.viewpoint, frame, views_of(self.stereo, view), settings, given)
        return [each.in_world() for each in found]

    def drawn_beams(
        self, frame: float | None = None, *, settings: Settings | None = None, **given: Unpack[SettingsArguments]
    ) -> list[scene.DrawnBeams]:
        """Return the beams of the first pass of a `frame` as plain numbers; `settings` and `given` as for `beams`."""
        found = self.subject.beams(self.viewpoint, frame, views_of(self.stereo, None), settings, given)
        return [  # in double precision
            moved(
                scene.DrawnBeams(each.name, **each.beams.arrays(), group=each.group, look=each.look),
                -np.array(each.zero),
            )
            for each in found
        ]

    @scene.arguments
    def write_beams(
        self, path: PathLike, frame: float | None = None, *, settings: Settings | None = None,
        **given: Unpack[SettingsArguments],
    ) -> int:  # fmt: skip
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
        self.subject.check_targets([path], frame)
        drawn = self.drawn_beams(frame, settings=settings, **given)
        self.subject.write_beams(drawn, path, frame)
        return sum(len(each.start) for each in drawn)
