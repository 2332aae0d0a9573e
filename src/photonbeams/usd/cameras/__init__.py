"""Cameras of stages."""
