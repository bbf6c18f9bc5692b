"""Constants of effects that are chosen, not derived, with the reason for each."""

SHORTEST_LAG, STIFF = 0.4, 4.0
"""The filter of a frictional delay has the time constant c = 0.4/(1 + K L/(4 A)) crossings, because
the slider itself responds within A/(K V). Half this c costs twice the steps."""
STATE_SCALE = 0.01
"""Scale of the delay's states relative to A: it reduces their weight in the solver's error."""
AHEAD = 0.25
"""A negative delay, which occurs only in trials of a fit, acts logarithmically beyond this many
crossings."""
LEAP_MAX = 10.0
"""Largest logarithm of a velocity's leap over its delayed value."""
LEAST_WAVES = 1.5
"""Least travel, in wavelengths, that determines a wavelength."""
DAMPING_FELT = 0.1
"""Damping force over bristle force above which a negative damping is unphysical."""
CUT_OFF = 1e-3
"""Below this share of the lowest speed, a cut-off velocity only shifts Coulomb friction."""
