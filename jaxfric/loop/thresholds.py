"""Thresholds of evidence that the loop asks for; tables and figures mark them."""

ACCEPT = 10.0
"""Fall of BIC for which an effect is taken, or a curve of another shape ruled out.

10 is "very strong" evidence (Kass and Raftery 1995, doi:10.1080/01621459.1995.10476572).
"""
ALIAS = 0.95
"""|cosine| of their sensitivities above which two effects are not told apart to first order."""
SIGNIFICANT = 0.01
"""Chance that noise alone leaves something, at any of the questions that are asked of it."""
LEFT = 0.005
"""p-value below which something left withholds a name, corrected for all that is asked.

Half of `SIGNIFICANT`: the noise of a recorder is nearly, not quite, that of a model. Of 48 records
with noise cut from measured ones and nothing else in them 7 had something left at 0.01, 3 at 0.005.
"""
