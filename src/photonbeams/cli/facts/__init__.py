"""What `photonbeams info` shows of stages, as rows of text."""
