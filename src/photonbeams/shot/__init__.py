"""Shots: USD in, EXR out. `Shot` opens a stage, renders frames of it, and the frames write themselves."""

from .plates import Holdout, Plate
from .rendered import Frame
from .shot import Shot
from .stereo import Stereo

__all__ = ["Frame", "Holdout", "Plate", "Shot", "Stereo"]
