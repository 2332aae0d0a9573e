"""One frame: the mean of independent passes, each with its own light paths and camera paths.

If anything moves, each pass covers a slice of the shutter interval. Motion within a slice is linear: light straight
from its lamp is traced at both ends of the slice with the same samples, the camera is known at both ends, and camera
rays have times in between. Radii shrink from pass to pass, so that bias and variance both vanish (Progressive Photon
Beams, Jarosz et al. 2011).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, Protocol

import drjit as dr
import numpy as np

from ..estimators.lanes import MoreSamples
from ..numerics.arrays import joined, taken, to_uint
from ..numerics.samples import BITS, Samples
from ..numerics.sampling import z_order
from ..numerics.streams import Stream
from ..runtime.device import Array2f, Array3f, Float, UInt32
from ..scene import SceneError
from ..world.cameras.cameras import Pinhole, Window
from ..world.cameras.sensors import PrimaryRays
from ..world.warp import disk
from .costs import LANES, power_below
from .films.film import BeamSamples, Film, SeenSums
from .films.frame_sums import FrameSums
from .films.sums import DEPTH, NORMAL, PassSums
from .light import ShotLight, TracedLight
from .memory import release_memory
from .passes import Statistics
from .paths import camera_paths
from .paths.surface_light import NO_LIGHT, SurfaceLight
from .pilots.coarse_passes import Pixels
from .pilots.sample_plan import planned_samples
from .ray_passes import CameraImage, PassRenderer, ViewRays, unshaded
from .settings import Settings
from .views import FrameView

DEFAULTS = Settings()

# A pixel has an edge if one of its rays reaches this many times as far as another.
_EDGE = 1.1
# Most extra samples of such a pixel: half of a small picture may be edges. Their number depends on nothing in the pass;
# otherwise crops would differ, and sequences would have gaps.
_AT_EDGES = 4
_EDGES = 0x3C6EF372  # offset of the seed of the extra samples there

#: The beams and photons of a pass, and their light on surfaces. What rays see except beams, by passes; and the rays.
Lit = tuple[TracedLight, SurfaceLight]
Seen = tuple[list[SeenSums], ViewRays]


class Instant(NamedTuple):
    """One time in a pass, from 0 to 1, and for each view a pinhole on its lens."""

    time: float
    pinholes: Sequence[Pinhole]


class PassMemory(Protocol):
    """Parts of passes that are kept, so that another frame need not make them again."""

    def light(self, number: int, trace: Callable[[], Lit]) -> Lit:
        """Return the light of pass `number`: that which is kept, or else what `trace` returns."""

    def picture(self, numbers: range, view: int, see: Callable[[], Seen]) -> Seen:
        """Return what a view sees in passes, except beams: what is kept, or else what `see` returns."""


class NoMemory:
    """A memory that keeps nothing."""

    def light(self, number: int, trace: Callable[[], Lit]) -> Lit:
        """Return what `trace` returns."""
        return trace()

    def picture(self, numbers: range, view: int, see: Callable[[], Seen]) -> Seen:
        """Return what `see` returns."""
        return see()


class FrameRenderer(PassRenderer):
    """A frame that is being rendered: the films of all its views.

    Parameters
    ----------
    settings, light, max_depth, statistics
        As in `PassRenderer`.
    views, films
        What sees the light, and the film of each view.
    planned
        The number of passes for which samples are chosen; None: any number.
    depth
        Whether the depth layer is wanted.
    memory
        Parts of passes that are kept for other frames.

    Attributes
    ----------
    about
        Hash of the passes' content, as in `FrameSums`.
    """

    def __init__(
        self, settings: Settings, light: ShotLight, views: Sequence[FrameView], films: Sequence[Film],
        max_depth: int | None, statistics: Statistics, planned: int | None = None, depth: bool = True,
        memory: PassMemory | None = None,
    ) -> None:  # fmt: skip
        super().__init__(settings, light, max_depth, statistics, planned)
        self._views, self._films, self._depth = views, films, depth
        self._memory: PassMemory = memory or NoMemory()
        self._surface_samples = self._wide = self._indices = 1
        self._size = (0, 0)
        self.about = ""
        self._plan(views[0].window, light)

    def _plan(self, window: Window, light: ShotLight) -> None:
        """Choose how many samples each pixel has of everything but beams, once the number of light paths is known.

        A crop, and a picture with overscan, have as many samples in each pixel as the whole picture.
        """
        self._size = window.width, window.height
        pixels, order = window.width * window.height, self._films[0].order
        chosen = self.settings.surface_samples
        if chosen is None:
            seen = self._views[0].holdout is None
            chosen = planned_samples(light, Pixels(pixels, self._films[0].averaged), self.statistics, seen)
        self._surface_samples = chosen
        # Sample indices have 32 bits. Those of further samples follow those of the whole picture, in crops, too.
        last = z_order(dr.opaque(UInt32, window.width - 1), dr.opaque(UInt32, window.height - 1))
        self._indices = 1 << int(last[0]).bit_length()
        own = 1 << int(dr.max(order)[0]).bit_length()
        self._wide = power_below(min(LANES // dr.width(order), (1 << 32) // own))

    def together(self, number: int) -> int:
        """Return how many passes from `number` on are best rendered at once."""
        if self.light.varies or self._views[0].holdout is not None:
            return 1
        # Sample sequences begin again after 2^BITS passes.
        return power_below(min(self._wide, (1 << BITS) - number % (1 << BITS)))

    def add_passes(self, numbers: range) -> None:
        """Add passes, several at once if `together` says so; each depends only on scene, settings and its number."""
        while numbers:
            count = min(self.together(numbers[0]), power_below(len(numbers)))
            if count > 1:
                self._add(numbers[:count])
            else:
                self.add_pass(numbers[0])
            numbers = numbers[count:]

    def add_pass(self, number: int) -> None:
        """Add pass `number`."""
        self._add(range(number, number + 1))

    def _add(self, numbers: range) -> None:
        """Add a pass, or several passes, if walks alone meet their light."""
        light, surfaces = self._memory.light(numbers[0], lambda: self.lit(numbers[0]))
        self.count(light)
        instant, there = self._instant(numbers[0], light), light
        if instant is not None:
            there = replace(light, sets=[each.at(instant.time) for each in light.sets])
        moving = any(each.close is not None for each in there.sets)
        for view, film in enumerate(self._films):
            pinhole = None if instant is None else instant.pinholes[view]
            seen, looked = self._memory.picture(
                numbers,
                view,
                lambda view=view, film=film: self._seen_in(numbers, view, film, light, surfaces),  # type: ignore[misc]
            )
            for own, number in zip(seen, numbers, strict=True):
                samples = self.samples(number)
                beams = BeamSamples({}, film.centers())
                if light.sets:
                    with self.statistics.phase("surfaces"):
                        # Rays with their own origins are not evenly spaced.
                        lattice = film.lattice(samples, *self._size) if looked.shared_origin or pinhole else None
                        places = film.places(samples, lattice)
                        rays = replace(self._rays(number, view, places, samples, moving, pinhole), lattice=lattice)
                        if lattice is not None:
                            inside = self._views[view].inside(number, rays, places, samples, moving, pinhole)
                            rays = replace(rays, inside=inside)
                    edge = self._edges(own, looked, film.order)
                    beams = self._beams(number, view, film, there, rays, places, edge)
                    release_memory(self._size)
                first = self._first_hits(view, film) if number == 0 else {}
                with self.statistics.phase("surfaces"):
                    film.add(number, own, beams, dr.opaque(Float, looked.exposure), first)
                release_memory(self._size)
        self.statistics.passes += len(numbers)

    def _seen_in(
        self, numbers: range, view: int, film: Film, light: TracedLight, surfaces: SurfaceLight
    ) -> tuple[list[SeenSums], ViewRays]:
        """Return what rays see, except beams, for each pass, and the rays of one sample.

        As many samples as memory allows are rendered as one wide picture, one sample of all pixels after the other.
        """
        each, pixels = self._surface_samples, dr.width(film.order)
        seen: list[SeenSums] = []
        wide = min(self._wide, each if each > 1 else len(numbers))
        for begin in range(each * numbers.start, each * numbers.stop, wide):
            with self.statistics.phase("surfaces"):
                samples = self.samples(begin, (wide - 1).bit_length(), each)
                single = [self.samples(begin + place, 0, each) for place in range(wide)]
                places = [film.places(own) for own in single]
                passes = [(begin + place) // each - numbers[0] for place in range(wide)]
                rays = [
                    self._rays(numbers[number], view, own, one)
                    for number, own, one in zip(passes, places, single, strict=True)
                ]
                joint = ViewRays(PrimaryRays.joined([own.primary for own in rays]), None, holdout=rays[0].holdout)
                order = samples.indices(film.order)
            picture = self.seen(light, joint, order, samples, surfaces)
            with self.statistics.phase("surfaces"):
                exposure = dr.opaque(Float, rays[0].exposure)
                while len(seen) <= passes[-1]:
                    seen.append(SeenSums(film, each, exposure))
                if each > 1:
                    seen[passes[0]].add(picture, joined(places))
                else:
                    for place, number in enumerate(passes):
                        seen[number].add(picture.of_pass(place, pixels), places[place])
            del picture
            release_memory(self._size)
        return seen, rays[0]

    def _instant(self, number: int, light: TracedLight) -> Instant | None:
        """Return the instant at which the beams of a pass are seen; None: pixels have their own, or nothing is blurred.

        One for all lets rays share their origin, so that few of them need be gathered. Over the passes it is as random
        as that of each pixel; if beams were blurred far, it would show as copies.
        """
        moving = any(each.close is not None for each in light.sets)
        if not light.sets or not (moving or any(each.blurs(number) for each in self._views)):
            return None
        samples, first = self.samples(number), dr.opaque(UInt32, 0)
        time = float(samples.pair(first, Stream.TIME).x[0])
        place = [float(each[0]) for each in disk(samples.pair(first, Stream.LENS))]
        passes = number + 1 if self.planned is None else self.planned
        pinholes = [each.instant(number, light, place, time, passes) for each in self._views]
        known = [each for each in pinholes if each is not None]
        return Instant(time, known) if len(known) == len(pinholes) else None

    def _rays(
        self, number: int, view: int, places: Array2f, samples: Samples, moving: bool = False,
        pinhole: Pinhole | None = None,
    ) -> ViewRays:  # fmt: skip
        """Return a view's camera rays in a pass, through `places` in the pixels; if beams move, they have times.

        If a `pinhole` is given, all rays are its rays.
        """
        return self._views[view].rays(number, places, self._films[view].order, samples, moving, pinhole)

    def _edges(self, seen: SeenSums, rays: ViewRays, order: UInt32) -> Any:
        """Return the pixels whose rays reach very different distances; none if rays have their own origins.

        They are sorted by `order`, so that pixels of a tile, whose rays meet the same beams, are together.
        """
        if self._surface_samples == 1 or not rays.shared_origin or seen.nearest is None:
            return ()
        edge = np.flatnonzero((seen.farthest > _EDGE * seen.nearest).numpy())
        return to_uint(edge[np.argsort(order.numpy()[edge])]) if len(edge) else ()

    def _beams(
        self, number: int, view: int, film: Film, light: TracedLight, rays: ViewRays, places: Array2f, edge: Any
    ) -> BeamSamples:
        """Return the light of the beams of pass `number`, with extra samples of the pixels `edge`.

        The fog behind an edge may be a hundred times as bright. The extra samples are independent of those that found
        these pixels; otherwise light that is rarely found would count too much.
        """
        samples, pixels = self.samples(number), dr.width(film.order)
        each = min(self._surface_samples, _AT_EDGES)
        if not len(edge):
            return BeamSamples(self.gathered(number, light, rays, film.order, samples), places)
        with self.statistics.phase("surfaces"):
            single = [self.samples(each * number + place, 0, each, _EDGES) for place in range(each)]
            further = [film.places(own) for own in single]
            # One picture of rays after the other: all of them at once would be most of a pass's memory.
            primary = []
            for own, one in zip(further, single, strict=True):
                whole = PrimaryRays.joined([self._rays(number, view, own, one).primary])
                primary.append(whole.taken(edge))
                dr.eval(primary[-1])
            some = PrimaryRays.joined(primary)
            lanes = joined([edge + dr.opaque(UInt32, place * pixels) for place in range(each)])
            # They are numbered like pixels of further pictures beside this one.
            own_order = taken(film.order, edge)
            order = joined([
                film.order,
                *(own_order + dr.opaque(UInt32, (place + 1) * self._indices & 0xFFFFFFFF) for place in range(each)),
            ])  # fmt: skip
            both = replace(rays, primary=rays.primary.with_more(some))
        more = MoreSamples(edge, each)
        found = self.gathered(number, light, both, order, samples, more)
        place = joined([dr.arange(UInt32, pixels), lanes + dr.opaque(UInt32, pixels)])
        share, groups = dr.zeros(Float, (each + 1) * pixels), {}
        dr.scatter(share, more.shares(pixels), place)
        for group, radiance in found.items():
            groups[group] = dr.zeros(Array3f, (each + 1) * pixels)
            dr.scatter(groups[group], radiance, place)
        return BeamSamples(groups, joined([places, *further]), share)

    def _first_hits(self, view: int, film: Film) -> dict[str, Any]:
        """Return planar depths and normals from a pinhole at shutter open: a mean of depths belongs to no surface."""
        if not self._depth:
            return {}
        normals, rays = self.settings.normals, self._views[view].pinhole(film.centers(), film.order, self.samples(0))
        count = dr.width(rays.primary.direction)
        if rays.holdout is not None:
            return {DEPTH: rays.holdout, **({NORMAL: dr.zeros(Array3f, count)} if normals else {})}
        tracing = replace(unshaded(self.camera_tracing(self.light.world, rays)), normals=normals, splits=False)
        image = CameraImage(count)
        with self.statistics.phase("surfaces"):
            begun = camera_paths.begin(tracing, rays.primary, film.order)
            for step in camera_paths.follow(tracing, begun, self.samples(0), NO_LIGHT):
                image.add(*step)
        depth = image.distance * (1.0 if rays.primary.facing is None else rays.primary.facing)
        return {DEPTH: depth, **({NORMAL: image.normal} if normals else {})}

    def layers(self) -> dict[str, np.ndarray]:
        """Return the layers of the first view."""
        return self._films[0].layers()

    def views(self) -> list[dict[str, np.ndarray]]:
        """Return the layers of each view, means over the passes."""
        return [film.layers() for film in self._films]

    def error(self) -> float:
        """Return the relative standard error so far of the view with the largest one."""
        return self.sums().error()

    def sums(self) -> FrameSums:
        """Return the sums of the passes so far."""
        statistics = self.statistics
        views = [film.sums for film in self._films]
        return FrameSums(views, self.planned, statistics.beams, statistics.tests, self.about)

    def clear(self) -> None:
        """Begin again, without passes."""
        self.statistics = self.statistics.fresh()
        for film in self._films:
            film.sums = PassSums()

    def restore(self, sums: FrameSums) -> None:
        """Continue from the sums of another frame; raise SceneError if they are of another picture."""
        if len(sums.views) != len(self._films):
            raise SceneError("the checkpoint is of another picture: expected one of its size, filter, views and layers")
        for film, each in zip(self._films, sums.views, strict=True):
            film.restore(each)
        statistics = self.statistics
        statistics.passes, statistics.beams, statistics.tests = len(sums), sums.beams, sums.tests
