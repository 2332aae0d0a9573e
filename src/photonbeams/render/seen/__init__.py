"""What the rays of a frame see beside light: first surfaces, layers of a holdout, and where beams are along them."""
