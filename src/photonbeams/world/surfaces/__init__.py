"""Surfaces that rays meet."""
