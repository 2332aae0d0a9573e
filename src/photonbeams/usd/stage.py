"""Open USD stages, and find their times, up axis, bounds and changes."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from functools import cache
from hashlib import sha256
from itertools import chain, pairwise
from math import isfinite
from typing import Any, TypeVar

import numpy as np

from ..images.color_spaces import working_space as working_space_of
from ..runtime.digest import digest
from ..scene import Array, Camera, Scene, SceneError, number, shown
from .authoring.editing import override
from .cameras.camera import list_cameras, read_camera
from .common import blender
from .common.color_spaces import spaces_of
from .common.openusd import Ar, Gf, Sdf, Tf, Ts, Usd, UsdGeom, UsdShade, UsdSkel, UsdUtils, sentences_of, text_of
from .common.reading import prims_under, quiet, varying_attributes
from .common.selection import EVERYTHING, Selection, keep
from .common.textures import texture_limit as texture_limit_of
from .common.warnings import Warnings
from .contents import read_extent, read_scene, with_looks
from .layers.composition import warn_of_composition
from .layers.counting import check_count
from .layers.frames import time_range
from .layers.metadata import complete_metadata, correct_metadata
from .layers.writing import read_layer, ready_layers, resolved_name, why_no_layer
from .lights.light import is_dome, is_light

T = TypeVar("T")

__all__ = [
    "Selection",
    "default_time",
    "list_cameras",
    "open_stage",
    "read_camera",
    "read_extent",
    "read_scene",
    "sample_times",
    "up_axis",
    "up_axis_name",
    "with_looks",
]


def open_stage(
    path: str | os.PathLike[str],
    session_layers: Iterable[str | os.PathLike[str]] = (),
    overrides: Iterable[str] = (),
    warnings: Warnings | None = None,
    texture_limit: int | None = None,
    selection: Selection = EVERYTHING,
    working_space: str | None = None,
    color_space: str | None = None,
) -> Usd.Stage:
    """Open a stage, with stronger layers and values on top of it.

    References, payloads and sublayers that cannot be read are left out with a warning.

    Parameters
    ----------
    path
        A .usd, .usda, .usdc or .usdz file.
    session_layers
        Layers over the stage, the strongest first.
    overrides
        Values over those, each "/prim.attribute=value" in USD's own notation ("/Lamp.inputs:intensity=2",
        "/Dust.photonbeams:scattering=(0.1, 0.1, 0.2)"). A single number sets all three channels of a colour.
    warnings
        The same as for `read_scene`.
    texture_limit
        Pixels a side beyond which textures are scaled down; None: 4096.
    selection
        What of the stage is rendered.
    working_space
        The linear colour space in which light is computed, by any of its names; None: that of the stage's render
        settings, or linear Rec. 709.
    color_space
        The linear colour space of colours and images that name none; None: linear Rec. 709.

    Raises
    ------
    SceneError
        The file does not exist, is not a stage, or is broken; or it refers to files that cannot be read, and warnings
        are errors.
    """
    warnings = warnings or Warnings()
    with quiet():  # the errors and warnings below contain what OpenUSD would print
        path = os.fspath(path)
        layer = _layer(path)
        try:
            session = Sdf.Layer.CreateAnonymous("session.usda")
            session.subLayerPaths = [*dict.fromkeys(_layer(os.fspath(each)).identifier for each in session_layers)]
            keep(
                session, textureLimit=texture_limit, workingSpace=_linear_space("working space", working_space),
                colorSpace=_linear_space("colour space", color_space),
            )  # fmt: skip
            ready = ready_layers(layer, session, warnings)
            check_count(layer, session, ready, selection.mask)
            stage = selection.open(layer, session)
            if selection.apply(stage, path):
                check_count(layer, session, ready, selection.mask)
            del ready  # the stage keeps the layers that it needs
        except Tf.ErrorException as error:
            raise SceneError(f"{path} cannot be read: {_reason(error, path)}") from None
    warn_of_composition(stage, warnings)
    complete_metadata(stage, warnings)
    blender.move_properties(stage)
    for each in overrides:
        override(stage, each)
    return stage


def _linear_space(what: str, name: str | None) -> str | None:
    """Return the name of a linear colour space, by which it is kept; SceneError for another one."""
    try:
        return None if name is None else working_space_of(name)
    except SceneError as error:
        raise SceneError(f"the {what} {error}") from None


def check_stage(stage: object) -> None:
    """Raise SceneError if a value is not an open stage, or has metadata that make no sense."""
    if not isinstance(stage, Usd.Stage):
        raise SceneError(f"stage is {shown(stage)}: expected a Usd.Stage; Shot.open takes a file")
    for layer in stage.GetUsedLayers():
        correct_metadata(layer, None)


def up_axis(stage: Usd.Stage) -> Array:
    """Return the stage's up axis, (3,), of unit length: +y or +z."""
    return np.array([0.0, 0.0, 1.0] if up_axis_name(stage) == "Z" else [0.0, 1.0, 0.0])


def up_axis_name(stage: Usd.Stage) -> str:
    """Return the name of the stage's up axis, "Y" or "Z"."""
    return str(UsdGeom.GetStageUpAxis(stage))


def listener(stage: Usd.Stage, changed: Callable[[Usd.Notice.ObjectsChanged, Usd.Stage], None]) -> Tf.Notice.Listener:
    """Return a listener that calls `changed` whenever the stage changes, as long as the listener exists."""
    return Tf.Notice.Register(Usd.Notice.ObjectsChanged, changed, stage)


def enable_domes(stage: Usd.Stage) -> None:
    """Make dome lights make beams, unless they set whether they do."""
    domes = [prim for prim in prims_under(stage.GetPseudoRoot()) if is_light(prim) and is_dome(prim)]
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        for prim in domes:
            name = "photonbeams:enabled"
            if not prim.IsInstanceProxy() and not prim.GetAttribute(name).HasAuthoredValue():
                prim.CreateAttribute(name, Sdf.ValueTypeNames.Bool).Set(True)


def time_code(frame: Usd.TimeCode | float) -> Usd.TimeCode:
    """Return a frame's number as a time code; SceneError if it is not a finite number."""
    return frame if isinstance(frame, Usd.TimeCode) else Usd.TimeCode(number(frame, "frame"))


def default_time(stage: Usd.Stage) -> Usd.TimeCode:
    """Return the stage's start if it has one, else the default time."""
    if stage.HasAuthoredMetadata("startTimeCode"):
        return Usd.TimeCode(stage.GetStartTimeCode())
    return Usd.TimeCode.Default()


@quiet()  # it opens value clips
def sample_times(stage: Usd.Stage, most: int) -> list[float]:
    """Return the time codes of all time samples on a stage, and of some points on its splines and arcs, in order.

    If there are more than `most`, return an even selection.
    """
    times: set[float] = set()
    for attribute in varying_attributes(stage):
        samples = attribute.GetTimeSamples()
        turns = attribute.GetName().startswith(_TURNS) and len(samples) <= _BY_HAND
        times.update(_with_between(samples) if turns else samples)
        if attribute.HasSpline():
            times.update(_spline_times(attribute.GetSpline(), stage))
    found = sorted(filter(isfinite, times))
    if len(found) <= most:
        return found
    return [found[round(k * (len(found) - 1) / (most - 1))] for k in range(most)]


_BETWEEN = 3  # times between two knots or samples: a curve, or what turns, may exceed both
_TURNS = ("xformOp:rotate", "xformOp:orient")
_BY_HAND = 8  # samples: where there are more, hardly anything turns far from one to the next


def _with_between(times: Sequence[float]) -> list[float]:
    """Return times in order and some between them."""
    between = [a + (b - a) * step / (_BETWEEN + 1) for a, b in pairwise(times) for step in range(1, _BETWEEN + 1)]
    return [*times, *between]


def _spline_times(spline: Ts.Spline, stage: Usd.Stage) -> list[float]:
    """Return the times of a spline's knots, of the stage's ends, and some in between."""
    ends = time_range(stage) or ()
    knots = {float(code) for code in spline.GetKnots().keys()}  # noqa: SIM118 (it is no mapping)
    if spline.HasLoops() and len(ends) == 2 and ends[0] < ends[1]:
        baked = spline.GetKnotsWithLoopsBaked(Gf.Interval(*ends)).keys()
        knots |= {float(code) for code in baked if ends[0] < code < ends[1]}
    return _with_between(sorted({*knots, *ends}))


def extent_varies(stage: Usd.Stage) -> bool:
    """Return whether anything except cameras may move or change its size with time."""
    sizes = ("inputs:radius", "inputs:width", "inputs:height", "inputs:length")
    for attribute in varying_attributes(stage):
        name = attribute.GetName()
        if name.startswith("photonbeams:") or (name.startswith("inputs:") and name not in sizes):
            continue
        if attribute.GetPrim().IsA(UsdSkel.Animation) or name in ("filePath", "fieldName", "fieldIndex"):  # of grids
            return True
        if any(prim.IsA(UsdGeom.Boundable) for prim in prims_under(attribute.GetPrim())):
            return True
    return False


# The greatest number of times at which the extent of an animated stage is read.
_MOST_TIMES = 33


def states_at_all_times(
    stage: Usd.Stage,
    content: Scene,
    read_extent: Callable[[float | None], Scene],
    read_cameras: Callable[[float | None], tuple[Camera, ...]],
    emits: bool,
) -> tuple[list[Scene], list[Array]]:
    """Return the scenes that together have the extent of a stage at all times, and where its cameras are.

    Parameters
    ----------
    content
        The scene at one time, which is enough if nothing changes.
    read_extent, read_cameras
        Functions that return the extent of the scene, and the cameras, at a time code.
    emits
        Whether a function makes beams: these may move without the stage showing it.
    """
    codes = sample_times(stage, _MOST_TIMES)
    moving = bool(codes) and (extent_varies(stage) or emits)
    states = [state for code in codes if (state := _sound(read_extent, code))] if moving else [content]
    times: list[float | None] = [*codes] or [None]
    cameras = [camera for time in times for camera in _sound(read_cameras, time) or ()]
    return states, [np.asarray(camera.to_world)[:3, 3] for camera in cameras]


def _sound(read: Callable[[float | None], T], code: float | None) -> T | None:
    """Return what `read` returns at a time, or None on an error, which rendering that time will raise."""
    with suppress(SceneError):
        return read(code)
    return None


def stage_digest(stage: Usd.Stage) -> str:
    """Return a hash of the composed stage, including its session layer, and of the files that it names."""
    with quiet():
        layer = stage.Flatten(addSourceFileComment=False)
        UsdUtils.ModifyAssetPaths(layer, cache(_file_digest))
    return digest(layer.ExportToString(), texture_limit_of(stage), repr(spaces_of(stage)))


def _file_digest(name: str) -> str:
    """Return a hash of the file that an asset path names, or the file's name if there is no file."""
    resolver = Ar.GetResolver()
    resolved = str(resolver.Resolve(name))
    outer = Ar.SplitPackageRelativePathOuter(resolved)[0] if resolved else ""
    # An empty file counts as a file here, unlike in `runtime.inputs`: it is another content than none.
    is_file = os.path.isfile(outer) and os.access(outer, os.R_OK)
    asset: Any = resolver.OpenAsset(Ar.ResolvedPath(resolved)) if is_file else None
    return os.path.basename(name) if asset is None else sha256(asset.GetBuffer() or b"").hexdigest()


def _layer(path: str) -> Sdf.Layer:
    if not path:
        raise SceneError("a layer's name is empty: expected a path")
    try:
        resolved = str(Ar.GetResolver().Resolve(path))
    except UnicodeEncodeError:
        raise SceneError(f"{path!r} cannot be read: expected a name in UTF-8") from None
    if not resolved or not os.path.exists(Ar.SplitPackageRelativePathOuter(resolved)[0]):
        raise SceneError(f"{path}: expected a USD stage, but there is no such file")
    problem = why_no_layer(resolved)
    if problem and not os.path.isdir(resolved):  # reading from a pipe may take for ever
        raise SceneError(f"{path} cannot be read: expected a USD stage, {problem}")
    try:
        if os.path.isdir(resolved) or not Usd.Stage.IsSupportedFile(resolved):
            raise SceneError(f"{path} is not a USD stage: expected a .usd, .usda, .usdc or .usdz file")
        # OpenUSD finds layers by the names that they were opened with, also in another working directory.
        layer = read_layer(os.path.abspath(path) if os.path.exists(path) else path)
    except Tf.ErrorException as error:
        raise SceneError(f"{path} cannot be read: {_reason(error, path)}") from None
    if not layer:
        raise SceneError(f"{path} cannot be read: expected a USD stage")
    if not layer.dirty:
        layer.Reload()  # OpenUSD caches layers, also of files that were written again
    return layer


def files_of(stage: Usd.Stage) -> Iterator[str]:
    """Yield the files that a stage is read from: its layers, and all that they name, at any time and in any variant."""
    root = stage.GetRootLayer()
    variables = {**root.expressionVariables, **stage.GetSessionLayer().expressionVariables}
    for layer in stage.GetUsedLayers():
        found = [layer.realPath]
        with quiet():  # it warns of templates of value clips without a folder
            names = [*chain(*UsdUtils.ExtractExternalReferences(layer.identifier))]
        for name in names:
            # What `--set` names is relative to the stage's own file.
            for anchor in (layer, root) if layer.anonymous else (layer,):
                found += [path for path, _ in UsdShade.UdimUtils.ResolveUdimTilePaths(name, anchor)]
                found.append(resolved_name(anchor, name, {**layer.expressionVariables, **variables})[0])
        yield from {Ar.SplitPackageRelativePathOuter(path)[0] for path in found if path}


_REPLACED = "\N{REPLACEMENT CHARACTER}"  # in place of bytes that are no text


def _reason(error: Tf.ErrorException, path: str | os.PathLike[str]) -> str:
    """Return OpenUSD's message with the line's number first, and the file's name if it is not that of `path`."""
    found = text_of(error)
    if old := re.search(
        r"with obsolete version (\S+)\. The oldest version this software supports is ([\d.]*\d)", found
    ):
        return f"it is a binary file of version {old[1]}, expected {old[2]} or later"
    messages = sentences_of(error)
    for message in messages:
        located = re.fullmatch(r"(.*?):(\d+):\d+: (.*)", message, re.DOTALL)
        if located:
            file, line, rest = located.groups()
            text = re.sub(r"parse error matching .*", "there is more than expected", " ".join(rest.split()))
            place = "" if os.path.basename(file) == os.path.basename(path) else f"{file}, "
            return f"{place}line {line}: {text}{'; expected UTF-8' if _REPLACED in found else ''}"
    return " ".join(messages[0].split()) if messages else "expected a USD stage"
