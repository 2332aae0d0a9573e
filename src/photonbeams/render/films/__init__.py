"""Films: sums over passes, and layers."""
