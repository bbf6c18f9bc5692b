"""Linear stability of steady sliding: plant and kernel, theorem, delays, margins."""
