"""Groups of flags, each in a module of its own."""
