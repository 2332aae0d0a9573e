"""One frame: the mean of independent passes, each with its own light paths and camera paths.

Stages and Mitsuba scenes have their own worlds, light paths and camera rays; everything else is here. If anything
moves, each pass covers a slice of the shutter interval. Motion within a slice is linear: light straight from its lamp
is traced at both ends of the slice with the same samples, the camera is known at both ends, and camera rays have times
in between. Radii shrink from pass to pass, so that bias and variance both vanish (Progressive Photon Beams, Jarosz et
al. 2011).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import numpy as np

from ..beams.sets import BeamSet
from ..estimators.lanes import Lattice, MoreSamples
from ..estimators.points import Points
from ..estimators.tiles import Projection
from ..looks import LightContext
from ..numerics.arrays import joined, taken, to_uint
from ..numerics.samples import Samples
from ..numerics.sampling import z_order
from ..runtime.device import Array2f, Array3f, Bool, Float, UInt32, check_recording
from ..scene import SceneError
from ..transport.radii import Limits
from ..transport.records import PhotonHits
from ..transport.simulation import Tuning
from ..world.cameras.cameras import Window
from ..world.cameras.sensors import PrimaryRays
from ..world.world import World
from . import camera_paths
from .branches import CameraPaths, add_to_pixels
from .camera_paths import CameraTracing, Lighting
from .costs import LANES, power_below, surface_samples
from .film import BeamSamples, Film, Groups, PassPicture, SeenSums
from .frame_sums import FrameSums
from .gathering import EstimatorOptions, Gathering
from .memory import release_memory
from .passes import Statistics
from .photons import PhotonLighting
from .settings import Settings
from .single_scattering import SingleScattering
from .sums import ALBEDO, DEPTH, MEAN_NORMAL, NORMAL, PassSums
from .walks import Walking

DEFAULTS = Settings()

# A pixel has an edge if one of its rays reaches this many times as far as another.
_EDGE = 1.1
# Most extra samples of such a pixel: half of a small picture may be edges. Their number depends on nothing in the pass;
# otherwise crops would differ, and sequences would have gaps.
_AT_EDGES = 4
_EDGES = 0x3C6EF372  # offset of the seed of the extra samples there


@dataclass(frozen=True)
class Simulated:
    """The result of tracing light in a pass: beams, and photon hits with the bounds of their radii.

    `world` is the world that the pass's camera paths meet.
    """

    world: World
    sets: list[BeamSet]
    hits: list[PhotonHits]
    limits: Limits


@dataclass(frozen=True)
class ViewRays:
    """A view's camera rays in a pass, their projection (or None), and the exposure.

    With a `holdout` rays see no surfaces, and these are the distances at which they end; else it is None. `lattice`
    tells which rays are evenly spaced. If there is also overscan, `inside` has the indices of the rays inside the
    picture, and these as rays of their own.
    """

    primary: PrimaryRays
    view: Projection | None
    exposure: float = 1.0
    holdout: Any = None
    lattice: Lattice | None = None
    inside: tuple[UInt32, ViewRays] | None = None

    @property
    def shared_origin(self) -> bool:
        """Whether all rays begin at one point, or on the film of a parallel projection."""
        return self.view is not None and self.primary.origins is None


class PassRenderer(ABC):
    """Renders passes: light first, then what camera rays see of it.

    Attributes
    ----------
    settings
        How passes are rendered.
    statistics
        The statistics so far.

    Raises
    ------
    DeviceError
        Within a function that `drjit.freeze` records.
    """

    def __init__(self, settings: Settings, max_depth: int | None, all_beams: bool = False) -> None:
        check_recording()
        self.settings, self.statistics = settings, self._no_statistics()
        self._all_beams = all_beams
        self._max_depth = max_depth
        self._points = Points(settings.rule)

    def _no_statistics(self) -> Statistics:
        """Return the statistics of a frame without passes."""
        return Statistics()

    @abstractmethod
    def _lighting(self, world: World) -> Lighting:
        """Return the lighting of a world."""

    @abstractmethod
    def simulated(self, number: int) -> Simulated:
        """Return the beams and photons of pass `number`."""

    def _single_scattering(self, world: World, count: int, samples: Samples) -> SingleScattering | None:
        """Return the light that media scatter toward `count` pixels without beams, or None."""
        return None

    def _walkings(self, world: World) -> Mapping[str, Walking]:
        """Return, by light groups, the walks that meet the light of emitters which send no light paths."""
        return {}

    def _clock(self, number: int) -> tuple[float, float]:
        """Return the frame number and the time in seconds of a pass, for looks that change with time."""
        return (0.0, 0.0)

    def _samples(self, number: int, together: int = 0, each: int = 1, other: int = 0) -> Samples:
        """Return the samples of pass `number`, or of sample `number` if pixels have `each` samples in a pass.

        Another value of `other` gives independent samples.
        """
        return Samples(self.settings.seed + other, number, together=together)

    @property
    def _max_bounces(self) -> int | None:
        """Most bounces of light before it is scattered toward the camera: two less than the longest path has edges."""
        return None if self._max_depth is None else self._max_depth - 2

    @property
    def _tuning(self) -> Tuning:
        settings = self.settings
        return Tuning(
            settings.seed, self._max_bounces, settings.rr_depth, settings.overlap, settings.alpha, settings.radius,
            settings.min_radius, settings.max_radius, settings.short, settings.surfaces, settings.max_depth is None,
            visible=settings.program is None and not self._all_beams,
        )  # fmt: skip

    def _lit(self, number: int) -> tuple[Simulated, PhotonLighting | None]:
        """Return the beams and photons of pass `number`, and photon maps, if there are photons."""
        with self.statistics.phase("simulate"):
            light = self.simulated(number)
            photons = None
            if light.hits:
                photons = PhotonLighting(light.world, light.hits, light.limits, self._max_bounces)
        self.statistics.beams += sum(len(each.beams) for each in light.sets)
        return light, photons

    def _seen(
        self, light: Simulated, rays: ViewRays, order: UInt32, samples: Samples, photons: PhotonLighting | None
    ) -> PassPicture:  # fmt: skip
        """Return what camera rays see, except beams; `order` are their numbers in the sample sequences."""
        statistics, count = self.statistics, dr.width(rays.primary.direction)
        tracing = self._camera_tracing(light.world, rays)
        walkings, picture = self._walkings(light.world), _CameraImage(count, tracing.albedo)
        sky = self._single_scattering(light.world, count, samples)
        scattered = {group: dr.zeros(Array3f, count) for group in walkings}
        with statistics.phase("surfaces"):
            begun = camera_paths.begin(tracing, rays.primary, order)
            for step in camera_paths.follow(tracing, begun, samples, photons):
                statistics.step()
                picture.add(*step)
                if sky is not None:
                    sky.add(*step)
                for group, walking in walkings.items():
                    walking.add(*step, samples, scattered[group], picture.surface)
        for group, found in ({} if sky is None else sky.radiance).items():
            scattered[group] = scattered.get(group, 0) + found
        guides = {ALBEDO: picture.albedo} if tracing.albedo else {}
        if self.settings.denoise:
            guides[MEAN_NORMAL] = picture.normal
        return PassPicture(picture.surface, picture.alpha, scattered, picture.transmittance, picture.reach, guides)

    def _gathered(
        self, number: int, light: Simulated, rays: ViewRays, order: UInt32, samples: Samples,
        more: MoreSamples | None = None,
    ) -> Groups:  # fmt: skip
        """Return the light of the beams of pass `number` along camera rays; with `more`, some pixels have several."""
        if not light.sets:
            return {}
        if rays.inside is not None:
            return self._gathered_apart(number, light, rays, rays.inside, order, samples, more)
        clock, statistics = self._clock(number), self.statistics
        tracing = _unshaded(self._camera_tracing(light.world, rays))
        options = EstimatorOptions(
            self.settings.estimator, self._points, self._max_depth,
            lambda each: LightContext(*clock, each.light, each.to_world), self.settings.gather_error,
        )  # fmt: skip
        with statistics.phase("beams"):
            gathering = Gathering(
                rays.view, rays.primary, light.world.media, light.sets, options, statistics, more, rays.lattice
            )
            begun = camera_paths.begin(tracing, rays.primary, order)
            for step in camera_paths.follow(tracing, begun, samples, None):
                gathering.add(*step)
            gathering.finish()
        return gathering.radiance

    def _gathered_apart(
        self, number: int, light: Simulated, rays: ViewRays, inside: tuple[UInt32, ViewRays], order: UInt32,
        samples: Samples, more: MoreSamples | None,
    ) -> Groups:  # fmt: skip
        """Return what `_gathered` returns, gathered apart for the picture and for overscan.

        Where some rays of the picture stand for others, which ones do must not depend on overscan.
        """
        index, own = inside
        if more is not None:
            index, own, own_more = _more_inside(rays, index, own, more)
        else:
            own_more = None
        beyond = dr.full(Bool, True, dr.width(rays.primary.direction))
        dr.scatter(beyond, Bool(False), index)
        far = dr.select(beyond, rays.primary.far, 0)
        dr.eval(far)
        rest = replace(rays, primary=replace(rays.primary, far=far), lattice=None, inside=None)
        result = dict(self._gathered(number, light, rest, order, samples, more))
        for group, radiance in self._gathered(number, light, own, taken(order, index), samples, own_more).items():
            dr.scatter(result[group], radiance, index)
        return result

    def _camera_tracing(self, world: World, rays: ViewRays) -> CameraTracing:
        settings = self.settings
        if rays.holdout is not None:
            world = world.without_surfaces()
            return CameraTracing(world, NoLighting(), None, settings.rr_depth, True, surfaces=False, sharp=world.sharp)
        return CameraTracing(
            world, self._lighting(world), self._max_depth, settings.rr_depth, settings.hide_emitters,
            settings.surfaces, world.sharp, walks=settings.surfaces and bool(self._walkings(world)),
            normals=settings.denoise, albedo=settings.denoise or settings.albedo,
        )  # fmt: skip


class FrameRenderer(PassRenderer):
    """A frame that is being rendered: the films of all its views.

    Attributes
    ----------
    planned
        The number of passes for which samples are chosen; None: any number.
    about
        Hash of the passes' content, as in `FrameSums`.
    """

    def __init__(self, settings: Settings, max_depth: int | None, planned: int | None, all_beams: bool = False) -> None:
        super().__init__(settings, max_depth, all_beams)
        self.planned = planned
        self._films: list[Film] = []
        self._surface_samples = self._wide = self._indices = 1
        self._size = (0, 0)
        self.about = ""

    @abstractmethod
    def _view_rays(
        self, number: int, view: int, places: Array2f, samples: Samples, moving: bool = False
    ) -> ViewRays:  # fmt: skip
        """Return a view's camera rays in a pass, through `places` in the pixels.

        If beams are `moving`, rays have times, and are otherwise the same.
        """

    def _inside(
        self, number: int, view: int, rays: ViewRays, places: Array2f, samples: Samples, moving: bool
    ) -> tuple[UInt32, ViewRays] | None:
        """Return the part of a view's rays, with a lattice, that is inside the picture; None if all rays are."""
        return None

    @abstractmethod
    def _pinhole(self, view: int) -> tuple[World, ViewRays] | None:
        """Return the world, and a pinhole camera's rays through the centres of pixels; None if no depth is wanted."""

    @abstractmethod
    def _light_paths(self) -> int:
        """Return how many light paths a pass has."""

    def _plan(self, window: Window) -> None:
        """Choose how many samples each pixel has of everything but beams, once the number of light paths is known.

        A crop, and a picture with overscan, have as many samples in each pixel as the whole picture.
        """
        self._size = window.width, window.height
        pixels, order = window.width * window.height, self._films[0].order
        chosen = self.settings.surface_samples
        self._surface_samples = surface_samples(self._light_paths(), pixels) if chosen is None else chosen
        # Sample indices have 32 bits. Those of further samples follow those of the whole picture, in crops, too.
        last = z_order(dr.opaque(UInt32, window.width - 1), dr.opaque(UInt32, window.height - 1))
        self._indices = 1 << int(last[0]).bit_length()
        own = 1 << int(dr.max(order)[0]).bit_length()
        self._wide = power_below(min(LANES // dr.width(order), (1 << 32) // own))

    def together(self, number: int) -> int:
        """Return how many passes from `number` on are best rendered at once."""
        return 1

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
        light, photons = self._lit(numbers[0])
        moving = any(each.close is not None for each in light.sets)
        for view, film in enumerate(self._films):
            seen, looked = self._seen_in(numbers, view, film, light, photons)
            for own, number in zip(seen, numbers, strict=True):
                samples = self._samples(number)
                beams = BeamSamples({}, film.centers())
                if light.sets:
                    with self.statistics.phase("surfaces"):
                        # Rays with their own origins are not evenly spaced.
                        lattice = film.lattice(samples, *self._size) if looked.shared_origin else None
                        places = film.places(samples, lattice)
                        rays = replace(self._view_rays(number, view, places, samples, moving), lattice=lattice)
                        if lattice is not None:
                            rays = replace(rays, inside=self._inside(number, view, rays, places, samples, moving))
                    edge = self._edges(own, rays, film.order)
                    beams = self._beams(number, view, film, light, rays, places, edge)
                    release_memory(self._size)
                first = self._first_hits(view, film) if number == 0 else {}
                with self.statistics.phase("surfaces"):
                    film.add(number, own, beams, dr.opaque(Float, looked.exposure), first)
                release_memory(self._size)
        self.statistics.passes += len(numbers)

    def _seen_in(
        self, numbers: range, view: int, film: Film, light: Simulated, photons: PhotonLighting | None
    ) -> tuple[list[SeenSums], ViewRays]:
        """Return what rays see, except beams, for each pass, and the rays of one sample.

        As many samples as memory allows are rendered as one wide picture, one sample of all pixels after the other.
        """
        each, pixels = self._surface_samples, dr.width(film.order)
        seen: list[SeenSums] = []
        wide = min(self._wide, each if each > 1 else len(numbers))
        for begin in range(each * numbers.start, each * numbers.stop, wide):
            with self.statistics.phase("surfaces"):
                samples = self._samples(begin, (wide - 1).bit_length(), each)
                single = [self._samples(begin + place, 0, each) for place in range(wide)]
                places = [film.places(own) for own in single]
                passes = [(begin + place) // each - numbers[0] for place in range(wide)]
                rays = [
                    self._view_rays(numbers[number], view, own, one)
                    for number, own, one in zip(passes, places, single, strict=True)
                ]
                joint = ViewRays(PrimaryRays.joined([own.primary for own in rays]), None, holdout=rays[0].holdout)
                order = samples.indices(film.order)
            picture = self._seen(light, joint, order, samples, photons)
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

    def _edges(self, seen: SeenSums, rays: ViewRays, order: UInt32) -> Any:
        """Return the pixels whose rays reach very different distances; none if rays have their own origins.

        They are sorted by `order`, so that pixels of a tile, whose rays meet the same beams, are together.
        """
        if self._surface_samples == 1 or not rays.shared_origin or seen.nearest is None:
            return ()
        edge = np.flatnonzero((seen.farthest > _EDGE * seen.nearest).numpy())
        return to_uint(edge[np.argsort(order.numpy()[edge])]) if len(edge) else ()

    def _beams(
        self, number: int, view: int, film: Film, light: Simulated, rays: ViewRays, places: Array2f, edge: Any
    ) -> BeamSamples:
        """Return the light of the beams of pass `number`, with extra samples of the pixels `edge`.

        The fog behind an edge may be a hundred times as bright. The extra samples are independent of those that found
        these pixels; otherwise light that is rarely found would count too much.
        """
        samples, pixels = self._samples(number), dr.width(film.order)
        each = min(self._surface_samples, _AT_EDGES)
        if not len(edge):
            return BeamSamples(self._gathered(number, light, rays, film.order, samples), places)
        with self.statistics.phase("surfaces"):
            single = [self._samples(each * number + place, 0, each, _EDGES) for place in range(each)]
            further = [film.places(own) for own in single]
            # One picture of rays after the other: all of them at once would be most of a pass's memory.
            primary = []
            for own, one in zip(further, single, strict=True):
                whole = PrimaryRays.joined([self._view_rays(number, view, own, one).primary])
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
        found = self._gathered(number, light, both, order, samples, more)
        place = joined([dr.arange(UInt32, pixels), lanes + dr.opaque(UInt32, pixels)])
        share, groups = dr.zeros(Float, (each + 1) * pixels), {}
        dr.scatter(share, more.shares(pixels), place)
        for group, radiance in found.items():
            groups[group] = dr.zeros(Array3f, (each + 1) * pixels)
            dr.scatter(groups[group], radiance, place)
        return BeamSamples(groups, joined([places, *further]), share)

    def _first_hits(self, view: int, film: Film) -> dict[str, Any]:
        """Return planar depths and normals from a pinhole at shutter open: a mean of depths belongs to no surface."""
        sharp, normals = self._pinhole(view), self.settings.normals
        if sharp is None:
            return {}
        world, rays = sharp
        count = dr.width(rays.primary.direction)
        if rays.holdout is not None:
            return {DEPTH: rays.holdout, **({NORMAL: dr.zeros(Array3f, count)} if normals else {})}
        tracing = replace(_unshaded(self._camera_tracing(world, rays)), normals=normals, splits=False)
        image = _CameraImage(count)
        with self.statistics.phase("surfaces"):
            begun = camera_paths.begin(tracing, rays.primary, film.order)
            for step in camera_paths.follow(tracing, begun, self._samples(0), None):
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
        self.statistics = self._no_statistics()
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


def _more_inside(
    rays: ViewRays, index: UInt32, own: ViewRays, more: MoreSamples
) -> tuple[UInt32, ViewRays, MoreSamples | None]:
    """Return indices, rays and further samples of the pixels inside the picture, with their further rays."""
    edges, pixels = more.pixels.numpy(), dr.width(rays.primary.direction) - more.each * dr.width(more.pixels)
    place = np.full(pixels, -1, np.int64)
    place[index.numpy()] = np.arange(dr.width(index))
    chosen = np.flatnonzero(place[edges] >= 0)
    if not len(chosen):
        return index, own, None
    lanes = to_uint((pixels + np.arange(more.each)[:, None] * len(edges) + chosen).ravel())
    further = PrimaryRays.joined([rays.primary]).taken(lanes)
    own = replace(own, primary=own.primary.with_more(further))
    return joined([index, lanes]), own, MoreSamples(to_uint(place[edges[chosen]]), more.each)


def _unshaded(tracing: CameraTracing) -> CameraTracing:
    """Return the same tracing for paths that only find where surfaces are."""
    return replace(tracing, surfaces=False, walks=False, shining=False, normals=False, albedo=False)


class _CameraImage:
    """The surfaces that camera paths see in a pass, by pixels.

    Normals are those of surfaces straight ahead. With `guides`, normals and albedos are those of the first surfaces
    that do more than mirror and refract.
    """

    def __init__(self, count: int, guides: bool = False) -> None:
        self.surface, self.transmittance = dr.zeros(Array3f, count), dr.zeros(Array3f, count)
        self.alpha, self.distance = dr.zeros(Float, count), dr.full(Float, dr.inf, count)
        self.normal, self.reach = dr.zeros(Array3f, count), dr.zeros(Float, count)
        self._unmet = dr.full(Bool, True, count) if guides else None
        self.albedo = dr.zeros(Array3f, count if guides else 1)

    def add(self, step: CameraPaths, vertex: camera_paths.CameraVertex) -> None:
        """Add one step of camera paths."""
        add_to_pixels(self.surface, vertex.radiance, step.pixel, step.branch, step.alive)
        own = step.alive & step.primary
        dr.scatter(self.transmittance, vertex.transmittance, step.pixel, own)
        dr.scatter(self.reach, vertex.end, step.pixel, own)
        first = own & vertex.solid
        dr.scatter(self.alpha, Float(1), step.pixel, first)
        dr.scatter(self.distance, vertex.end, step.pixel, first)
        if self._unmet is not None:
            # Only one branch of a pixel counts: several may arrive at the same step.
            first = step.alive & (step.branch == 0) & vertex.rough & dr.gather(Bool, self._unmet, step.pixel)
            dr.scatter(self._unmet, Bool(False), step.pixel, first)
            dr.scatter(self.albedo, vertex.albedo, step.pixel, first)
            dr.eval(self._unmet, self.albedo)
        if dr.width(vertex.normal) > 1:
            dr.scatter(self.normal, vertex.normal, step.pixel, first)
        dr.eval(self.surface, self.transmittance, self.alpha, self.distance, self.normal, self.reach)


class NoLighting:
    """The lighting of a world in which nothing emits light or is lit directly."""

    def lamp(self, origin: Array3f, direction: Array3f, flown: Float) -> None:
        """Return None."""
        return

    def emission(self, hit: Any, origin: Array3f, direction: Array3f, active: Bool) -> Array3f:
        """Return black."""
        return dr.zeros(Array3f, dr.width(hit.t))

    def direct(self, point: camera_paths.ShadingPoint, active: Bool) -> Array3f:
        """Return black."""
        return dr.zeros(Array3f, dr.width(point.hit.t))
