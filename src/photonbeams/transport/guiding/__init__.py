"""What a pilot finds out about emission: maps of samples, fitted portals, numbers of light paths."""
