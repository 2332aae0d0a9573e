"""The world of a scene in plain numbers, such as a stage at one time: surfaces and boundaries of media, media, lights.

Lights are not part of the Mitsuba scene: `world.emitters` sample and intersect them, so that beams and surfaces have
the same light. A glowing surface has an `area` emitter, which is evaluated where a ray hits it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .. import scene
from .bounds import Bounds, bounding_sphere, endless_length
from .emitters.build import emitters_of
from .emitters.emitter import Emitter
from .emitters.lamp import Lamp
from .emitters.sources import Source
from .media.bounded import BoundedMedia, same, touching
from .shadow_rays import size_of
from .surfaces.build import Group, grouped, ids_of, shapes_of
from .surfaces.shapes import glows, is_body, scene_of
from .world import World, mirrors, passes, translucent

if TYPE_CHECKING:
    from ..runtime.mitsuba_types import MiScene, MiShape


@dataclass(frozen=True)
class KeptParts:
    """What `world_of_scene` keeps to build the world of another time.

    Attributes
    ----------
    given, content
        The scene, and what of it the world has: fog that varies ends at its bounds.
    groups, shapes
        The surfaces, each group as a Mitsuba shape.
    media
        The media and their boundaries.
    glass
        Closed meshes of glass, which are empty inside.
    sharp
        As in `world_of_scene`.
    """

    given: scene.Scene
    content: scene.Scene
    groups: list[Group]
    shapes: tuple[Any, ...]
    media: BoundedMedia
    glass: tuple[scene.Mesh, ...]
    sharp: bool

    def built(self, media: BoundedMedia) -> dict[tuple[int, ...], MiShape]:
        """Return the shapes that stay the same among media, by the ids of their meshes."""
        changed = media is not self.media and (media.outside or self.media.outside)
        bodies = {id(each) for each in self.glass} if changed else ()
        found = zip(map(ids_of, self.groups), self.shapes, strict=True)
        return {ids: shape for ids, shape in found if ids[0] not in bodies}


def world_of_scene(
    description: scene.Scene, viewpoints: Sequence[npt.ArrayLike] = (), like: World | None = None, sharp: bool = False
) -> World:  # fmt: skip
    """Build the world of a scene.

    Parameters
    ----------
    description
        The scene.
    viewpoints
        The camera's positions, which the bounds contain unless the scene gives its own bounds.
    like
        A world of the same shot at another time, as `sharp`. Objects that are identical in both scenes are not built
        again.
    sharp
        Whether smooth metal is an ideal mirror and transparent materials are glass. Camera paths need more than two
        edges to show what these reflect and refract.

    Raises
    ------
    SceneError
        A portal has no area.
    """
    given = description
    known: KeptParts | None = None if like is None else like.parts
    center, radius = description.bounds or bounding_sphere([description], viewpoints)
    description = _within(description, (center, radius), known)
    meshes = _surfaces(description)
    host = scene_of(()) if like is None else like.host
    glass = tuple(each for each in meshes if sharp and is_body(each))
    content = _media(description, host, known, glass)
    bodies = {id(each) for each in glass}
    linked = {names for light in description.lights for names in (light.unlit, light.unshadowed) if names}
    linked |= {each.left_out for light in description.lights for each in light.filters if each.left_out}
    glow = _glow(description)
    linked |= {frozenset(name for name, own in glow.items() if own == group) for group in glow.values()}
    groups = grouped(meshes, bodies, linked, sharp)
    shapes = shapes_of(groups, bodies, sharp, content.outside, known.built(content) if known else {})
    still = known is not None and same(shapes, known.shapes)
    surfaces = like.surfaces if like and still else scene_of(shapes, host)
    kept = still and known is not None and content.boundaries is known.media.boundaries
    plugin = like.plugin if like and kept else _with_boundaries(surfaces, shapes, content.boundaries, host)
    emitters = emitters_of(description.lights, meshes, host, [plugin], like.emitters if like else ())
    shown = [(group[0].name, shape) for group, shape in zip(groups, shapes, strict=True)]
    numbers = {each.name: own.number for each, own in zip(description.media, content.media.all, strict=True)}
    endless = [each for each in content.media.all if each.number not in content.boxes]
    world = World(
        plugin=plugin, surfaces=surfaces, around=content.around, host=host, media=content.media, emitters=emitters,
        sources=_sources(description, emitters, numbers), bounds=Bounds(center, radius), radius=radius, extent=radius,
        endless=endless_length(radius, endless),
        parts=KeptParts(given, description, groups, shapes, content, glass, sharp),
        nested=bool(content.boundaries or content.outside),
        touching=like.touching if like and kept
        else bool(shapes) and touching(description.media, surfaces, size_of(plugin)),
        translucent=translucent(plugin), cutouts=any(passes(each.bsdf()) for each in shapes),
        mirrors=mirrors(surfaces),
        perturbed=any(each.material.perturbed for each in meshes), glowing=any(glows(each.material) for each in meshes),
        boundaries=content.boundaries,
        shapes=shown,
        blockers=_blockers(emitters, host, shown, like.blockers if like and still else {}),
        boxes=content.boxes,
        reentrant=content.reentrant,
        numbers=numbers,
        drawn=description.drawn,
        glow=glow,
        zero=description.zero,
    )  # fmt: skip
    return _as_seen(world, groups)


def _within(description: scene.Scene, bounds: tuple[Any, float], known: KeptParts | None) -> scene.Scene:
    """Return the scene with bounds, at which fog that varies ends; fog that is the same at another time stays so."""
    result = description.within(bounds)
    if known is None or known.content.bounds is None or not np.array_equal(known.content.bounds[0], bounds[0]):
        return result
    if known.content.bounds[1] != bounds[1] or len(known.given.media) != len(description.media):
        return result
    media = zip(known.given.media, known.content.media, description.media, result.media, strict=True)
    return replace(result, media=tuple(kept if before is now else own for before, kept, now, own in media))


def _as_seen(world: World, groups: Sequence[Group]) -> World:
    """Return a world with what the camera sees of its surfaces, which are these groups."""
    pairs = [(group[0], shape) for group, (_, shape) in zip(groups, world.shapes, strict=True)]
    if held := [shape for mesh, shape in pairs if mesh.holdout]:
        world = replace(world, holdouts=scene_of(held, world.host))
    visible = [shape for mesh, shape in pairs if mesh.seen]
    if len(visible) == len(pairs):
        return world
    surfaces = scene_of(visible, world.host)
    plugin = _with_boundaries(surfaces, visible, world.boundaries, world.host)
    return replace(world, shown=replace(world, plugin=plugin, surfaces=surfaces, blockers={}))


def _with_boundaries(
    surfaces: MiScene, shapes: Sequence[MiShape], boundaries: Sequence[MiShape], host: MiScene
) -> MiScene:  # fmt: skip
    """Return the Mitsuba scene of surfaces and of the boundaries of media: that of the surfaces if there are none."""
    return scene_of([*shapes, *boundaries], host) if boundaries else surfaces


def _glow(description: scene.Scene) -> dict[str, str]:
    """Return the light groups of surfaces that glow, by the names of meshes; without those of the unnamed group."""
    lights = (each for each in description.lights if isinstance(each, scene.MeshLight))
    return {each.name: each.group for each in lights if each.surface and each.group}


def _surfaces(description: scene.Scene) -> tuple[scene.Mesh, ...]:
    """Return the meshes that are surfaces: not portals, and not boundaries of media."""
    hidden = {light.portal.name for light in description.lights if light.portal is not None}
    hidden |= {each.mesh.name for each in description.media if each.mesh is not None}
    return tuple(mesh for mesh in description.meshes if mesh.name not in hidden and len(mesh.faces))


def _media(
    description: scene.Scene, host: MiScene, known: KeptParts | None, glass: Sequence[scene.Mesh]
) -> BoundedMedia:  # fmt: skip
    """Return the media of a scene; those of a world of the same shot if it has the same media and glass."""
    if known is None:
        return BoundedMedia.of(description.media, host, glass, {})
    if same(known.content.media, description.media) and same(known.glass, glass):
        return known.media
    built = zip(known.content.media, known.media.media.all, strict=True)
    return BoundedMedia.of(description.media, host, glass, {id(each): own.plugin for each, own in built})


def _sources(
    description: scene.Scene, emitters: Sequence[Emitter], numbers: Mapping[str, int]
) -> tuple[Source, ...]:  # fmt: skip
    """Return what the beams of each light have in common."""
    media = [each.bounces for each in description.media if each.bounces is not None]
    usual = max(media) if media else None
    return tuple(
        _source(number, light, each.lamp, usual, numbers)
        for number, (light, each) in enumerate(zip(description.lights, emitters, strict=True))
    )


def _source(
    number: int, light: scene.Light, lamp: Lamp, bounces: int | None, media: Mapping[str, int]
) -> Source:  # fmt: skip
    return Source(
        number=number,
        name=light.name,
        group=light.group,
        look=light.look,
        beams=light.emits_beams,
        beam_scale=light.beam_scale,
        scattered=light.scattered,
        surfaces=light.lights_surfaces,
        bounces=bounces if light.bounces is None else light.bounces,
        to_world=light.frame,
        guides=light.guides,
        scattered_beams=light.lights_media,
        unlit=frozenset(own for name, own in media.items() if name in light.unlit_media),
        endless=not (light.guides or lamp.infinite),
        filters=lamp.filters,
    )


def _blockers(
    emitters: Sequence[Emitter],
    host: MiScene,
    shapes: Sequence[tuple[str, MiShape]],
    known: Mapping[frozenset[str], MiScene],
) -> dict[frozenset[str], MiScene]:
    """Return Mitsuba scenes of the surfaces that block lights with shadow links, by the names of those that do not."""
    absent = {each.links.unshadowed for each in emitters} - {frozenset()}
    return {
        names: known.get(names) or scene_of([shape for name, shape in shapes if name not in names], host)
        for names in absent
    }
