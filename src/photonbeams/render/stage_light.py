"""The light of a stage: its worlds over the shutter interval, and light paths toward what its cameras see."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

from .. import scene
from ..transport.guiding.lines import LightLines
from ..transport.simulation import Simulation
from ..transport.strata import Allotment
from ..world.cameras.cameras import View, Window
from ..world.shutter import Shutter
from ..world.world import World
from .light import ShotLight, tuning_of
from .passes import Statistics
from .pilots.pilot import Findings, Pilot
from .settings import Settings
from .techniques import SEGMENTS
from .worlds import ShutterWorlds

LOG = logging.getLogger("photonbeams")


class Earlier(Protocol):
    """An earlier frame of the same shot, parts of which may be used again.

    Attributes
    ----------
    worlds
        Its worlds.
    light_side
        Names of the lights that are seen past their portals; None: they have to be found again.
    """

    worlds: Sequence[World]
    light_side: frozenset[str] | None

    def findings(self, world: World, light_side: frozenset[str]) -> Findings | None:
        """Return what the earlier frame's pilots found; None if it has to be found again.

        `light_side` are the names of the lights that this frame sees past their portals.
        """


def light_of_stage(
    shutter: Shutter, window: Window, settings: Settings, statistics: Statistics,
    viewers: Callable[[], Sequence[scene.Camera]] | None = None, planned: int | None = None,
    all_beams: bool = False, earlier: Earlier | None = None,
) -> tuple[ShotLight, ShutterWorlds]:  # fmt: skip
    """Return the light of a stage, and its worlds.

    Parameters
    ----------
    shutter, window
        The scene and cameras over the shutter interval, and the size of the picture with its crop.
    settings
        Passes, light paths, seed.
    statistics
        Statistics to which the time for this is added.
    viewers
        Returns the cameras of all frames, for which emission is guided; None: the cameras of this frame.
    planned
        How many passes share the shutter interval; further passes begin it again. None: the number is not known.
    all_beams
        Whether beams are made even if no medium and no look shows them.
    earlier
        An earlier frame of the same shot.
    """
    if SEGMENTS in settings.without:
        shutter = shutter.with_scenes(_without_skies)
    opened, usual = shutter.at(0.0), settings.beams or scene.DEFAULT_BEAMS
    max_depth = settings.depth(2 + opened.scene.bounces)
    worlds = ShutterWorlds(shutter, max_depth != 2, planned, () if earlier is None else earlier.worlds)
    with statistics.phase("build"):
        light_side = _seen_past_portals(worlds, window, None if earlier is None else earlier.light_side)
    simulation = Simulation(tuning_of(settings, max_depth, all_beams), Allotment(usual, past=light_side))
    counts = [usual if light.beam_count is None else light.beam_count for light in opened.scene.lights]
    paths = sum(counts) + sum(len(each.start) for each in opened.scene.drawn)
    known = None if earlier is None else earlier.findings(worlds.opened, light_side)
    findings = Findings() if known is None else known
    cameras = [View(camera, window) for camera in (viewers() if viewers else opened.cameras)]
    with statistics.phase("guide"):
        return Pilot(worlds, settings, max_depth, simulation, cameras, findings, paths).light(), worlds


def _without_skies(content: scene.Scene) -> scene.Scene:
    """Return a scene whose domes make beams, if they light media."""
    changed = {id(each): replace(each, emits_beams=True, lights_media=False) for each in content.sky}
    return replace(content, lights=tuple(changed.get(id(each), each) for each in content.lights))


def _seen_past_portals(worlds: ShutterWorlds, window: Window, known: frozenset[str] | None) -> frozenset[str]:
    """Return the names of lights that cameras see past their portals; warn of those in overscan alone."""
    result, beyond, inside = known or frozenset(), set[str](), window.inside()
    for moment in worlds.shutter.ends(0.0, 1.0):
        world = worlds.at(moment)
        for camera in moment.cameras:
            view = View(camera, window)
            if known is None:
                result |= LightLines(world, view.whole().projections).seen_past_portals()
            if inside != (0, 0, *window.shape[::-1]):
                beyond |= LightLines(world, view.projections).seen_past_portals()
    for name in sorted(beyond - result):
        LOG.warning("%s is seen before its portal in overscan alone, where its beams are left out", name)
    return result
