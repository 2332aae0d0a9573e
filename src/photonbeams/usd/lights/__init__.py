"""Lights of stages."""
