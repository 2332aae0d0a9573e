"""Evaluate shader nodes: links, values at points, textures of noise, skies, and mixtures of surfaces."""
