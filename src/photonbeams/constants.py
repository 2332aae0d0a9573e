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

#: The depth's layer, layers of other numbers that are no colours, and the beginning of the names of cryptomattes.
DEPTH_LAYER, NUMBER_LAYERS, CRYPTO = "depth", ("depth", "normal", "position", "motion"), "crypto_"

#: The layers that are made on request, by the settings that ask for them.
REQUESTED = {
    "normals": ("normal",),
    "albedo": ("albedo",),
    "positions": ("position",),
    "motion": ("motion",),
    "crypto_object": ("crypto_object00", "crypto_object01", "crypto_object02"),
    "crypto_material": ("crypto_material00", "crypto_material01", "crypto_material02"),
}

#: Pixel filters, by Mitsuba's names.
FILTERS = ("box", "tent", "gaussian", "mitchell", "catmullrom", "lanczos")


def is_number(layer: str) -> bool:
    """Return whether a layer holds numbers rather than colours, so that it makes no picture."""
    return layer in NUMBER_LAYERS or layer.startswith(CRYPTO)


def layers_named(name: str) -> tuple[str, ...]:
    """Return the layers that a user means by a name: that of a cryptomatte stands for all of its layers."""
    return REQUESTED[name] if name.startswith(CRYPTO) and name in REQUESTED else (name,)
