"""Looks of beams on stages."""
