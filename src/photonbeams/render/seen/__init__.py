"""What the rays of a frame see beside light: first surfaces, layers of a holdout, and where along the rays beams are."""
