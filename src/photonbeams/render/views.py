"""Views of a frame: cameras over the shutter interval, and sensors of Mitsuba's that are no cameras."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import drjit as dr
import numpy as np

from ..beams import Beams
from ..beams.sets import BeamSet
from ..estimators.lanes import Lattice
from ..numerics.arrays import taken, to_numpy, to_uint
from ..numerics.samples import Samples
from ..numerics.streams import Stream
from ..runtime.device import Array2f, Array3f, Float, UInt32
from ..transport.guiding.eye_points import surfaces_seen
from ..world.cameras import panoramas
from ..world.cameras.cameras import CameraRays, Pinhole, View, Window, on_lens
from ..world.cameras.sensors import PrimaryRays, sampled_rays
from ..world.shutter import CameraMotion, turn, with_lens
from ..world.world import World
from .holdouts import HoldoutDepth
from .light import TracedLight
from .ray_passes import ViewRays

LOG = logging.getLogger("photonbeams")
_WIDEST_TURN = 30.0  # degrees: interpolated axes of the camera are then 3.4 % too short in the middle of the turn
# A pass has one instant for all pixels if so much of its light is hardly blurred, and the camera turns at most by so
# many degrees: straight motion is then that of surfaces to a tenth of a pixel.
_NEARLY_ALL, _LEAST_TURN = 0.95, 2.0
_STEADY = 0.2  # greatest relative change of a beam's power in a pass
_ENOUGH = 1 << 14  # beams, approximately, that are asked
_PARTS = (0.0, 0.25, 0.5, 0.75, 1.0)  # places along beams that are asked


class FrameView:
    """A view of a frame.

    Parameters
    ----------
    window
        The picture's size and its crop.
    camera
        Returns the camera in a pass, by the pass's number; None if a sensor is given.
    holdout
        The depth at which beams end. The scene's own surfaces are then not seen, but still stop light.
    sensor
        A sensor of Mitsuba's that is neither perspective nor orthographic.
    clips
        Whether rays begin and end at the camera's clipping planes.
    turned
        Names of cameras that turn too far for straight motion blur, of which a warning has been given.
    """

    def __init__(
        self, window: Window, camera: Callable[[int], CameraMotion] | None, holdout: HoldoutDepth | None = None,
        sensor: Any = None, clips: bool = False, turned: set[str] | None = None,
    ) -> None:  # fmt: skip
        self.window, self.holdout = window, holdout
        self._camera, self._sensor, self._clips = camera, sensor, clips
        self._turned: set[str] = set() if turned is None else turned

    def blurs(self, number: int) -> bool:
        """Return whether the camera has a lens, or moves during a pass."""
        if self._camera is None:
            return False
        opened, middle, closed = self._camera(number)
        return closed is not opened or (middle.lens_radius != 0 and not middle.orthographic)

    def instant(
        self, number: int, light: TracedLight, place: Sequence[float], time: float, passes: int
    ) -> Pinhole | None:
        """Return a pinhole in place of the camera of a pass, at one time and one place on the lens.

        None if the camera turns or is panoramic, or if many beams change, move far in the picture, or are far out of
        focus: by more than a pixel and more than half of the beam's radius. And None if surfaces that end beams move
        by more than a pixel, or are so far out of focus that the edges of so many passes lie more than a pixel apart.

        Parameters
        ----------
        light
            The light of the pass, and the world that its rays meet.
        place, time
            The place on the lens, in the unit disc, and the time in the pass, from 0 to 1.
        passes
            How many passes there are at least.
        """
        if self._camera is None or self._panoramic:
            return None
        motion = self._camera(number)
        if turn(motion.opened, motion.closed) > _LEAST_TURN:
            return None
        # Not at the time that was drawn: passes that chose by it would prefer some times to others.
        own = View(with_lens(motion.opened, motion.middle), self.window)
        parts = [_sharp_part(each, motion, own) for each in light.sets]
        sharp, total = (sum(each) for each in zip(*parts, strict=True))
        if not sharp >= _NEARLY_ALL * total:
            return None
        ends = self._ends(light.world, own)
        hop, lens, pixel = _blurs(ends, ends, motion, own)
        edges = (hop <= pixel) & (lens <= pixel * max(1.0, passes / 2))
        return on_lens(motion.at(time), place) if edges.all() else None

    def _ends(self, world: World, own: View) -> np.ndarray:
        """Return places, (N, 3), where rays all over the picture end; a holdout's edges stay in their pixels."""
        if self.holdout is not None:
            return np.zeros((0, 3))
        points = surfaces_seen(world, own.whole().projections)
        return np.zeros((0, 3)) if points is None else points.places

    @property
    def _panoramic(self) -> bool:
        return self._camera is not None and self._camera(0).opened.panoramic

    @property
    def opened(self) -> View | None:
        """The pinhole at shutter open; None for a sensor that is no camera."""
        return None if self._camera is None else View(replace(self._camera(0).opened, lens_radius=0.0), self.window)

    def whole(self) -> FrameView:
        """Return the same view of the whole picture, without a holdout."""
        return FrameView(self.window.whole(), self._camera, sensor=self._sensor, clips=self._clips, turned=self._turned)

    def shares_origin(self, number: int) -> bool:
        """Return whether tiles hold all rays of a pass: they begin at one point, or on a parallel projection's film."""
        return self._camera is not None and not self._panoramic and not self.blurs(number)

    def exposure(self, number: int) -> float:
        """Return the factor of light on the film in a pass."""
        return 1.0 if self._camera is None else self._camera(number).middle.exposure_scale

    def rays(
        self, number: int, places: Array2f, order: Any, samples: Samples, moving: bool = False,
        pinhole: Pinhole | None = None, some: UInt32 | None = None,
    ) -> ViewRays:  # fmt: skip
        """Return the rays of pass `number`, through `places` in the pixels, or in `some` pixels with these numbers.

        `order` has the pixels' numbers for their samples, or with `some` pixels the indices of samples. If beams are
        `moving`, rays have times, and are otherwise the same. If a `pinhole` is given, all rays are its rays.
        """
        if self._camera is None:
            return ViewRays(sampled_rays(self._sensor, self.window, places, order, samples, some), None)
        own = self._view(number, self.window, pinhole)
        sample = None
        if own.film or moving:
            sample = partial(_on_lens, samples, index=None if some is None else order)
        rays = own.rays(places, sample, some)
        far = None
        if self.holdout is not None:
            there = own.on_lens(sample, some)
            if pinhole is not None and pinhole.place is not None:
                x, y, focus = (dr.opaque(Float, each) for each in pinhole.place)
                there = x, y, focus
            chance = samples.pair(order, Stream.HOLDOUT).x if self.holdout.layered else None
            far = self.holdout.distances(own, rays.facing, places, there, some, chance)
        return ViewRays(self._primary(own, rays, far), own.tiled, far)

    def inside(
        self, number: int, rays: ViewRays, places: Array2f, samples: Samples, moving: bool,
        pinhole: Pinhole | None,
    ) -> tuple[UInt32, ViewRays] | None:  # fmt: skip
        """Return the part of the view's rays, with a lattice, that is inside the picture; None if all rays are."""
        left, top, right, bottom = self.window.inside()
        (height, width), (x, y) = self.window.shape, self.window.crop[:2]
        if (left, top, right, bottom) == (0, 0, width, height) or left >= right or top >= bottom:
            return None
        row, column = np.mgrid[top:bottom, left:right]
        index = to_uint((row * width + column).ravel())
        own = self._view(number, replace(self.window, crop=(x + left, y + top, x + right, y + bottom)), pinhole)
        found = own.rays(taken(places, index), partial(_on_lens, samples) if moving else None)
        far = None if rays.holdout is None else taken(rays.primary.far, index)
        assert rays.lattice is not None
        lattice = Lattice.of(own.window.width, own.window.height, own.window.crop[:2], rays.lattice.place)
        return index, ViewRays(self._primary(own, found, far), own.projection, far, lattice)

    def pinhole(self, places: Array2f, order: Any, samples: Samples) -> ViewRays:
        """Return the rays of a pinhole at shutter open through places in the pixels, with the holdout's depth."""
        holdout = None if self.holdout is None else self.holdout.depth
        own = self.opened
        if own is None:
            return ViewRays(sampled_rays(self._sensor, self.window, places, order, samples), None, holdout=holdout)
        return ViewRays(self._primary(own, own.rays(places)), own.tiled, holdout=holdout)

    def on_lens(self, number: int, time: float, place: Sequence[float]) -> Pinhole:
        """Return the pinhole at a time in a pass, from 0 to 1, and at a place on the lens, in the unit disc."""
        assert self._camera is not None
        return on_lens(self._camera(number).at(time), place)

    def pinholes(self, number: int, pinhole: Pinhole | None) -> list[View]:
        """Return the whole picture of a pinhole or of a still camera: of a panoramic one, faces of a cube."""
        return self._view(number, self.window.whole(), pinhole).flat(panoramas.OVERLAP)

    def through_middles(self, view: View) -> ViewRays:
        """Return the rays through the middles of all pixels of a view.

        Where a holdout ends beams, the scene's surfaces are not seen.
        """
        height, width = view.window.shape
        primary = self._primary(view, view.rays(dr.full(Array2f, 0.5, width * height)))
        return ViewRays(primary, view.projection, holdout=None if self.holdout is None else primary.far)

    def _view(self, number: int, window: Window, pinhole: Pinhole | None = None) -> View:
        """Return the camera of a pass, or a pinhole, in a window of the picture."""
        if pinhole is not None:
            return View(pinhole.camera, window)
        assert self._camera is not None
        opened, middle, closed = self._camera(number)
        angle = turn(opened, closed)
        if angle > _WIDEST_TURN and opened.name not in self._turned:
            self._turned.add(opened.name)
            text = "%s turns by %.0f degrees within one pass, but its motion blur is straight: expected more passes"
            LOG.warning(text, opened.name, angle)
        return View(with_lens(opened, middle), window, None if closed is opened else closed)

    def _primary(self, view: View, rays: CameraRays, far: Any = None) -> PrimaryRays:
        count = dr.width(rays.direction)
        near, end = dr.zeros(Float, count), dr.full(Float, dr.largest(Float), count)
        if self._clips:
            near, end = (dr.opaque(Float, each) / rays.facing for each in view.camera.clipping)
        ones = dr.ones(Array3f, count)
        far = end if far is None else far
        if rays.seen is not None:
            near, far = (dr.select(rays.seen, each, 0) for each in (near, far))
            ones = dr.select(rays.seen, ones, 0)
            dr.eval(near, far, ones)
        return PrimaryRays(
            origin=rays.origin,
            direction=rays.direction,
            near=near,
            far=far,
            weight=ones,
            facing=rays.facing,
            origins=rays.origins,
            times=rays.times,
        )


def _sharp_part(each: BeamSet, motion: CameraMotion, own: View) -> tuple[float, float]:
    """Return how much light of beams is hardly blurred by motion and lens, and how much there is."""
    states = [_rows(beams) for beams in (each.beams, each.beams if each.close is None else each.close)]
    (power, later), lengths = ([state[2] for state in states], [np.linalg.norm(b - a, axis=1) for a, b, *_ in states])
    most = np.maximum(power, later).max(axis=1)
    light, sharp = most * np.maximum(*lengths), np.zeros(len(most))
    for part in _PARTS:
        opened, closed = ((1 - part) * start + part * end for start, end, *_ in states)
        radius, wider = (((1 - part) * first + part * last)[:, 0] for *_, first, last in states)
        hop, lens, pixel = _blurs(opened, closed, motion, own)
        blur = np.maximum(np.maximum(hop, lens), np.abs(wider - radius))
        sharp += blur <= np.maximum(pixel, 0.5 * radius)
    sharp *= np.abs(later - power).max(axis=1) <= _STEADY * most
    return float(light @ sharp) / len(_PARTS), float(light.sum())


def _rows(beams: Beams) -> list[np.ndarray]:
    """Return starts, ends, powers, and radii at both ends, by rows: of all beams, or of as many as tell enough."""
    step = len(beams) // _ENOUGH + 1
    arrays = beams.start, beams.end, beams.power, [beams.radius_start], [beams.radius_end]
    return [to_numpy(each).T[::step].astype(np.float64) for each in arrays]


def _blurs(
    opened: np.ndarray, closed: np.ndarray, motion: CameraMotion, own: View
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return how far places, (N, 3), move across the view in a pass; how far the lens spreads them; and a pixel there.

    All three are in scene units, at the places' distance from the camera.
    """
    camera, scale = own.camera, float(np.max(own.pixels_per_tangent))
    first, last = (
        places @ matrix[:3, :3].T + matrix[:3, 3]
        for places, matrix in (
            (opened, np.linalg.inv(np.asarray(motion.opened.to_world, dtype=np.float64))),
            (closed, np.linalg.inv(np.asarray(motion.closed.to_world, dtype=np.float64))),
        )
    )
    lens, pixel, along = np.zeros(len(first)), np.full(len(first), 1 / scale), np.array([0.0, 0.0, -1.0])
    if not camera.orthographic:
        distance = np.linalg.norm(first, axis=1)
        pixel, along = distance / scale, first / np.maximum(distance, 1e-30)[:, None]
        if camera.lens_radius > 0:
            lens = camera.lens_radius * np.abs(1 + first[:, 2] / camera.focus_distance)
    hop = last - first
    return np.linalg.norm(hop - (hop * along).sum(axis=1, keepdims=True) * along, axis=1), lens, pixel


def _on_lens(samples: Samples, groups: UInt32, index: UInt32 | None = None) -> tuple[Any, Any]:
    """Return the place on the lens, in the unit square, and the time in the pass of groups of pixels.

    `index` is that of samples of their pixels; None: the pass has one sample.
    """
    groups = groups if index is None else samples.like(groups, index)
    return samples.pair(groups, Stream.LENS), samples.pair(groups, Stream.TIME).x
