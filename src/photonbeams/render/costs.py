"""The cost of passes, computed from counts: no clock is read, so a scene has the same picture on every machine."""

from __future__ import annotations

# In microseconds of a processor core: tracing any light paths, each beam or photon, each pair of beam and pixel, the
# same where beams are gathered along fewer rays than pixels, and the walks of a pixel. For six scenes at two sizes
# these are right within a factor of two or three.
TRACING, RECORD, TEST, FEWER_TESTS, WALK = 2e5, 15.0, 1e-3, 2e-4, 3.0

# Usual number of beams and photons of a light path, and the cost of surfaces and walks for a sample of a pixel.
_RECORDS, _SAMPLE = 2.0, 2.0

# The samples of surfaces in a pass cost at most this fraction of what its beams cost. The fraction is larger if walks
# begin there, because then most of the noise is theirs. Without a plan, a pixel has no more than so many: beyond that
# number, most of the remaining noise is the beams' own.
_SHARE, _SHARE_WALKED, _MOST = 0.5, 1.0, 16

#: Rays that are followed at once: so many that work done once for all of them hardly counts.
LANES = 1 << 19


def of_tracing(paths: int) -> float:
    """Return the cost of so many light paths, whose beams are not tested."""
    return of_beams(_RECORDS * paths, 0, 0)


def of_sample(walked: bool) -> float:
    """Return the cost of a sample of surfaces; `walked` says whether walks begin there."""
    return _SAMPLE + WALK if walked else _SAMPLE


def of_beams(records: float, beams: float, pixels: int, coarse: float = 0.0) -> float:
    """Return the cost of a pass with this many `records`, beams and photons, of which `beams` are tested.

    Of these, `coarse` ones are gathered along fewer rays than pixels.
    """
    return TRACING + RECORD * records + (TEST * (beams - coarse) + FEWER_TESTS * coarse) * pixels


def surface_samples(paths: int, pixels: int, walked: bool = False) -> int:
    """Return how many samples of surfaces a pixel has in a pass of this many light `paths`: the nearest power of two.

    Without light paths it is one: then a pass costs no more than a sample. `walked` says whether walks begin there.
    """
    if not paths:
        return 1
    share = _SHARE_WALKED if walked else _SHARE
    affordable = share * of_beams(_RECORDS * paths, _RECORDS * paths, pixels) / (of_sample(walked) * pixels)
    return power_below(int(min(2**0.5 * affordable, _MOST)))


def power_below(most: int) -> int:
    """Return the greatest power of two that is at most `most`, and at least 1."""
    return 1 << (max(most, 1).bit_length() - 1)
