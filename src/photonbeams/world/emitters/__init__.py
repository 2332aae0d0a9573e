"""Emitters of light."""
