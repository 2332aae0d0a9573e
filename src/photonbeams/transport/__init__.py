"""Light paths: emission, guiding, interactions, radii, and the beams that they leave."""
