"""Arrays, hashes and sample sequences in Dr.Jit."""
