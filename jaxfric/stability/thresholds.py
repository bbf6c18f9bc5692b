"""Thresholds of linear stability, each with its reason."""

SURE = 2.0
"""Least distance of a slope, or of A - B, from zero, in standard errors."""
FALSE_ALARM = 0.01
"""Probability of finding runs above a correct curve at low speed."""
FEWEST = 6
"""Least number of runs for the test of the slowest ones."""
LARGEST_SHARE = 0.5
"""Largest share of the runs that may be called slow."""
PADE = 4
"""Order of the approximant of exp(-T s): its phase error is 8e-4 rad at w T = 3."""
DELAY_POLES = 9
"""Poles of a delay slider that a root locus shows."""
FREQUENCIES, BEYOND_MEMORY = 257, 30.0
"""Frequencies at which the largest Re G(i w) is searched, and the factor by which they extend
beyond those of the kernel."""
UNRESOLVED, SPLIT = 1e-6, 0.05
"""Largest share of int |g| dt in the last two Legendre coefficients of the panels of a kernel, and
the part of it above which panels are split."""
MOST_PANELS = 4096
"""Panels of a kernel are split up to this number."""
LATE, NEGLECTED = 0.9, 1e-4
"""Largest |g| after the first share of the horizon, times the horizon, as a share of int |g| dt.
This is about the share of a kernel ~ 1/t^2 that lies beyond the horizon."""
BEYOND_KERNEL = 1e3
"""Factor by which the search for critical frequencies extends beyond those of the kernel."""
POINTS, BEYOND = 2048, 1e2
"""Frequencies at which a loop that is not rational is searched, about one per cent apart, and the
factor by which they extend beyond those of kernel and plant."""
CROSSINGS, MINIMA = 64, 4
"""Crossings that are kept, lowest frequency first, and minima that are refined."""
REFINEMENTS = 16
"""Rounds in which a grid of frequencies is refined."""
BISECTIONS, MET = 100, 1e-6
"""Largest number of steps to a zero, and the largest value there over that at the grid's points: at
a jump the value stays as large."""
AT_LIMIT = 1e-12
"""Angle of L from -1 that is only rounding [rad]."""
LEAST_SLOPE = 1e-7
"""Least slope over ln w at which a crossing has a derivative; below it rounding dominates."""
WORSE = 1e-12
"""Relative rise by which a refined minimum may exceed its start, from rounding."""
MAX_ITERATIONS = 60
"""Largest number of Aberth's steps."""
NEARLY = 0.02
"""The iteration is of third order: after a change below this share of the cube root of the rounding
unit (1e-7 in double, 1e-4 in single precision) one more step is exact to rounding."""
REAL = 1e-6
"""A root of a polynomial in w^2 counts as real if |imaginary part|/|root| is below this."""
SPREAD = 140.0
"""Roots may differ from the root of middle size by this number/n decades: squares of polynomials
must not overflow."""
LARGEST = 1e40
"""Roots in w^2 above this are crossings at infinity."""
TINY = 1e-300
"""Replaces a divisor of 0."""
INFINITE = 1e150
"""Represents infinity; its square does not overflow."""
ROUNDINGS = 100
"""Relative change of an equation's terms that counts as rounding, in rounding units: 2e-14."""
