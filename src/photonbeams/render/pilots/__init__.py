"""Pilots: a few passes along a coarse grid of rays, whose noise tells how a frame is best rendered."""
