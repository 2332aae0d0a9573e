"""One frame of a shot: camera rays, surfaces through fog, passes, layers."""
