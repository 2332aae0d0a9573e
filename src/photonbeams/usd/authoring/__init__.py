"""Changes of stages, and stages written."""
