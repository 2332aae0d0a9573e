"""Two eyes: a pair of camera prims with stereoRole, or one camera split in two with parallel axes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any

import numpy as np

from ...scene import FARTHEST, Camera, SceneError, shown
from ..common.openusd import Usd, UsdGeom
from ..common.reading import Reading, Time, file_of
from ..common.warnings import Warnings
from .camera import chosen_camera, list_cameras, read_camera

EYES = ("left", "right")
_EYE_DISTANCE = 0.065  # metres, between human eyes
# Attributes that must be the same for the two eyes of a pair.
_ALIKE = (
    *("projection", "focalLength", "horizontalAperture", "verticalAperture", "fStop", "focusDistance"),
    *("shutter:open", "shutter:close"),
    *("exposure", "exposure:iso", "exposure:time", "exposure:fStop", "exposure:responsivity"),
)


@dataclass(frozen=True)
class Stereo:
    """How one camera becomes two eyes; a pair of camera prims needs neither value.

    Attributes
    ----------
    interaxial
        Distance between the eyes in scene units; None: 65 mm.
    convergence
        Distance in scene units at which both eyes see the same point in the middle of the picture; None: the camera's
        focus distance, or infinity if it has none.

    Raises
    ------
    SceneError
        The interaxial distance is negative or beyond 1e12, or the convergence is not above 0.

    Examples
    --------
    >>> eyes = pb.Stereo(interaxial=0.065, convergence=3.0)
    >>> eyes.convergence
    3.0

    `pb.Shot.open("shot.usda", stereo=eyes)` renders both eyes.
    """

    interaxial: float | None = None
    convergence: float | None = None

    def __post_init__(self) -> None:
        far = f"0 or more and no more than {FARTHEST:g}"
        self._check("interaxial", f"a distance in scene units, {far}", lambda value: 0 <= value <= FARTHEST)
        self._check("convergence", "a positive distance in scene units", lambda value: value > 0)

    def _check(self, name: str, expected: str, fits: Callable[[Any], bool]) -> None:
        value = getattr(self, name)
        if value is not None and not (isinstance(value, Real) and fits(value)):
            raise SceneError(f"{name} is {shown(value)}: expected {expected}")


def check_stereo(stereo: object) -> None:
    """Raise SceneError if a value is neither a `Stereo` nor None."""
    if not (stereo is None or isinstance(stereo, Stereo)):
        raise SceneError(f"stereo is {stereo!r}: expected a Stereo, such as Stereo(interaxial=0.065, convergence=3)")


def read_eyes(
    stage: Usd.Stage, name: str | None, stereo: Stereo, time: Time = None, warnings: Warnings | None = None
) -> tuple[Camera, Camera]:
    """Return the cameras of the left and the right eye; `warnings` is the same as for `read_scene`.

    A camera with a stereoRole is one of a pair; its partner is the camera with the other role beside it, or the only
    such camera on the stage. Any other camera is split: both eyes look along its axis, and their apertures are shifted
    so that objects at the convergence distance have no disparity. Toed-in eyes would show verticals of different
    heights.

    Raises
    ------
    SceneError
        A camera with a stereoRole has no partner, or the pictures of partners do not fit each other; a camera to split
        is orthographic, or its eyes would converge nearer than they can.
    """
    prim = chosen_camera(stage, name, warnings)
    role = _role(prim)
    if role not in EYES:
        camera = read_camera(stage, str(prim.GetPath()), time, warnings)
        return split(camera, stereo, UsdGeom.GetStageMetersPerUnit(stage), f"{file_of(stage)}: {camera.name}")
    other = _partner(stage, prim, EYES[1 - EYES.index(role)])
    left, right = (prim, other) if role == EYES[0] else (other, prim)
    if stereo != Stereo():
        reading = Reading(stage, None, warnings or Warnings())
        reading.warn(prim, "is one of a pair, whose places are fixed: interaxial and convergence are ignored")
    first, second = (read_camera(stage, str(each.GetPath()), time, warnings) for each in (left, right))
    _check_pair(Reading(stage, time), left, right)
    return first, second


def is_eye(stage: Usd.Stage, name: str | None) -> bool:
    """Return whether a camera has the stereoRole of one of two eyes."""
    return _role(chosen_camera(stage, name)) in EYES


def usual_interaxial(stage: Usd.Stage) -> float:
    """Return the distance between human eyes in scene units."""
    return _EYE_DISTANCE / float(UsdGeom.GetStageMetersPerUnit(stage))


def _role(prim: Usd.Prim) -> str:
    return str(UsdGeom.Camera(prim).GetStereoRoleAttr().Get() or "mono")


def views_of(stereo: Stereo | None, view: str | None) -> list[str]:
    """Return the views of a frame: both eyes, or the requested one, or "" for a camera that is not split.

    Raises
    ------
    SceneError
        There is no such view.
    """
    if view is not None and (stereo is None or view not in EYES):
        expected = f"one of {', '.join(EYES)}" if stereo is not None else "none, because the shot has one camera"
        raise SceneError(f"view is '{view}': expected {expected}")
    return [view] if view is not None else list(EYES) if stereo is not None else [""]


def _check_pair(reading: Reading, left: Usd.Prim, right: Usd.Prim) -> None:
    """Raise SceneError if two eyes differ in attributes other than their transforms."""
    for name in _ALIKE:
        a, b = (reading.value(prim, name) for prim in (left, right))
        if a != b:
            first, second = (each if isinstance(each, str) else f"{each:g}" for each in (a, b))
            text = f"is {first} but that of {right.GetPath()} is {second}: expected the same for both eyes"
            raise reading.fail(left, name, text)


def _partner(stage: Usd.Stage, prim: Usd.Prim, role: str) -> Usd.Prim:
    cameras = [camera for path in list_cameras(stage) if _role(camera := stage.GetPrimAtPath(path)) == role]
    cameras = [camera for camera in cameras if camera.GetParent() == prim.GetParent()] or cameras
    if len(cameras) != 1:
        names = ", ".join(str(camera.GetPath()) for camera in cameras) or "none"
        raise SceneError(
            f"{file_of(stage)}: {prim.GetPath()} is one of two eyes: expected one camera with stereoRole "
            f"'{role}' beside it, found {names}"
        )
    return cameras[0]


def split(camera: Camera, stereo: Stereo, meters_per_unit: float, name: str) -> tuple[Camera, Camera]:
    """Split a camera into two eyes; messages call the camera `name`.

    Raises
    ------
    SceneError
        The camera is not perspective, or the eyes would converge nearer than they can.
    """
    half = 0.5 * (_EYE_DISTANCE / meters_per_unit if stereo.interaxial is None else stereo.interaxial)
    if camera.projection != "perspective":  # of an orthographic one, it would only shift the picture
        raise SceneError(f"{name} is {camera.projection}: expected a perspective camera to be split into two eyes")
    convergence = stereo.convergence or camera.focus_distance or np.inf
    # The middle of the convergence plane is `half` beside each eye's own axis. At a depth z the eyes see intervals of
    # width w z / f, whose middles are 2 half |z / convergence - 1| apart. If the aperture is shifted by its width w or
    # more, half f / convergence >= w, the intervals do not overlap beyond twice the convergence or before two thirds.
    shift = half * camera.focal_length / convergence
    if shift > camera.horizontal_aperture:
        least = half * camera.focal_length / camera.horizontal_aperture
        where = f"{convergence:g}" if stereo.convergence else f"its focusDistance, {convergence:g}"
        raise SceneError(
            f"{name} has eyes {2 * half:g} apart that converge at {where}: expected a convergence of at least "
            f"{least:.4g} scene units, or eyes closer together"
        )

    def eye(side: float) -> Camera:
        to_world = camera.to_world.copy()
        to_world[:, 3] += side * half * camera.to_world[:, 0]
        return replace(camera, to_world=to_world, horizontal_offset=camera.horizontal_offset - side * shift)

    return eye(-1.0), eye(1.0)
