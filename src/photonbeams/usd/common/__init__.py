"""What all readers of stages share."""
