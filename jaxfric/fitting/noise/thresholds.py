"""Numbers of the noise that are chosen, not derived; each with its reason."""

# ---- the filter

HIDDEN = 1e12
"""Variance of a row that is passed over: its gain is 0 to the precision of a double."""
CRITICAL = 1e-3
"""|w| and s of a resonator below which it is taken as that: 1/w is not known at its critical
damping."""
BLOCK = 512
"""Rows that are whitened before their products are added: they are still in the cache then."""
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
"""Starts of a family, likeliest for the residual alone, whose restricted likelihood is asked."""
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
