"""Numbers by which the loop decides, each with its source; tables and figures mark some of them."""

ACCEPT = 10.0
"""Fall of BIC for which an effect is taken, or a curve of another shape ruled out.

10 is "very strong" evidence (Kass and Raftery 1995, doi:10.1080/01621459.1995.10476572).
"""
TIE = 2.0
"""Difference of BIC that is no evidence: of models so near the first is kept. What falls by more
without being accepted is a hint."""
ALIAS = 0.95
"""|cosine| of their sensitivities above which two effects are not told apart to first order."""
SIGNIFICANT = 0.01
"""Chance that noise alone leaves something, at any of the questions that are asked of it."""
FAR = 1.5
"""A held-out error of so many times what noise gives is not a little that is left."""
HELD_OUT = 1.06
"""A held-out error of so many times the noise is at least allowed to a model that describes it."""

TRAIN_FLOOR = 1.04
"""The same of the train block, whose parameters were fitted to it."""
ASKED = 12
"""About as many questions as are asked of a residual (`residual_tests.asked`)."""
EDGE = 1.1
"""K/K_cr below which a small misfit of the law looks like a large effect."""

BEYOND = 2.0
"""Lengths and times beyond so many times those of the record are not seen in it."""
FAR_VELOCITY = 30.0
"""Velocities this factor below or above all of a record are not seen in it."""
KNOWN, LOST = 4.0, 2.0
"""Errors from which a parameter of the base is known, and within which it is lost."""
LEAST_SHARE = 1 / 3
"""A mass or Coulomb friction that falls below this share of itself is taken."""
MANY = 5.0
"""Errors by which a headline parameter moves far."""

REFITS = 4
"""Most promising effects that are fitted jointly in a round."""
WORSE = 1.02
"""Times by which the error of the select block may grow, whatever chance is."""
LOST_LIKELIHOOD = 2.0
"""-2 ln L by which a fit may be less likely than without its effect, which it has at its null."""
PARTS = (0.1, 0.01, 1e-3)
"""Shares of the first-order amplitude from which a fit that ran away begins again."""

SPARED = 2.0
"""Factor by which errors may grow without a velocity step for it to be one of several that agree on
the parameters, or do not."""
SEEN = 1e-6
"""Share of a column's length below which what is left of it is rounding."""
HELD_OUT_FROM = 3
"""Velocity steps from which on laws are compared on some that are held out: of fewer, `split` cuts
into steps, and a law that is not fitted to a whole step is not asked to predict one."""
LEAST_MEMORY = 10.0
"""Rows over which noise may be correlated at least, however few a velocity step has: without
them BIC of simulated records whose noise lasts for eight rows, a sixth of a step, differs by up to
six more between laws."""

FEWEST_ROWS = 20
"""Rows without which nothing is said of a block, a direction or a turn: of fewer that are
correlated neither mean nor scatter is known."""
UNEXPLAINED = 0.5
"""A model explains too little of a force that leaves more than this share of its size."""
ENDS_OF_SPEED = (0.05, 0.95)
"""Quantiles of the speeds of a direction between which it was driven: nine rows in ten."""
ONE_SPEED_RANGE = 2.0
"""Ratio of these below which a direction was driven at one speed: friction over it is not known."""
NEAR_SPEED = 0.2
"""Share by which a row may move faster or slower and count to a speed."""
FEWEST_STROKES = 4
"""Runs or strokes without which an axis is not fitted: of three parameters and a spread."""
SHARE = 1 / 6
"""Share of the rows of an axis in each block that is held out."""
TAIL = (0.6, 0.8)
"""Shares of the way of a single step that end its transient, and its select block."""
QUARTER = 0.75
"""Share of the way of the first of two steps that trains."""
LOWER_CUTOFFS = 8
"""Cutoffs are tried down by factors of sqrt 2, to a sixteenth."""
PERIODS = 10.0
"""Periods of the cutoff that a record lasts at least."""
REACH = 10.0
"""Times the fastest speed, and below the slowest, to which a curve is asked for."""
GRID = 241
"""Speeds at which it is, before they are rounded to two digits."""
STAIRS = 4.0
"""The low-pass took motion away where it took more than this many noises of the encoder."""
SAME_FORCE = 0.05
"""Share of a force that what describes it may leave: where position alone does there is neither
inertia nor friction, where a stated controller does not it is another one."""
MOSTLY = 0.5
"""Share of a bump above which the base takes up the greater part of it."""
PRIOR = 3.0
"""Standard deviation of missing friction before anything is known, over the rms of the residual."""
