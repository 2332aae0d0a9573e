"""The choice of the emitters whose light is met by walks, and the light of a shot for that choice.

Emitters without settings of their own are assigned by `method`. If walks meet an emitter, they find all of its light
except caustics, which is light that a mirror or glass turns before anything else. The caustics of emitters that look
small from a point are traced from the emitter, and walks leave them out. Wide emitters, such as skies, are met behind
glass as well as anywhere else.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

from .. import scene
from ..transport.emission import PathEmitter
from ..transport.guiding.guides import UNGUIDED, Guides
from ..transport.simulation import Simulation
from ..world.cameras.cameras import View
from ..world.emitters.emitter import Emitter, Links
from ..world.emitters.portal_lamps import EnvironmentPortal
from ..world.world import World
from .choice import Pixels, preferred
from .light import ShotLight
from .passes import Statistics
from .paths.walked_emitters import Walked, WalkedEmitters
from .paths.walked_lamps import WalkedLamps
from .paths.walks import Walking
from .settings import Settings
from .worlds import Worlds


@dataclass
class Findings:
    """Results of pilots for a scene, a view and settings. They do not depend on the seed.

    Attributes
    ----------
    walked
        The numbers of the emitters whose light walks should meet; None: not known yet.
    guides
        Guides, by the emitters that walks meet and the emitters that are dark.
    portal
        The portal that was fitted to the light of the environment, or None.
    """

    walked: list[int] | None = None
    guides: dict[tuple[tuple[int, ...], frozenset[int]], Guides] = field(default_factory=dict)
    portal: EnvironmentPortal | None = None


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

    def light(self, walked: Sequence[int], dark: Collection[int] = ()) -> ShotLight:
        """Return the light of which walks meet some emitters, by their numbers; emitters that are `dark` have none."""
        world = self.world
        sharp = frozenset(each for each in walked if world.mirrors and world.emitters[each].lamp.bare.sharp)
        without = frozenset({*dark, *(each for each in walked if each not in sharp)})
        allotment = replace(self.simulation.allotment, without=without, caustics=sharp)
        simulation = replace(self.simulation, allotment=allotment)
        simulation = replace(simulation, guides=self._guides(simulation, (tuple(walked), frozenset(dark))))
        portal = self.portal  # the pilot may have found one
        power = [float(max(PathEmitter(world, each).flux)) for each in walked]

        def walks(world: World) -> dict[str, Walking]:
            groups = dict.fromkeys(world.emitters[each].beams.group for each in walked)
            result = {}
            for group in groups:
                own = [place for place, each in enumerate(walked) if world.emitters[each].beams.group == group]
                numbers, powers = [walked[place] for place in own], [power[place] for place in own]
                emitters: Walked = (
                    WalkedEmitters(world, numbers, powers, sharp, portal)
                    if world.emits
                    else WalkedLamps(world, numbers, powers, sharp)
                )
                result[group] = Walking(emitters, self.max_depth, simulation.tuning.rr_depth)
            return result

        paths = sum(each.count for each in simulation.strata(world)) if self.paths is None else self.paths
        varies = paths > 0 or self.worlds.varies
        return ShotLight(
            self.worlds, simulation, self.settings, self.max_depth, paths, varies, walks, portal, self.findings
        )

    def _guides(self, simulation: Simulation, asked: tuple[tuple[int, ...], frozenset[int]]) -> Guides:
        """Return the guides of light paths, which a pilot finds if they are not known."""
        if self.settings.guiding is False or not self.cameras:
            return UNGUIDED
        if asked not in self.findings.guides:
            world = self.world
            # What is found for a scene holds for all seeds, and is kept. Frames of a stage find their own.
            seed = 0 if world.emits else simulation.tuning.seed
            pilot = replace(simulation, tuning=replace(simulation.tuning, seed=seed))
            # For whole pictures; otherwise a crop would differ from the same part of the whole picture.
            guides = pilot.guided(world, [each.whole().projection for each in self.cameras]).guides
            for stratum in pilot.strata(world):
                opening = guides.openings.get(stratum.name)
                if opening is not None and stratum.emitter.lamp.bare is self._environment:
                    self.findings.portal = EnvironmentPortal(world.plugin, opening.portal)
            self.findings.guides[asked] = guides
        return self.findings.guides[asked]

    @property
    def free(self) -> list[int]:
        """The numbers of the emitters whose light walks may meet: those without settings of their own."""
        settings = self.settings
        if settings.method == "beams" or settings.program is not None or settings.short or not settings.surfaces:
            return []
        return [number for number, each in enumerate(self.world.emitters) if _is_plain(each)]

    def walked(self, pixels: Pixels, statistics: Statistics) -> Sequence[int]:
        """Return the numbers of the emitters whose light walks should meet, for passes of these pixels."""
        free = self.free
        if self.settings.method != "auto" or not free:
            return free
        if self.findings.walked is None:
            with statistics.phase("choose"):
                pilot = replace(self, settings=replace(self.settings, seed=0))  # the result holds for all seeds
                self.findings.walked = preferred(pilot, free, pixels)
        return self.findings.walked


def _is_plain(emitter: Emitter) -> bool:
    """Return whether an emitter lights everything, and has no settings of its beams but a light group."""
    own, usual = emitter.beams, scene.BeamSettings()
    said = {each.name for each in fields(usual) if getattr(own, each.name) != getattr(usual, each.name)}
    return said <= {"group"} and own.lights_surfaces and emitter.links == Links() and not getattr(own, "guides", ())
