"""Thresholds of evidence that the loop asks for; tables and figures mark them."""

ACCEPT = 10.0
"""Fall of BIC for which an effect is taken, or a curve of another shape ruled out.

10 is "very strong" evidence (Kass and Raftery 1995, doi:10.1080/01621459.1995.10476572).
"""
TIE = 2.0
"""Difference of BIC that is no evidence: of models so near the first is kept."""
ALIAS = 0.95
"""|cosine| of their sensitivities above which two effects are not told apart to first order."""
SIGNIFICANT = 0.01
"""Chance that noise alone leaves something, at any of the questions that are asked of it."""
FAR = 1.5
"""A held-out error of so many times what noise gives is not a little that is left."""
HELD_OUT = 1.06
"""A held-out error of so many times the noise is at least allowed to a model that describes it."""
HELD_OUT_FROM = 3
"""Velocity steps from which on laws are compared on some that are held out: of fewer, `split` cuts
into steps, and a law that is not fitted to a whole step is not asked to predict one."""
LEAST_MEMORY = 10.0
"""Rows over which noise may be correlated under every law, however few a velocity step has: without
them BIC of simulated records whose noise lasts for eight rows, a sixth of a step, differs by up to
six more between laws."""
