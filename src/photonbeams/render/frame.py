"""One frame: the mean of independent passes, each with its own light paths and camera paths.

If anything moves, each pass covers a slice of the shutter interval. Motion within a slice is linear: light straight
from its lamp is traced at both ends of the slice with the same samples, the camera is known at both ends, and camera
rays have times in between. Radii shrink from pass to pass, so that bias and variance both vanish (Progressive Photon
Beams, Jarosz et al. 2011).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, Protocol

import drjit as dr
import numpy as np

from ..estimators.lanes import MoreSamples
from ..numerics.arrays import channel_mean, joined, taken, to_uint
from ..numerics.samples import BITS, Samples
from ..numerics.sampling import z_order
from ..numerics.streams import Stream
from ..runtime.device import Array2f, Float, UInt32, uncollected
from ..scene import SceneError
from ..world.cameras.cameras import Pinhole
from ..world.cameras.sensors import PrimaryRays
from ..world.shutter import Moment
from ..world.warp import disk
from .costs import LANES, power_below
from .films.film import BeamSamples, Film, PassPicture, SeenSums
from .films.frame_sums import FrameSums
from .films.sample_layout import PixelSamples, SampleLayout, SamplePiece, parts
from .films.sums import PassSums
from .light import ShotLight, TracedLight
from .memory import release_memory
from .passes import Statistics
from .paths.surface_light import SurfaceLight
from .pilots.beam_noise import BeamCost, beam_cost
from .pilots.beam_widths import sentences
from .pilots.sample_plan import EDGE, SAMPLES, Pixels, SampleCounts, pilot_pixels, sample_plan
from .ray_passes import PassRenderer, ViewRays, unshaded
from .seen.deep import deep_pass, deep_pictures
from .seen.first_hits import Later, first_hits
from .settings import Settings
from .tallied import PinholeRays, TalliedView, parts_with_media, tallied_view
from .views import FrameView

DEFAULTS = Settings()

# Most extra samples of such a pixel: half of a small picture may be edges. Their number depends on nothing in the pass;
# otherwise crops would differ, and sequences would have gaps.
_AT_EDGES = 4
_EDGES = 0x3C6EF372  # offset of the seed of the extra samples there
_PILOT = 0x1B873593  # and of those of the pilot

#: The beams and photons of a pass, and their light on surfaces. What rays see except beams, by passes.
Lit = tuple[TracedLight, SurfaceLight]
Seen = list[SeenSums]


class Instant(NamedTuple):
    """One time in a pass, from 0 to 1, and for each view a pinhole on its lens."""

    time: float
    pinholes: Sequence[Pinhole]


class WidePicture(NamedTuple):
    """Samples of pixels that are followed at once, with their `indices`, from pass `number` on.

    `share` is the weight of each in its pixel; None: each pass has one sample of each pixel, and there may be several
    passes. `layout` tells where the samples of a pixel are; None: each has one.
    """

    number: int
    samples: Samples
    indices: UInt32
    pixel: UInt32
    share: Any = None
    layout: SampleLayout | None = None


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
    later
        Returns the shot one frame later; None: nothing moves.

    Attributes
    ----------
    about
        Hash of the passes' content, as in `FrameSums`.
    worlds
        The world over the shutter interval.
    findings
        What the pilot has found out so far.
    """

    def __init__(
        self, settings: Settings, light: ShotLight, views: Sequence[FrameView], films: Sequence[Film],
        max_depth: int | None, statistics: Statistics, planned: int | None = None, depth: bool = True,
        memory: PassMemory | None = None, later: Callable[[], Moment] | None = None,
    ) -> None:  # fmt: skip
        super().__init__(settings, light, max_depth, statistics, planned)
        self.worlds, self._moments = light.worlds, later
        self._views, self._films, self._depth = views, films, depth
        self._memory: PassMemory = memory or NoMemory()
        self.about, self._doubts = "", partial(sentences, light)
        window, order = views[0].window, films[0].order
        self._size, self._counts = (window.width, window.height), list[tuple[SampleCounts, list[SamplePiece]]]()
        pixels, seen = Pixels(window.width * window.height, films[0].averaged), views[0].holdout is None
        self._plan, self.findings = sample_plan(light, pixels, seen), light.findings
        # Sample indices have 32 bits. Those of further samples follow those of the whole picture, in crops, too.
        last = z_order(dr.opaque(UInt32, window.width - 1), dr.opaque(UInt32, window.height - 1))
        self._indices = 1 << int(last[0]).bit_length()
        self._wide = power_below(min(LANES // dr.width(order), (1 << 32) >> int(dr.max(order)[0]).bit_length()))

    def _plan_views(self, first: Callable[[], Lit]) -> None:
        """Plan how many samples each pixel has of everything but beams; pixels of a crop have those of the whole.

        They are planned by the light of the `first` pass: all passes add samples that no plan has seen.
        """
        if not self._plan.sample:
            counts = [SampleCounts.of(self._plan.usual)] * len(self._views)
        else:
            lit = first()
            beams = self._beam_cost(lit[0])
            counts = [self._planned(view, lit, beams) for view in self._views]
        self._counts = [
            (own, [] if own.uniform else own.pieces(view.window)) for own, view in zip(counts, self._views, strict=True)
        ]

    def _beam_cost(self, first: TracedLight) -> BeamCost:
        """Return the noise and cost of the beams of the first pass; an earlier render may have found them."""
        known, pixels = self.findings.beams, self._size[0] * self._size[1]
        if pixels not in known:
            with self.statistics.phase("plan"):
                known = {**known, pixels: beam_cost(self, first, pixels)}
            self.findings = replace(self.findings, beams=known)
        return known[pixels]

    def _planned(self, view: FrameView, first: Lit, beams: BeamCost) -> SampleCounts:
        """Return the plan of a view."""
        with self.statistics.phase("plan"):
            whole, pixels = view.whole(), pilot_pixels(*self._size)
            lanes = PixelSamples.of(self._size[0] * self._size[1], [SamplePiece(pixels, SAMPLES, range(SAMPLES))])
            columns = dr.opaque(UInt32, self._size[0])
            samples = self.counted_samples(0, SAMPLES, _PILOT)
            order = z_order(lanes.pixel % columns, lanes.pixel // columns)
            index = samples.index(order, lanes.each, lanes.sample)
        picture, _ = self._looked(whole, WidePicture(0, samples, index, lanes.pixel), first)
        radiance = channel_mean(picture.radiance).numpy().reshape(SAMPLES, -1)
        return self._plan.counts(beams, radiance, picture.reach.numpy().reshape(SAMPLES, -1), whole.window)

    @uncollected()
    def doubts(self) -> list[str]:
        """Return sentences about gaps that are finer than beams are wide."""
        return [*self._doubts()]

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

    @uncollected()
    def _add(self, numbers: range) -> None:
        """Add a pass, or several passes, if walks alone meet their light."""
        if numbers[0] > 0 and not self._counts:
            self._plan_views(lambda: self._lit(0))
        lit = self._lit(numbers[0])
        light, _ = lit
        self.count(light)
        instant, there = self._instant(numbers[0], light), light
        if instant is not None:
            there = replace(light, sets=[each.at(instant.time) for each in light.sets])
        moving = any(each.close is not None for each in there.sets)
        for view, film in enumerate(self._films):
            pinhole = None if instant is None else instant.pinholes[view]
            seen = self._memory.picture(
                numbers,
                view,
                lambda view=view, film=film: self._seen_in(numbers, view, film, lit),  # type: ignore[misc]
            )
            eye = self._views[view]
            shared = eye.shares_origin(numbers[0])
            for own, number in zip(seen, numbers, strict=True):
                samples, tallied = self.samples(number), self._tallied(number, light, eye, pinhole)
                beams = BeamSamples({}, film.centers())
                if light.sets or light.tally is not None:
                    with self.statistics.phase("surfaces"):
                        # Rays with their own origins are not evenly spaced.
                        lattice = film.lattice(samples, *self._size) if shared or pinhole else None
                        places = film.places(samples, lattice)
                        rays = eye.rays(number, places, film.order, samples, moving, pinhole)
                        rays = replace(rays, lattice=lattice)
                        if lattice is not None:
                            inside = eye.inside(number, rays, places, samples, moving, pinhole)
                            rays = replace(rays, inside=inside)
                    edge = _edges(own, film.order) if shared else ()
                    beams = self._beams(
                        number=number,
                        view=view,
                        film=film,
                        light=there,
                        rays=rays,
                        places=places,
                        edge=edge,
                        each=min(own.typical, _AT_EDGES),
                        tallied=tallied,
                    )
                    release_memory(self._size)
                first = first_hits(self, eye, film, partial(self._later, view)) if number == 0 and self._depth else {}
                if self.settings.deep and number == deep_pass(self.planned):
                    first |= deep_pictures(
                        renderer=self,
                        eye=eye,
                        film=film,
                        light=there,
                        tallied=tallied,
                        number=number,
                        moving=moving,
                        pinhole=pinhole,
                    )
                with self.statistics.phase("surfaces"):
                    film.add(number, own, beams, own.exposure, first)
                release_memory(self._size)
        self.statistics.passes += len(numbers)

    def _lit(self, number: int) -> Lit:
        """Return the light of a pass, which may be kept."""
        return self._memory.light(number, lambda: self.lit(number))

    def _seen_in(self, numbers: range, view: int, film: Film, lit: Lit) -> Seen:
        """Return what rays see, except beams, for each pass.

        As many samples as memory allows are rendered as one wide picture.
        """
        if not self._counts:
            self._plan_views(lambda: lit)
        (counts, pieces), own, pixels = self._counts[view], self._views[view], dr.width(film.order)
        exposure = dr.opaque(Float, own.exposure(numbers[0]))
        seen = [SeenSums(film, counts.typical, exposure) for _ in numbers]
        for wide in self._wide_pictures(numbers, counts, pieces, film.order):
            picture, places = self._looked(own, wide, lit)
            with self.statistics.phase("surfaces"):
                begin = wide.number - numbers[0]
                if wide.share is not None:
                    seen[begin].add(picture, places, wide.share, wide.layout, wide.pixel)
                else:
                    for place, sums in enumerate(seen[begin : begin + dr.width(places) // pixels]):
                        lanes = dr.arange(UInt32, pixels) + dr.opaque(UInt32, place * pixels)
                        sums.add(picture.taken(lanes), taken(places, lanes))
            del picture, places
            release_memory(self._size)
        return seen

    def _wide_pictures(
        self, numbers: range, counts: SampleCounts, pieces: Sequence[SamplePiece], order: UInt32
    ) -> Iterator[WidePicture]:  # fmt: skip
        """Yield the samples of passes that are followed at once: one pass after the other, or several."""
        pixels, each = dr.width(order), counts.most
        if not counts.uniform:
            counted = self.counted_samples(numbers[0], each)
            assert len(numbers) == 1, "light is traced, so that passes are rendered one by one"
            for part in parts(pieces, pixels, max(LANES, pixels)):
                lanes, own = PixelSamples.of(pixels, part), SampleLayout.of(pixels, part)
                index = counted.index(taken(order, lanes.pixel), lanes.each, lanes.sample)
                yield WidePicture(numbers[0], counted, index, lanes.pixel, dr.rcp(Float(lanes.each)), own)
            return
        wide = min(self._wide, each if each > 1 else len(numbers))
        pixel = dr.arange(UInt32, wide * pixels) % dr.opaque(UInt32, pixels)
        share = dr.opaque(Float, 1 / each) if each > 1 else None
        layout = SampleLayout.of(pixels, [SamplePiece(None, each, range(wide))]) if wide > 1 else None
        for begin in range(each * numbers.start, each * numbers.stop, wide):
            samples = self.samples(begin, (wide - 1).bit_length(), each)
            yield WidePicture(begin // each, samples, samples.indices(order), pixel, share, layout)

    def _looked(self, view: FrameView, wide: WidePicture, lit: Lit) -> tuple[PassPicture, Array2f]:
        """Return what rays see, except beams, and where they pass the pixels."""
        with self.statistics.phase("surfaces"):
            places = wide.samples.pair(wide.indices, Stream.PIXEL)
            rays = view.rays(wide.number, places, wide.indices, wide.samples, some=wide.pixel)
            joint = replace(rays, primary=PrimaryRays.joined([rays.primary]), view=None)
        light, surfaces = lit
        return self.seen(light, joint, wide.indices, wide.samples, surfaces), places

    def _instant(self, number: int, light: TracedLight) -> Instant | None:
        """Return the instant at which the beams of a pass are seen; None: pixels have their own, or nothing is blurred.

        One for all lets rays share their origin, so that few of them need be gathered. Over the passes it is as random
        as that of each pixel; if beams were blurred far, it would show as copies.
        """
        moving = any(each.close is not None for each in light.sets)
        if not (light.sets or light.tally) or not (moving or any(each.blurs(number) for each in self._views)):
            return None
        time, place = self._drawn(number)
        passes = number + 1 if self.planned is None else self.planned
        pinholes = [each.instant(number, light, place, time, passes) for each in self._views]
        known = [each for each in pinholes if each is not None]
        return Instant(time, known) if len(known) == len(pinholes) else None

    def _drawn(self, number: int) -> tuple[float, list[float]]:
        """Return a time in a pass, from 0 to 1, and a place on the lens, in the unit disc, drawn for all pixels."""
        samples, first = self.samples(number), dr.opaque(UInt32, 0)
        time = float(samples.pair(first, Stream.TIME).x[0])
        return time, [float(each[0]) for each in disk(samples.pair(first, Stream.LENS))]

    def _beams(
        self, number: int, view: int, film: Film, light: TracedLight, rays: ViewRays, places: Array2f, edge: Any,
        each: int, tallied: Sequence[TalliedView],
    ) -> BeamSamples:  # fmt: skip
        """Return the light of the beams of pass `number`, with `each` extra samples of the pixels `edge`.

        The fog behind an edge may be a hundred times as bright. The extra samples are independent of those that found
        these pixels; otherwise light that is rarely found would count too much.
        """
        samples, pixels = self.samples(number), dr.width(film.order)
        if not len(edge):
            found = self.gathered(number, light, rays, film.order, samples, tallied=tallied)
            return BeamSamples(found, places)
        with self.statistics.phase("surfaces"):
            lanes = PixelSamples.of(pixels, [SamplePiece(edge, each, range(each))])
            own_order, further = taken(film.order, lanes.pixel), self.counted_samples(number, each, _EDGES)
            index = further.index(own_order, lanes.each, lanes.sample)
            beside = further.pair(index, Stream.PIXEL)
            more_rays = self._views[view].rays(number, beside, index, further, some=lanes.pixel)
            # They are numbered like pixels of further pictures beside this one.
            order = joined([film.order, own_order + (lanes.sample + 1) * dr.opaque(UInt32, self._indices)])
            both = replace(rays, primary=rays.primary.with_more(PrimaryRays.joined([more_rays.primary])))
        more = MoreSamples(edge, each)
        found = self.gathered(number, light, both, order, samples, more, tallied)
        # All samples of these pixels, with those that all pixels have, follow those of all pixels.
        own = dr.arange(UInt32, each * dr.width(edge)) + dr.opaque(UInt32, pixels)
        index = joined([dr.arange(UInt32, pixels), edge, own])
        layout = SampleLayout.of(pixels, [SamplePiece(None, 1, range(1)), SamplePiece(edge, each + 1, range(each + 1))])
        groups = {group: taken(radiance, index) for group, radiance in found.items()}
        return BeamSamples(groups, taken(joined([places, beside]), index), taken(more.shares(pixels), index), layout)

    def _tallied(
        self, number: int, light: TracedLight, eye: FrameView, pinhole: Pinhole | None
    ) -> list[TalliedView]:  # fmt: skip
        """Return the light of the tally of a pass toward a view, or toward its faces; none if there is no tally."""
        samples, result = self.samples(number), list[TalliedView]()
        if light.tally is None:
            return result
        with self.statistics.phase("beams"):
            apart = pinhole is None and eye.blurs(number)
            if apart:
                pinhole = eye.on_lens(number, *self._drawn(number))
            for view in eye.pinholes(number, pinhole):
                parts = []
                for part, media in parts_with_media(light.world, view):
                    rays = eye.through_middles(part)
                    tracing = unshaded(self.camera_tracing(light.world, rays))
                    parts.append(PinholeRays(part.projection, rays.primary, tracing, samples, media))
                result.append(tallied_view(light.world, light.tally, view.projection, parts, number, apart=apart))
        return result

    def _later(self, view: int) -> Later | None:
        """Return the scene and the camera of a view one frame later; None: nothing moves."""
        moment = None if self._moments is None else self._moments()
        return None if moment is None else (moment.scene, moment.cameras[view])

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


def _edges(seen: SeenSums, order: UInt32) -> Any:
    """Return the pixels whose rays, which share an origin, reach very different distances.

    They are sorted by `order`, so that pixels of a tile, whose rays meet the same beams, are together.
    """
    if seen.nearest is None:
        return ()
    edge = np.flatnonzero((seen.farthest > EDGE * seen.nearest).numpy())
    return to_uint(edge[np.argsort(order.numpy()[edge])]) if len(edge) else ()
