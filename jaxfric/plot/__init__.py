"""Figures, from result objects only.

A function `..._figure` makes the figure of a result, as the result's method `.plot()` does.
`style.write` writes a figure to files.
"""
