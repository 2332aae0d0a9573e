"""Media that rays pass."""
