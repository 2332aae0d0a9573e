"""Which light is met by walks from the camera, and which is traced from its emitters, for each kind of path.

On surfaces, walks meet all light but caustics, which is light that a mirror or glass turns before anything else. The
caustics of emitters that look small from a point are traced from the emitter, up to the first surface that scatters
them: walks meet them there. Wide emitters, such as skies, are met behind glass as well as anywhere else. In media,
light is either traced as beams or met by walks, emitter by emitter, as `method` says.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from .. import scene
from ..transport.emission import PathEmitter
from ..transport.guiding.guides import UNGUIDED, Guides
from ..transport.segments.records import Counts
from ..transport.simulation import Simulation
from ..transport.tuning import own_bounces
from ..world.cameras.cameras import View
from ..world.emitters.emitter import Emitter, Links
from ..world.emitters.portal_lamps import EnvironmentPortal
from ..world.media.rendered import RenderedMedium
from ..world.world import World
from .light import ShotLight
from .passes import Statistics
from .paths.virtual_lights import bound
from .paths.walked_emitters import Chosen, Walked, WalkedEmitters
from .paths.walked_lamps import WalkedLamps
from .paths.walks import Walking, Walks
from .pilots.choice import lights_little, preferred
from .pilots.coarse_passes import Pixels
from .pilots.sample_plan import BeamCost
from .settings import Settings
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
    connects
        Whether emitters may have virtual lights.
    """

    worlds: Worlds
    settings: Settings
    max_depth: int | None
    simulation: Simulation
    cameras: Sequence[View]
    findings: Findings
    paths: int | None = None
    connects: bool = True

    @property
    def world(self) -> World:
        """The world when the shutter opens."""
        return self.worlds.opened

    def _counts(
        self, walked: Collection[int], lit: Collection[int], dark: Collection[int], further: Counts
    ) -> dict[int, Counts]:
        """Return which light of each emitter is traced; `further` is that of emitters with virtual lights.

        Walks meet the light of `walked` emitters in media and on surfaces, and that of `lit` ones on surfaces.
        """
        world, result = self.world, {}
        for number, emitter in enumerate(world.emitters):
            sharp = world.mirrors and emitter.lamp.bare.sharp
            counts = Counts.ALL
            if number in walked:
                counts = Counts.CAUSTICS if sharp else Counts.NOTHING
            elif number in lit:
                counts = Counts.BEAMS | (Counts.CAUSTIC_PHOTONS if sharp else Counts.NOTHING)
            if number in lit and number in self._connected:
                counts |= further
            if not emitter.lamp.illuminates:
                counts |= Counts.DIRECT_PHOTONS
            result[number] = Counts.NOTHING if number in dark else counts
        return result

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
        lit = [each for each in self._lit if each not in dark]
        thick = {each: media for each, media in self._thick.items() if each not in {*walked, *dark}}
        walked = [*walked, *(each for each, media in thick.items() if media == world.numbers.keys())]
        counts = self._counts(walked, lit, dark, Counts.DIRECT_PHOTONS if self.connects else Counts.NOTHING)
        # Virtual lights are guided as the photons would be to which they send light.
        seen = self._counts(walked, lit, dark, Counts.DIRECT_PHOTONS | Counts.PHOTONS)
        guides = self._guides(seen, (tuple(walked), frozenset(dark))) if any(counts.values()) else UNGUIDED
        allotment = replace(self.simulation.allotment, counts=counts)
        by_source = {world.emitters[each].source: media for each, media in thick.items()}
        simulation = replace(self.simulation, allotment=allotment, guides=guides, walked=by_source)
        portal = self.portal  # the pilot may have found one
        sharp = frozenset(each for each, own in counts.items() if own & Counts.CAUSTICS)
        connected = frozenset(each for each in lit if counts[each] & Counts.DIRECT_PHOTONS)
        power = {each: float(max(PathEmitter(world, each).flux)) for each in {*walked, *lit, *thick}}
        bounces = own_bounces(world.sources, simulation.tuning)

        def walking(
            world: World, numbers: Sequence[int], own: Collection[int], grouped: bool, media: Collection[str] = ()
        ) -> Walking:
            most = None if bounces is None else [bounces[world.emitters[each].source] for each in numbers]
            chosen = Chosen(numbers, [power[each] for each in numbers], most, sharp, own, grouped)
            emitters: Walked = WalkedEmitters(world, chosen, portal) if world.emits else WalkedLamps(world, chosen)
            begin = [world.numbers[name] for name in media] or None
            least = bound(world) if own else None
            return Walking(emitters, self.max_depth, simulation.tuning.rr_depth, least, begin)

        def walks(world: World) -> Walks:
            everywhere = frozenset[str]()
            alike: dict[tuple[str, frozenset[str]], list[int]] = {}
            for each, media in {**thick, **dict.fromkeys(walked, everywhere)}.items():
                alike.setdefault((world.emitters[each].beams.group, media), []).append(each)
            fog = [(group, walking(world, own, (), False, media)) for (group, media), own in alike.items()]
            return Walks(fog, walking(world, lit, connected, True) if lit else None)

        paths = sum(each.count for each in simulation.strata(world)) if self.paths is None else self.paths
        varies = paths > 0 or self.worlds.varies
        return ShotLight(
            self.worlds, simulation, self.settings, self.max_depth, paths, varies, walks, portal, self.findings,
            self.cameras,
        )  # fmt: skip

    @cached_property
    def _thick(self) -> dict[int, frozenset[str]]:
        """The names of the thick media in which walks meet the light of emitters, by the numbers of these.

        Where a medium varies, walks find a lamp in it, or close to it, too seldom. What mirrors and glass turn is
        always traced, and beams carry the light before and after that.
        """
        world, result = self.world, {}
        thick = [] if world.mirrors else self.simulation.tuning.thick(world)
        names = {number: name for name, number in world.numbers.items()}
        for each in self.free if thick else ():
            own = [names[medium.number] for medium in thick if self._apart(each, medium)]
            if own:
                result[each] = frozenset(own)
        return result

    def _apart(self, number: int, medium: RenderedMedium) -> bool:
        """Return whether an emitter is farther from a medium that varies than this is wide; True if it does not."""
        emitter, (low, high) = self.world.emitters[number], self.world.boxes[medium.number]
        if medium.tracked is None or emitter.lamp.infinite or not isinstance(emitter.beams, scene.Light):
            return True
        points = emitter.beams.points
        gaps = np.linalg.norm(points - np.clip(points, low, high), axis=1)
        return bool((gaps > self.world.radius_of(medium)).all())

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

    @cached_property
    def _lit(self) -> list[int]:
        """The numbers of the emitters whose light on surfaces walks meet."""
        settings = self.settings
        if settings.method == "beams" or not settings.surfaces or not self.simulation.tuning.scatters:
            return []
        return [number for number, each in enumerate(self.world.emitters) if self._is_met(each)]

    def _is_met(self, emitter: Emitter) -> bool:
        """Return whether walks can meet the light of an emitter on surfaces.

        They cannot if it shines along one direction, if some surfaces do not block it, or behind images and filters
        before Mitsuba's emitters.
        """
        own, lamp = emitter.beams, emitter.lamp
        behind = self.world.emits and (lamp.images or own.filters)
        return lamp.illuminates and own.lights_surfaces and own.shines and not behind and not emitter.links.unshadowed

    @cached_property
    def _connected(self) -> frozenset[int]:
        """The numbers of the emitters of which the places that they light become virtual lights.

        These are sharp ones that light little of what the first camera sees: walks seldom find it. Paths past a portal
        may not be traced. The direct photons of emitters that shine along one direction are no virtual lights, so then
        there are none. Endless fog dims light from infinity on its way from the bounds, but not direct light on
        surfaces: see `VirtualLights`, which cannot tell if other media are in it.
        """
        world, result = self.world, []
        directed = not all(each.lamp.illuminates for each in world.emitters)
        if not self.cameras or self.settings.guiding is False or directed:
            return frozenset()
        for number in self._lit:
            emitter = world.emitters[number]
            lamp = emitter.lamp
            mixed = lamp.infinite and world.media.filling > 0 and world.nested
            able = lamp.bare.sharp and emitter.portal is None and emitter.links == Links()
            if able and not mixed and lights_little(world, self.cameras[0], number):
                result.append(number)
        return frozenset(result)

    @property
    def free(self) -> list[int]:
        """The numbers of the emitters whose light in media walks may meet: those without settings of their own."""
        settings = self.settings
        if settings.method == "beams" or settings.program is not None or settings.short or not settings.surfaces:
            return []
        return [number for number, each in enumerate(self.world.emitters) if _is_plain(each)]

    def walked(self, pixels: Pixels, statistics: Statistics) -> Sequence[int]:
        """Return the numbers of the emitters whose light in media walks should meet, for passes of these pixels."""
        free = self.free
        if self.settings.method != "auto" or not free:
            return free
        if self.findings.walked is None:
            with statistics.phase("choose"):
                # The result holds for all seeds. Virtual lights are the same either way.
                pilot = replace(self, settings=replace(self.settings, seed=0), connects=False)
                self.findings.walked = preferred(pilot, free, pixels)
        return self.findings.walked


def _is_plain(emitter: Emitter) -> bool:
    """Return whether an emitter lights everything from all around, and has no settings of its beams but a group."""
    own, usual = emitter.beams, scene.BeamSettings()
    said = {each.name for each in fields(usual) if getattr(own, each.name) != getattr(usual, each.name)}
    plain = said <= {"group"} and own.lights_surfaces and emitter.lamp.illuminates
    return plain and emitter.links == Links() and not getattr(own, "guides", ())
