"""Segments of light paths, and the beams that they become."""
