"""Stages as Mitsuba scenes."""
