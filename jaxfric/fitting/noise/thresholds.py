"""Constants of the noise model that are chosen, not derived, with the reason for each."""

# ---- the filter

HIDDEN = 1e12
"""Variance of a skipped row: its gain is 0 in double precision."""
CRITICAL = 1e-3
"""Lower bound of |w| and s of a resonator: at critical damping they are 0, and 1/w is infinite."""
BLOCK = 512
"""Rows that are whitened before their products are added: they then fit in the cache."""
ALTERNATING = 0.98
"""Largest negative part, as a share of its limit. At the limit the spectrum is 0 at zero frequency,
and the filter divides by 0."""

# ---- the search

LONGEST = 0.1
"""Longest correlation length of a fit's noise, as a share of the record. Slower noise is sampled
too rarely to determine its size, and its likelihood has no maximum."""
SHORTEST = 1e-6
"""Shortest gap of rows in the search, as a share of the record: a clock may stand still."""
CLOSEST = 0.25
"""Share of the rows, those closest to their neighbours, that resolve an oscillation of four rows.
Of the train rows of p655 a quarter are at most .01 s apart and half at least .02 s: only to the
first is a machine that swings every .08 s an oscillation."""
MOST_PARTS = 2
"""Most correlated parts. Measured runs show one part with a correlation length of two or three
rows, and one of tens of rows or an oscillation."""
EXCHANGES = 3
"""Most exchanges of parts. Of 38 searches in loops on measured and drawn records six made one or
more, which lowered the BIC by 11 to 79."""
LARGEST = 9.0
"""Largest |logarithm| of a part's variance over the white one: beyond, one is negligible."""
SHAPE_ENDS = (-2.0, 4.5)
"""Range of ln(1 + beta)/2 of a resonator: below it is exponential, above it oscillates for more
than fifteen periods."""
MEMORIES, SHAPES = 6, (-1.0, 0.0, 0.75, 1.75)
"""Number of correlation lengths on a clock, and shapes ln(1 + beta)/2, that start a search. The
maximum is within half a step of this grid, or Newton's method reaches it."""
SIZES, SIZES_OF_RESONATORS = (-2.0, -0.5, 1.0, 2.5), (-0.5, 2.0)
"""Logarithms of a new part's variance over the white one that start a search."""
SIZES_OF_ALTERNATING = (-1.0, 1.0, 3.0, 5.0)
"""Logarithms of a negative part's variance over the remaining distance to its limit, as starts."""
TOGETHER_SIZES, TOGETHER_RATIO, TOGETHER_MEMORIES = (0.0, 3.0), 1.0, 3
"""The same for all parts at once, with much or little white noise; the logarithm of the ratio of
the largest part to the smallest; and the number of correlation lengths of each."""
LIKELY = 8
"""Starts of a family in a record longer than a stretch: the likelihood of the residual alone
preselects them for the restricted likelihood, which takes them in one pass."""
REFINED = 2
"""Families with one more part that are refined: those with the likeliest starts."""
TOGETHER, ALONE = 8, 64
"""Noises per whitening pass. More take as long for each, and every number is compiled. For the
residual alone more fit in the cache."""
NEWTON, DAMPINGS, STEP = 12, 8, 0.05
"""Most Newton steps, dampings tried in each, and the step of finite differences. The curvature of a
likelihood changes over a unit of theta."""
SETTLED = 0.002
"""Gain of ln L that ends a search. At .02 the deviance of the validation rows, which extrapolates
the noise, still moved by 2: on p655 two equal fits differed by 2.8 in BIC."""
CLOSE = 0.1
"""The same while noises are compared; the best one is then settled."""
FAR_FROM = 0.5
"""Velocity steps have one pace if the gain of separate paces is below this share of their BIC
penalty."""
ALSO_DIFFERS = 0.5
"""Residuals that gain at least this share of the largest gain from their own noise are left out of
a shared noise at once. The others may differ only from a noise that the first ones changed."""
STRETCH, SOUGHT, SIZED = 1024, 8, 64
"""Rows of a stretch; stretches of a long record to search its parts in, and to size them in."""
BETWEEN, SIZES_AROUND, MEMORIES_AROUND = (0.0, 0.5, 1.0), (-1.5, 0.0, 1.5), (-0.7, 0.0, 0.7)
"""Positions between two noises, and offsets of the logarithms of sizes and correlation lengths, for
screening candidates. A finer grid selects the same effects."""

# ---- the noise of a result

ALIKE = 0.2
"""Correlation of neighbouring rows below which a part counts as white: the rows do not resolve
it."""
SWING_SEEN = 1.5
"""w of a resonator above which its oscillation is visible: it decays by a factor 66 per period."""

FEWEST_PAIRS, LAGS = 30, 40
"""Fewest pairs of rows of an autocorrelation, and number of its distances."""
EXACT_ROWS, SOME_PAIRS = 60, 400
"""Most rows whose correlations are summed pair by pair, and pairs of a mean correlation."""
CHANCE_OF_LAG, RANGES_TOLD = 0.05, 4
"""Significance level of an autocorrelation beyond its model, and most ranges told."""

# ---- by velocity step

LEAST_VARIANCE = 1e-4
"""Least variance of a step over the largest one: a step of equal rows would have variance 0."""
LIKENESS = (0.05, 0.995)
"""Range of correlation of neighbouring rows that gives a pace: less is white, more is misfit."""

# ---- quantisation

OFF_A_STEP = 0.02
"""Largest distance of a value from a whole number of steps, in steps."""
SMALLEST_STEP = 1e-11
"""Smallest step, in units of the largest value: smaller ones are rounding."""
DISTINCT = 0.9
"""Largest ratio of distinct values to rows; in a continuous column it is nearly 1."""
COARSE = 2.0
"""Quantisation step over the rest of the noise that warns: the rows then form a staircase."""

# ---- glitches

ROUNDS = 2
"""Number of searches for outliers, each followed by a new estimate of the noise."""
LONGEST_GLITCH = 3
"""Largest number of rows of a glitch."""
RARE = 0.01
"""Probability that noise alone makes a record of this length show one glitch. Also the largest
share of rows that may be glitches: more frequent outliers belong to the noise."""
BODY, SHOULDER = 0.5, 0.93
"""Quantiles of absolute prediction errors that determine their law: a hundredth of outliers and
their neighbours hardly change them."""
ROWS_FOR_GLITCHES = 50
"""Fewest rows for a search: fewer do not determine the law of the errors."""
BESIDE, BESIDE_PART = (5, 10), 0.1
"""Range of the number of spared rows after a velocity step, and its share of the shorter step."""
NEAR_GLITCH = 0.6
"""Share of the limit for glitches that the rows beside a glitch must stay below."""
SHARED = 20
"""Weight, in rows, of the median of all steps in that of one step."""
TOLD = 3
"""Most items of a kind in a message: glitches, undecided models, velocities that decide."""
CLEAR = 3.0
"""Standard errors of a clear deviation (chance about 1 in 400): of a line from the mains, of a step
time from the load point, of a curve from another, of a sign from the possible one."""

# ---- hum

MAINS = (50.0, 60.0, 100.0, 120.0)
"""Frequencies of the mains and of their rectified current [Hz]."""
MAINS_OFF = 0.2
"""Tolerance of a mains frequency [Hz]: the steady deviation that the European grid allows."""
CHANCE_OF_HUM = 1e-4
"""Chance of a false line in a record of noise alone, if its spectrum is known. None of 400 records
of noise (`fits/hum`) had one; at ten times the chance two of 300 had."""
CHANCE_OF_LINE = 1e-3
"""Chance that noise has as much power at a given frequency in any piece: below, a line is
significant there."""
SAME_VELOCITY = 0.9
"""Two detected velocities count as one commanded velocity above this ratio."""
LONGEST_PIECE, ROWS_OF_PIECE = 10.0, 1000
"""Shortest duration [s] and fewest rows of a piece, if the step has them. The mains stay in phase
for some ten seconds."""
FEWEST_OF_PIECE, CYCLES, CYCLES_FITTED = 80, 10, 4
"""Fewest rows and cycles of a piece for a search: below, friction changes after a step look alike.
Fewest cycles in a piece to test or fit a known line there. `CYCLES` in the longest piece are 1 Hz:
below are oscillating servos, and temperature, which is no noise."""
HALF_A_CYCLE = 1e-6
"""Tolerance for two rows per cycle, where cosine and sine coincide: of the determinant relative to
that of many cycles, and of the frequency relative to half a cycle per row."""
GOES_ON = 0.7
"""Power of a piece over that of its halves: 1 for hum, 0.5 for a line in one half only."""
FINER, TRIED_AROUND = 4, 41
"""Cells per row, frequencies per cycle in a piece, and the largest ratio of the mean to the median
interval of rows that widens the frequency range; frequencies tried around the best."""
SLOW, EACH_COSINE, COSINES = 3, 20, (2, 24)
"""Cycles per piece below which the surrounding noise is not fitted; frequencies per cosine, and
range of the number of cosines."""
LINES_TRIED = 8
"""Most lines tested."""
