"""Trace the beams of stages without rendering a picture."""

from dataclasses import replace

import numpy as np

from photonbeams import scene
from photonbeams.transport.emission import Emission
from photonbeams.transport.simulation import Simulation
from photonbeams.transport.strata import Allotment
from photonbeams.transport.tuning import Tuning
from photonbeams.world.described import world_of_scene


def in_a_medium(world):
    """Return the world, filled with a vacuum medium if it has no media, because beams exist only in media."""
    if world.parts.content.media:
        return world
    bounds = np.array([float(each[0]) for each in world.bounds.center]), world.radius
    return world_of_scene(replace(world.parts.content, media=(VACUUM,), bounds=bounds), like=world)


VACUUM = scene.Medium(scene.BLACK)


def trace(world, *, beams_per_light=scene.DEFAULT_BEAMS, pass_index=0, seed=0, light_side=(), overlap=1.0, close=None,
          looks=None, max_bounces=0):  # fmt: skip
    """Return the sets of beams of a pass, with the radii of the first pass."""
    tuning = Tuning(seed, max_bounces, overlap=overlap, alpha=1.0)
    worlds = [in_a_medium(each) for each in ([world] if close is None else [world, close])]
    if close is not None and close.surfaces is world.surfaces:
        worlds[1] = world_of_scene(worlds[1].parts.content, like=worlds[0])
    simulation = Simulation(tuning, Allotment(beams_per_light, past=light_side))
    return simulation.simulated(worlds, pass_index, looks)[0]


def emission_of(world, count):
    """Return the emission of a Mitsuba scene, whose emitters share `count` light paths."""
    return Emission(Allotment(count, shared=True, past=None).strata(world, Tuning()), shared=True)
