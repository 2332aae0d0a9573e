"""Light transport through any Mitsuba scene: light paths as photon beams, and camera paths that meet them."""
