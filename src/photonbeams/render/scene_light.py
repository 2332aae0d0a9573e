"""The light of a Mitsuba scene, pass by pass: of some emitters as beams and photons, of others by walks.

Emitters of which nothing is said are dealt out by `method`. The light of one that walks meet is theirs alone but for
caustics, which walks do not find: light that a mirror or glass turns before anything else. Of emitters that are small
as their points see them, these are traced from the emitter, and left out by walks; wide ones, such as skies, are met
behind glass as well as anywhere.
"""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from .. import scene
from ..runtime.device import mitsuba
from ..transport.emission import Stratum
from ..transport.fitted_portals import Opening, parted
from ..transport.guiding import GuidingMap
from ..transport.scene_emitters import emission_of, power_of, redistribute
from ..transport.simulation import Simulation, Tuning
from ..world.cameras import View
from ..world.gobos import bare
from ..world.portal_lamps import EnvironmentPortal
from ..world.scene_lamps import names_of
from ..world.scene_world import SceneWorld
from ..world.sources import Source
from ..world.surroundings import Place
from ..world.warnings import warn
from ..world.world import World
from .camera_paths import Lighting
from .choice import Pixels, is_sharp, preferred
from .frame import PassRenderer, Simulated
from .passes import Statistics
from .scene_lighting import SceneLighting
from .settings import DEFAULT_PATHS, Settings
from .walks import WalkedEmitters, Walking

mi = mitsuba()


@dataclass(frozen=True)
class EmitterSettings:
    """The beam settings of a scene by emitter; the sources that they make, and by emitter the number of its source."""

    beams: list[scene.BeamSettings]
    sources: list[Source]
    numbers: list[int]

    @classmethod
    def of(cls, plugin: Any, given: Mapping[str, scene.BeamSettings]) -> EmitterSettings:
        """Return the settings that are given by the names of emitters, as in `scene_frame.Extras`."""
        usual = given.get("", scene.BeamSettings())
        emitters = [names_of(each) for each in plugin.emitters()]
        for name in given:
            if name and not any(name in names for names in emitters):
                known = ", ".join(dict.fromkeys(names[-1] for names in emitters if names)) or "none"
                raise scene.SceneError(f"the scene has no emitter '{name}': expected one of {known}")
        beams = [next((given[name] for name in names if name in given), usual) for names in emitters]
        different = list({id(each): each for each in beams}.values()) or [usual]
        numbers = [next(place for place, each in enumerate(different) if each is own) for own in beams]
        sources = []
        for place, each in enumerate(different):
            name = next((names[-1] for names, own in zip(emitters, numbers, strict=True) if own == place and names), "")
            own = Source(place, name, each.group, each.look, each.emits_beams, each.beam_scale, each.scattered)
            sources.append(replace(own, bounces=each.bounces))
        return cls(beams, sources, numbers)

    def free(self, world: SceneWorld, settings: Settings) -> list[int]:
        """Return the numbers of the emitters whose light walks may meet: those of which nothing is said."""
        if settings.method == "beams" or settings.program is not None or settings.short or not settings.surfaces:
            return []
        return [
            number for number, (own, lamp) in enumerate(zip(self.beams, world.lamps, strict=True))
            if own == scene.BeamSettings(group=own.group) and lamp is None
        ]  # fmt: skip

    def as_caustics(self, emitters: Collection[int]) -> EmitterSettings:
        """Return the same with sources of their own for emitters whose light paths count only as caustics."""
        sources, numbers = list(self.sources), list(self.numbers)
        for old in dict.fromkeys(numbers[each] for each in emitters):
            for each in emitters:
                if self.numbers[each] == old:
                    numbers[each] = len(sources)
            sources.append(replace(self.sources[old], number=len(sources), caustics=True))
        return replace(self, sources=sources, numbers=numbers)

    @property
    def named(self) -> bool:
        """Whether beams carry what looks and programs may read."""
        first = self.sources[0]
        return len(self.sources) > 1 or first.look is not None or first.beam_scale != 1


class Guidance(NamedTuple):
    """Of an emitter's light: its fitted portal, and the map of the samples and the number of paths of its strata."""

    opening: Opening | None
    maps: list[GuidingMap | None]
    counts: list[int]


@dataclass
class Findings:
    """What pilots have found of a scene, a view and settings, whatever the seed: it is true while these are the same.

    Attributes
    ----------
    walked
        The numbers of the emitters whose light walks had better meet; None: not known yet.
    guides
        Guidance of each stratum by the emitters that walks meet, and those that are dark.
    portal
        The portal that was fitted to the light of the environment, or None.
    """

    walked: list[int] | None = None
    guides: dict[tuple[tuple[int, ...], frozenset[int]], list[Guidance]] = field(default_factory=dict)
    portal: EnvironmentPortal | None = None


class SceneLight:
    """The light of some emitters of a scene, those among them that walks meet told apart.

    Parameters
    ----------
    world, own
        The scene, and the settings of its emitters.
    walked, dark
        The numbers of the emitters that walks meet, and of those that have no light here.
    settings, tuning, max_depth, findings
        As in `light_of`.
    """

    def __init__(
        self, world: SceneWorld, own: EmitterSettings, walked: Sequence[int], dark: Collection[int],
        settings: Settings, tuning: Tuning, max_depth: int | None, findings: Findings,
    ) -> None:  # fmt: skip
        self.world, self._findings, self._placed = world, findings, _placed_portal(world)
        sharp = {each for each in walked if world.mirrors and is_sharp(world.plugin.emitters()[each])}
        lit = own.as_caustics(sorted(sharp)) if sharp else own
        self._walks = {}
        groups = [own.sources[each].group for each in own.numbers]
        power = {each: power_of(world, each) for each in walked}
        for group in dict.fromkeys(groups[each] for each in walked):
            numbers = [each for each in walked if groups[each] == group]
            emitters = WalkedEmitters(world, numbers, [power[each] for each in numbers], sharp)
            self._walks[group] = Walking(emitters, max_depth, tuning.rr_depth)
        without = {*dark, *(each for each in walked if each not in sharp)}
        emission = emission_of(world, settings.beams or DEFAULT_PATHS, settings.seed, lit.numbers, without)
        self.simulation = Simulation(world, emission, tuning, lit.sources, world.sizes, own.named)

    @property
    def portal(self) -> EnvironmentPortal | None:
        """What stands before the environment: a portal that somebody placed, or one that was fitted; or None."""
        return self._findings.portal if self._placed is None else self._placed

    @property
    def walks(self) -> dict[str, Walking]:
        """How walks meet the light of emitters, by group."""
        portal = self.portal
        return {name: replace(each, emitters=each.emitters.behind(portal)) for name, each in self._walks.items()}

    def with_paths(self, strata: Sequence[Stratum]) -> SceneLight:
        """Return the same with other light paths."""
        result = copy(self)
        result._sent(strata)
        return result

    def guide(self, cameras: Sequence[View]) -> list[Guidance]:
        """Send light paths toward what cameras see, and return what does it."""
        strata = self.simulation.emission.strata
        if not cameras or not strata:
            return [Guidance(None, [each.guide], [each.count]) for each in strata]
        # Of whole pictures, or a crop would not be that part of the picture.
        found = self.simulation.guide([each.whole().projection for each in cameras])
        for stratum, each in zip(strata, found, strict=True):
            if each.opening is not None and bare(stratum.emitter.lamp).emitter == self.world.plugin.environment():
                self._findings.portal = EnvironmentPortal(self.world.plugin, each.opening.portal)
        self._sent([stratum for each in found for stratum in each.strata])
        redistribute(self.simulation.emission.strata, np.array([own for each in found for own in each.light]))
        return [
            Guidance(each.opening, [own.guide for own in each.strata], [own.count for own in each.strata])
            for each in found
        ]

    def follow(self, guides: list[Guidance]) -> None:
        """Send light paths as guides do that were found for the same light with another seed."""
        sent = []
        for stratum, guide in zip(self.simulation.emission.strata, guides, strict=True):
            parts = zip(parted(stratum, guide.opening), guide.maps, guide.counts, strict=True)
            sent += [replace(part, guide=own, count=count) for part, own, count in parts]
        self._sent(sent)

    def _sent(self, strata: Sequence[Stratum]) -> None:
        emission = self.simulation.emission
        self.simulation = replace(self.simulation, emission=replace(emission, strata=strata))

    def simulated(self, number: int) -> Simulated:
        """Return what light leaves in pass `number`."""
        limits = self.simulation.tuning.limits(number, self.world.radius)
        return Simulated(self.world, *self.simulation.simulated(number), limits)


def _placed_portal(world: SceneWorld) -> EnvironmentPortal | None:
    """Return the planar portal that somebody placed before the environment, None where there is none."""
    environment = world.plugin.environment()
    lamp = None if environment is None else world.lamps[world.plugin.emitters().index(environment)]
    if lamp is None or lamp.portal is None or lamp.portal.sides is None:
        return None
    return EnvironmentPortal(world.plugin, lamp.portal)


def light_of(
    plugin: Any, eye: Place, settings: Settings, tuning: Tuning, beams: Mapping[str, scene.BeamSettings],
    cameras: Sequence[View], pixels: Pixels, warned: set[str] | None, statistics: Statistics, max_depth: int | None,
    findings: Findings | None = None,
) -> SceneLight:  # fmt: skip
    """Return the light of a Mitsuba scene.

    Parameters
    ----------
    plugin, eye
        The scene, and the place where camera paths begin.
    settings, tuning
        How it is rendered, and how its light paths are traced.
    beams
        As in `scene_frame.Extras`.
    cameras
        What light paths are guided toward; none: they are not guided.
    pixels
        The camera paths of a pass of the whole picture.
    warned
        Texts of warnings that were given.
    statistics
        They get the time that this takes.
    max_depth
        The longest path in edges; None: any.
    findings
        What is known of it; what is found out is added.

    Raises
    ------
    SceneError
        Something in the scene that cannot be rendered; beams of an emitter that is not there.
    """
    findings = Findings() if findings is None else findings
    with statistics.phase("build"):
        own = EmitterSettings.of(plugin, beams)
        world = SceneWorld(plugin, eye, own.sources, own.beams)
        if settings.short:
            world.media.all = tuple(each.for_short_beams() for each in world.media.all)
    warn(plugin, world.surroundings, set() if warned is None else warned)

    # Pilots have a seed of their own: all seeds are of one kind of light, and what is found is true for all.
    pilot_settings, pilot_tuning = replace(settings, seed=0), replace(tuning, seed=0)

    @cache
    def piloted(walked: tuple[int, ...], dark: frozenset[int]) -> SceneLight:
        result = SceneLight(world, own, walked, dark, pilot_settings, pilot_tuning, max_depth, findings)
        if settings.guiding in (None, True):
            findings.guides[walked, dark] = result.guide(cameras)
        return result

    walked = own.free(world, settings)
    if settings.method == "auto" and walked:
        if findings.walked is None:
            with statistics.phase("choose"):
                findings.walked = preferred(world, walked, cameras[:1], pixels, piloted, pilot_settings, max_depth)
        walked = findings.walked
    if walked:
        names = [(names_of(each) or [each.class_name()])[-1] for each in plugin.emitters()]
        logging.getLogger("photonbeams").info(
            "paths from the camera find the light of %s", ", ".join(dict.fromkeys(names[each] for each in walked))
        )
    with statistics.phase("guide"):
        result = SceneLight(world, own, walked, (), settings, tuning, max_depth, findings)
        if settings.guiding in (None, True):
            asked = tuple(walked), frozenset[int]()
            if asked not in findings.guides:
                piloted(*asked)
            result.follow(findings.guides[asked])
        return result


class ScenePasses(PassRenderer):
    """Passes over a Mitsuba scene, whose light is `light`."""

    light: SceneLight

    def _lighting(self, world: World) -> Lighting:
        assert isinstance(world, SceneWorld)
        return SceneLighting(world, self.light.portal)

    def _walkings(self, world: World) -> Mapping[str, Walking]:
        return self.light.walks

    def simulated(self, number: int) -> Simulated:
        """Return what light leaves in pass `number`."""
        return self.light.simulated(number)
