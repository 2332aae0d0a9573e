"""What the rays of a frame see beside light: the first surfaces, and where along the rays beams are."""
