"""The radiance of beams along camera rays: billboard (1D), frustum (2D) and their blend, for rays and images."""

from .estimate import ESTIMATORS, estimate

__all__ = ["ESTIMATORS", "estimate"]
