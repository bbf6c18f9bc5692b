"""Thresholds of the loop, each with its source. Tables and figures mark some of the thresholds."""

import math

from ..records.rows import MIN_ROWS

ACCEPT = 10.0
"""Reduction of BIC that accepts an effect, or rules out a curve of another shape.

10 is "very strong" evidence (Kass and Raftery 1995, doi:10.1080/01621459.1995.10476572).
"""
TIE = 2.0
"""Difference of BIC that is no evidence: among models within it, the first of the catalogue is
kept. A larger reduction that is not accepted is a hint."""
ALIAS = 0.95
"""|cosine| of sensitivities above which two effects are indistinguishable to first order."""
SIGNIFICANT = 0.01
"""Significance level: chance that any test of a residual of noise alone is significant."""
FAR = 1.5
"""Held-out error over noise above which the remaining misfit is large."""
HELD_OUT = 1.06
"""Held-out error over noise that a good model is always allowed."""

TRAIN_FLOOR = 1.04
"""Train error over noise that a good model is always allowed, after the fit of its parameters."""
ASKED = 12
"""Approximate number of tests of a residual (`residual_tests.asked`), for Bonferroni."""
EDGE = 1.1
"""K/K_cr below which a small misfit of the law looks like a large effect."""

BEYOND = 2.0
"""Multiple of the record's path or duration above which a length or time is undetermined."""
FAR_VELOCITY = 30.0
"""Factor below or above all velocities of a record beyond which a velocity is undetermined."""
KNOWN, LOST = 4.0, 2.0
"""Standard errors above which a parameter of the base is known, and within which it is lost."""
LEAST_SHARE = 1 / 3
"""Mass or Coulomb friction that falls below this share of itself counts as taken over."""
MANY = 5.0
"""Standard errors above which the move of a headline parameter is large."""

REFITS = 4
"""Number of most promising effects that are refitted in a round."""
LOST_LIKELIHOOD = TIE
"""Largest rise of -2 ln L by an effect in a good fit; at its null the effect changes nothing."""
PARTS = (0.1, 0.01, 1e-3)
"""Shares of the first-order amplitude that start a fit again if it ran away."""

SPARED = 2.0
"""Factor on errors without a velocity step: above it the jackknife keeps the step, since no other
step has the same information."""
SEEN = 1e-6
"""Share of a column's norm below which its remainder after a projection is rounding."""
HELD_OUT_FROM = 3
"""Fewest velocity steps for a comparison of laws on held-out steps. With fewer, `split` cuts steps,
and a law fitted to a part of a step cannot be expected to predict the rest."""
LEAST_MEMORY = 10.0
"""Lower limit, in rows, of the longest correlation length, however short a velocity step is.
Simulated records with noise correlated over eight rows (a sixth of a step) need it: without it, BIC
differs by up to six more between laws."""

FEWEST_ROWS = MIN_ROWS
"""Fewest rows of a block, a direction or a turn: fewer correlated rows determine neither mean nor
scatter."""
UNEXPLAINED = 0.5
"""Residual over force above which a model explains too little, in a record or in a row."""
ENDS_OF_SPEED = (0.05, 0.95)
"""Quantiles of the speeds of a direction that bound its driven range (nine rows in ten)."""
ONE_SPEED_RANGE = 2.0
"""Ratio of the two bounding speeds below which a direction has one speed and no friction slope."""
NEAR_SPEED = 0.2
"""Relative tolerance for a row to belong to a speed."""
FEWEST_STROKES = 4
"""Fewest runs or strokes to fit an axis: three parameters and a spread."""
SHARE = 1 / 6
"""Share of the rows of an axis in each held-out block."""
TAIL = (0.6, 0.8)
"""Shares of the displacement of a single step that end its transient, and its validation block."""
QUARTER = 0.75
"""Train share of the displacement of the first of two steps."""
LOWER_CUTOFFS = 8
"""Number of lower cutoffs, in factors of sqrt 2, down to a sixteenth."""
PERIODS = 10.0
"""Fewest periods of the cutoff in a record."""
REACH = 10.0
"""Factor below the slowest and above the fastest speed, up to which curves are compared."""
GRID = 241
"""Number of speeds at which curves are compared, before rounding to two digits."""
STAIRS = 4.0
"""The low-pass removed motion if it removed more than this many standard errors of the encoder."""
SAME_FORCE = 0.05
"""Residual over force below which a description is complete. If position alone suffices, there is
neither inertia nor friction. If a stated controller fails, another controller acts."""
CONTROLLER_OFF = 10.0
"""Difference of the recorded from the stated force, in scatters, above which a row disagrees."""
MOSTLY = 0.5
"""Share of a bump above which the base absorbs most of it; share of rows that are most rows."""
PRIOR = 3.0
"""Prior standard deviation of missing friction, over the rms of the residual."""

# ---- search and fits

MOST = 8
"""Largest number of effects that a search adds; usually it ends earlier for lack of evidence."""
PASSES = 2
"""Most descents of a fit, each with the noise of the previous residual."""
SAME_NOISE = 0.05
"""Change of the logarithms of sizes and memories of noise that needs no further descent: weights
change by as much, and estimates by much less than their errors."""
EXACT, ROUGH = 1e-6, 1e-4
"""Relative reduction of the sum of squares at which a descent ends."""
TRIALS = 60
"""Most steps of a descent."""
SHAPES = 8
"""Shapes of an effect that are preselected for the likelihood, under each of two noises."""
OTHER_SHAPE = math.log(2)
"""Smallest |ln ratio| of a shape parameter to that of the best shape that starts a second fit. The
ripple of sepiolite, 44 um, is behind 344 um by 2 units of -2 ln L to first order, and ahead by 14
if both are fitted."""
FELT = 0.1
"""Effect of the error of a step time, over the noise, above which the time is fitted. Smaller
errors add up over steps to what looks like a lag."""
BETWEEN = (1 / 2, 1 / 8, 1 / 32)
"""Times of more samples of the sensor, as shares of the distance back to the row before."""
COARSE_SHARE, MOST_COARSE = 0.25, 1024
"""Share of all rows that count as coarsest, and their largest number. Longer records have finer
rows after a step, or more rows where friction does not bend."""
LATE = 0.8
"""Share of a phase of a run after which friction counts as steady, for starting values."""
START_ROWS = 1000
"""Most rows of a step of a run in the fits for starting values."""

# ---- passes of computation

FITTED_ROWS = 8192
"""Most rows of a loop. Longer records are averaged, if this flattens no peak: on 23,790 rows of a
gouge the results of 7,930 means are the same within a fifth of their errors, in 0.6 of the time."""
PASS, MORE_DIRECTIONS = 6, 3
"""Directions per pass: those of the base and a few more, rounded up to a multiple of `PASS`. One
effect has one to six parameters. Each number of directions is compiled, and padding costs as much
as a derivative: on 23,790 rows of a gouge, 12 directions take .6 of the time of 24."""
HEAVY = 2
"""Factor on the largest number of solver steps for a heavy effect."""
KEPT = 32 * 2**20
"""Bytes of cached linearisations: fits restart at the previous optimum, so hits are frequent."""
GROUPS = 7
"""Groups of step times that are delayed together: 44 steps then need one pass, not three."""
FORGOTTEN = 0.01
"""Largest remaining share of a response at the next step of its group."""
NOISES_AT_ONCE, NOISE_PASSES = 4, 4
"""Noises per pass, and passes over the weight of extra rows against friction, which converge."""

# ---- residual and location

ALONG, SINCE = 24, 8
"""Numbers of hat functions: along the record (the first columns), and since each step."""
COARSE, FINE = 8, 16
"""Numbers of bumps over a variable; slip, time and the variables of an axis have the finer ones."""
WAVES, AXIS_WAVES = 117, 60
"""Numbers of wavelengths: of a slider half a period apart over the record."""
DRAWS, SEED = 60, 20
"""Simulated records for the Bartlett correction, and the seed of their noise."""
SIZES, MEMORIES = (-1.0, 0.0, 1.0), (-0.5, 0.0, 0.5)
"""Offsets of the noise grid of a likelihood ratio, in logarithms."""
OF_BASE = 2
"""Parameters of the base's steady curve: level and A - B, or Coulomb and viscous friction."""

# ---- rows of an axis

LEAST_UNIT = 1e-3
"""Lower bound of the unit of residuals, as a share of the range of force."""
OF_NOISE, OF_RESIDUAL = 0.5**0.5, 0.25
"""Largest noise of the prediction, as a share of the force noise, and of the base law's residual.
The larger of both limits applies."""
BIAS, BIASED = 0.5, 1.0
"""Largest bias of the mass by errors of the motion, in its standard errors: that the choice of a
cutoff allows, and that needs no warning."""
WIDTHS = (1.0, 0.5, 0.25)
"""Factors on the default width of the smoothed sign that are tried for a split."""
WIDTH_IN_NOISE, WIDTH_SHARE = 2.0, 1e-3
"""Default width of the smoothed sign: in standard deviations of the velocity noise, and at least
this share of the largest speed."""
STUCK = 0.05
"""Shortest stop [s]; rows that deviate within this time of each other belong to one stretch."""
SIDE = 0.1
"""Smallest ratio of the ways before and after a stop in mid-stroke, and of a steady stroke to the
longest one."""
JITTER, FEW = 0.2 - 1e-6, 0.01
"""Relative jitter of the time of a row, less its rounding, and share of such rows, that warn."""
NEARLY_ALL = 0.99
"""Quantile of the speeds that must exceed `CLEAR` deviations of the velocity noise. That quantile
of normal noise alone is 2.6."""
NEAR_ENOUGH = 0.2
"""Tolerance of the coefficient of a disturbance around -1 and 0."""
TRIMS, NEAR, OUTLYING = 8, 2.5, 10.0
"""Iterations of a trimmed fit; scatters of kept rows and of outliers."""

# ---- speeds that an axis supports

BINS, ROWS_OF_BIN = 12, 8
"""Bins of rows by speed, and their fewest rows."""
LATEST, LAGS = 0.2, 101
"""Largest delay of a controller's response in the search [s], and number of delays."""
HYSTERESIS, BEGUN, ANEW, STEPS = 0.2, 0.15, 0.6, 0.1
"""Thresholds for an axis that never slid: largest share of the force unexplained by position; the
initial part of a stroke; the residual there over its mean, below which it starts anew; the same
over its deviation, below which it is zero."""

# ---- steady speeds

FEWEST, FEWEST_OF_EACH = 8, 3
"""Fewest runs in total, and in each direction, to try effects: the largest model has six parameters
and a spread."""
SPEEDS_OF_CURVE, POWERS = 60, (1.0, 2.0)
"""Values of vs in the grid of a Stribeck term, and of its exponent n."""
APART = 20.0
"""Distance between two runs in longest correlation lengths: correlation is then exp(-20)."""
MOST_ROWS = 16384
"""Most rows of all runs for the noise estimate; of longer runs their middle."""
SIZE, MEMORY, SHORTER = 4.0, 0.9, (-3.0, -1.0)
"""Starts of an oscillation once per turn: logarithm of the variance of both parts over white, its
correlation length over the longest one, and logarithms of the other part's length over that."""
