"""Thresholds of the loop, each with its source. Tables and figures mark some of the thresholds."""

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
LOST_LIKELIHOOD = 2.0
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

FEWEST_ROWS = 20
"""Fewest rows of a block, a direction or a turn: fewer correlated rows determine neither mean nor
scatter."""
UNEXPLAINED = 0.5
"""Residual over force above which a model explains too little."""
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
MOSTLY = 0.5
"""Share of a bump above which the base absorbs most of it."""
PRIOR = 3.0
"""Prior standard deviation of missing friction, over the rms of the residual."""
