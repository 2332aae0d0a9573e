"""The radiance of beams along camera rays: billboard (1D), frustum (2D) and their blend, for rays and images."""

from ..constants import ESTIMATORS
from .estimate import estimate

__all__ = ["ESTIMATORS", "estimate"]
