"""Photon beams, curved beams, and functions that change or make beams."""

from .beams import Beams

__all__ = ["Beams"]
