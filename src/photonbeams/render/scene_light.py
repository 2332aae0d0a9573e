"""The light of a Mitsuba scene, and the beam settings of its emitters."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from .. import scene
from ..constants import DEFAULT_PATHS
from ..runtime.device import mitsuba
from ..transport.simulation import Simulation
from ..transport.strata import Allotment
from ..world.cameras.cameras import View
from ..world.emitters.filters import chain_of
from ..world.emitters.mitsuba_scene import names_of
from ..world.emitters.sources import Source
from ..world.media.discovery.surroundings import Place
from ..world.media.discovery.warnings import warn
from ..world.plugin import world_of_plugin
from ..world.world import World
from .light import ShotLight, tuning_of
from .passes import Statistics
from .pilots.pilot import Findings, Pilot
from .settings import Settings
from .techniques import FOG, WALKS
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
            mine = [emitter for emitter, number in zip(plugin.emitters(), numbers, strict=True) if number == place]
            far = all(mi.has_flag(emitter.flags(), mi.EmitterFlags.Infinite) for emitter in mine)
            sources.append(replace(own, bounces=each.bounces, filters=chain_of(each.filters, far)))
        return cls(beams, sources, numbers)

    @property
    def named(self) -> bool:
        """Whether beams carry the data that only looks and programs read."""
        first = self.sources[0]
        return len(self.sources) > 1 or first.look is not None or first.beam_scale != 1


def light_of(
    plugin: Any, eye: Place, settings: Settings, beams: Mapping[str, scene.BeamSettings], cameras: Sequence[View],
    warned: set[str] | None, statistics: Statistics, findings: Findings | None = None,
) -> ShotLight:  # fmt: skip
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
    warned
        Texts of warnings that have been given already.
    statistics
        Statistics to which the time for this is added.

    Raises
    ------
    SceneError
        If something in the scene cannot be rendered, or beams are set for an emitter that does not exist.
    """
    warned, findings = set() if warned is None else warned, Findings() if findings is None else findings
    with statistics.phase("build"):
        own = EmitterSettings.of(plugin, beams)
        world = findings.world
        if world is None or world.plugin is not plugin:
            world = world_of_plugin(plugin, eye, own.sources, own.beams, own.numbers, settings.short)
            findings = replace(findings, world=world)
    if world.surroundings is not None:
        warn(plugin, world.surroundings, warned)
    allotment = Allotment(settings.beams or DEFAULT_PATHS, shared=True, past=None)
    simulation = Simulation(tuning_of(settings, settings.depth()), allotment, named=own.named)
    with statistics.phase("guide"):
        light = Pilot(StillWorld(world), settings, settings.depth(), simulation, cameras, findings).light()
    _tell(world, [row.number for row in light.rows if row.by(WALKS, FOG)], warned)
    return light


def _tell(world: World, walked: Sequence[int], warned: set[str]) -> None:
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
