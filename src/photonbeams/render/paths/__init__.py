"""Camera paths and what lights their vertices."""
