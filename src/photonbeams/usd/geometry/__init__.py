"""Geometry of stages, as triangles and polylines."""
