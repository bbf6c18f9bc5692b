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
