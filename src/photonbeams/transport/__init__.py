"""Light paths: emission, guiding, interactions, radii, and the beams that paths leave."""
