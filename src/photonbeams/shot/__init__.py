"""Shots: a stage or a Mitsuba scene with a camera, rendered into frames."""

from ..images.frame import Frame
from ..images.plates import Holdout, Plate
from ..usd.cameras.stereo import Stereo
from .shot import Shot

__all__ = ["Frame", "Holdout", "Plate", "Shot", "Stereo"]
