"""The light of a Mitsuba scene, pass by pass: of some emitters as beams and photons, of others by walks.

Emitters without settings of their own are assigned by `method`. If walks meet an emitter, they find all of its light
except caustics, which is light that a mirror or glass turns before anything else. The caustics of emitters that look
small from a point are traced from the emitter, and walks leave them out. Wide emitters, such as skies, are met behind
glass as well as anywhere else.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from .. import scene
from ..constants import DEFAULT_PATHS
from ..numerics.samples import Samples
from ..runtime.device import mitsuba
from ..transport.emission import Stratum
from ..transport.fitted_portals import Opening, parted
from ..transport.guiding import GuidingMap
from ..transport.scene_emitters import emission_of, power_of, redistribute
from ..transport.simulation import Simulation
from ..transport.tuning import Tuning
from ..world.cameras.cameras import View
from ..world.emitters.mitsuba_scene import names_of
from ..world.emitters.portal_lamps import EnvironmentPortal
from ..world.emitters.sources import Source
from ..world.media.discovery.surroundings import Place
from ..world.media.discovery.warnings import warn
from ..world.scene_world import SceneWorld
from ..world.world import World
from .choice import Pixels, is_sharp, preferred
from .light import TracedLight, tuning_of
from .passes import Statistics
from .paths.camera_paths import Lighting
from .paths.scene_lighting import SceneLighting
from .paths.walks import WalkedEmitters, Walking
from .settings import Settings

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

    def as_caustics(self, emitters: Collection[int]) -> EmitterSettings:
        """Return the same settings, with separate sources for emitters whose light paths count only as caustics."""
        sources, numbers = list(self.sources), list(self.numbers)
        for old in dict.fromkeys(numbers[each] for each in emitters):
            for each in emitters:
                if self.numbers[each] == old:
                    numbers[each] = len(sources)
            sources.append(replace(self.sources[old], number=len(sources), caustics=True))
        return replace(self, sources=sources, numbers=numbers)

    @property
    def named(self) -> bool:
        """Whether beams carry the data that only looks and programs read."""
        first = self.sources[0]
        return len(self.sources) > 1 or first.look is not None or first.beam_scale != 1


class Guidance(NamedTuple):
    """How an emitter's light is guided: its fitted portal, and for each stratum a guiding map and a number of paths."""

    opening: Opening | None
    maps: list[GuidingMap | None]
    counts: list[int]


@dataclass
class Findings:
    """Results of pilots for a scene, a view and settings. They do not depend on the seed.

    Attributes
    ----------
    walked
        The numbers of the emitters whose light walks should meet; None: not known yet.
    guides
        Guidance of each stratum, by the emitters that walks meet and the emitters that are dark.
    portal
        The portal that was fitted to the light of the environment, or None.
    """

    walked: list[int] | None = None
    guides: dict[tuple[tuple[int, ...], frozenset[int]], list[Guidance]] = field(default_factory=dict)
    portal: EnvironmentPortal | None = None


class SceneLight:
    """The light of some emitters of a scene; walks meet some of them, the others send light paths.

    Parameters
    ----------
    world, own
        The scene, and the settings of its emitters.
    walked, dark
        The numbers of the emitters that walks meet, and of the emitters without light here.
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
        """The portal before the environment, placed by the user or fitted; or None."""
        return self._findings.portal if self._placed is None else self._placed

    @property
    def walks(self) -> dict[str, Walking]:
        """The walks that meet the light of emitters, by light group."""
        portal = self.portal
        return {name: replace(each, emitters=each.emitters.behind(portal)) for name, each in self._walks.items()}

    def with_paths(self, strata: Sequence[Stratum]) -> SceneLight:
        """Return the same light with other light paths."""
        result = copy(self)
        result._sent(strata)
        return result

    def guide(self, cameras: Sequence[View]) -> list[Guidance]:
        """Guide light paths toward what cameras see, and return the guidance of each stratum."""
        strata = self.simulation.emission.strata
        if not cameras or not strata:
            return [Guidance(None, [each.guide], [each.count]) for each in strata]
        # For whole pictures; otherwise a crop would differ from the same part of the whole picture.
        found = self.simulation.guide([each.whole().projection for each in cameras])
        for stratum, each in zip(strata, found, strict=True):
            if each.opening is not None and stratum.emitter.lamp.bare.emitter == self.world.plugin.environment():
                self._findings.portal = EnvironmentPortal(self.world.plugin, each.opening.portal)
        self._sent([stratum for each in found for stratum in each.strata])
        redistribute(self.simulation.emission.strata, np.array([own for each in found for own in each.light]))
        return [
            Guidance(each.opening, [own.guide for own in each.strata], [own.count for own in each.strata])
            for each in found
        ]

    def follow(self, guides: list[Guidance]) -> None:
        """Guide light paths by `guides` that were found for the same light with another seed."""
        sent = []
        for stratum, guide in zip(self.simulation.emission.strata, guides, strict=True):
            parts = zip(parted(stratum, guide.opening), guide.maps, guide.counts, strict=True)
            sent += [replace(part, guide=own, count=count) for part, own, count in parts]
        self._sent(sent)

    def _sent(self, strata: Sequence[Stratum]) -> None:
        emission = self.simulation.emission
        self.simulation = replace(self.simulation, emission=replace(emission, strata=strata))

    @property
    def paths(self) -> int:
        """The number of light paths in a pass."""
        return self.simulation.emission.count

    @property
    def varies(self) -> bool:
        """Whether passes differ in more than the samples of camera paths."""
        return bool(self.simulation.emission.strata)

    def traced(self, number: int, step: Callable[[], None]) -> TracedLight:
        """Return the beams and photons of pass `number`; `step` is called between parts of the pass."""
        limits = self.simulation.tuning.limits(number, self.world.radius)
        return TracedLight(self.world, *replace(self.simulation, step=step).simulated(number), limits)

    def lighting(self, world: World) -> Lighting:
        """Return the lighting of a world."""
        assert isinstance(world, SceneWorld)
        return SceneLighting(world, self.portal)

    def single_scattering(self, world: World, count: int, samples: Samples) -> None:
        """Return None: walks find the light of skies."""

    def clock(self, number: int) -> tuple[float, float]:
        """Return (0, 0): nothing changes with time."""
        return 0.0, 0.0


def _placed_portal(world: SceneWorld) -> EnvironmentPortal | None:
    """Return the planar portal that the user has placed before the environment, or None."""
    environment = world.plugin.environment()
    lamp = None if environment is None else world.emitters[world.plugin.emitters().index(environment)]
    if lamp is None or lamp.portal is None or lamp.portal.sides is None:
        return None
    return EnvironmentPortal(world.plugin, lamp.portal)


def light_of(
    plugin: Any, eye: Place, settings: Settings, beams: Mapping[str, scene.BeamSettings], cameras: Sequence[View],
    pixels: Pixels, warned: set[str] | None, statistics: Statistics, findings: Findings | None = None,
) -> SceneLight:  # fmt: skip
    """Return the light of a Mitsuba scene.

    Parameters
    ----------
    plugin, eye
        The scene, and the place where camera paths begin.
    settings
        How it is rendered.
    beams
        As in `scene_frame.Extras`.
    cameras
        Cameras toward which light paths are guided; without any they are not guided.
    pixels
        The camera paths of a pass of the whole picture.
    warned
        Texts of warnings that have been given already.
    statistics
        Statistics to which the time for this is added.
    findings
        Results of pilots that are known already; new ones are added.

    Raises
    ------
    SceneError
        If something in the scene cannot be rendered, or beams are set for an emitter that does not exist.
    """
    findings, max_depth = Findings() if findings is None else findings, settings.depth()
    tuning = tuning_of(settings, max_depth)
    with statistics.phase("build"):
        own = EmitterSettings.of(plugin, beams)
        world = SceneWorld(plugin, eye, own.sources, own.beams)
        if settings.short:
            world.media.all = tuple(each.for_short_beams() for each in world.media.all)
    warned = set() if warned is None else warned
    warn(plugin, world.surroundings, warned)

    # Pilots have a seed of their own: their results hold for all seeds.
    pilot_settings, pilot_tuning = replace(settings, seed=0), replace(tuning, seed=0)

    @cache
    def piloted(walked: tuple[int, ...], dark: frozenset[int]) -> SceneLight:
        result = SceneLight(world, own, walked, dark, pilot_settings, pilot_tuning, max_depth, findings)
        if settings.guiding in (None, True):
            findings.guides[walked, dark] = result.guide(cameras)
        return result

    walked = own.free(settings)
    if settings.method == "auto" and walked:
        if findings.walked is None:
            with statistics.phase("choose"):
                findings.walked = preferred(world, walked, cameras[:1], pixels, piloted, pilot_settings, max_depth)
        walked = findings.walked
    names = [(names_of(each) or [each.class_name()])[-1] for each in plugin.emitters()]
    dark = [names[each] for each in world.short_of_fog(set(range(len(names))) - set(walked))]
    if dark and (text := _DARK_FOG.format(", ".join(dark[:3]), world.radius)) not in warned:
        warned.add(text)
        logging.getLogger("photonbeams").warning("%s", text)
    if walked:
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
