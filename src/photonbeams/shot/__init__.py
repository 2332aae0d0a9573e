"""Shots: a stage or a Mitsuba scene and a camera, rendered into frames that write themselves."""

from ..images.frame import Frame
from ..images.plates import Holdout, Plate
from ..usd.stereo import Stereo
from .shot import Shot

__all__ = ["Frame", "Holdout", "Plate", "Shot", "Stereo"]
