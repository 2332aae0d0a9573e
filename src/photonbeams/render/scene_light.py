"""The light of a Mitsuba scene, pass by pass: of some emitters as beams and photons, of others by walks.

Emitters without settings of their own are assigned by `method`. If walks meet an emitter, they find all of its light
except caustics, which is light that a mirror or glass turns before anything else. The caustics of emitters that look
small from a point are traced from the emitter, and walks leave them out. Wide emitters, such as skies, are met behind
glass as well as anywhere else.
"""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from .. import scene
from ..constants import DEFAULT_PATHS
from ..runtime.device import mitsuba
from ..transport.emission import PathEmitter
from ..transport.guides import UNGUIDED, Guides
from ..transport.simulation import Simulation
from ..transport.strata import Allotment
from ..world.cameras.cameras import View
from ..world.emitters.mitsuba_scene import names_of
from ..world.emitters.portal_lamps import EnvironmentPortal
from ..world.emitters.sources import Source
from ..world.media.discovery.surroundings import Place
from ..world.media.discovery.warnings import warn
from ..world.scene_world import SceneWorld
from .choice import Pixels, is_sharp, preferred
from .light import Light, tuning_of
from .passes import Statistics
from .paths.walks import WalkedEmitters, Walking
from .settings import Settings
from .worlds import StillWorld

mi = mitsuba()

_DARK_FOG = (
    "the light of {} comes from infinity and enters endless fog {:.3g} units from the middle of the shapes, so fog "
    "that is farther away is dark: expected a shape that bounds the fog, or method 'auto'"
)


@dataclass(frozen=True)
class EmitterSettings:
    """The beam settings of a scene by emitter, the sources that they make, and the number of each emitter's source."""

    beams: list[scene.BeamSettings]
    sources: list[Source]
    numbers: list[int]

    @classmethod
    def of(cls, plugin: Any, given: Mapping[str, scene.BeamSettings]) -> EmitterSettings:
        """Return the settings `given` by the names of emitters, as in `scene_frame.Extras`."""
        usual = given.get("", scene.BeamSettings())
        emitters = [names_of(each) for each in plugin.emitters()]
        for name in given:
            if name and not any(name in names for names in emitters):
                known = ", ".join(dict.fromkeys(names[-1] for names in emitters if names))
                expected = f"expected one of {known}" if known else "none of its emitters has an id"
                raise scene.SceneError(f"the scene has no emitter '{name}': {expected}")
        beams = [next((given[name] for name in names if name in given), usual) for names in emitters]
        different = list({id(each): each for each in beams}.values()) or [usual]
        numbers = [next(place for place, each in enumerate(different) if each is own) for own in beams]
        sources = []
        for place, each in enumerate(different):
            name = next((names[-1] for names, own in zip(emitters, numbers, strict=True) if own == place and names), "")
            own = Source(place, name, each.group, each.look, each.emits_beams, each.beam_scale, each.scattered)
            sources.append(replace(own, bounces=each.bounces))
        return cls(beams, sources, numbers)

    def free(self, settings: Settings) -> list[int]:
        """Return the numbers of the emitters whose light walks may meet: those without settings of their own."""
        if settings.method == "beams" or settings.program is not None or settings.short or not settings.surfaces:
            return []
        return [
            number for number, own in enumerate(self.beams) if own == scene.BeamSettings(group=own.group)
        ]  # fmt: skip

    def with_caustics(self, emitters: Collection[int]) -> tuple[list[Source], list[int]]:
        """Return sources and their numbers, with separate sources for emitters whose paths count only as caustics."""
        sources, numbers = list(self.sources), list(self.numbers)
        for old in dict.fromkeys(numbers[each] for each in emitters):
            for each in emitters:
                if self.numbers[each] == old:
                    numbers[each] = len(sources)
            sources.append(replace(self.sources[old], number=len(sources), caustics=True))
        return sources, numbers

    @property
    def named(self) -> bool:
        """Whether beams carry the data that only looks and programs read."""
        first = self.sources[0]
        return len(self.sources) > 1 or first.look is not None or first.beam_scale != 1


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
    """The light of a scene for each choice of the emitters that walks meet.

    Attributes
    ----------
    world, own
        The scene, and the settings of its emitters.
    settings
        How it is rendered.
    cameras
        Cameras toward which light paths are guided; without any they are not guided.
    findings
        Results of pilots that are known already; new ones are added.
    """

    world: SceneWorld
    own: EmitterSettings
    settings: Settings
    cameras: Sequence[View]
    findings: Findings

    @cached_property
    def _placed(self) -> EnvironmentPortal | None:
        """The planar portal that the user has placed before the environment, or None."""
        environment = self.world.plugin.environment()
        lamp = None if environment is None else self.world.emitters[self.world.plugin.emitters().index(environment)]
        if lamp is None or lamp.portal is None or lamp.portal.sides is None:
            return None
        return EnvironmentPortal(self.world.plugin, lamp.portal)

    @property
    def portal(self) -> EnvironmentPortal | None:
        """The portal before the environment, placed by the user or fitted; or None."""
        return self.findings.portal if self._placed is None else self._placed

    def light(self, walked: Sequence[int], dark: Collection[int] = ()) -> Light:
        """Return the light of which walks meet some emitters, by their numbers; emitters that are `dark` have none."""
        settings, max_depth = self.settings, self.settings.depth()
        tuning = tuning_of(settings, max_depth)
        sharp = {each for each in walked if self.world.mirrors and is_sharp(self.world.plugin.emitters()[each])}
        world = self.world.with_sources(*self.own.with_caustics(sorted(sharp)))
        without = frozenset({*dark, *(each for each in walked if each not in sharp)})
        allotment = Allotment(settings.beams or DEFAULT_PATHS, shared=True, past=None, without=without)
        simulation = Simulation(tuning, allotment, named=self.own.named)
        simulation = replace(simulation, guides=self._guides(simulation, world, (tuple(walked), frozenset(dark))))
        groups = [self.own.sources[each].group for each in self.own.numbers]
        power = {each: float(max(PathEmitter(world, each).flux)) for each in walked}
        walks = {}
        for group in dict.fromkeys(groups[each] for each in walked):
            numbers = [each for each in walked if groups[each] == group]
            emitters = WalkedEmitters(world, numbers, [power[each] for each in numbers], sharp, self.portal)
            walks[group] = Walking(emitters, max_depth, tuning.rr_depth)
        paths = sum(each.count for each in simulation.strata(world))
        return Light(
            StillWorld(world), simulation, settings, max_depth, paths,
            varies=paths > 0, walks=walks, portal=self.portal,
        )  # fmt: skip

    def _guides(
        self, simulation: Simulation, world: SceneWorld, asked: tuple[tuple[int, ...], frozenset[int]]
    ) -> Guides:
        """Return the guides of light paths, which a pilot finds if they are not known."""
        if self.settings.guiding is False or not self.cameras:
            return UNGUIDED
        if asked not in self.findings.guides:
            pilot = replace(simulation, tuning=replace(simulation.tuning, seed=0))  # the result holds for all seeds
            # For whole pictures; otherwise a crop would differ from the same part of the whole picture.
            guides = pilot.guided(world, [each.whole().projection for each in self.cameras]).guides
            for stratum in pilot.strata(world):
                opening = guides.openings.get(stratum.name)
                if opening is not None and stratum.emitter.lamp.bare.emitter == world.plugin.environment():
                    self.findings.portal = EnvironmentPortal(world.plugin, opening.portal)
            self.findings.guides[asked] = guides
        return self.findings.guides[asked]

    def walked(self, pixels: Pixels, statistics: Statistics) -> Sequence[int]:
        """Return the numbers of the emitters whose light walks should meet, for passes of these pixels."""
        free = self.own.free(self.settings)
        if self.settings.method != "auto" or not free:
            return free
        if self.findings.walked is None:
            with statistics.phase("choose"):
                pilot = replace(self, settings=replace(self.settings, seed=0))  # the result holds for all seeds
                self.findings.walked = preferred(pilot, free, pixels)
        return self.findings.walked


def light_of(
    plugin: Any, eye: Place, settings: Settings, beams: Mapping[str, scene.BeamSettings], cameras: Sequence[View],
    pixels: Pixels, warned: set[str] | None, statistics: Statistics, findings: Findings | None = None,
) -> Light:  # fmt: skip
    """Return the light of a Mitsuba scene.

    Parameters
    ----------
    plugin, eye
        The scene, and the place where camera paths begin.
    settings
        How it is rendered.
    beams
        As in `scene_frame.Extras`.
    cameras, findings
        As in `Lights`.
    pixels
        The camera paths of a pass of the whole picture.
    warned
        Texts of warnings that have been given already.
    statistics
        Statistics to which the time for this is added.

    Raises
    ------
    SceneError
        If something in the scene cannot be rendered, or beams are set for an emitter that does not exist.
    """
    warned = set() if warned is None else warned
    with statistics.phase("build"):
        own = EmitterSettings.of(plugin, beams)
        world = SceneWorld(plugin, eye, own.sources, own.beams, own.numbers)
        if settings.short:
            world.media.all = tuple(each.for_short_beams() for each in world.media.all)
    warn(plugin, world.surroundings, warned)
    lights = Lights(world, own, settings, cameras, Findings() if findings is None else findings)
    walked = lights.walked(pixels, statistics)
    _tell(world, walked, warned)
    with statistics.phase("guide"):
        return lights.light(walked)


def _tell(world: SceneWorld, walked: Sequence[int], warned: set[str]) -> None:
    """Say which emitters' light walks find, and warn of emitters whose beams do not reach all fog."""
    log = logging.getLogger("photonbeams")
    names = [(names_of(each) or [each.class_name()])[-1] for each in world.plugin.emitters()]
    dark = [names[each] for each in world.short_of_fog(set(range(len(names))) - set(walked))]
    if dark and (text := _DARK_FOG.format(", ".join(dark[:3]), world.radius)) not in warned:
        warned.add(text)
        log.warning("%s", text)
    if walked:
        found = ", ".join(dict.fromkeys(names[each] for each in walked))
        log.info("paths from the camera find the light of %s", found)
