"""Bounds and names that the command's help tells; NumPy is not imported here, since it would slow down the help."""

DEFAULT_BEAMS = 4096  # per pass, for each light that does not set a number

DEFAULT_PATHS = 1 << 14  # light paths in a pass of a Mitsuba scene

MOST_BEAMS = 100_000_000  # that a light may ask for

MOST_PIXELS = 65536  # of a picture, along each side

#: A rule is unrolled into the kernel that uses it, so its size is limited; 64 Gauss points already count as converged.
MOST_POINTS = 256

DEFAULT_POINTS = 6  # of the quadrature: those that a production needed at most (Talk, section 3)

#: How a beam's radiance is estimated: as a flat billboard (1D), in its frustum (2D), or by a blend of both.
ESTIMATORS = ("auto", "billboard", "frustum")

#: Pixel filters, by Mitsuba's names.
FILTERS = ("box", "tent", "gaussian", "mitchell", "catmullrom", "lanczos")
