"""Where beams come from: lights, portals, and the paths that light takes to the first surface."""

from .trace import BeamSet, trace

__all__ = ["BeamSet", "trace"]
