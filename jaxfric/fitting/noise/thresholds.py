"""Numbers of the noise that are chosen, not derived; each with its reason."""

# ---- the filter

HIDDEN = 1e12
"""Variance of a row that is passed over: its gain is 0 to the precision of a double."""
CRITICAL = 1e-3
"""|w| and s of a resonator below which it is taken as that: 1/w is not known at its critical
damping."""
BLOCK = 512
"""Rows that are whitened before their products are added: they are still in the cache then."""
FEW, MANY, LONG = 8, 64, 1 << 16
"""Columns that are whitened in one pass, few or many, so that few shapes are compiled; and rows
from which on memory counts: few columns at a time."""
ALTERNATING = 0.98
"""Largest share of the limit of a negative part: at the limit no white noise is left at zero
frequency, and the filter divides by 0."""

# ---- the search

LONGEST = 0.1
"""Longest memory of the noise of a fit, as a share of the record: what wanders for longer is seen
too seldom for its size to be known, and a likelihood makes it as large as it likes."""
SHORTEST = 1e-6
"""Shortest gap of rows that is searched, as a share of the record: clocks may stand."""
MOST_PARTS = 2
"""Correlated parts that are sought at most: measured runs show one that is gone after two or three
rows and one that lasts tens of them, or a swing."""
LARGEST = 9.0
"""Largest |logarithm| of a part's variance over the white one: beyond it is all or nothing."""
SHAPE_ENDS = (-2.0, 4.5)
"""Smallest and largest ln(1 + beta)/2 of a resonator: it is an exponential below, and swings for
fifteen periods above."""
MEMORIES, SHAPES = 6, (-1.0, 0.0, 0.75, 1.75)
"""Memories of a clock, and shapes ln(1 + beta)/2, from which a part is sought; a likelihood has its
maximum within half a step of the grid, or Newton's method goes there."""
SIZES, SIZES_OF_RESONATORS = (-2.0, -0.5, 1.0, 2.5), (-0.5, 2.0)
"""Logarithms of a new part's variance over the white one from which it is sought."""
SIZES_OF_ALTERNATING = (-1.0, 1.0, 3.0, 5.0)
"""The same of a negative part, of its variance over what is left to the limit."""
TOGETHER_SIZES, TOGETHER_RATIO, TOGETHER_MEMORIES = (0.0, 3.0), 1.0, 3
"""The same where all parts are sought at once, beside white noise or hardly any; the logarithm of
the ratio of the largest part to the smallest; and memories of each."""
LIKELY = 12
"""Starts of a family, likeliest for the residual alone, whose restricted likelihood is asked of a
record longer than a stretch."""
REFINED = 2
"""Families, likeliest at their starts, that are refined with one part more."""
TOGETHER, ALONE = 8, 64
"""Noises that are whitened in one pass: passes of more take as long for each, and every number of
them is compiled for. Of the residual alone more fit in the cache."""
NEWTON, DAMPINGS, STEP = 12, 8, 0.2
"""Steps of Newton's method at most, dampings that are tried in each, and the difference by which
derivatives are taken: a likelihood bends over a unit of theta."""
SETTLED = 0.02
"""Gain of ln L below which a search ends: a fiftieth of what a parameter is worth at least."""
FAR_FROM = 0.5
"""Share of what a part is worth below which the spectrum's gain is far from it."""
STRETCH, SOUGHT, SIZED = 1024, 8, 64
"""Rows of a stretch; stretches of a long record in which its parts are sought, and their sizes."""
BETWEEN, SIZES_AROUND, MEMORIES_AROUND = (0.0, 0.5, 1.0), (-1.5, 0.0, 1.5), (-0.7, 0.0, 0.7)
"""Places between two noises, and logarithms of sizes and of memories around them, that candidates
are screened under: a finer grid names the same effects."""

# ---- the spectrum

SAME_SPEED, SAME_STEP = 0.02, 0.5
"""Relative changes from row to row of one clock over another, and of a clock, within a piece."""
PIECE = 64
"""Rows of a piece at least."""
LEFT_OUT = 0.1
"""Most rows in shorter pieces, as a share."""
BAND = 0.04
"""Width of a band over its frequency: narrower than a part resolves."""
SPECTRAL_SIZES, SPECTRAL_MEMORIES = (-3.0, -2.0, -1.0, 0.0, 1.5, 3.0), 9
"""Logarithms of sizes over the white noise, and memories of a clock, that the bound tries: it is to
be within half of what a part is worth."""

# ---- the noise of a result

WHITE = 0.05
"""Share of the variance below which a correlated part is not told: it is of no consequence."""
ALIKE = 0.2
"""Correlation of neighbouring rows from which a part of a noise is not white: less the rows do not
resolve."""
SWING_SEEN = 1.5
"""w of a resonator from which its swing is seen: it has lost a factor 66 after a period."""
MOST_OF_WHITE = 0.5
"""Share of the white part's variance above which it is a recorder's steps."""

# ---- by velocity step

LEAST_VARIANCE = 1e-4
"""Least variance of a step over the largest one: a step whose rows are all alike has none."""
LIKENESS = (0.05, 0.995)
"""Ends of the correlation of neighbouring rows that a pace is read off: less is white, more is
structure."""

# ---- quantisation

OFF_A_STEP = 0.02
"""Largest distance of a value from a whole number of steps, in steps."""
SMALLEST_STEP = 1e-11
"""Smallest step, in units of the largest value: smaller ones are rounding."""
DISTINCT = 0.9
"""Largest ratio of distinct values to rows; in a continuous column it is nearly 1."""
COARSE = 2.0
"""Steps over the rest of the noise from which they are told: rows are a staircase then."""

# ---- glitches

LONGEST_GLITCH = 3
"""Largest number of rows of a glitch."""
CHANCE_OF_GLITCH = 0.01
"""Probability that noise alone makes a record of this length show one glitch."""
SHARE_OF_GLITCHES = 0.01
"""Largest share of rows that may be glitches: more frequent outliers belong to the noise."""
BODY, SHOULDER = 0.5, 0.93
"""Quantiles of the sizes of prediction errors that their law is read off: a hundredth of wrong rows
and their neighbours hardly move them."""
ROWS_FOR_GLITCHES = 50
"""Rows below which none is looked for: a law is not known from fewer."""
BESIDE, BESIDE_PART = (5, 10), 0.1
"""Rows after a velocity step that are spared: a tenth of the shorter step, but so few and many."""
NEAR_GLITCH = 0.6
"""Share of the limit for glitches that the rows beside a glitch must stay below."""
SHARED = 20
"""Weight of the median of all steps against that of one, in rows."""
TOLD = 3
"""How many of a kind are told at most: glitches, models left open, velocities that decide."""
CLEAR = 3.0
"""Standard errors from which something is off: a line the mains, a step the time that the load
point shows, a curve another, a sign what is possible. Chance in one of 400."""

# ---- hum

MAINS = (50.0, 60.0, 100.0, 120.0)
"""Frequencies of the mains and of their rectified current [Hz]."""
MAINS_OFF = 0.2
"""How far the mains may be off [Hz]: the steady deviation that the grid of Europe allows itself."""
CHANCE_OF_HUM = 1e-4
"""Chance that noise alone shows a line in a record, were the noise around it known; of 400 records
of noise alone (`fits/hum`) none had one, of 300 at ten times the chance two."""
CHANCE_OF_LINE = 1e-3
"""Chance that noise has as much at a given frequency in any piece: a line stands out there."""
SAME_VELOCITY = 0.9
"""Two velocities that were found are one commanded velocity from this ratio on."""
LONGEST_PIECE, ROWS_OF_PIECE = 10.0, 1000
"""Pieces last so long [s] and have so many rows at least, where a step has: the mains stay in
phase for some ten seconds."""
LOWEST = 1.0
"""Lowest frequency of a line [Hz]: slower are servos, which swing, and temperature, which is no
noise."""
FEWEST_OF_PIECE, CYCLES, CYCLES_FITTED = 80, 10, 4
"""Rows of a piece in which lines are sought, and cycles in it: below, friction has what it does
after a step. Cycles in a piece from which a line that is known is fitted to it."""
HALF_A_CYCLE = 1e-6
"""Determinant over that of many cycles, and how far rows may be off half a cycle, where a cosine
and a sine are one."""
GOES_ON = 0.7
"""Share of both halves' lines that is in phase: 1 of hum, 0.5 of what is in one half only."""
CELLS, FINER, TRIED_AROUND = 4, 4, 41
"""Cells of a row, frequencies of a cycle in a piece, and those that are tried around the best."""
BURST = 4
"""The mean interval of rows over the median at most, as far as frequencies are sought."""
SLOW, EACH_COSINE, COSINES = 3, 20, (2, 24)
"""Cycles of a piece below which noise around is not asked; frequencies for each of its cosines, and
how many of them."""
LINES_TRIED, LINES = 8, 6
"""Lines that are looked at, and taken, at most."""
