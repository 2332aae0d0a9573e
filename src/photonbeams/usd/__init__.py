"""USD stages in, beams out, and the schemas."""
