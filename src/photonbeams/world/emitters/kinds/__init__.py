"""The kinds of lamps, a file each."""
