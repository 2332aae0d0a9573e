"""The pilot of a frame: what is found out about the light of a shot before its passes.

Lines, light paths and coarse passes tell what of each emitter's light is seen, through which openings it comes, and how
much noise and cost its beams have. That is a value, `Findings`, by which techniques are chosen, light paths guided, and
samples planned. It is found once for a shot, and not at all where it could change nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import sqrt
from typing import Any

from ...transport.emission import PathEmitter
from ...transport.guiding.guides import UNGUIDED, Guides
from ...transport.guiding.lines import LightLines
from ...transport.guiding.openings import openings
from ...transport.light_tracer import LightTracer, Reach
from ...transport.simulation import Simulation
from ...transport.strata import Allotment
from ...transport.tuning import Tuning
from ...world.cameras.cameras import View
from ...world.emitters.portal_lamps import EnvironmentPortal
from ...world.emitters.rectangles import Sides
from ...world.world import World
from ..light import ShotLight
from ..settings import Settings
from ..techniques import METHODS, TALLY, SeenLight, Techniques
from ..worlds import Worlds
from .beam_noise import BeamCost

# Number of light paths of each emitter that tell what part of its light is seen.
_PATHS = 1 << 13
# Walks of a tally for a picture of one pixel.
_WALKS = 512


@dataclass(frozen=True)
class Findings:
    """What a pilot has found out about a shot, for its cameras and settings; None: not yet. It is right for all seeds.

    Attributes
    ----------
    world
        The world of a Mitsuba scene: rays find the media in which its paths begin.
    seen
        What the first camera sees of the emitters' light.
    guides
        Guides of light paths.
    portal
        The portal that was fitted to the light of Mitsuba's environment, if there is one.
    beams
        The noise and cost of the beams of a pass, by the number of pixels.
    """

    world: World | None = None
    seen: SeenLight | None = None
    guides: Guides | None = None
    portal: EnvironmentPortal | None = None
    beams: Mapping[int, BeamCost] = field(default_factory=dict)


@dataclass(frozen=True)
class Pilot:
    """The pilot of a shot.

    Attributes
    ----------
    worlds, settings, max_depth
        The world over the shutter interval, how it is rendered, and the longest path in edges.
    simulation
        The light paths of all emitters.
    cameras
        Cameras toward which light paths are guided; without any they are not guided.
    known
        What has been found for another frame or seed, and holds for this one.
    paths
        The number of light paths in a pass, and of drawn beams; None: those that emitters share.
    """

    worlds: Worlds
    settings: Settings
    max_depth: int | None
    simulation: Simulation
    cameras: Sequence[View]
    known: Findings = field(default_factory=Findings)
    paths: int | None = None

    @property
    def world(self) -> World:
        """The world when the shutter opens."""
        return self.worlds.opened

    def light(self) -> ShotLight:
        """Return the light of the shot."""
        world, rows, guided = self.world, self.techniques.rows, self._guided
        counts = {row.number: row.counts for row in rows}
        simulation = replace(
            self.simulation, guides=guided, walked={world.emitters[row.number].source: row.thick for row in rows},
            allotment=replace(self.simulation.allotment, counts=counts, walks=self._walks),
        )  # fmt: skip
        paths = sum(each.count for each in simulation.strata(world)) if self.paths is None else self.paths
        fitted = self._fitted if self.known.guides is None else self.known.portal
        findings = replace(self.known, seen=self._seen, guides=guided, portal=fitted)
        return ShotLight(
            worlds=self.worlds,
            simulation=simulation,
            settings=self.settings,
            max_depth=self.max_depth,
            paths=paths,
            varies=paths > 0 or self.worlds.varies,
            rows=rows,
            portal=fitted if self._placed is None else self._placed,
            findings=findings,
            cameras=self.cameras,
        )

    @property
    def _walks(self) -> int:
        """How many walks the tally has: with the root of the number of pixels, noise costs the least.

        In media that vary, each costs several times as much.
        """
        views = [own for each in self.cameras for own in each.whole().projections]
        walks = int(_WALKS * sqrt(max((each.width * each.height for each in views), default=1)))
        return walks // 4 if self.world.media.any_varying else walks

    @cached_property
    def reach(self) -> dict[str, Reach]:
        """Which part of each emitter's light gets into fog, and which part each camera sees, by the emitters' names.

        With a portal, it is that of the light through it.
        """
        views = [each.projections for each in self.cameras]
        return {name: tracer.reach(views) for name, tracer in self._straight.items()}

    def openings(self, names: Collection[str]) -> dict[str, list[Sides]]:
        """Return through which openings emitters with these names light what cameras see; none if one has a portal."""
        views = [own for each in self.cameras for own in each.projections]
        found = {name: self._straight[name].guide(views, thorough=True)[0].bundle for name in names if views}
        return {name: [each.sides for each in openings(own)] if own else [] for name, own in found.items()}

    @cached_property
    def _straight(self) -> dict[str, LightTracer]:
        """What traces some light straight from each emitter, by names."""
        alone = Simulation(Tuning(max_bounces=0), Allotment(_PATHS))
        strata = alone.strata(self.world)
        return {each.emitter.name: alone.tracer(self.world, [replace(each)]) for each in strata}

    @cached_property
    def techniques(self) -> Techniques:
        """Which techniques find which light."""
        return replace(self._unseeing, seen=self._seen)

    @cached_property
    def _unseeing(self) -> Techniques:
        """The techniques as if nothing were known of what is seen."""
        off = METHODS[self.settings.method] | self.settings.without
        # The tally is in froxels of a camera's picture.
        return Techniques(self.world, self.simulation.tuning, off if self.cameras else off | {TALLY})

    @cached_property
    def _seen(self) -> SeenLight:
        """What the first camera sees of the emitters' light."""
        if self.known.seen is not None or not self.cameras:
            return self.known.seen or SeenLight()
        world, lines = self.world, LightLines(self.world, self.cameras[0].whole().projections)
        rare = [] if self.settings.guiding is False else self._unseeing.rare
        lit = {each: lines.lit(world.emitters[each]) for each in rare}
        return SeenLight(lit, {each: lines.free(PathEmitter(world, each)) for each in self._unseeing.hidden})

    @cached_property
    def _guided(self) -> Guides:
        """The guides of light paths of which any light is seen, which rounds of them find if they are not known."""
        if self.known.guides is not None:
            return self.known.guides
        counts = {row.number: row.guided for row in self.techniques.rows}
        if self.settings.guiding is False or not self.cameras or not any(counts.values()):
            return UNGUIDED
        # What is found for a scene holds for all seeds. Frames of a stage find their own.
        seed = 0 if self.world.emits else self.simulation.tuning.seed
        tuning = replace(self.simulation.tuning, seed=seed)
        rounds = replace(self.simulation, tuning=tuning, allotment=replace(self.simulation.allotment, counts=counts))
        # For whole pictures; otherwise a crop would differ from the same part of the whole picture.
        return rounds.guided(self.world, [own for each in self.cameras for own in each.whole().projections]).guides

    @cached_property
    def _fitted(self) -> EnvironmentPortal | None:
        """The portal that the guides have before Mitsuba's environment, or None."""
        openings = self._guided.openings
        for stratum in self.simulation.strata(self.world) if openings else ():
            opening = openings.get(stratum.name)
            if opening is not None and stratum.emitter.lamp.bare is self._environment:
                return EnvironmentPortal(self.world.plugin, opening.portal)
        return None

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
