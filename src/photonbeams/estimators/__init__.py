"""What a camera ray sees of beams: billboard (1D), frustum (2D), and their blend, for any rays and for whole images."""

from .estimate import ESTIMATORS, estimate

__all__ = ["ESTIMATORS", "estimate"]
