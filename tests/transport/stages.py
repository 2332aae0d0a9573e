"""The beams of stages, without a picture."""

from photonbeams import scene
from photonbeams.transport.simulation import StageSimulation, Tuning


def trace(world, *, beams_per_light=scene.DEFAULT_BEAMS, pass_index=0, seed=0, light_side=(), overlap=1.0, close=None,
          looks=None, max_events=0):  # fmt: skip
    """Return the sets of beams of a pass whose radii are those of the first."""
    tuning = Tuning(seed, max_events, overlap=overlap, alpha=1.0)
    worlds = [world] if close is None else [world, close]
    return StageSimulation(tuning, beams_per_light, light_side).simulated(worlds, pass_index, looks)[0]
