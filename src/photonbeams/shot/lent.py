"""The view and the light that are lent to what has none, as usdrecord and usdview lend them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..scene import FARTHEST, Array, Camera, DistantLight, DomeLight, Scene, SceneError
from ..usd.common.reading import Reading, file_of
from ..usd.groups import hidden_lights

if TYPE_CHECKING:
    from .subject import Subject

#: The names of the view and of the lights.
VIEW, LIGHTS = "the default view", ("the default sky", "the default headlight")
# Of the light on white paper that faces the camera and the open sky, whose radiance is 1, each has a half: the sky
# alone leaves closed rooms black, and a headlight alone mirrors and smoke.
_HALF = 0.5
_ROOM = 1.05  # how much wider the view is than what it shows


def lent_view(subject: Subject, what: str, box: Sequence[Array] | None, up: str = "Y") -> Camera:
    """Return the view that is lent to a subject without a camera, and warn; `what` it lacks. See `view_of`."""
    if box is None:
        raise SceneError(f"{subject.name} has no {what}, and nothing that a view of all could show: expected a {what}")
    text = f"{subject.name}: there is no {what}: {VIEW} shows all of it from the front"
    subject.warnings.give(f"{text}; expected a {what}")
    return view_of(box, up)


def view_of(box: Sequence[Array], up: str) -> Camera:
    """Return a camera that sees all of a box from the front: along −Z or, with the `up` axis "Z", along +Y.

    The box is two corners, (3,) each.
    """
    camera, (low, high) = Camera(VIEW, np.eye(4)), box
    turn = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]] if up == "Z" else np.eye(3), dtype=float)
    wide, tall, deep = np.abs(turn.T @ (high - low)) / 2
    apertures = np.array([camera.horizontal_aperture, camera.vertical_aperture])
    before = _ROOM * float(np.max(np.array([wide, tall]) * 2 * camera.focal_length / apertures))
    away = deep + (max(before, 1e-3 * deep) or 1.0)  # also before a line that is seen end on, or a point
    to_world = np.eye(4)
    to_world[:3, :3] = turn
    to_world[:3, 3] = 0.5 * (low + high) + away * turn[:, 2]
    return replace(camera, to_world=to_world, clipping=(0.0, FARTHEST))


def lit(reading: Reading, content: Scene, camera: Camera) -> Scene:
    """Return what a stage shows; in a white light, and with a warning, if it has none at any time and nothing glows.

    The light comes from the sky and, past all surfaces, from the camera. It makes no beams, and is not seen itself.
    Stages in memory get none: programs, such as Blender, know what they light.
    """
    from ..render.stage_frame import is_unlit

    shown = content.meshes or content.media
    in_memory = reading.stage.GetRootLayer().anonymous
    if in_memory or not (shown and is_unlit(content)) or hidden_lights(reading.stage, reading.time):
        return content
    text = "there is no light: a white one, from the sky and the camera, makes no beams"
    expected = "expected a UsdLux light, a surface that glows, or drawn beams"
    reading.warnings.give(f"{file_of(reading.stage)}: {text}; {expected}")
    plain: dict[str, Any] = {"emits_beams": False, "seen": False}
    axis, meshes = -np.asarray(camera.to_world)[:3, 2], frozenset(mesh.name for mesh in content.meshes)
    sky = DomeLight(LIGHTS[0], (_HALF,) * 3, lights_media=True, **plain)
    headlight = DistantLight(LIGHTS[1], (_HALF * np.pi,) * 3, axis=axis, angle=0.0, unshadowed=meshes, **plain)
    return replace(content, lights=(sky, headlight))
