"""Figures, from result objects only.

`..._figure` makes the figure of a result, as its method `.plot()` does; `style.write` writes it.
"""
