"""What passes cost, reckoned from counts: no clock is asked, and a scene has the same picture on every machine."""

from __future__ import annotations

# In microseconds of a processor core: light paths at all, each beam or photon, each beam and pixel, and the walks of a
# pixel. Six scenes at two sizes are within a factor of two or three of that.
TRACING, RECORD, TEST, WALK = 2e5, 15.0, 1e-3, 3.0

# Beams and photons of a light path, as they usually are, and what surfaces and walks of a pixel's sample cost.
_RECORDS, _SAMPLE = 2.0, 2.0

# Samples that surfaces have in each pixel of a pass cost at most this part of what its beams do. There are no more than
# so many: from there on, the beams' own noise is most of what is left.
_SHARE, _MOST = 0.5, 16

#: Rays that are followed at once: enough that what is done once for all of them hardly counts.
LANES = 1 << 19


def of_beams(records: float, beams: float, pixels: int) -> float:
    """Return the cost of a pass with so many beams and photons, of which `beams` are tested against pixels."""
    return TRACING + RECORD * records + TEST * beams * pixels


def surface_samples(paths: int, pixels: int) -> int:
    """Return how many samples surfaces have in each pixel of a pass of so many light paths, a power of two.

    Without light paths it is one: then passes cost no more than samples.
    """
    if not paths:
        return 1
    affordable = _SHARE * of_beams(_RECORDS * paths, _RECORDS * paths, pixels) / (_SAMPLE * pixels)
    return power_below(int(min(affordable, _MOST)))


def power_below(most: int) -> int:
    """Return the greatest power of two that is at most a number, and 1 where that is less."""
    return 1 << (max(most, 1).bit_length() - 1)
