"""The shot as Mitsuba sees it: surfaces to hit, fog to pass, portals and lights, and the sphere around it all.

Lights are not in the Mitsuba scene: `world.lights` samples and intersects them, so that beams and surfaces see the
same light. A surface that glows is an `area` emitter, read where a ray hits it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import drjit as dr
import numpy as np

from .. import scene
from ..numerics.arrays import opaque, to_uint
from ..numerics.hashing import hash32, unit_float
from ..runtime.device import Array3f, Bool, Float, UInt32, mitsuba
from .bounds import Bounds, bounding_sphere
from .gobos import Images, Masked, bare, masked, pack_masked
from .lights import DistantSource, DomeSource, FlatSource, Source, SphereSource, pack, source
from .portals import Portal
from .shapes import cut_out, glows, outward, scene_of, shape_of, shapes_of

mi = mitsuba()

_LAYERS = 32  # of cut-out surfaces that a ray may pass


class Fog:
    """The medium: its extinction (opaque) and its boundary, or None where it fills the whole space."""

    def __init__(self, medium: scene.Medium) -> None:
        self.medium = medium
        self.extinction = opaque(medium.extinction)
        self.boundary = None
        if medium.mesh is not None:
            self.step = opaque(1e-4 * float(np.linalg.norm(np.ptp(medium.mesh.points, axis=0))))
            self.boundary = mi.load_dict({"type": "scene", "boundary": shape_of(outward(medium.mesh))})

    def interval(self, origin: Array3f, direction: Array3f) -> tuple[Float, Float, Array3f]:
        """Return the first stretch [enter, exit] of a ray inside the fog, and the outward normal at the exit.

        A ray that misses the fog enters at infinity and exits at 0. `exit` is infinite without a boundary.
        """
        if self.boundary is None:
            nowhere = 0 * origin.x + 0 * direction.x
            return nowhere, dr.inf + nowhere, direction + nowhere
        first = self.boundary.ray_intersect(mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction)))
        hit = first.is_valid()
        inside = hit & (dr.dot(Array3f(first.n), direction) > 0)
        beyond = origin + (dr.select(hit, first.t, 0) + self.step) * direction
        second = self.boundary.ray_intersect(mi.Ray3f(mi.Point3f(beyond), mi.Vector3f(direction)), hit & ~inside)
        through = hit & ~inside & second.is_valid()
        enter = dr.select(inside, 0, dr.select(through, first.t, dr.inf))
        leave = dr.select(inside, first.t, dr.select(through, first.t + self.step + second.t, 0))
        return enter, leave, Array3f(dr.select(inside, first.n, second.n))

    def length(self, origin: Array3f, direction: Array3f, distance: Float) -> Float:
        """Return how much of a ray, up to `distance`, lies in the fog.

        An unbounded fog does not dim what is infinitely far away, or no sky would shine through it: length 0.
        """
        if self.boundary is None:
            return dr.select(dr.isfinite(distance), distance, 0)
        enter, leave, _ = self.interval(origin, direction)
        return dr.maximum(dr.minimum(leave, distance) - enter, 0)

    def transmittance(self, origin: Array3f, direction: Array3f, distance: Float) -> Array3f:
        """Return exp(−σt · length) up to `distance`."""
        return dr.exp(-self.extinction * self.length(origin, direction, distance))


class Links(NamedTuple):
    """What lights are linked to: the world with the surfaces that stop them, and by shape whether they light it."""

    world: World
    lit: Any | None

    def lights(self, hit: Any, active: Bool) -> Bool:
        """Return which of the active hits are on surfaces that the lights shine on."""
        if self.lit is None:
            return active
        return active & (dr.gather(UInt32, self.lit, _number(hit.shape), active) > 0)


class Lamps(NamedTuple):
    """All lights of one kind and the same links: a struct of arrays of it, their number (opaque), and more.

    `pixels` are the images of lights that are behind some. `links` says what they light, None everything.
    """

    kind: Any
    packed: Any
    count: Any
    pixels: dict[str, Any]
    links: Links | None

    @classmethod
    def of(cls, sources: Sequence[Any], links: Links | None) -> Lamps:
        """Return lights of one kind, packed."""
        kind, count = type(sources[0]), dr.opaque(UInt32, len(sources))
        if not isinstance(sources[0], Masked):
            return cls(kind, pack(sources), count, {}, links)
        packed, pixels = pack_masked(sources)
        return cls(kind, packed, count, pixels, links)

    def light(self, number: UInt32) -> Any:
        """Return one of the lights, in a loop over them."""
        light = dr.gather(self.kind, self.packed, number)
        return light.with_pixels(self.pixels) if self.pixels else light


@dataclass(frozen=True)
class World:
    """All of a shot but its camera, ready for rays.

    Attributes
    ----------
    description
        The plain numbers that it was built from.
    meshes, shapes, surfaces
        What is a surface, each as a Mitsuba shape, and the Mitsuba scene of them (Embree on the CPU, OptiX on a GPU).
    blockers
        Mitsuba scenes without some of the surfaces, by their names: what stops lights that those do not stop.
    sources, portals
        The lights as Dr.Jit sees them, in the order of `description.lights`, and by the name of the light its portal.
    images
        The images before lights and on portals that are on the device.
    fog
        The medium, or None.
    bounds, radius
        A sphere around everything, including the viewpoints.
    cutouts, glowing
        Whether any surface lets rays pass, and whether any emits light.
    """

    description: scene.Scene
    meshes: tuple[scene.Mesh, ...]
    shapes: tuple[Any, ...]
    surfaces: Any
    blockers: dict[frozenset[str], Any]
    sources: tuple[Source, ...]
    portals: dict[str, Portal]
    images: Images
    fog: Fog | None
    bounds: Bounds
    radius: float
    cutouts: bool
    glowing: bool

    @classmethod
    def build(cls, description: scene.Scene, viewpoints: Sequence[Any] = (), like: World | None = None) -> World:
        """Build the world of a scene.

        Parameters
        ----------
        description
            The scene.
        viewpoints
            The camera's positions, which the bounds shall contain where the scene does not give its own.
        like
            A world of the same shot at another time: what is the same object in both scenes is not built again.

        Raises
        ------
        SceneError
            If a portal has no area.
        """
        center, radius = description.bounds or bounding_sphere([description], viewpoints)
        medium = description.medium
        hidden = {light.portal.name for light in description.lights if light.portal is not None}
        hidden |= {medium.mesh.name} if medium is not None and medium.mesh is not None else set()
        meshes = tuple(mesh for mesh in description.meshes if mesh.name not in hidden and len(mesh.faces))
        still = like is not None and _same(meshes, like.meshes)
        shapes = like.shapes if like is not None and still else shapes_of(meshes)
        portals = {
            light.name: _known_portal(light, like) or Portal(light.portal, shape_of(light.portal))
            for light in description.lights
            if light.portal is not None
        }
        images = _known_images(description, like)
        return cls(
            description=description,
            meshes=meshes,
            shapes=shapes,
            surfaces=like.surfaces if like is not None and still else scene_of(shapes),
            blockers=_blockers(description, meshes, shapes, like.blockers if like is not None and still else {}),
            sources=tuple(
                masked(source(light), light, portals.get(light.name), images) for light in description.lights
            ),
            portals=portals,
            images=images,
            fog=_fog(medium, like),
            bounds=Bounds(center, radius),
            radius=radius,
            cutouts=any(cut_out(mesh.material) for mesh in meshes),
            glowing=any(glows(mesh.material) for mesh in meshes),
        )

    @cached_property
    def lamps(self) -> tuple[Lamps, ...]:
        """The lights of surfaces, packed by kind, for loops over them; domes are in `domes`."""
        lights = zip(self.description.lights, self.sources, strict=True)
        nothing: tuple[frozenset[str], ...] = (frozenset(), frozenset())
        groups: dict[Any, list[Any]] = {(kind, *nothing): [] for kind in (SphereSource, FlatSource, DistantSource)}
        for light, item in lights:
            if light.lights_surfaces and max(light.radiance) > 0 and not isinstance(bare(item), DomeSource):
                groups.setdefault((type(item), *self._linked(light)), []).append(item)
        return tuple(Lamps.of(items, self._links(*key[1:])) for key, items in groups.items() if items)

    @cached_property
    def domes(self) -> tuple[tuple[Any, Links | None], ...]:
        """The environments, and what they light."""
        lights = zip(self.description.lights, self.sources, strict=True)
        return tuple(
            (item, self._links(*self._linked(light)))
            for light, item in lights
            if isinstance(bare(item), DomeSource) and light.lights_surfaces
        )

    def stopping(self, light: scene.Light) -> World:
        """Return the world with those surfaces alone that stop a light: itself, where all do."""
        _, unshadowed = self._linked(light)
        return replace(self, surfaces=self.blockers[unshadowed]) if unshadowed else self

    def _linked(self, light: scene.Light) -> tuple[frozenset[str], frozenset[str]]:
        """Return which of the surfaces a light does not light, and which do not stop it."""
        return _among(light.unlit, self.meshes), _among(light.unshadowed, self.meshes)

    def _links(self, unlit: frozenset[str], unshadowed: frozenset[str]) -> Links | None:
        if not unlit and not unshadowed:
            return None
        world = replace(self, surfaces=self.blockers[unshadowed]) if unshadowed else self
        return Links(world, self._lit_shapes(unlit) if unlit else None)

    def _lit_shapes(self, unlit: frozenset[str]) -> Any:
        """Return by the number that Mitsuba gave each shape whether it is lit, 1 or 0."""
        numbers = [int(_number(mi.ShapePtr(shape))[0]) for shape in self.shapes]
        table = np.zeros(max(numbers, default=0) + 2, dtype=np.uint32)
        table[numbers] = [mesh.name not in unlit for mesh in self.meshes]
        return to_uint(table)

    def intersect(self, origin: Array3f, direction: Array3f, active: Bool, seed: UInt32) -> Any:
        """Return the first surface that rays hit, as a SurfaceInteraction3f.

        A surface of some opacity stops that part of the rays, decided by a hash of `seed`; the rest goes through.
        """
        skip = self._skip_cutouts(origin, direction, active, seed) if self.cutouts else 0
        ray = mi.Ray3f(mi.Point3f(origin + skip * direction), mi.Vector3f(direction))
        hit = self.surfaces.ray_intersect(ray, active)
        hit.t += skip
        return hit

    def blocked(self, origin: Array3f, direction: Array3f, distance: Float, active: Bool, seed: UInt32) -> Bool:
        """Return which rays hit a surface before `distance`."""
        skip = self._skip_cutouts(origin, direction, active, seed) if self.cutouts else 0
        ray = mi.Ray3f(mi.Point3f(origin + skip * direction), mi.Vector3f(direction))
        ray.maxt = dr.minimum(distance, dr.largest(Float)) - skip
        return self.surfaces.ray_test(ray, active & (ray.maxt > 0))

    def _skip_cutouts(self, origin: Array3f, direction: Array3f, active: Bool, seed: UInt32) -> Float:
        """Return how far rays go before the surface that stops them."""
        # Beyond the rounding of a hit's place.
        step = 1e-5 * dr.max(dr.abs(origin))

        def passing(skip: Float, layer: UInt32, going: Bool) -> tuple[Float, UInt32, Bool]:
            ray = mi.Ray3f(mi.Point3f(origin + skip * direction), mi.Vector3f(direction))
            hit = self.surfaces.ray_intersect(ray, going)
            clear = dr.mean(hit.bsdf().eval_null_transmission(hit, going))
            going = going & hit.is_valid() & (unit_float(hash32(seed, layer)) < clear)
            return dr.select(going, skip + hit.t * (1 + 1e-5) + step, skip), layer + 1, going

        state = (0 * origin.x + 0 * direction.x, dr.zeros(UInt32, dr.width(origin)), Bool(active))
        skip, _, _ = dr.while_loop(state, lambda _, layer, going: going & (layer < _LAYERS), passing, label="cutouts")
        return skip


def _same(these: Sequence[Any], those: Sequence[Any]) -> bool:
    return len(these) == len(those) and all(a is b for a, b in zip(these, those, strict=True))


def _known_portal(light: scene.Light, like: World | None) -> Portal | None:
    if like is None:
        return None
    return next((like.portals[each.name] for each in like.description.lights if each.portal is light.portal), None)


def _known_images(description: scene.Scene, like: World | None) -> Images:
    """Return those of the images of another world that this scene uses, too."""
    gobos = [gobo for light in description.lights for gobo in (light.gobo, light.portal_gobo) if gobo is not None]
    known = {} if like is None else like.images
    return {id(gobo.image): known[id(gobo.image)] for gobo in gobos if id(gobo.image) in known}


def _fog(medium: scene.Medium | None, like: World | None) -> Fog | None:
    if medium is None:
        return None
    return like.fog if like is not None and like.description.medium is medium else Fog(medium)


def _number(shape: Any) -> Any:
    """Return the numbers by which Mitsuba knows shapes."""
    return dr.reinterpret_array(UInt32, shape)


def _among(names: frozenset[str], meshes: Sequence[scene.Mesh]) -> frozenset[str]:
    """Return those of the names that are names of meshes."""
    return names & frozenset(mesh.name for mesh in meshes) if names else names


def _blockers(
    description: scene.Scene, meshes: Sequence[scene.Mesh], shapes: Sequence[Any], known: dict[frozenset[str], Any]
) -> dict[frozenset[str], Any]:
    """Return the surfaces that stop lights which not all of them stop."""
    absent = {_among(light.unshadowed, meshes) for light in description.lights} - {frozenset()}

    def rest(names: frozenset[str]) -> Any:
        return scene_of([shape for mesh, shape in zip(meshes, shapes, strict=True) if mesh.name not in names])

    return {names: known.get(names) or rest(names) for names in absent}
