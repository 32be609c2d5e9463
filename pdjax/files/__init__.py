"""Files of bodies and results for other programs."""
