"""Thresholds of a fit, each with its reason."""

from statistics import NormalDist

import numpy as np

# ---- problem

FAILED_MISFIT = 1e7
"""Misfit of every row of a failed simulation, in units of the noise scale, so that the solver
rejects the trial and shortens its step. It is above 100 times the range of friction, since the
noise scale is at least 1e-5 of this range (`noise_from_differences`)."""
MASS_SHARE = 1e-4
"""Typical mass of an axis, over force times duration over velocity."""
TIME_SHARE = 1e-3
"""Typical lag of a slider, over the duration of the record."""
LAG_SHARE = 1e-2
"""Typical lag of an axis, over the range of position divided by the largest speed."""
SLOWEST = 0.02
"""Quantile of the speeds of the used rows: the slowest speed that the record resolves. Also the
share of the largest speed below which friction is not checked."""
SPEEDS_CHECKED = 12
"""Number of speeds at which friction must not drive the axis."""
NEGLIGIBLE = 0.02
"""Share of the force below which a negative friction, or a difference, counts as zero; share of the
forward travel below which the backward travel counts as none."""
MASS_SHARES = (1e-3, 0.1)
"""Inertial force at the largest acceleration, as a share of the typical force. A fit that starts
with a mass below the first share starts at the second instead."""

# ---- starts and descents

HOLD = 3.0
"""The reload after a hold counts as a change of ln V of at least this size."""
GRID_PAIRS = 16
"""Slip lengths of the grid for two or more states."""
INTERVALS = 160
"""Approximate number of means of a record."""
FELT = 0.25
"""Above this share of the noise of a row a known change of friction matters to a fit."""
NOISE_REACHED = 1.1
"""Misfit per sample below which no further start is tried: the fit has reached the noise, which is
estimated from second differences of the record."""
DESCENTS, MOST_POINTS = 3, 80
"""Most descents of a record, and most points of a descent."""
DASHPOTS = (1e-2, 2e-3, 4e-4, 8e-5, 1.6e-5, 3e-6, 6e-7)
"""Strengths of the dashpots with which a runaway is approached, see `Problem.damped`."""
LEVEL = 1e-14
"""A descent ends when a rejected step would gain less than this share of |r|^2: below it, rounding
and simulation errors decide whether a step is a gain."""
NEAR, SHORT = 30.0, 1e-5
"""A descent also ends when a full step is within `NEAR` times `rtol` and rejections have shortened
the next step to a hundredth. The sum of squares jumps where a simulation changes its pattern of
time steps, which hides the remaining gain."""
UNSEEN = 1e-12
"""Share of a column's squared norm below which its part orthogonal to the others is rounding."""
DAMPING = 1e-3
"""First l of Marquardt: almost a Gauss-Newton step."""
AT_ONCE = 32
"""Most records in a batch: more wait longer for the slowest, fewer leave vector units idle."""
FEW_AT_ONCE = 4
"""Records in the smallest batch. Sizes grow by factors of eight, since each is compiled."""
POINTS = (6, 12, MOST_POINTS)
"""Points after which a descent of a batch is cut the first, second and third time."""
SCATTER = 4.0
"""Two standard errors of the noise variance from differences, times sqrt(rows). Without this margin
four of 16 records of 500 rows would be fitted twice more for nothing."""
FEWEST_TO_FIT = 8
"""Fewest rows of a record that is given as arrays: as many as parameters and two more."""
TOLERANCE = 1e-9
"""Relative change of parameters and sum of squares at which a fit of an axis ends."""
TRIALS = 60
"""Most steps of a fit of an axis."""
COMPARED = 10
"""The output error compares every tenth sample: neighbouring samples of a position agree."""

FEWEST_PADDED = 256
"""Smallest padded number of rows, velocities or knots, so that few shapes are compiled."""
FEW, WIDE = 16, 48
"""Multiples of columns to pad to; the larger for rare passes, so that fewer shapes are compiled."""

# ---- errors and warnings

ENDS = (2.5, 97.5)
"""Percentiles at the ends of a 95 % interval."""
QUANTILE = NormalDist().inv_cdf(ENDS[1] / 100)
"""Half width of a 95 % interval in standard deviations of a normal distribution."""
HALF_DECADE = 0.5 * np.log(10.0)
"""Half of the longest 95 % interval of the logarithm of a determined positive parameter."""
LARGEST_ERROR = HALF_DECADE / QUANTILE
"""Largest relative standard error of a determined positive parameter: 59 %."""
PROFILE_POINTS = (0.7, 1.4, 2.0, 2.8, 4.0, 6.0)
"""Distances from the estimate at which a profile is computed, in standard errors."""
OTHER_LENGTHS = (1.25, 1.5, 2.0, 3.0, 5.0)
"""Factors of the slip length at which A - B is computed for the interval of A - B."""
CLEAR_LENGTH = 0.05
"""Error of ln L below which the misfit is quadratic enough for the error of A - B. Of 120 simulated
records with a median error of 0.08, the interval of a quadratic misfit held A - B of 90 %."""
SAMPLES = 4096
"""Samples for an interval: its ends are exact to a few per cent of a standard deviation."""
LEAST_L, MOST_FORCE, MOST_OFFSET = 0.01, 30.0, 10.0
"""Least L over the least slip from row to row; most A and |B| over the range of friction per e-fold
of velocity; most distance of f0 from the record, in ranges of friction."""
NEAR_EDGE = 2.0
"""K/K_cr below which steps of a usual size may leave the basin of steady sliding."""
OTHER_SPEED = 1.5
"""Steps contradict their record if stated and recorded speed differ by this factor."""
EXCESS = 2.0
"""rms residual over scatter from which the model lacks an effect, or the noise is correlated over
many rows."""
BLUR = 0.5
"""Flattening of the peaks by means of rows that warns, in units of the noise."""
MOST_STATES = 3
"""Most states of a fitted law: no record determines more."""
BLOCKS = 8
"""Blocks of the rows before the first step, whose means show a drift."""
RARE_DRIFT, CONTRADICTED = 1e-3, 1e-2
"""Significance levels: of a drift if the model has no slip trend; of a wrong slip trend."""

CLEAR_RISE, LARGE_RISE = 5.0, 0.1
"""A rise of friction counts if it exceeds so many standard deviations of the rows before the step,
and this share of the range of friction."""
IMPOSSIBLE, DOUBTFUL = 10.0, 1.5
"""Ratios of the least to the stated stiffness: the first refuses it, the second warns. A stated
stiffness above `IMPOSSIBLE` times that of a rise one row earlier warns too. This ratio is large: a
step by a factor of 2 needs some 3 times the path of the bare spring for its half rise."""

# ---- preparation of an axis

ORDER = 4
"""Order of the Butterworth filter of the position, as usual in robotics."""
FREQUENCIES = 4000
"""Frequencies of the integral for the noise of the acceleration."""
SEED = 1
"""Seed of a draw of that noise."""
CUTOFF_SHARE = 0.1
"""Cutoff of the low-pass over the sampling rate."""
SLOW = 200.0
"""Sampling rate [Hz] below which all rows are kept."""
SLOW_CUTOFF_SHARE = 0.2
"""Cutoff over the sampling rate of such a slow record."""
RIPPLE = 0.05
"""Ripple of the filter of published errors [dB], with `PASS` as in `scipy.signal.decimate`."""
PASS = 0.8
"""Pass band of that filter, over half the row rate."""
EDGE = 0.2
"""Least time [s] left out at both ends, where a zero-phase filter sees samples on one side only."""
MOST_EDGE = 0.1
"""Most time left out at each end, over the duration: a short record has no more rows to spare."""
UNEVEN = 0.01
"""Relative jitter of intervals above which rows are interpolated."""
MARGIN = 0.5
"""Padding [s] at both ends against the wrap-around of a Fourier transform."""
SAME_ROWS = 0.49
"""Share of the default cutoff down to which rows keep their length."""
FEWEST_ROWS = 10
"""Fewest rows that a cutoff must leave."""
SAMPLES_OF_ROW = 20
"""Fewest samples of the motion in a long row."""

# ---- a steady start

STEADY_PARTS, STEADY_SCALES, STEADY_ROWS = 8, (4, 8, 16, 32), 5
"""Parts of the first velocity at which sliding may become steady; shares of the rows in which a
change is sought; least number of rows of a mean."""
STEADY_LOADS, STEADY_AWAY, STEADY_USUAL = 0.1, 0.03, 3.0
"""Friction settles if more than this share of the motion loads or unloads the spring, if friction
differs from its later level by this share of its range, and if it changes by this factor more than
later, as a trend or a slow noise does not."""
STEADY_SAFE = 0.3
"""Factor of both shares from which a later start is advised."""

# ---- the stiffness of the machine

STRESSES_ALIKE = 1.02
"""Normal stresses are equal within this factor."""
STIFFNESS_OFF, STIFFNESS_FAR = 0.1, 3.0
"""Stiffnesses disagree if they differ by more than this share and by more than this many errors."""
