"""The light of a frame, pass by pass, as a pass renderer asks for it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar

import drjit as dr
import numpy as np

from ..beams.sets import BeamSet
from ..numerics.grouped import GroupedLight
from ..numerics.samples import Samples
from ..runtime.device import Array3f, Bool, Float
from ..scene.places import moved
from ..transport.emission import PathEmitter
from ..transport.segments.radii import Limits
from ..transport.segments.records import PhotonHits
from ..transport.simulation import Simulation, renumbering
from ..transport.tally import Tally
from ..transport.tuning import Tuning, own_bounces
from ..world.cameras.cameras import View
from ..world.emitters.portal_lamps import EnvironmentPortal
from ..world.world import World
from .paths import camera_paths
from .paths.camera_paths import Lighting
from .paths.emitters import Chosen, Emitters
from .paths.mitsuba_emitters import MitsubaEmitters, sampled_first
from .paths.single_scattering import SingleScattering
from .paths.stage_emitters import StageEmitters
from .paths.stage_lighting import StageLighting
from .paths.virtual_lights import bound
from .paths.walks import Walking, Walks
from .settings import Settings
from .techniques import (
    CAUSTICS,
    FOG_CAUSTICS,
    FURTHER,
    PHOTONS,
    SEGMENTS,
    SELDOM,
    SKIES,
    STRAIGHT,
    VIRTUAL,
    WALKS,
    Kind,
    Row,
)
from .worlds import Worlds

if TYPE_CHECKING:
    from .pilots.pilot import Findings

T = TypeVar("T")


@dataclass(frozen=True)
class TracedLight:
    """The result of tracing light in a pass: beams, photon hits with the bounds of their radii, and `own_bounces`.

    `world` is the world that the pass's camera paths meet.
    """

    world: World
    sets: list[BeamSet]
    hits: list[PhotonHits]
    limits: Limits
    bounces: Sequence[int] | None = None
    tally: Tally | None = None


@dataclass(eq=False)
class ShotLight:
    """The light of a frame, pass by pass: of some emitters as beams and photons, of others by walks.

    Attributes
    ----------
    worlds, simulation
        The world over the shutter interval, and the light paths through it.
    settings, max_depth
        How it is rendered, and the longest path in edges, as in Mitsuba's integrators; None: no limit.
    paths, varies
        The number of light paths in a pass, and whether passes differ in more than the samples of camera paths.
    rows
        Which techniques find the light of each emitter.
    portal, findings
        The portal before Mitsuba's environment, or None; and the results of its pilots.
    cameras
        The cameras that see it, of all frames of a shot; none if there is a sensor that is no camera.
    """

    worlds: Worlds
    simulation: Simulation
    settings: Settings
    max_depth: int | None
    paths: int
    varies: bool
    rows: Sequence[Row]
    portal: EnvironmentPortal | None
    findings: Findings
    cameras: Sequence[View]

    @property
    def world(self) -> World:
        """The world when the shutter opens."""
        return self.worlds.opened

    def traced(self, number: int, step: Callable[[], None]) -> TracedLight:
        """Return the beams and photons of pass `number`; `step` is called between parts of the pass."""
        ends, between = self.worlds.ends(number), self.worlds.middle(number)
        found = self.simulation.simulated(ends, number, self.worlds.looks(number), step)
        media = renumbering(ends[0], between)
        sets = [each._replace(medium=media.get(each.medium, each.medium)) for each in found.sets]
        if self.settings.program is not None:
            zero, medium = ends[0].zero, self.worlds.medium(number)
            medium = None if medium is None else moved(medium, -np.array(zero))
            x, y, z = (float(each[0]) - begin for each, begin in zip(ends[0].bounds.center, zero, strict=True))
            # Programs get the times of the pass whether or not anything moves.
            sets = self.settings.program(
                sets, number, self.settings.seed, self.worlds.slice(number), medium,
                ((x, y, z), ends[0].radius), zero,
            )  # fmt: skip
        dr.eval([(each.beams, each.close) for each in sets])
        tuning = self.simulation.tuning
        limits, bounces = tuning.limits(number, ends[0].radius), own_bounces(between.sources, tuning)
        tally = None if found.tally is None else replace(found.tally, media=media)
        return TracedLight(between, sets, found.hits, limits, bounces, tally)

    def clock(self, number: int) -> tuple[float, float]:
        """Return the frame number and the time in seconds of a pass, for looks that change with time."""
        return self.worlds.clock(number)

    def walks(self, world: World) -> Walks:
        """Return the walks in a world."""
        return self._kept("walks", world, self._walks_in)

    def _walks_in(self, world: World) -> Walks:
        """Return the walks in a world: in media by light groups, and on surfaces."""
        alike: dict[tuple[str, frozenset[str]], list[Row]] = {}
        for row in self.rows:
            if row.walked:
                alike.setdefault((world.emitters[row.number].beams.group, row.thick), []).append(row)
        fog = []
        for (group, names), own in alike.items():
            media = [world.numbers[name] for name in names] or None
            fog.append((group, self._walking(self._met(world, own, FOG_CAUSTICS), media=media)))
        lit = [row for row in self.rows if row.by(WALKS, FURTHER)]
        if not lit:
            return Walks(fog)
        least = bound(world) if any(row.by(VIRTUAL, SELDOM) for row in lit) else None
        return Walks(fog, self._walking(self._met(world, lit, CAUSTICS), bound=least))

    def _walking(self, emitters: Emitters, **more: Any) -> Walking:
        return Walking(emitters, self.max_depth, self.simulation.tuning.rr_depth, **more)

    def _met(self, world: World, rows: Sequence[Row], mirrors: Kind) -> Emitters:
        """Return the emitters of rows, by `mirrors` only where walks find such paths, too."""
        bounces = own_bounces(world.sources, self.simulation.tuning)
        numbers = [row.number for row in rows]
        chosen = Chosen(
            numbers, [self._power[each] for each in numbers],
            None if bounces is None else [bounces[world.emitters[each].source] for each in numbers],
            sharp=[row.number for row in rows if mirrors in row.found and not row.by(WALKS, mirrors)],
            connected=[row.number for row in rows if row.by(VIRTUAL, SELDOM)], grouped=mirrors is CAUSTICS,
        )  # fmt: skip
        if world.emits:
            return MitsubaEmitters(world, chosen, self.portal)
        return StageEmitters(world.feeling_all(), chosen)

    def _kept(self, name: str, world: World, make: Callable[[World], T]) -> T:
        """Return what is made of a world, or was when it was last asked for by this name."""
        if name not in self._known or self._known[name][0] is not world:
            self._known[name] = world, make(world)
        result: T = self._known[name][1]
        return result

    @cached_property
    def _known(self) -> dict[str, tuple[World, Any]]:
        """The last worlds, and what was made of them, by name."""
        return {}

    @cached_property
    def _power(self) -> dict[int, float]:
        """The power of the emitters that walks meet, by number."""
        walked = [row.number for row in self.rows if row.walked or row.by(WALKS, FURTHER)]
        return {each: float(max(PathEmitter(self.world, each).flux)) for each in walked}

    def lighting(self, world: World) -> Lighting:
        """Return the lighting of a world."""
        return self._kept("lighting", world, self._lighting_of)

    def _lighting_of(self, world: World) -> Lighting:
        photons = [row.number for row in self.rows if row.by(PHOTONS, STRAIGHT)]
        if world.emits:
            return MitsubaEmitters(world, sampled_first(world, photons), self.portal)
        return StageLighting(world, photons)

    def single_scattering(self, world: World, count: int, samples: Samples) -> SingleScattering | None:
        """Return the light that media scatter toward `count` pixels without beams, or None."""
        skies = [row.number for row in self.rows if row.by(SEGMENTS, SKIES)]
        return SingleScattering(world, skies, count, samples, self.max_depth) if skies else None


def tuning_of(settings: Settings, max_depth: int | None, all_beams: bool = False) -> Tuning:
    """Return how light paths are traced; with `all_beams`, also beams that no medium and no look shows."""
    return Tuning(
        seed=settings.seed,
        max_bounces=max_bounces(max_depth),
        rr_depth=settings.rr_depth,
        overlap=settings.overlap,
        alpha=settings.alpha,
        radius=settings.radius,
        min_radius=settings.min_radius,
        max_radius=settings.max_radius,
        short=settings.short,
        surfaces=settings.surfaces,
        own_bounces=settings.max_depth is None,
        visible=settings.program is None and not all_beams,
    )


def max_bounces(max_depth: int | None) -> int | None:
    """Return the most bounces of light before it is scattered toward the camera: the longest path has 2 edges more."""
    return None if max_depth is None else max_depth - 2


class NoLighting:
    """The lighting of a world in which nothing emits light or is lit directly."""

    def __init__(self, world: World) -> None:
        self._groups = len(world.groups)

    def lamp(self, origin: Array3f, direction: Array3f, flown: Float) -> None:
        """Return None."""
        return

    def emission(self, hit: Any, origin: Array3f, direction: Array3f, active: Bool) -> GroupedLight:
        """Return black."""
        return GroupedLight.dark(self._groups, dr.width(hit.t))

    def direct(self, point: camera_paths.ShadingPoint, active: Bool) -> GroupedLight:
        """Return black."""
        return GroupedLight.dark(self._groups, dr.width(point.hit.t))
