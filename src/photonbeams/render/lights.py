"""The light of a shot, as the table of `techniques` says: which light paths are traced, and which emitters walks meet.

Pilots choose which emitters' light in media walks meet in Mitsuba scenes, and guide light paths toward what is seen.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from ..transport.guiding.guides import UNGUIDED, Guides
from ..transport.guiding.lines import Lines
from ..transport.segments.records import Counts
from ..transport.simulation import Simulation
from ..world.cameras.cameras import View
from ..world.emitters.portal_lamps import EnvironmentPortal
from ..world.world import World
from .light import ShotLight
from .passes import Statistics
from .pilots.choice import preferred
from .pilots.coarse_passes import Pixels
from .pilots.sample_plan import BeamCost
from .settings import Settings
from .techniques import FOG, METHODS, VIRTUAL, WALKS, Techniques
from .worlds import Worlds


@dataclass
class Findings:
    """What is found out about a scene, for a view and settings. It does not depend on the seed.

    Attributes
    ----------
    world
        The world of a Mitsuba scene: rays find the media in which its paths begin.
    walked
        The numbers of the emitters whose light walks should meet; None: not known yet.
    guides
        Guides, by the emitters that walks meet and those that are dark.
    portal
        The portal that was fitted to the light of the environment, or None.
    beams
        What plans of samples know of the beams of a pass, by the number of pixels.
    """

    world: World | None = None
    walked: list[int] | None = None
    guides: dict[tuple[tuple[int, ...], frozenset[int]], Guides] = field(default_factory=dict)
    portal: EnvironmentPortal | None = None
    beams: dict[int, BeamCost] = field(default_factory=dict)


@dataclass(frozen=True)
class Lights:
    """The light of a shot for each choice of the emitters that walks meet.

    Attributes
    ----------
    worlds, settings, max_depth
        The world over the shutter interval, how it is rendered, and the longest path in edges.
    simulation
        The light paths of all emitters.
    cameras
        Cameras toward which light paths are guided; without any they are not guided.
    findings
        Results of pilots that are known already; new ones are added.
    paths
        The number of light paths in a pass, and of drawn beams; None: those that emitters share.
    """

    worlds: Worlds
    settings: Settings
    max_depth: int | None
    simulation: Simulation
    cameras: Sequence[View]
    findings: Findings
    paths: int | None = None

    @property
    def world(self) -> World:
        """The world when the shutter opens."""
        return self.worlds.opened

    @cached_property
    def techniques(self) -> Techniques:
        """Which techniques find which light."""
        settings, lines = self.settings, None
        if self.cameras and settings.guiding is not False:
            lines = Lines(self.world, self.cameras[0].whole().projections)
        return Techniques(self.world, self.simulation.tuning, METHODS[settings.method] | settings.without, lines)

    @cached_property
    def _placed(self) -> EnvironmentPortal | None:
        """The planar portal that the user has placed before Mitsuba's environment, or None."""
        found = [each.portal for each in self.world.emitters if each.lamp.bare is self._environment]
        if not found or found[0] is None or found[0].sides is None:
            return None
        return EnvironmentPortal(self.world.plugin, found[0])

    @cached_property
    def _environment(self) -> Any:
        """The lamp of Mitsuba's environment, or None."""
        plugin = self.world.plugin
        environment = plugin.environment() if self.world.emits else None
        return environment and self.world.emitters[plugin.emitters().index(environment)].lamp.bare

    @property
    def portal(self) -> EnvironmentPortal | None:
        """The portal before Mitsuba's environment, placed by the user or fitted; or None."""
        return self.findings.portal if self._placed is None else self._placed

    def light(self, walked: Collection[int], dark: Collection[int] = ()) -> ShotLight:
        """Return the light of which walks meet some emitters, by their numbers; emitters that are `dark` have none."""
        world, rows = self.world, self.techniques.rows(walked, dark)
        counts = {row.number: row.counts for row in rows}
        asked = tuple(row.number for row in rows if row.by(WALKS, FOG)), frozenset(dark)
        guides = self._guides({row.number: row.guided for row in rows}, asked) if any(counts.values()) else UNGUIDED
        simulation = replace(
            self.simulation, allotment=replace(self.simulation.allotment, counts=counts), guides=guides,
            walked={world.emitters[row.number].source: row.thick for row in rows},
        )  # fmt: skip
        paths = sum(each.count for each in simulation.strata(world)) if self.paths is None else self.paths
        varies = paths > 0 or self.worlds.varies
        return ShotLight(
            self.worlds, simulation, self.settings, self.max_depth, paths, varies, rows, self.portal, self.findings,
            self.cameras,
        )  # fmt: skip

    def _guides(self, counts: Mapping[int, Counts], asked: tuple[tuple[int, ...], frozenset[int]]) -> Guides:
        """Return the guides of light paths of which this is seen, which a pilot finds if they are not known."""
        if self.settings.guiding is False or not self.cameras:
            return UNGUIDED
        if asked not in self.findings.guides:
            world, simulation = self.world, self.simulation
            # What is found for a scene holds for all seeds, and is kept. Frames of a stage find their own.
            seed = 0 if world.emits else simulation.tuning.seed
            tuning, allotment = replace(simulation.tuning, seed=seed), replace(simulation.allotment, counts=counts)
            pilot = replace(simulation, tuning=tuning, allotment=allotment)
            # For whole pictures; otherwise a crop would differ from the same part of the whole picture.
            guides = pilot.guided(world, [own for each in self.cameras for own in each.whole().projections]).guides
            for stratum in pilot.strata(world):
                opening = guides.openings.get(stratum.name)
                if opening is not None and stratum.emitter.lamp.bare is self._environment:
                    self.findings.portal = EnvironmentPortal(world.plugin, opening.portal)
            self.findings.guides[asked] = guides
        return self.findings.guides[asked]

    def walked(self, pixels: Pixels, statistics: Statistics) -> Sequence[int]:
        """Return the numbers of the emitters whose light in media walks should meet, for passes of these pixels."""
        techniques = self.techniques
        if techniques.free and self.findings.walked is None:
            with statistics.phase("choose"):
                # The result holds for all seeds. Virtual lights are the same either way.
                settings = replace(self.settings, seed=0, without=self.settings.without | {VIRTUAL})
                self.findings.walked = preferred(replace(self, settings=settings), techniques.free, pixels)
        first = self.findings.walked if techniques.free else ()
        return [row.number for row in techniques.rows(first or ()) if row.by(WALKS, FOG)]
