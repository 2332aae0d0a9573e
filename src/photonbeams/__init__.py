"""Volumetric light as photon beams, with programmable looks and Gaussian quadrature."""

from . import device

# Dr.Jit loads libLLVM while it is imported, so the library must be chosen now: the user's next line may import Mitsuba.
device.prepare()
