"""Read USD stages, write beams to them, and define the schemas of photonbeams."""
