"""The surfaces and media that light paths and camera paths meet, of a stage or of a Mitsuba scene."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from ..numerics.hashing import hash32, unit_float
from ..runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from ..scene import DrawnBeams
from .bounds import Bounds, Box
from .emitters.emitter import Emitter, Links
from .emitters.rays import EmittedRays
from .emitters.sources import Source
from .media.media import Media
from .media.parts import parts
from .media.rendered import RenderedMedium
from .shadow_rays import rounding, size_of
from .surfaces.normal_maps import NormalMap

if TYPE_CHECKING:
    from ..runtime.mitsuba_types import EmitterPtr, MiBsdf, MiScene, SurfaceInteraction

mi = mitsuba()

_LAYERS = 32  # most cut-out surfaces that a ray may pass


class World:
    """The surfaces and media that rays meet.

    Attributes
    ----------
    plugin
        The Mitsuba scene of surfaces and of the media's boundaries (Embree on the CPU, OptiX on a GPU).
    media
        Its media.
    radius, bounds
        Radius of a sphere around everything, and that sphere.
    extent
        Radius of a region that has all surfaces, finite lamps and cameras, if any medium is endless; else as `radius`.
    endless
        Length at which light in endless media no longer matters (`bounds.endless_length`); 0 if `escape` is as long.
    emitters
        The emitters.
    sources
        What the beams of each emitter have in common, by the emitters' numbers.
    cutouts
        Whether cut-out surfaces stop rays with the probability of their opacity: `intersect` then skips those that do
        not. If not, they are ordinary surfaces, whose BSDFs have null lobes.
    perturbed, translucent
        Whether BSDFs may perturb the normal (bump and normal maps), and whether any has diffuse or glossy transmission.
    mirrors
        Whether there are mirrors or glass.
    narrows
        Whether beams straight from a lamp are narrowed where a surface blocks their rim.
    boxes
        Boxes around media, by number, beside which light straight from lamps makes beams: see `transport.fringes`.
    reentrant
        Numbers of the media that a line may leave and enter again.
    lit_by_domes
        Numbers of the media that domes light without beams.
    sizes
        Radius of each medium, by number; a medium without an entry has the world's.
    numbers
        Numbers of the media by name, which may be others at another time; media without a name have none.
    drawn
        Beams that no lamp makes.
    lamps, domes, mesh_lamps
        Lights that are no part of `plugin`: packed by kind; and environments and mesh lights, each with its links.
    sky
        Environments that light media without beams, with their lamps and their links.
    glowing, emits
        Whether any surfaces shine, to both sides; and whether the emitters are those of `plugin`.
    surfaces, boundaries
        The Mitsuba scene of the surfaces, and the shapes of the media's boundaries, if they are known apart.
    connects
        Whether `blocked`, `clear`, `solid`, `medium_at` and `dimming` answer for straight lines to lamps.
    host
        The Mitsuba scene that the scenes of portals share on CUDA: see `shapes.scene_of`.
    """

    plugin: Any
    media: Media
    radius: float
    bounds: Bounds
    extent: float
    endless: float
    emitters: Sequence[Emitter]
    sources: Sequence[Source]
    cutouts: bool
    perturbed: bool
    boxes: Mapping[int, Box]
    reentrant: Collection[int]
    translucent: bool
    mirrors: bool
    narrows: bool
    lit_by_domes: Collection[int] = ()
    sizes: Mapping[int, float]
    numbers: Mapping[str, int] = {}
    drawn: Sequence[DrawnBeams] = ()
    lamps: Sequence[Any] = ()
    domes: Sequence[Any] = ()
    mesh_lamps: Sequence[Any] = ()
    sky: Sequence[Any] = ()
    glowing: bool
    emits = False
    connects = False
    boundaries: Sequence[Any]
    surfaces: Any
    host: Any

    @cached_property
    def size(self) -> Float:
        """Diameter of the surfaces and boundaries, for rays that leave them: see `shadow_rays`."""
        return size_of(self.plugin)

    @property
    def hazy(self) -> bool:
        """Whether any medium scatters light."""
        return any(max(each.medium.scattering) > 0 for each in self.media.all)

    @property
    def sharp(self) -> bool:
        """Whether camera paths may continue somewhere: at a boundary of media, a mirror or glass."""
        return True

    def feeling_all(self) -> World:
        """Return the world in which light feels all of its media, beams-only ones, too."""
        return self

    def without_surfaces(self) -> World:
        """Return the world with its media alone."""
        raise NotImplementedError

    def blocking_scenes(self) -> Sequence[MiScene]:
        """Return the Mitsuba scenes that block light instead of `plugin`, by link number minus 1."""
        return ()

    def entered(self, number: int, rays: EmittedRays, bounds: Bounds, through: bool) -> EmittedRays:
        """Return rays of an emitter as they begin in the world, with `reach` and `medium`.

        `bounds` is the sphere which light from infinity enters, and `through` says whether the rays were sampled on a
        portal, rather than on the emitter.
        """
        raise NotImplementedError

    def short_of_fog(self, emitters: Iterable[int]) -> list[int]:
        """Return those emitters at infinity whose beams, which begin around shapes, do not reach all endless fog."""
        return []

    def radius_of(self, medium: RenderedMedium) -> float:
        """Return the radius of a medium, at most that of the region with everything in it."""
        return min(self.sizes.get(medium.number, np.inf), self.extent)

    def medium_at(self, origin: Array3f, direction: Array3f, active: Bool) -> UInt32:
        """Return the numbers of the media at points, found by rays along `direction`."""
        raise NotImplementedError

    def solid(
        self, origin: Array3f, direction: Array3f, active: Bool, seed: UInt32, link: UInt32 | None = None
    ) -> SurfaceInteraction:
        """Return the first surface that rays hit, as a SurfaceInteraction3f; boundaries of media do not count."""
        raise NotImplementedError

    def blocked(
        self, origin: Array3f, direction: Array3f, distance: Float, active: Bool, seed: UInt32,
        link: UInt32 | None = None,
    ) -> Bool:  # fmt: skip
        """Return which rays hit a surface before `distance`."""
        raise NotImplementedError

    def clear(
        self, origin: Array3f, direction: Array3f, distance: Float, active: Bool, seed: UInt32, link: UInt32
    ) -> Float:
        """Return how far rays are clear: the distances at which they hit a surface before `distance`, else infinity."""
        raise NotImplementedError

    def stopping(self, links: Links) -> World:
        """Return the world with only the surfaces that block lights with these links."""
        return self

    def colors(self, emitter: EmitterPtr, point: Array3f, direction: Array3f, distance: Float) -> Array3f:
        """Return the colours of the images that light passes on its way from Mitsuba's emitters to points."""
        return Array3f(1)

    def dimming(
        self, origin: Array3f, direction: Array3f, distance: Float, medium: UInt32, seed: UInt32, active: Bool
    ) -> Array3f:
        """Return the transmittance, as surfaces feel it, along rays that begin in a medium and meet no surface."""
        raise NotImplementedError

    def escape(self, origin: Array3f, direction: Array3f) -> Float:
        """Return the lengths of light paths that meet nothing."""
        raise NotImplementedError

    def medium_of_view(self, origin: Array3f, direction: Array3f) -> UInt32:
        """Return the numbers of the media in which camera rays begin."""
        raise NotImplementedError

    def shading_normal(self, hit: SurfaceInteraction, active: Bool) -> Array3f:
        """Return the normals of surfaces in world space; on stages, normal and bump maps are applied."""
        if not any(isinstance(each, NormalMap) for each in parts(self.plugin, mi.BSDF)):
            return Array3f(hit.sh_frame.n)
        return Array3f(dr.dispatch(hit.bsdf(), _mapped_normal, hit, active))

    def seen(self, origin: Array3f, direction: Array3f, reach: Float, active: Bool, seed: UInt32) -> SurfaceInteraction:
        """Return the first surface, or boundary of a medium, that camera rays meet within `reach`."""
        hit = self.intersect(origin, direction, active, seed)
        hit.t = dr.select(hit.t < reach, hit.t, dr.inf)
        return hit

    def intersect(
        self, origin: Array3f, direction: Array3f, active: Bool, seed: UInt32, link: UInt32 | None = None
    ) -> SurfaceInteraction:
        """Return the first surface, or boundary of a medium, that rays meet, as a SurfaceInteraction3f.

        `seed` decides which cut-out surfaces a ray passes. `link` selects the surfaces that block light: see
        `blocking_scenes`.
        """
        return self._first(self.plugin, self.blocking_scenes(), origin, direction, active, seed, link)

    def _first(
        self, plugin: MiScene, others: Sequence[MiScene], origin: Array3f, direction: Array3f, active: Bool,
        seed: UInt32, link: UInt32 | None,
    ) -> SurfaceInteraction:  # fmt: skip
        first, *more = by_link(plugin, others, link)
        hit = self._met(first[0], origin, direction, active & first[1], seed)
        for each, own in more:
            hit = dr.select(own, self._met(each, origin, direction, active & own, seed), hit)
        return hit

    def _met(
        self, plugin: MiScene, origin: Array3f, direction: Array3f, active: Bool, seed: UInt32
    ) -> SurfaceInteraction:
        ray, skip = self._beyond_cutouts(plugin, origin, direction, active, seed)
        hit = plugin.ray_intersect(ray, active)
        if self.cutouts:
            hit.t += skip
        return hit

    def _beyond_cutouts(
        self, plugin: MiScene, origin: Array3f, direction: Array3f, active: Bool, seed: UInt32
    ) -> tuple[Any, Any]:
        """Return rays moved beyond the cut-out surfaces that they pass, and the distances by which they were moved."""
        skip = self._skipped(plugin, origin, direction, active, seed) if self.cutouts else 0
        return mi.Ray3f(mi.Point3f(origin + skip * direction), mi.Vector3f(direction)), skip

    def _skipped(self, plugin: Any, origin: Array3f, direction: Array3f, active: Bool, seed: UInt32) -> Float:
        """Return the distance to the last cut-out surface that rays pass; boundaries of media stop them."""
        origin, direction = dr.detach(Array3f(origin)), dr.detach(Array3f(direction))
        # More than the rounding error of a hit's place.
        extent = dr.max(dr.abs(origin))
        step = 1e-5 * extent

        def passing(skip: Float, layer: UInt32, going: Bool) -> tuple[Float, UInt32, Bool]:
            ray = mi.Ray3f(mi.Point3f(origin + skip * direction), mi.Vector3f(direction))
            hit = plugin.ray_intersect(ray, going)
            clear = dr.mean(hit.bsdf().eval_null_transmission(hit, going))
            passes = hit.is_valid() & ~hit.is_medium_transition() & (unit_float(hash32(seed, layer)) < clear)
            going = going & passes
            # No further than the next leaf, in small scenes and far from the origin.
            most = dr.maximum(mi.math.RayEpsilon * self.size, rounding(hit.t + extent))
            usual = 1e-5 * hit.t + step <= most
            beyond = dr.select(usual, skip + hit.t * (1 + 1e-5) + step, skip + hit.t + most)
            return dr.select(going, beyond, skip), layer + 1, going

        state = (0 * origin.x + 0 * direction.x, dr.zeros(UInt32, dr.width(origin)), Bool(active))
        skip, _, _ = dr.while_loop(state, lambda _, layer, going: going & (layer < _LAYERS), passing, label="cutouts")
        return skip

    def opacity(self, hit: Any, active: Bool) -> Float:
        """Return the opacity of the cut-out surfaces that stopped rays, above 0; 1 for other surfaces."""
        if not self.cutouts:
            return Float(1)
        return dr.maximum(1 - dr.mean(hit.bsdf().eval_null_transmission(hit, active)), 1e-6)


def _mapped_normal(bsdf: MiBsdf, hit: SurfaceInteraction, active: Bool) -> Any:
    """Return the normal of a BSDF in world space."""
    maps = [each for each in [bsdf, *parts(bsdf, mi.BSDF)] if isinstance(each, NormalMap)]
    return mi.Normal3f(hit.to_world(maps[0].normal(hit, active))) if maps else hit.sh_frame.n


def by_link(plugin: MiScene, others: Sequence[MiScene], link: UInt32 | None) -> list[tuple[Any, Bool]]:
    """Return Mitsuba scenes and which rays meet them: link 0 meets `plugin`, link 1 the first of the others."""
    if not others or link is None:
        return [(plugin, Bool(True))]
    linked = [(each, link == dr.opaque(UInt32, number)) for number, each in enumerate(others, 1)]
    return [(plugin, link == 0), *linked]


def perturbs(plugin: MiScene) -> bool:
    """Return whether a scene has BSDFs that perturb the normal."""
    return any(each.class_name() in ("NormalMap", "BumpMap") for each in parts(plugin, mi.BSDF))


def translucent(plugin: MiScene) -> bool:
    """Return whether a scene has surfaces with diffuse or glossy transmission."""
    return _has_lobes(plugin, mi.BSDFFlags.DiffuseTransmission, mi.BSDFFlags.GlossyTransmission)


def mirrors(plugin: MiScene) -> bool:
    """Return whether a scene has mirrors or glass: surfaces with an ideal lobe that turns light."""
    return _has_lobes(plugin, mi.BSDFFlags.DeltaReflection, mi.BSDFFlags.DeltaTransmission)


def _has_lobes(plugin: MiScene, *kinds: int) -> bool:
    flags = [int(each.flags()) for each in parts(plugin, mi.BSDF)]
    return any(mi.has_flag(each, kind) for each in flags for kind in kinds)
