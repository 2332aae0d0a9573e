"""Files and layers of stages."""
