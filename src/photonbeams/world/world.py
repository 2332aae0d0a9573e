"""The world that light paths and camera paths meet: surfaces, media and emitters, of a stage or of a Mitsuba scene.

`described.world_of_scene` builds the world of a stage, or of a scene that is built in Python, and
`plugin.world_of_plugin` that of a Mitsuba scene. Nothing asks afterwards which it was.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from ..numerics.arrays import opaque
from ..runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ..scene import ESCAPE, DrawnBeams
from ..scene.places import ZERO, Point
from .bounds import Bounds, Box
from .emitters.emitter import Emitter, Links
from .emitters.filters import PathFilters
from .emitters.groups import LightGroups
from .emitters.linking import Linking
from .emitters.packed import PackedLamps
from .emitters.rays import EmittedRays
from .emitters.sources import Source
from .media.interfaces import is_boundary, medium_at, transmits
from .media.media import Media
from .media.parts import parts
from .media.rendered import RenderedMedium
from .media.visibility import through
from .shadow_rays import ShadowRay, gap_at, gap_before, size_of
from .surfaces.normal_maps import NormalMap
from .surfaces.rays import RayScenes, opacity
from .surfaces.shapes import scene_of

if TYPE_CHECKING:
    from ..runtime.mitsuba_types import EmitterPtr, MiBsdf, MiScene, MiShape, SurfaceInteraction
    from .media.discovery.surroundings import Surroundings

mi = mitsuba()


@dataclass(frozen=True, eq=False)
class World:
    """The surfaces, media and emitters that rays meet, at one time.

    Attributes
    ----------
    plugin, surfaces, around
        Mitsuba scenes (Embree on the CPU, OptiX on a GPU): of the surfaces and of the media's boundaries; of the
        surfaces alone, if they are `apart`; and of boundaries that light passes, and of bodies of glass in media as
        boundaries of empty space. They are built early, because their first use may be in a kernel's loop.
    host
        The Mitsuba scene whose shader binding table all others share on CUDA: see `shapes.scene_of`.
    media
        The media.
    emitters, sources
        The emitters; and what the beams of each have in common, by the numbers of sources.
    bounds, radius
        A sphere around everything, and its radius.
    extent
        Radius of a region that has all surfaces, finite lamps and cameras, if any medium is endless; else as `radius`.
    endless
        Length at which light in endless media no longer matters (`bounds.endless_length`); 0 if `escape` is as long.
    parts
        What its builder keeps to build the world of another time.
    emits
        Whether the emitters are those of `plugin`.
    surroundings
        What tells the media in which paths begin; None: rays find them, by `medium_at`.
    nested, touching
        Whether any media have boundaries, and whether a boundary coincides with a surface somewhere.
    fog_beyond, reach_from_infinity
        Whether endless fog goes on outside of the bounds where a camera or a lamp is; and how far light from infinity
        goes on, in radii of the bounds.
    cutouts
        Whether there are surfaces through which light goes straight, and cut-out ones among them stop rays with the
        probability of their opacity: `intersect` then skips those that do not. If not, they are ordinary surfaces,
        whose BSDFs have null lobes.
    perturbed, translucent
        Whether BSDFs may perturb the normal (bump and normal maps), and whether any has diffuse or glossy transmission.
    mirrors, glowing
        Whether there are mirrors or glass, and whether surfaces shine without being emitters, to both sides.
    boundaries, shapes
        Mitsuba's shapes of the media's boundaries, or that light passes; and of the surfaces. A shape may be several
        meshes that lights treat alike, and has the name of the first.
    blockers
        For lights with shadow links: Mitsuba scenes without some of the surfaces, by the names of these.
    boxes
        Boxes around media, by number; a medium without an entry is as large as the world.
    reentrant
        Numbers of the media that a line may leave and enter again.
    numbers
        Numbers of the media by name, which may be others at another time; media without a name have none.
    drawn
        Beams that no lamp makes.
    glow
        The light groups of surfaces that glow, by their names in `shapes`; others belong to the unnamed group.
    zero
        Where the user's coordinates begin: see `scene.places`.
    shown
        The world that camera rays meet before they are reflected or refracted; None: this one.
    holdouts
        A Mitsuba scene of the surfaces in whose place these rays show black; None: there are none.
    """

    plugin: Any
    surfaces: Any
    around: Any
    host: Any
    media: Media
    emitters: Sequence[Emitter]
    sources: Sequence[Source]
    bounds: Bounds
    radius: float
    extent: float
    endless: float
    parts: Any = None
    emits: bool = False
    surroundings: Surroundings | None = None
    nested: bool = False
    touching: bool = False
    fog_beyond: bool = False
    reach_from_infinity: float = 1.0
    cutouts: bool = False
    perturbed: bool = False
    translucent: bool = False
    mirrors: bool = False
    glowing: bool = False
    boundaries: Sequence[Any] = ()
    shapes: Sequence[tuple[str, MiShape]] = ()
    blockers: Mapping[frozenset[str], Any] = field(default_factory=dict)
    boxes: Mapping[int, Box] = field(default_factory=dict)
    reentrant: Collection[int] = frozenset()
    numbers: Mapping[str, int] = field(default_factory=dict)
    drawn: Sequence[DrawnBeams] = ()
    glow: Mapping[str, str] = field(default_factory=dict)
    zero: Point = ZERO
    shown: World | None = None
    holdouts: Any = None

    @cached_property
    def size(self) -> Float:
        """Diameter of the surfaces and boundaries, for rays that leave them: see `shadow_rays`."""
        return size_of(self.plugin)

    @cached_property
    def groups(self) -> LightGroups:
        """The light groups that shine on surfaces."""
        return LightGroups(self.emitters, self.sources, self.glow.values(), self.glowing or self.media.emissive)

    @cached_property
    def linking(self) -> Linking:
        """What lights, and their filters, leave out."""
        return Linking(self)

    @cached_property
    def lamps(self) -> PackedLamps:
        """The lamps that are no part of `plugin`, as kernels need them."""
        return PackedLamps(self.emitters)

    @cached_property
    def filters(self) -> PathFilters | None:
        """The filters of the lamps, as light paths meet them; None if there are none."""
        chains = [each.filters for each in self.sources]
        return PathFilters(chains) if any(each is not None for each in chains) else None

    @property
    def apart(self) -> bool:
        """Whether surfaces and boundaries are known apart, so that `solids` tests straight lines, as narrowing does."""
        return not self.emits

    @property
    def hazy(self) -> bool:
        """Whether any medium scatters light."""
        return any(max(each.medium.scattering) > 0 for each in self.media.all)

    @property
    def sharp(self) -> bool:
        """Whether camera paths may continue somewhere: at a boundary of media, a mirror or glass."""
        return self.mirrors or bool(self.boundaries)

    @property
    def fringed(self) -> Mapping[int, Box]:
        """Boxes around media beside which light straight from lamps makes beams: see `transport.fringes`."""
        return self.boxes if self.apart else {}

    def radius_of(self, medium: RenderedMedium) -> float:
        """Return the radius of a medium, at most that of the region with everything in it."""
        low, high = self.boxes.get(medium.number, (np.zeros(3), np.full(3, np.inf)))
        return min(0.5 * float(np.linalg.norm(high - low)), self.extent)

    def short_of_fog(self, emitters: Iterable[int]) -> list[int]:
        """Return those emitters at infinity whose beams, which begin around shapes, do not reach all endless fog."""
        return [each for each in emitters if self.fog_beyond and self.emitters[each].lamp.infinite]

    def veiled(
        self, emitter: EmitterPtr, place: Array3f, direction: Array3f, distance: Float
    ) -> tuple[Bool, Float]:  # fmt: skip
        """Return which of Mitsuba's emitters light places from infinity through endless fog, and how far it dims them.

        Their light begins in planes that touch the bounds, as that of beams does, and rays to infinity do not meet it.
        Places outside of the bounds have none: an infinite distance. Where the scene itself goes on beyond the bounds,
        their light begins at Mitsuba's `distance`.
        """
        if not any(each.number not in self.boxes and each.tracked is None for each in self.media.all):
            return Bool(False), distance
        inside = dr.maximum(self.bounds.behind(place, -direction), 0)
        over: Any = distance if self.fog_beyond else dr.select(self.bounds.holds(place), inside, dr.inf)
        veiled = mi.has_flag(emitter.flags(), mi.EmitterFlags.Infinite)
        return veiled, dr.select(veiled, over, distance)

    def feeling_all(self) -> World:
        """Return the world in which light feels all of its media, beams-only ones, too."""
        media = self.media.all_felt()
        return self if media is self.media else replace(self, media=media)

    @cached_property
    def uncut(self) -> World:
        """The world in which cut-out surfaces stop all rays: another one, since a cycle would keep scenes in memory."""
        return replace(self, cutouts=False)

    def without_surfaces(self) -> World:
        """Return the world with its media alone."""
        return replace(
            self, plugin=self.around, touching=False, cutouts=False, mirrors=False, shown=None, holdouts=None
        )

    def stopping(self, links: Links) -> World:
        """Return the world with only the surfaces that block lights with these links; the world itself if all do."""
        return replace(self, surfaces=self.blockers[links.unshadowed]) if links.unshadowed else self

    @cached_property
    def _unshadowing(self) -> list[frozenset[str]]:
        """The names of the surfaces that do not block lights, by link number minus 1."""
        return sorted(self.blockers, key=sorted)

    @cached_property
    def solids(self) -> RayScenes:
        """The surfaces alone, without the boundaries of media, as rays meet them."""
        others = [self.blockers[names] for names in self._unshadowing]
        return RayScenes(self.surfaces, others, self.cutouts, self.size)

    @cached_property
    def everything(self) -> RayScenes:
        """The surfaces and boundaries, as rays meet them."""
        if not self.boundaries or not self.blockers:
            return replace(self.solids, plugin=self.plugin)
        rest = ([shape for name, shape in self.shapes if name not in names] for names in self._unshadowing)
        return RayScenes(
            self.plugin, [scene_of([*each, *self.boundaries], self.host) for each in rest], self.cutouts, self.size
        )

    def intersect(
        self, origin: Array3f, direction: Array3f, active: Bool, seed: UInt32, link: UInt32 | None = None
    ) -> SurfaceInteraction:
        """Return the first surface, or boundary of a medium, that rays meet, as a SurfaceInteraction3f.

        `seed` and `link` are those of `RayScenes`. Where an opaque surface and a boundary coincide, rays meet the
        surface.
        """
        hit = self.everything.first(origin, direction, active, seed, link)
        if not self.touching:
            return hit
        on_boundary = active & is_boundary(hit)
        solid = self.solids.first(origin, direction, on_boundary, seed, link)
        behind = (solid.t - hit.t) * dr.abs(dr.dot(Array3f(hit.n), direction))
        met = on_boundary & solid.is_valid() & ~transmits(solid) & (behind <= gap_at(Array3f(hit.p), self.size))
        return dr.select(met, solid, hit)

    def seen(
        self, origin: Array3f, direction: Array3f, reach: Float, active: Bool, seed: UInt32, straight: Bool
    ) -> SurfaceInteraction:
        """Return the first surface, or boundary of a medium, that camera rays meet within `reach`.

        `straight` are the rays that nothing has reflected or refracted.
        """
        if self.shown is None:
            hit = self.intersect(origin, direction, active, seed)
        else:
            hit = self.intersect(origin, direction, active & ~straight, seed)
            hit = dr.select(straight, self.shown.intersect(origin, direction, active & straight, seed), hit)
        hit.t = dr.select(hit.t < reach, hit.t, dr.inf)
        return hit

    def held_out(self, hit: SurfaceInteraction, origin: Array3f, direction: Array3f, active: Bool) -> Bool:
        """Return which hits of camera rays are on holdouts."""
        if self.holdouts is None:
            return Bool(False)
        found = self.holdouts.ray_intersect(mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction)), active)
        return active & found.is_valid() & (dr.norm(found.p - hit.p) <= gap_at(Array3f(hit.p), self.size))

    def entered(self, number: int, rays: EmittedRays, bounds: Bounds, through: bool) -> EmittedRays:
        """Return rays of an emitter as they begin in the world, with `reach` and `medium`.

        `bounds` is the sphere which light from infinity enters, and `through` says whether the rays were sampled on a
        portal, rather than on the emitter.
        """
        rays.flux = dr.select(rays.valid, rays.flux, 0)
        active, lamp = dr.max(rays.flux) > 0, self.emitters[number].lamp
        if through and self.emits:  # they begin beyond the portal, which is a shape of the scene
            step = gap_at(rays.origin, self.size)
            rays.origin, rays.portal = rays.origin + step * rays.direction, rays.portal - step
        if lamp.flat:
            rays.origin = self._off_surfaces(number, rays.origin, active)
        reach = self._reach_from_infinity if lamp.infinite else self._reach
        rays.reach = bounds.exit(rays.origin, rays.direction, reach)
        rays.medium = (
            self.medium_at(rays.origin, rays.direction, active)
            if self.surroundings is None
            else self.surroundings.of_emitter(number, rays.origin, rays.direction)
        )
        return rays

    def _off_surfaces(self, number: int, origin: Array3f, active: Bool) -> Array3f:
        """Return origins of paths; those on a flat lamp in the plane of a surface begin before that surface."""
        emitter = self.emitters[number]
        gap, axis = gap_before(origin, self.size), emitter.lamp.bare.axis + 0 * origin.x
        seed = dr.arange(UInt32, dr.width(origin))
        link = dr.opaque(UInt32, emitter.link) + 0 * seed
        flush = self.solids.blocked(origin - gap * axis, axis, 2 * gap, active, seed, link)
        return dr.select(flush, origin + gap * axis, origin)

    @cached_property
    def _reach(self) -> Float:
        """How far light goes on, in radii of the bounds."""
        return opaque(ESCAPE * self.extent / self.radius)

    @cached_property
    def _reach_from_infinity(self) -> Float:
        return opaque(self.reach_from_infinity)

    def escape(self, origin: Array3f, direction: Array3f) -> Float:
        """Return the lengths of light paths that meet nothing."""
        return self.bounds.exit(origin, direction, self._reach)

    def medium_of_view(self, origin: Array3f, direction: Array3f) -> UInt32:
        """Return the numbers of the media in which camera rays begin."""
        if self.surroundings is None:
            return self.medium_at(origin, direction, Bool(True))
        return self.surroundings.of_sensor(origin, direction)

    def medium_at(self, origin: Array3f, direction: Array3f, active: Bool) -> UInt32:
        """Return the numbers of the media at points, found by rays along `direction`."""
        filling = dr.opaque(UInt32, self.media.filling)
        if not self.nested:
            return filling + dr.zeros(UInt32, max(dr.width(origin), dr.width(direction)))
        return medium_at(self.around, origin, direction, filling, filling, active, self.size)

    def dimming(
        self, origin: Array3f, direction: Array3f, distance: Float, medium: UInt32, seed: UInt32, active: Bool
    ) -> Array3f:
        """Return the transmittance, as surfaces feel it, along rays that begin in a medium and meet no surface."""
        if not self.media.all:
            return Array3f(1)
        if not self.nested:
            passed = self.media.transmittance(medium, origin, direction, distance, seed, active)
            return self.media.felt(medium, passed)
        ray = mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction))
        ray.maxt = dr.minimum(distance, dr.largest(Float))
        return through(self.around, self.media, ray, medium, seed, active, size=self.size)[0]

    def ahead(self, origin: Array3f, direction: Array3f, seed: UInt32, panes: bool = True) -> SurfaceInteraction:
        """Return the surfaces that end what is seen straight along rays, past boundaries of media and past `panes`."""
        every = dr.full(Bool, True, max(dr.width(origin), dr.width(direction)))
        if self.apart:
            solids = self.solids
            return (
                solids.behind_panes(origin, direction, every, seed)[0]
                if panes
                else solids.first(origin, direction, every, seed)
            )
        ray, medium = mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction)), self.medium_of_view(origin, direction)
        return through(self.plugin, self.media, ray, medium + 0 * seed, seed, every, size=self.size)[1]

    def unblocked(
        self, ray: ShadowRay, medium: UInt32, seed: UInt32, active: Bool, link: int = 0
    ) -> tuple[Bool, Array3f]:  # fmt: skip
        """Return which shadow rays no surface blocks, and the transmittance of the media along these."""
        distance = dr.minimum(ray.length, dr.largest(Float))
        if self.apart:
            links = dr.zeros(UInt32, dr.width(seed)) + dr.opaque(UInt32, link)
            free = ~self.solids.blocked(ray.origin, ray.direction, distance, active, seed, links)
            return free, self.dimming(ray.origin, ray.direction, distance, medium, seed, active)
        passed, _ = through(self.plugin, self.media, ray.ray(), medium, seed, active, size=self.size)
        free = dr.max(passed) > 0
        return free, dr.select(free, passed, 1)

    def shading_normal(self, hit: SurfaceInteraction, active: Bool) -> Array3f:
        """Return the normals of surfaces in world space; on stages, normal and bump maps are applied."""
        if not any(isinstance(each, NormalMap) for each in parts(self.plugin, mi.BSDF)):
            return Array3f(hit.sh_frame.n)
        return Array3f(dr.dispatch(hit.bsdf(), _mapped_normal, hit, active))

    def opacity(self, hit: Any, active: Bool) -> Float:
        """Return the opacity of the cut-out surfaces that stopped rays, above 0; 1 for other surfaces."""
        if not self.cutouts:
            return Float(1)
        return dr.maximum(opacity(hit, active), 1e-6)


def _mapped_normal(bsdf: MiBsdf, hit: SurfaceInteraction, active: Bool) -> Any:
    """Return the normal of a BSDF in world space."""
    maps = [each for each in [bsdf, *parts(bsdf, mi.BSDF)] if isinstance(each, NormalMap)]
    return mi.Normal3f(hit.to_world(maps[0].normal(hit, active))) if maps else hit.sh_frame.n


def perturbs(plugin: MiScene) -> bool:
    """Return whether a scene has BSDFs that perturb the normal."""
    return any(each.class_name() in ("NormalMap", "BumpMap") for each in parts(plugin, mi.BSDF))


def translucent(plugin: MiScene) -> bool:
    """Return whether a scene has surfaces with diffuse or glossy transmission."""
    return _has_lobes(plugin, mi.BSDFFlags.DiffuseTransmission, mi.BSDFFlags.GlossyTransmission)


def passes(bsdf: MiBsdf) -> bool:
    """Return whether some light passes straight through a surface."""
    return bool(mi.has_flag(int(bsdf.flags()), mi.BSDFFlags.Null))


def mirrors(plugin: MiScene) -> bool:
    """Return whether a scene has mirrors or glass: surfaces with an ideal lobe that turns light."""
    return _has_lobes(plugin, mi.BSDFFlags.DeltaReflection, mi.BSDFFlags.DeltaTransmission)


def _has_lobes(plugin: MiScene, *kinds: int) -> bool:
    flags = [int(each.flags()) for each in parts(plugin, mi.BSDF)]
    return any(mi.has_flag(each, kind) for each in flags for kind in kinds)
