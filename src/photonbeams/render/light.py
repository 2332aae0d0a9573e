"""The light of a frame, pass by pass, as a pass renderer asks for it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

import drjit as dr
import numpy as np

from ..beams.sets import BeamSet
from ..numerics.grouped import GroupedLight
from ..numerics.samples import Samples
from ..runtime.device import Array3f, Bool, Float
from ..scene.places import moved
from ..transport.guiding.guides import Name
from ..transport.segments.radii import Limits
from ..transport.segments.records import PhotonHits
from ..transport.simulation import Simulation, renumbering
from ..transport.tuning import Tuning, own_bounces
from ..world.cameras.cameras import View
from ..world.emitters.portal_lamps import EnvironmentPortal
from ..world.world import World
from .paths import camera_paths
from .paths.camera_paths import Lighting
from .paths.lighting import EmitterLighting
from .paths.single_scattering import SingleScattering
from .paths.walks import Walks
from .settings import Settings
from .worlds import Worlds

if TYPE_CHECKING:
    from .lights import Findings


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


class FrameLight(Protocol):
    """The light of a frame: its beams and photons pass by pass, and what camera paths meet."""

    @property
    def world(self) -> World:
        """The world when the shutter opens."""

    @property
    def paths(self) -> int:
        """The number of light paths in a pass."""

    @property
    def varies(self) -> bool:
        """Whether passes differ in more than the samples of camera paths."""

    def walks(self, world: World) -> Walks:
        """Return the walks in a world."""

    def traced(self, number: int, step: Callable[[], None]) -> TracedLight:
        """Return the beams and photons of pass `number`; `step` is called between parts of the pass."""

    def lighting(self, world: World) -> Lighting:
        """Return the lighting of a world."""

    def single_scattering(self, world: World, count: int, samples: Samples) -> SingleScattering | None:
        """Return the light that media scatter toward `count` pixels without beams, or None."""

    def clock(self, number: int) -> tuple[float, float]:
        """Return the frame number and the time in seconds of a pass, for looks that change with time."""


class ShotLight:
    """The light of a frame: of some emitters as beams and photons, of others by walks.

    Parameters
    ----------
    worlds, simulation
        The world over the shutter interval, and the light paths through it.
    settings, max_depth
        How it is rendered, and the longest path in edges, as in Mitsuba's integrators; None: no limit.
    paths, varies
        As in `FrameLight`.
    walks
        Returns the walks in a world.
    portal, findings
        The portal before Mitsuba's environment, or None; and the results of its pilots.
    cameras
        The cameras that see it, of all frames of a shot; none if there is a sensor that is no camera.
    """

    def __init__(
        self, worlds: Worlds, simulation: Simulation, settings: Settings, max_depth: int | None,
        paths: int, varies: bool, walks: Callable[[World], Walks], portal: EnvironmentPortal | None,
        findings: Findings, cameras: Sequence[View],
    ) -> None:  # fmt: skip
        self.worlds, self.simulation, self.settings, self.max_depth = worlds, simulation, settings, max_depth
        self.paths, self.varies, self._walks, self._portal = paths, varies, walks, portal
        self.findings, self.cameras = findings, cameras
        self._walking: tuple[World, Walks] | None = None

    @property
    def world(self) -> World:
        """The world when the shutter opens."""
        return self.worlds.opened

    def with_counts(self, counts: Mapping[Name, int]) -> ShotLight:
        """Return the same light with other numbers of light paths, by the names of strata."""
        result, guides = copy(self), self.simulation.guides
        result.simulation = replace(self.simulation, guides=replace(guides, counts={**guides.counts, **counts}))
        return result

    def seeded(self, seed: int) -> ShotLight:
        """Return the same light with another seed."""
        result = copy(self)
        result.settings = replace(self.settings, seed=seed)
        result.simulation = replace(self.simulation, tuning=replace(self.simulation.tuning, seed=seed))
        return result

    def traced(self, number: int, step: Callable[[], None]) -> TracedLight:
        """Return the beams and photons of pass `number`; `step` is called between parts of the pass."""
        ends, between = self.worlds.ends(number), self.worlds.middle(number)
        sets, hits = self.simulation.simulated(ends, number, self.worlds.looks(number), step)
        media = renumbering(ends[0], between)
        sets = [each._replace(medium=media.get(each.medium, each.medium)) for each in sets]
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
        return TracedLight(between, sets, hits, limits, bounces)

    def clock(self, number: int) -> tuple[float, float]:
        """Return the frame number and the time in seconds of a pass, for looks that change with time."""
        return self.worlds.clock(number)

    def walks(self, world: World) -> Walks:
        """Return the walks in a world."""
        if self._walking is None or self._walking[0] is not world:
            self._walking = world, self._walks(world)
        return self._walking[1]

    def lighting(self, world: World) -> Lighting:
        """Return the lighting of a world."""
        return EmitterLighting(world, self._portal)

    def single_scattering(self, world: World, count: int, samples: Samples) -> SingleScattering | None:
        """Return the light that media scatter toward `count` pixels without beams, or None."""
        return SingleScattering(world, count, samples, self.max_depth) if world.sky else None


def tuning_of(settings: Settings, max_depth: int | None, all_beams: bool = False) -> Tuning:
    """Return how light paths are traced; with `all_beams`, also beams that no medium and no look shows."""
    return Tuning(
        settings.seed, max_bounces(max_depth), settings.rr_depth, settings.overlap, settings.alpha, settings.radius,
        settings.min_radius, settings.max_radius, settings.short, settings.surfaces, settings.max_depth is None,
        visible=settings.program is None and not all_beams,
    )  # fmt: skip


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
