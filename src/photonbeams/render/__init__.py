"""One frame: camera rays, surfaces through fog, passes and layers."""
