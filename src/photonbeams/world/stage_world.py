"""The world of a stage: surfaces and boundaries of media as Mitsuba scenes, media, lights and portals.

Lights are not part of the Mitsuba scene: `world.emitters` sample and intersect them, so that beams and surfaces have
the same light. A glowing surface has an `area` emitter, which is evaluated where a ray hits it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np
import numpy.typing as npt

from .. import scene
from ..numerics.arrays import opaque, to_uint
from ..runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from .bounds import Bounds, Box, bounding_sphere, endless_length
from .emitters.build import KINDS, emitters_of
from .emitters.emitter import Emitter, Links
from .emitters.lamp import Lamp
from .emitters.portal_lamps import behind
from .emitters.rays import EmittedRays
from .emitters.sources import Source
from .emitters.stage_lamps import Lamps, LinkedSurfaces, shape_number
from .media.bounded import BoundedMedia, same, touching
from .media.interfaces import is_boundary, medium_at, transmits
from .media.media import Media
from .media.visibility import through
from .shadow_rays import gap_at, gap_before, size_of
from .surfaces.shapes import cut_out, glows, is_glass, is_mirror, scene_of, shapes_of
from .world import World, by_link, translucent

if TYPE_CHECKING:
    from ..runtime.mitsuba_types import MiScene, MiShape, SurfaceInteraction

mi = mitsuba()


@dataclass(frozen=True)
class StageWorld(World):
    """The world of a stage at one time.

    Attributes
    ----------
    description
        The scene from which it was built.
    host
        An empty Mitsuba scene, whose shader binding table all others share on CUDA.
    meshes, shapes, surfaces
        The surfaces, each as a Mitsuba shape, and the Mitsuba scene of all of them (Embree on the CPU, OptiX on a GPU).
    blockers
        For lights with shadow links: Mitsuba scenes without some of the surfaces, by the names of these.
    plugin
        The Mitsuba scene of the surfaces and of the media's boundaries.
    media, boundaries, boxes
        The media, the Mitsuba shapes of their boundaries, and the boxes around bounded media by number: two corners.
    around
        The Mitsuba scene of the boundaries alone, and of bodies of glass in media, as boundaries of empty space. It is
        built early, because its first use may be in a kernel's loop.
    glass, outside
        Closed meshes of glass, which are empty inside, and the Mitsuba media around them, by name.
    emitters
        The lights, in the order of `description.lights`.
    bounds, radius
        A sphere around everything, including the viewpoints.
    endless
        See `World`.
    touching
        Whether a boundary of a medium coincides with a surface somewhere.
    cutouts, glowing, translucent
        Whether any surface is cut out, whether any emits light, and whether any has diffuse or glossy transmission.
    mirrors, narrows, perturbed
        See `World`.
    """

    connects = True
    description: scene.Scene
    host: Any
    meshes: tuple[scene.Mesh, ...]
    shapes: tuple[Any, ...]
    surfaces: Any
    blockers: dict[frozenset[str], Any]
    plugin: Any
    media: Media
    boundaries: tuple[Any, ...]
    around: Any
    boxes: dict[int, Box]
    reentrant: frozenset[int]
    emitters: tuple[Emitter, ...]
    bounds: Bounds
    radius: float
    endless: float
    touching: bool
    cutouts: bool
    glowing: bool
    translucent: bool
    mirrors: bool = False
    narrows: bool = True
    perturbed: bool = False
    glass: tuple[scene.Mesh, ...] = ()
    outside: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def build(
        cls,
        description: scene.Scene,
        viewpoints: Sequence[npt.ArrayLike] = (),
        like: StageWorld | None = None,
        sharp: bool = False,
    ) -> StageWorld:
        """Build the world of a scene.

        Parameters
        ----------
        description
            The scene.
        viewpoints
            The camera's positions, which the bounds contain unless the scene gives its own bounds.
        like
            A world of the same shot at another time. Objects that are identical in both scenes are not built again.
        sharp
            Whether smooth metal is an ideal mirror and transparent materials are glass. Camera paths need more than two
            edges to show what these reflect and refract.

        Raises
        ------
        SceneError
            A portal has no area.
        """
        center, radius = description.bounds or bounding_sphere([description], viewpoints)
        hidden = {light.portal.name for light in description.lights if light.portal is not None}
        hidden |= {each.mesh.name for each in description.media if each.mesh is not None}
        meshes = tuple(mesh for mesh in description.meshes if mesh.name not in hidden and len(mesh.faces))
        materials = [mesh.material for mesh in meshes]
        still = like is not None and same(meshes, like.meshes)
        host = scene_of(()) if like is None else like.host
        glass = tuple(each for each in meshes if sharp and is_glass(each.material) and each.closed)
        content = BoundedMedia.of(description, host, like, glass)
        still = still and (not content.outside or (like is not None and content.media is like.media))
        shapes = like.shapes if like is not None and still else shapes_of(_solid(meshes, glass), sharp, content.outside)
        surfaces = like.surfaces if like is not None and still else scene_of(shapes, host)
        boundaries = content.boundaries
        kept = like is not None and still and boundaries is like.boundaries
        plugin = like.plugin if kept else scene_of([*shapes, *boundaries], host) if boundaries else surfaces  # type: ignore[union-attr]
        names = frozenset(mesh.name for mesh in meshes)
        emitters = emitters_of(description.lights, names, host, [plugin], () if like is None else like.emitters)
        return cls(
            description=description,
            host=host,
            meshes=meshes,
            shapes=shapes,
            surfaces=surfaces,
            plugin=plugin,
            endless=endless_length(radius, [each for each in content.media.all if each.number not in content.boxes]),
            media=content.media,
            boundaries=boundaries,
            around=content.around,
            boxes=content.boxes,
            reentrant=content.reentrant,
            glass=glass,
            outside=content.outside,
            blockers=_blockers(emitters, host, meshes, shapes, like.blockers if like is not None and still else {}),
            emitters=emitters,
            bounds=Bounds(center, radius),
            radius=radius,
            touching=like.touching  # type: ignore[union-attr]
            if kept
            else bool(shapes) and touching(description.media, surfaces, size_of(plugin)),
            cutouts=any(cut_out(each) and not (sharp and is_glass(each)) for each in materials),
            perturbed=any(each.perturbed for each in materials),
            mirrors=sharp and any(is_glass(each) or is_mirror(each) for each in materials),
            glowing=any(map(glows, materials)),
            translucent=translucent(plugin),
        )

    @property
    def extent(self) -> float:  # type: ignore[override]
        """The radius of the bounds."""
        return self.radius

    @cached_property
    def sizes(self) -> dict[int, float]:  # type: ignore[override]
        """The radii of bounded media, by number."""
        return {own: 0.5 * float(np.linalg.norm(high - low)) for own, (low, high) in self.boxes.items()}

    @cached_property
    def lamps(self) -> tuple[Lamps, ...]:  # type: ignore[override]
        """The lights that light surfaces, packed by kind, for loops; others are in `domes` and `mesh_lamps`."""
        groups: dict[Any, list[Any]] = {(kind, Links()): [] for kind in KINDS}
        for each in self.emitters:
            if each.beams.lights_surfaces and each.beams.shines and each.lamp.bare.DRJIT_STRUCT:
                groups.setdefault((type(each.lamp), each.links), []).append(each.lamp)
        return tuple(Lamps.of(items, self._linked(links)) for (_, links), items in groups.items() if items)

    @property
    def drawn(self) -> Sequence[scene.DrawnBeams]:  # type: ignore[override]
        """Beams that no lamp makes."""
        return self.description.drawn

    @cached_property
    def domes(self) -> tuple[tuple[Any, LinkedSurfaces | None], ...]:  # type: ignore[override]
        """The environments, each with its links."""
        return self._each_of(lambda lamp: lamp.environment)

    @cached_property
    def sky(self) -> tuple[tuple[scene.DomeLight, Any, LinkedSurfaces | None], ...]:  # type: ignore[override]
        """The environments that light media without beams, each with its lamp and its links."""
        own = {id(each.beams): each for each in self.emitters}
        found = [(light, own[id(light)]) for light in self.description.sky]
        return tuple((light, behind(each.lamp, each.portal), self._linked(each.links)) for light, each in found)

    @cached_property
    def lit_by_domes(self) -> frozenset[int]:  # type: ignore[override]
        """Numbers of the media that domes light without beams."""
        return frozenset(self.numbers[each.name] for each in self.description.media if each.lit_by_domes)

    @cached_property
    def mesh_lamps(self) -> tuple[tuple[Any, LinkedSurfaces | None], ...]:  # type: ignore[override]
        """The mesh lights, each with its links."""
        return self._each_of(lambda lamp: not (lamp.environment or lamp.bare.DRJIT_STRUCT))

    def _each_of(self, chosen: Callable[[Lamp], bool]) -> tuple[tuple[Any, LinkedSurfaces | None], ...]:
        return tuple(
            (behind(each.lamp, each.portal), self._linked(each.links))
            for each in self.emitters
            if chosen(each.lamp) and each.beams.lights_surfaces
        )

    def stopping(self, links: Links) -> StageWorld:
        """Return the world with only the surfaces that block lights with these links; the world itself if all do."""
        return replace(self, surfaces=self.blockers[links.unshadowed]) if links.unshadowed else self

    def _linked(self, links: Links) -> LinkedSurfaces | None:
        if links == Links():
            return None
        lit = self._lit_shapes(links.unlit) if links.unlit else None
        reach, scale, shadow = (
            opaque(each) for each in (links.shadow_distance, links.surface_scale, links.shadow_color)
        )
        return LinkedSurfaces(self.stopping(links), lit, reach, scale, shadow, links.seen)

    def _lit_shapes(self, unlit: frozenset[str]) -> Any:
        """Return whether each shape is lit, 1 or 0, by Mitsuba's numbers."""
        numbers = [int(shape_number(mi.ShapePtr(shape))[0]) for shape in self.shapes]
        table = np.zeros(max(numbers, default=0) + 2, dtype=np.uint32)
        table[numbers] = [mesh.name not in unlit for mesh in self.meshes]
        return to_uint(table)

    @cached_property
    def numbers(self) -> dict[str, int]:  # type: ignore[override]
        """Numbers of the media by name; a medium may have different numbers in the worlds of two times."""
        media = zip(self.description.media, self.media.all, strict=True)
        return {described.name: medium.number for described, medium in media}

    @property
    def sharp(self) -> bool:
        """Whether camera paths may continue somewhere: at a boundary of media, a mirror or glass."""
        return self.mirrors or bool(self.boundaries)

    def feeling_all(self) -> StageWorld:
        """Return the world in which light feels all of its media."""
        media = self.media.all_felt()
        return self if media is self.media else replace(self, media=media)

    def without_surfaces(self) -> StageWorld:
        """Return the world with its media alone."""
        return replace(self, plugin=self.around, touching=False, cutouts=False, mirrors=False)

    @cached_property
    def sources(self) -> tuple[Source, ...]:  # type: ignore[override]
        """What the beams of each light have in common."""
        media = [each.bounces for each in self.description.media if each.bounces is not None]
        usual = max(media) if media else None
        return tuple(
            _source(number, light, each.lamp.infinite, usual)
            for number, (light, each) in enumerate(zip(self.description.lights, self.emitters, strict=True))
        )

    @cached_property
    def _unshadowing(self) -> list[frozenset[str]]:
        return sorted(self.blockers, key=sorted)

    @property
    def _by_link(self) -> list[Any]:
        """Mitsuba scenes of the surfaces that block lights with links, by link number minus 1."""
        return [self.blockers[names] for names in self._unshadowing]

    @cached_property
    def _blocking_scenes(self) -> list[MiScene]:
        if not self.boundaries:
            return self._by_link
        shapes = list(zip(self.meshes, self.shapes, strict=True))
        return [
            scene_of([*(shape for mesh, shape in shapes if mesh.name not in names), *self.boundaries], self.host)
            for names in self._unshadowing
        ]

    def blocking_scenes(self) -> Sequence[MiScene]:
        """Return the Mitsuba scenes that block light instead of `plugin`, by link number minus 1."""
        return self._blocking_scenes

    def entered(self, number: int, rays: EmittedRays, bounds: Bounds, through: bool) -> EmittedRays:
        """Return rays of an emitter as they begin in the world; see `World.entered`."""
        rays.flux = dr.select(rays.valid, rays.flux, 0)
        active, lamp = dr.max(rays.flux) > 0, self.emitters[number].lamp
        if lamp.flat:
            rays.origin = self._off_surfaces(number, rays.origin, active)
        rays.reach = bounds.exit(rays.origin, rays.direction, 1.0 if lamp.infinite else scene.ESCAPE)
        rays.medium = self.medium_at(rays.origin, rays.direction, active)
        return rays

    def _off_surfaces(self, number: int, origin: Array3f, active: Bool) -> Array3f:
        """Return origins of paths; those on a flat lamp in the plane of a surface begin before that surface."""
        emitter = self.emitters[number]
        gap, axis = gap_before(origin, self.size), emitter.lamp.bare.axis + 0 * origin.x
        seed = dr.arange(UInt32, dr.width(origin))
        link = dr.opaque(UInt32, emitter.link) + 0 * seed
        flush = self.blocked(origin - gap * axis, axis, 2 * gap, active, seed, link)
        return dr.select(flush, origin + gap * axis, origin)

    def escape(self, origin: Array3f, direction: Array3f) -> Float:
        """Return the lengths of light paths that meet nothing."""
        return self.bounds.exit(origin, direction, scene.ESCAPE)

    def medium_of_view(self, origin: Array3f, direction: Array3f) -> UInt32:
        """Return the numbers of the media in which camera rays begin."""
        return self.medium_at(origin, direction, Bool(True))

    def dimming(
        self, origin: Array3f, direction: Array3f, distance: Float, medium: UInt32, seed: UInt32, active: Bool
    ) -> Array3f:
        """Return the transmittance, as surfaces feel it, along rays that begin in a medium and meet no surface."""
        if not self.media.all:
            return Array3f(1)
        if not self.boundaries and not self.outside:
            passed = self.media.transmittance(medium, origin, direction, distance, seed, active)
            return self.media.felt(medium, passed)
        ray = mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction))
        ray.maxt = dr.minimum(distance, dr.largest(Float))
        return through(self.around, self.media, ray, medium, seed, active, size=self.size)[0]

    def medium_at(self, origin: Array3f, direction: Array3f, active: Bool) -> UInt32:
        """Return the numbers of the media at points, found by rays along `direction`."""
        filling = dr.opaque(UInt32, self.media.filling)
        if not self.boundaries and not self.outside:
            return filling + dr.zeros(UInt32, max(dr.width(origin), dr.width(direction)))
        return medium_at(self.around, origin, direction, filling, filling, active, self.size)

    def intersect(
        self, origin: Array3f, direction: Array3f, active: Bool, seed: UInt32, link: UInt32 | None = None
    ) -> SurfaceInteraction:
        """Return the first surface, or boundary of a medium, that rays meet: see `World.intersect`.

        Where an opaque surface and a boundary coincide, rays meet the surface.
        """
        hit = super().intersect(origin, direction, active, seed, link)
        if not self.touching:
            return hit
        on_boundary = active & is_boundary(hit)
        solid = self.solid(origin, direction, on_boundary, seed, link)
        behind = (solid.t - hit.t) * dr.abs(dr.dot(Array3f(hit.n), direction))
        met = on_boundary & solid.is_valid() & ~transmits(solid) & (behind <= gap_at(Array3f(hit.p), self.size))
        return dr.select(met, solid, hit)

    def solid(
        self, origin: Array3f, direction: Array3f, active: Bool, seed: UInt32, link: UInt32 | None = None
    ) -> SurfaceInteraction:
        """Return the first surface that rays hit, as a SurfaceInteraction3f; boundaries of media do not count.

        A cut-out surface stops a ray with the probability of its opacity, decided by a hash of `seed`.
        """
        return self._first(self.surfaces, self._by_link, origin, direction, active, seed, link)

    def blocked(
        self, origin: Array3f, direction: Array3f, distance: Float, active: Bool, seed: UInt32,
        link: UInt32 | None = None,
    ) -> Bool:  # fmt: skip
        """Return which rays hit a surface before `distance`."""
        first, *more = by_link(self.surfaces, self._by_link, link)
        result = self._stopped(first[0], origin, direction, distance, active & first[1], seed)
        for each, own in more:
            result |= self._stopped(each, origin, direction, distance, active & own, seed)
        return result

    def clear(
        self, origin: Array3f, direction: Array3f, distance: Float, active: Bool, seed: UInt32, link: UInt32
    ) -> Float:
        """Return how far rays are clear: the distances at which they hit a surface before `distance`, else infinity."""
        result = Float(dr.inf)
        for plugin, own in by_link(self.surfaces, self._by_link, link):
            ray, skip = self._beyond_cutouts(plugin, origin, direction, active & own, seed)
            ray.maxt = dr.minimum(distance, dr.largest(Float)) - skip
            tried = active & own & (ray.maxt > 0)
            # What lies there does not matter, and takes long to compute for many shapes.
            found = plugin.ray_intersect_preliminary(ray, False, tried)
            result = dr.select(tried & found.is_valid(), found.t + skip, result)
        return result

    def _stopped(
        self, plugin: Any, origin: Array3f, direction: Array3f, distance: Float, active: Bool, seed: UInt32
    ) -> Bool:
        ray, skip = self._beyond_cutouts(plugin, origin, direction, active, seed)
        ray.maxt = dr.minimum(distance, dr.largest(Float)) - skip
        return plugin.ray_test(ray, active & (ray.maxt > 0))


def _source(number: int, light: scene.Light, infinite: bool, bounces: int | None) -> Source:
    """Return what the beams of a light have in common."""
    return Source(
        number, light.name, light.group, light.look, light.emits_beams, light.beam_scale, light.scattered,
        light.lights_surfaces, bounces if light.bounces is None else light.bounces, light.frame, light.guides,
        light.lights_media, endless=not (light.guides or infinite),
    )  # fmt: skip


def _blockers(
    emitters: Sequence[Emitter],
    host: MiScene,
    meshes: Sequence[scene.Mesh],
    shapes: Sequence[MiShape],
    known: dict[frozenset[str], MiScene],
) -> dict[frozenset[str], MiScene]:
    """Return Mitsuba scenes of the surfaces that block lights with shadow links, by the names of those that do not."""
    absent = {each.links.unshadowed for each in emitters} - {frozenset()}

    def rest(names: frozenset[str]) -> MiScene:
        return scene_of([shape for mesh, shape in zip(meshes, shapes, strict=True) if mesh.name not in names], host)

    return {names: known.get(names) or rest(names) for names in absent}


def _solid(meshes: Sequence[scene.Mesh], glass: Sequence[scene.Mesh]) -> list[scene.Mesh]:
    """Return meshes, those of glass with their faces outward."""
    bodies = {id(each) for each in glass}
    return [each.solid() if id(each) in bodies else each for each in meshes]
