"""Media of stages."""
