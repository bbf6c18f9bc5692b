"""A blind study: records with a hidden effect, written by a simulator of its own.

`plants` holds the equations and `generate` writes the records; both are NumPy and SciPy only and
import nothing of `jaxfric`, so that what is scored cannot share a mistake with what made it.
"""
