"""Trace the beams of stages without rendering a picture."""

from dataclasses import replace

import numpy as np

from photonbeams import scene
from photonbeams.transport.stage_simulation import StageSimulation
from photonbeams.transport.tuning import Tuning
from photonbeams.world.stage_world import StageWorld


def in_a_medium(world):
    """Return the world, filled with a vacuum medium if it has no media, because beams exist only in media."""
    if world.description.media:
        return world
    bounds = np.array([float(each[0]) for each in world.bounds.center]), world.radius
    return StageWorld.build(replace(world.description, media=(VACUUM,), bounds=bounds), like=world)


VACUUM = scene.Medium(scene.BLACK)


def trace(world, *, beams_per_light=scene.DEFAULT_BEAMS, pass_index=0, seed=0, light_side=(), overlap=1.0, close=None,
          looks=None, max_bounces=0):  # fmt: skip
    """Return the sets of beams of a pass, with the radii of the first pass."""
    tuning = Tuning(seed, max_bounces, overlap=overlap, alpha=1.0)
    worlds = [in_a_medium(each) for each in ([world] if close is None else [world, close])]
    if close is not None and close.surfaces is world.surfaces:
        worlds[1] = StageWorld.build(worlds[1].description, like=worlds[0])
    return StageSimulation(tuning, beams_per_light, light_side).simulated(worlds, pass_index, looks)[0]
