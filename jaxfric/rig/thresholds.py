"""Constants of rigs that are chosen, not derived, with the reason for each."""

LOG_MAX = 40.0
"""Largest logarithm of a velocity ratio, which keeps a solver's trial steps finite."""
NEAR_ZERO = 1e-12
"""Lower bound on the base of a power: at 0 the power may have no derivative."""
NEWTON_STEPS = 4
"""Newton steps from a near start: each doubles the digits, from one to all of a double."""
MOST_NEWTON_STEPS = 60
"""Most Newton steps from a far start, which is at most `LOG_MAX` e-folds away."""
SHARP = 1e-12
"""Width [m/s or rad/s] of a smoothed sign that is sharp at any speed of an axis."""
SIGN_WIDTH = 1e-3
"""Width of the smoothed sign over the lowest speed of a table: exact at all speeds of the table."""
KNOTS = 1024
"""Most knots of a recorded normal stress: more follow the noise of its gauge, and mean the same."""
FEWEST_ROWS = 5
"""Fewest rows of a recorded normal stress, and fewest of its intervals."""
KNOTS_OF_BLOCK = 64
"""Knots of a block: an interval is found by its block first, with few comparisons."""
SERIES = 0.1
"""Largest x of the power series of (1 - exp(-x))/x: its second derivative is exact to 1e-13 there.
"""
