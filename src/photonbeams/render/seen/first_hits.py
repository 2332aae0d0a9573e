"""The first surfaces that a view's pixels see: depths, normals, positions, motion vectors and cryptomattes.

They are known from the first pass alone: a mean of depths belongs to no surface.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from ... import scene
from ...numerics.arrays import to_numpy, to_uint
from ...numerics.samples import Samples
from ...numerics.streams import Stream
from ...runtime.device import Array3f, UInt32
from ...scene.cameras import EQUIRECTANGULAR
from ...world.cameras.cameras import View
from ..films.film import Film
from ..films.mattes import MATERIAL, OBJECT, Mattes
from ..films.sums import DEPTH, MOTION, NORMAL, POSITION
from ..paths import camera_paths
from ..paths.surface_light import NO_LIGHT
from ..ray_passes import CameraImage, unshaded
from .surfaces import SeenPoints, Surfaces

if TYPE_CHECKING:
    from ..frame import FrameRenderer
    from ..ray_passes import ViewRays
    from ..views import FrameView

#: The scene and a view's camera one frame later.
Later = tuple[scene.Scene, scene.Camera]

_MATTES = 0x2545F491  # offset of the seed of samples for cryptomattes
_SAMPLES = 64  # of a pixel in which there are several objects, and of another pixel
_FEW = 16


def first_hits(
    renderer: FrameRenderer, eye: FrameView, film: Film, later: Callable[[], Later | None]
) -> dict[str, Any]:  # fmt: skip
    """Return pictures of the first surfaces that a view sees, by the names of their sums.

    Depths are planar. Like normals, positions and motion they are those of a pinhole at shutter open, at pixels'
    centres. `later` returns where everything is one frame later, None if nothing moves.
    """
    with renderer.statistics.phase("surfaces"):
        return _pictures(renderer, eye, film, later)


def _pictures(
    renderer: FrameRenderer, eye: FrameView, film: Film, later: Callable[[], Later | None]
) -> dict[str, Any]:  # fmt: skip
    """Return what `first_hits` returns."""
    settings, samples = renderer.settings, renderer.samples(0)
    rays = eye.pinhole(film.centers(), film.order, samples)
    count, placed = dr.width(rays.primary.direction), settings.positions or settings.motion
    image, points = CameraImage(count), SeenPoints(count)
    if rays.holdout is None:
        tracing = replace(
            unshaded(renderer.camera_tracing(renderer.light.world, rays)), normals=settings.normals, splits=False,
            points=placed,
        )  # fmt: skip
        begun = camera_paths.begin(tracing, rays.primary, film.order)
        for step in camera_paths.follow(tracing, begun, samples, NO_LIGHT):
            image.add(*step)
            points.add(*step)
        result: dict[str, Any] = {DEPTH: image.distance * (1.0 if rays.primary.facing is None else rays.primary.facing)}
    else:
        result = {DEPTH: rays.holdout}
        if placed:
            points.place = _at_depth(rays)
    if settings.normals:
        result[NORMAL] = image.normal
    if settings.positions:
        zero = np.reshape(renderer.light.world.zero, (3, 1))
        place = (to_numpy(points.place) - zero).astype(np.float32)
        result[POSITION] = np.where(np.isfinite(to_numpy([result[DEPTH]])), place, np.float32(0))
    if settings.motion:
        result[MOTION] = motion_of(renderer, eye, rays, points, later())
    if rays.holdout is None and (settings.crypto_object or settings.crypto_material):
        result |= _mattes(renderer, eye, film)
    return result


def _at_depth(rays: ViewRays) -> Array3f:
    """Return where rays reach a holdout's depth."""
    primary = rays.primary
    distance = rays.holdout if primary.facing is None else rays.holdout / primary.facing
    return Array3f(primary.origin + distance * primary.direction)


def motion_of(
    renderer: FrameRenderer, eye: FrameView, rays: ViewRays, points: SeenPoints, later: Later | None
) -> np.ndarray:
    """Return how far what pixels see moves in the picture until the next frame, (3, N): pixels right and up, and 0.

    What is not on a mesh, such as the background and lamps, is at rest in the world.
    """
    count, before = dr.width(rays.primary.direction), eye.opened
    result = np.zeros((3, count), np.float32)
    if later is None or before is None:
        return result
    content, camera = later
    place = to_numpy(points.place).T.astype(np.float64)
    # Far away, places are directions, which only a turn of the camera moves.
    far = ~np.isfinite(place).all(axis=1) | (points.shape.numpy() == 0) & ~points.solid.numpy()
    direction = to_numpy(rays.primary.direction + dr.zeros(Array3f, count)).T.astype(np.float64)
    place[far] = direction[far]
    homogeneous = np.where(far, 0.0, 1.0)[:, None]
    surfaces = Surfaces.of(renderer.light.world)
    there = surfaces.moved(points, place, content.meshes)
    film = [
        View(each, before.window).in_picture(np.concatenate([own, homogeneous], axis=1))
        for own, each in ((place, before.camera), (there, camera))
    ]
    moved = (film[1] - film[0]) * [before.window.width, before.window.height]
    if before.camera.projection == EQUIRECTANGULAR:  # what crosses the seam does not come from the other side
        around = 2 * np.pi * before.pixels_per_tangent[0]
        moved[:, 0] -= around * np.round(moved[:, 0] / around)
    result[:2] = np.where(np.isfinite(moved), moved, 0).T
    return result


def _mattes(renderer: FrameRenderer, eye: FrameView, film: Film) -> dict[str, np.ndarray]:
    """Return cryptomattes' pictures: ranks of objects or materials by how much of each pixel they cover.

    Samples are spread over the shutter interval and the lens as those of passes are, and over the pixel by its filter.
    """
    settings, count = renderer.settings, film.shape[0] * film.shape[1]
    found = {name: Mattes(count) for name in (OBJECT, MATERIAL) if getattr(settings, name)}
    some: np.ndarray | None = None
    for number in range(_SAMPLES):
        if number == _FEW:
            some = np.flatnonzero(np.logical_or.reduce([each.mixed() for each in found.values()]))
            if not len(some):
                break
        surfaces, points = _seen(renderer, eye, film, number, some)
        numbers = surfaces.numbers(points)
        for name, mattes in found.items():
            mattes.add(surfaces.materials if name == MATERIAL else surfaces.names, numbers, some)
    return {key: each for name, mattes in found.items() for key, each in mattes.pictures(name).items()}


def _seen(
    renderer: FrameRenderer, eye: FrameView, film: Film, number: int, some: np.ndarray | None
) -> tuple[Surfaces, SeenPoints]:
    """Return where sample `number` of all pixels, or of `some`, meets the first surfaces, and these."""
    passes = min(renderer.planned or _FEW, _FEW)
    own, bits = number % passes, (_SAMPLES - 1).bit_length()
    world = renderer.worlds.middle(own)
    samples = Samples(renderer.settings.seed ^ _MATTES, number, bits)
    pixel = None if some is None else to_uint(some)
    order = film.order if pixel is None else dr.gather(UInt32, film.order, pixel)
    rays = eye.rays(own, film.spread(samples.pair(order, Stream.PIXEL)), order, samples, some=pixel)
    rays = replace(rays, view=None, primary=type(rays.primary).joined([rays.primary]))
    tracing = replace(unshaded(renderer.camera_tracing(world, rays)), splits=False, points=True)
    points = SeenPoints(dr.width(order))
    for step in camera_paths.follow(tracing, camera_paths.begin(tracing, rays.primary, order), samples, NO_LIGHT):
        points.add(*step)
    return Surfaces.of(world), points
