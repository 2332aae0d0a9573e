"""Walks: camera paths that continue after they are scattered, as in a path tracer, for the light of some emitters.

Light of large lamps and of the sky comes to every point of a cloud from everywhere: there a walk from the camera is
more likely to find the light than a beam is to find the camera. Each emitter's light is either traced into beams and
photons or met by walks, never both. For all emitters, `camera_paths` handles what the camera sees of the emitters
themselves, and their direct light on the first surface. At each vertex a walk takes one sample of an emitter and one of
the phase function or BSDF, combined by the power heuristic (Veach 1997), as in Mitsuba's `volpath`.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from ...estimators.estimate import ENDLESS
from ...numerics.arrays import compressed, padded, to_float, to_uint
from ...numerics.samples import Samples
from ...numerics.sampling import power_heuristic
from ...numerics.streams import Stream
from ...numerics.structs import Struct
from ...runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ...transport.interactions import SAMPLED, SCATTERED, flight, survival
from ...world.emitters.portal_lamps import EnvironmentPortal
from ...world.media.interfaces import pointers
from ...world.media.tracking import free_flight
from ...world.media.visibility import through
from ...world.scene_world import SceneWorld
from ...world.shadow_rays import leaving, to_point
from ...world.spectra import rgb
from .branches import CameraPaths, add_to_pixels
from .camera_paths import CameraVertex

mi = mitsuba()

# The fraction of samples that is spread evenly over all emitters: a weak one may be near.
_EVENLY = 0.25

# Steps after which walks end if nothing else ends them, as in a box of mirrors.
_STEPS = 1024


class Walk(Struct):
    """Walks.

    Attributes
    ----------
    origin, direction, medium
        The current rays of walks, and the media in which these begin.
    first, length
        Whether a walk is still on the camera's own segment. It ends there unless it is scattered before `length`.
    throughput, initial
        The path's throughput, and its largest channel after the first scattering event. Where that event is certain,
        the latter is small.
    depth
        How often the path was scattered.
    counts
        Whether emitters that the ray meets count: not after the first surface, whose direct light is counted elsewhere.
    place, pdf
        Where the walk was last scattered, and the density of its direction per solid angle, 0 after ideal lobes.
    order, pixel, branch
        The pixel's place in the sample sequences, the pixel, and the branch of its camera paths.
    name
        The name of the camera vertex at which the walk began.
    """

    origin: Array3f
    direction: Array3f
    medium: UInt32
    first: Bool
    length: Float
    throughput: Array3f
    initial: Float
    depth: UInt32
    counts: Bool
    place: Array3f
    pdf: Float
    order: UInt32
    pixel: UInt32
    branch: UInt32
    name: UInt32


class WalkedEmitters:
    """The emitters of a Mitsuba scene that walks meet; their samples choose an emitter mostly by its power.

    Parameters
    ----------
    world
        The scene.
    numbers
        The numbers of the emitters in the scene, at least one.
    power
        The power of each.
    sharp
        Emitters whose caustics are left to photons and beams.
    portal
        The portal before the scene's environment, or None.
    """

    def __init__(
        self, world: SceneWorld, numbers: Sequence[int], power: Sequence[float], sharp: Collection[int] = (),
        portal: EnvironmentPortal | None = None,
    ) -> None:  # fmt: skip
        emitters = world.plugin.emitters()
        known = [int(UInt32(dr.reinterpret_array(mi.UInt32, mi.EmitterPtr(each)))[0]) for each in emitters]
        part = np.asarray(power) / sum(power) if sum(power) > 0 else np.zeros(len(numbers))
        part = _EVENLY / len(numbers) + (1 - _EVENLY) * part
        part /= part.sum()
        table = np.zeros(max(known) + 2, dtype=np.float32)
        table[[known[each] for each in numbers]] = part
        self.world, self._table, self._sharp = world, to_float(table), None
        self._size = len(numbers)
        self._portal = portal
        if sharp:
            caustics = np.zeros(len(table), dtype=np.uint32)
            caustics[[known[each] for each in sharp]] = 1
            self._sharp = to_uint(caustics)
        places = to_uint(padded(numbers))
        self._own = dr.gather(mi.EmitterPtr, world.plugin.emitters_dr(), places)
        self._choice = mi.DiscreteDistribution(mi.Float(to_float([*part, 0.0])))
        self._visible = any(not mi.has_flag(emitters[each].flags(), mi.EmitterFlags.Delta) for each in numbers)

    def __len__(self) -> int:
        """Return how many emitters there are."""
        return self._size

    def sample(self, reference: Any, which: Float, aim: Any, active: Bool) -> tuple[Any, Array3f]:
        """Return a sample of one of the emitters from a point, and its radiance over the density."""
        index, probability = self._choice.sample_pmf(which, active)
        emitter = dr.gather(mi.EmitterPtr, self._own, index, active)
        light, radiance = emitter.sample_direction(reference, mi.Point2f(aim), active)
        light.pdf *= probability
        brought = rgb(radiance) * dr.rcp(dr.maximum(probability, 1e-30))
        if self._portal is None:
            return light, brought
        return self._portal.sampled(Array3f(reference.p), light, brought, aim, probability)

    def met(self, hit: Any, place: Array3f, ideal: Bool, active: Bool) -> tuple[Array3f, Float]:
        """Return the radiance of these emitters where rays meet them, and the density with which `sample` chooses it.

        `ideal` says which rays come from mirrors or glass.
        """
        if not self._visible:
            return dr.zeros(Array3f, dr.width(place)), dr.zeros(Float, dr.width(place))
        emitter: Any = hit.emitter(self.world.plugin, active)
        numbers: Any = dr.reinterpret_array(UInt32, emitter)
        probability = dr.gather(Float, self._table, numbers, active)
        own = active & (probability > 0)
        if self._sharp is not None:
            own &= ~(ideal & (dr.gather(UInt32, self._sharp, numbers, active) > 0))
        reference = _interaction(place, Array3f(0))
        light = mi.DirectionSample3f(self.world.plugin, hit, reference)
        pdf = emitter.pdf_direction(reference, light, own) * probability
        if self._portal is not None:
            pdf = self._portal.density(emitter, place, Array3f(light.d), pdf, probability)
        return dr.select(own, rgb(emitter.eval(hit, own)), 0), dr.select(own, pdf, 0)


@dataclass(frozen=True)
class Walking:
    """How walks are followed: the emitters that they meet, and depths as in `CameraTracing`."""

    emitters: WalkedEmitters
    max_depth: int | None
    rr_depth: int

    def add(
        self, paths: CameraPaths, vertex: CameraVertex, samples: Samples, scattered: Array3f, reflected: Array3f
    ) -> None:
        """Add the radiance of walks from one step of camera paths, to `scattered` from media, else to `reflected`."""
        for target, walks in zip((scattered, reflected), self._begun(paths, vertex), strict=True):
            if walks is not None:
                found = self.radiance(walks, samples)
                found = dr.select(dr.isfinite(dr.sum(found)), found, 0)
                dr.eval(found)
                add_to_pixels(target, found, walks.pixel, walks.branch)

    def _begun(self, paths: CameraPaths, vertex: CameraVertex) -> tuple[Walk | None, Walk | None]:
        """Return the walks of a step of camera paths, those in media and those from surfaces; None if there are none.

        Walks begin at surfaces only if these are shaded.
        """
        media, zeros = self.emitters.world.media, dr.zeros(Float, dr.width(paths.pixel))
        inside = paths.alive & (dr.max(media.scattering(paths.medium)) > 0) & (vertex.end > paths.near)
        inside &= self.within(paths.depth, 2)
        start = paths.origin + paths.near * paths.direction
        scattered = Walk(
            start, paths.direction, paths.medium, inside, dr.minimum(vertex.end, ENDLESS) - paths.near,
            paths.throughput, zeros, paths.depth, inside, start, zeros, paths.order, paths.pixel,
            paths.branch, vertex.name,
        )  # fmt: skip
        beginning = next(iter(compressed(inside, scattered)), None)
        if vertex.bounce is None:
            return beginning, None
        bounce = vertex.bounce
        going = (dr.max(bounce.throughput) > 0) & self.within(paths.depth, 3)
        reflected = Walk(
            bounce.origin, bounce.direction, bounce.medium, ~going, zeros, bounce.throughput,
            dr.max(bounce.throughput), paths.depth + 1, ~going, bounce.origin, zeros, paths.order, paths.pixel,
            paths.branch, vertex.name,
        )  # fmt: skip
        return beginning, next(iter(compressed(going, reflected)), None)

    def within(self, depth: UInt32, more: int) -> Any:
        """Return whether paths that were scattered `depth` times, with `more` edges, are not too long."""
        return Bool(True) if self.max_depth is None else depth + more <= dr.opaque(UInt32, self.max_depth)

    def radiance(self, walks: Walk, samples: Samples) -> Array3f:
        """Return the radiance that each walk brings."""

        def further(walk: Walk, going: Bool, number: UInt32, found: Array3f) -> tuple[Any, ...]:
            brought, following, goes = self._step(walk, going, samples, (walk.name, number))
            return following, goes, number + 1, found + brought

        width = dr.width(walks.order)
        state = (walks, dr.full(Bool, True, width), dr.zeros(UInt32, width), dr.zeros(Array3f, width))
        return dr.while_loop(
            state, lambda walk, going, number, found: going & (number < _STEPS), further, label="walks"
        )[3]

    def _step(self, walk: Walk, going: Bool, samples: Samples, name: tuple[Any, ...]) -> tuple[Array3f, Walk, Bool]:
        world = self.emitters.world
        ray = mi.Ray3f(mi.Point3f(walk.origin), mi.Vector3f(walk.direction))
        hit = world.plugin.ray_intersect(ray, going & ~walk.first)
        beyond = dr.select(hit.is_valid(), hit.t, dr.largest(Float))
        flown = self._flown(walk, dr.select(walk.first, walk.length, beyond), going, samples, name)
        distance, weight, scattered, tinted = flown
        throughput = walk.throughput * weight
        on = going & ~walk.first & ~scattered & ~tinted
        found, density = self.emitters.met(
            hit, walk.place, walk.pdf <= 0, on & walk.counts & self.within(walk.depth, 1)
        )
        share = dr.select(walk.pdf > 0, power_heuristic(walk.pdf, density), 1)
        result: Any = dr.select(dr.max(found) > 0, throughput * found * share, 0)
        vertex = _Vertex(walk, hit, walk.origin + distance * walk.direction, scattered, on & hit.is_valid())
        result += throughput * self._direct(vertex, samples, name)
        following, weight, goes = self._onward(vertex, samples, name)
        following.throughput = throughput * weight
        # After a null collision, which only changes the colour, a walk continues straight.
        for each, same in {"direction": walk.direction, "depth": walk.depth, "counts": walk.counts, "pdf": walk.pdf,
                           "place": walk.place, "first": walk.first, "medium": walk.medium,
                           "throughput": throughput}.items():  # fmt: skip
            setattr(following, each, dr.select(tinted, same, getattr(following, each)))
        following.origin = dr.select(tinted, vertex.position, following.origin)
        following.length = walk.length - distance
        for each in ("order", "pixel", "branch", "name"):
            setattr(following, each, getattr(walk, each))
        following.initial = dr.select(walk.first & scattered, dr.max(throughput), walk.initial)
        goes = (going & tinted) | goes
        return result, following, self._roulette(following, goes, samples, name)

    def _flown(
        self, walk: Walk, length: Float, going: Bool, samples: Samples, name: tuple[Any, ...]
    ) -> tuple[Any, ...]:
        """Return free flights: their distances and weights, and whether they end with scattering or a tint alone."""
        media = self.emitters.world.media
        fractions = walk.throughput * dr.rcp(dr.maximum(dr.sum(walk.throughput), 1e-30))
        varying, colored = media.varying(walk.medium)
        branch = dr.select(walk.first & ~varying, UInt32(SCATTERED), UInt32(SAMPLED))
        u = samples.pair(walk.order, Stream.PATH_FLIGHT, *name)
        distance, weight = flight(media, walk.medium, branch, fractions, length, u)
        scattered, tinted = going & (distance < length), Bool(False)
        if media.any_varying:
            varying &= going
            other, collided, scatters, color = free_flight(
                pointers(dr.select(varying, walk.medium, 0)), walk.origin, walk.direction, length, fractions,
                samples.bits(walk.order, Stream.PATH_FLIGHT, *name), varying, colored,
            )  # fmt: skip
            distance, weight = dr.select(varying, other, distance), dr.select(varying, color, weight)
            scattered, tinted = dr.select(varying, scatters, scattered), varying & collided & ~scatters
        return dr.minimum(distance, length), weight, scattered, tinted

    def _direct(self, vertex: _Vertex, samples: Samples, name: tuple[Any, ...]) -> Array3f:
        """Return the light of one sample of the emitters that vertices scatter along the path, over its density."""
        walk, hit, world = vertex.walk, vertex.hit, self.emitters.world
        smooth = vertex.on_surface & mi.has_flag(hit.bsdf().flags(), mi.BSDFFlags.Smooth)
        active = (vertex.scattered | smooth) & self.within(walk.depth, 2)
        order = walk.order
        reference = _interaction(vertex.position, dr.select(smooth, Array3f(hit.n), 0))
        which, aim = (
            samples.single(order, Stream.PATH_WHICH_EMITTER, *name),
            samples.pair(order, Stream.PATH_EMITTER, *name),
        )
        light, radiance = self.emitters.sample(reference, which, aim, active)
        lit = active & (light.pdf > 0)
        phase = vertex.phase()
        value, pdf = phase.eval_pdf(mi.PhaseFunctionContext(), vertex.place(), light.d, lit & vertex.scattered)
        reflected, density = hit.bsdf().eval_pdf(mi.BSDFContext(), hit, hit.to_local(light.d), lit & smooth)
        value = dr.select(vertex.scattered, rgb(value), rgb(reflected))
        pdf = dr.select(vertex.scattered, pdf, density)
        value = value * radiance * dr.select(light.delta, 1, power_heuristic(light.pdf, pdf))
        lit &= (dr.max(value) > 0) & dr.isfinite(dr.sum(value))
        entered = world.media.beyond(hit, light.d, walk.medium, lit & smooth)
        medium = dr.select(vertex.scattered, walk.medium, entered)
        seed = samples.bits(order, Stream.PATH_SHADOW, *name)
        ray = to_point(reference, Array3f(light.p), world.size).ray()
        passed, _ = through(world.plugin, world.media, ray, medium, seed, lit, coarse=True, size=world.size)
        return dr.select(lit, value * passed, 0)

    def _onward(self, vertex: _Vertex, samples: Samples, name: tuple[Any, ...]) -> tuple[Walk, Array3f, Bool]:
        """Return the walks after their vertices, the weights of their new directions, and which walks continue."""
        walk, hit, media = vertex.walk, vertex.hit, self.emitters.world.media
        lobe, turn = (
            samples.single(walk.order, Stream.PATH_LOBE, *name),
            mi.Point2f(samples.pair(walk.order, Stream.PATH_TURN, *name)),
        )
        turned, own, pdf = vertex.phase().sample(
            mi.PhaseFunctionContext(), vertex.place(), lobe, turn, vertex.scattered
        )
        sample, weight = hit.bsdf().sample(mi.BSDFContext(), hit, lobe, turn, vertex.on_surface)
        kind, direction = sample.sampled_type, hit.to_world(sample.wo)
        null = vertex.on_surface & mi.has_flag(kind, mi.BSDFFlags.Null)
        ideal = vertex.on_surface & mi.has_flag(kind, mi.BSDFFlags.Delta)
        following = Walk()
        following.direction = Array3f(dr.select(vertex.scattered, turned, direction))
        origin = leaving(hit, direction, self.emitters.world.size)
        following.origin = dr.select(vertex.on_surface, origin, vertex.position)
        following.medium = dr.select(
            vertex.on_surface, media.beyond(hit, direction, walk.medium, vertex.on_surface), walk.medium
        )
        following.first = Bool(False)
        following.depth = walk.depth + dr.select(null, 0, 1)
        following.counts = walk.counts | ~null
        following.place = dr.select(null, walk.place, vertex.position)
        following.pdf = dr.select(null, walk.pdf, dr.select(ideal, 0, dr.select(vertex.scattered, pdf, sample.pdf)))
        factor: Any = dr.select(vertex.scattered, rgb(own), rgb(weight))
        good = vertex.scattered | (vertex.on_surface & (sample.pdf > 0))
        good &= dr.isfinite(dr.sum(factor)) & self.within(following.depth, 1)
        return following, dr.select(good, factor, 0), good

    def _roulette(self, walk: Walk, going: Bool, samples: Samples, name: tuple[Any, ...]) -> Bool:
        """Return which walks continue, by Russian roulette; their throughput makes up for the walks that end."""
        most = dr.max(walk.throughput)
        surviving: Any = survival(most * dr.rcp(dr.maximum(walk.initial, 1e-30)), walk.depth)
        tried = going & (walk.depth >= dr.opaque(UInt32, self.rr_depth))
        survives = samples.single(walk.order, Stream.PATH_ROULETTE, *name) < surviving
        walk.throughput = walk.throughput * dr.select(tried, dr.rcp(dr.maximum(surviving, 1e-30)), 1)
        return going & (most > 0) & (~tried | survives)


class _Vertex:
    """The vertices of a step: scattered in a medium, or on a surface."""

    def __init__(self, walk: Walk, hit: Any, position: Array3f, scattered: Bool, on_surface: Bool) -> None:
        self.walk, self.hit, self.scattered, self.on_surface = walk, hit, scattered, on_surface
        self.position = dr.select(on_surface, Array3f(hit.p), position)

    def phase(self) -> Any:
        """Return pointers to the phase functions of the media in which light is scattered."""
        return pointers(dr.select(self.scattered, self.walk.medium, 0)).phase_function()

    def place(self) -> Any:
        """Return Mitsuba's interactions with media."""
        result = dr.zeros(mi.MediumInteraction3f, dr.width(self.walk.order))
        result.p, result.wi = mi.Point3f(self.position), mi.Vector3f(-self.walk.direction)
        result.sh_frame = mi.Frame3f(result.wi)
        result.medium = pointers(dr.select(self.scattered, self.walk.medium, 0))
        return result


def _interaction(place: Array3f, normal: Array3f) -> Any:
    result = dr.zeros(mi.Interaction3f, dr.width(place))
    result.p, result.n = mi.Point3f(place), mi.Normal3f(normal)
    return result
