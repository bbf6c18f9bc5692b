"""Thresholds of simulations, each with its reason."""

SAFETY = 0.03
"""Tolerance of a step over the error wanted of the motion. Errors of steps accumulate and the
interpolant adds its own; this factor keeps the result within 10 rtol (tests/test_simulate.py)."""
STIFF = 3000.0
"""Load-point path over A/K (spring relaxations) above which the stiff method is faster."""
STABLE = 2.5
"""Rate of the fastest change times the longest step of a slider. Tsit5 is stable to 3.3 for real
rates."""
AXIS_STEP = 0.5
"""The same of an axis, whose method is stable to 2.8; in a fit the rate may double."""
LEAST_TRIED, SPEEDS_TRIED, ROWS_TRIED = 1e-3, 40, 64
"""Least speed over the width of the smoothed sign, number of speeds and of rows of the motion, at
which the rate of an axis is computed."""
MOST_SUBSTEPS = 4096
"""Largest number of steps per sample of an axis; a record of 20,000 rows then takes seconds."""
SHRINK, GROW, CAUTION = 0.2, 10.0, 0.9
"""Least and largest factor between the lengths of two steps, and the share of the length at which
the estimated error would equal its tolerance."""
SMALL = 0.01
"""Largest first step, over the spring's relaxation time."""
ROUNDINGS = 8
"""Length of the shortest steps, in roundings of time."""
FOLLOWS = 3e-4
"""Bound of (T/t_s)^2 t_m/t_s, the error of a velocity that follows a small mass
(`SliderEquation._following`)."""
ROWS = 32
"""Steps of a segment for few samples."""
SAMPLES_EACH, MOST_PARTS = 256, 16
"""A segment gets `ROWS` more steps for every 256 samples, up to 16 times `ROWS`."""
FEWEST_PARTS = 4
"""Least multiple of `ROWS` without derivatives: longer segments evaluate the interpolant less."""
FAN = 16
"""Segments, or groups of them, in one scan, all skipped by one condition."""
BLOCK = 256
"""Rows of a block: with 24 derivatives, each scalar of a row takes 49 kB a block."""
CLOSED_FORM = 5
"""Up to this number of equations the inverse of a matrix is unrolled."""
NODES = 16
"""Points in one step of a delay. More steps are cheaper than more points: linear algebra costs
their cube."""
COLLOCATION_STEPS = 12
"""Largest number of Newton steps for these points."""
ORDERS = 2
"""Highest order of exact derivatives of these points: one more Newton step each."""
