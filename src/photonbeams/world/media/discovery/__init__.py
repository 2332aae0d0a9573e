"""Which medium is where in a Mitsuba scene, where nobody says."""
