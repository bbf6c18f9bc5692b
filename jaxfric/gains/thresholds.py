"""Numbers by which gains are found and judged, each with its reason."""

POSITIVE = 1e-9
""""Any positive" stiffness or damping, in natural units."""
FEASIBLE = 1e-7
"""Share of its requirement by which gains may miss a constraint, and of |y| (the gains in natural
units) by which they may be off one that they are held by: rounding of a margin is below."""
ZERO = 1e-6
"""What counts as zero in the KKT equations of |y| = min: their residual, a multiplier times its
gradient or a step along a constraint, over |y|; the sine of the angle of two constraints, and the
curvature along one. Second derivatives of a margin are right to about as much."""
ROUNDS = 20
"""Times that a set of scenarios or samples is changed for those that decide: more never settle."""
SPEEDS = 501
"""Speeds at which a steady curve is searched: 0.8 % apart over two decades."""
SLOWER = 1e-6
"""Of the slowest or fastest speed that is asked for, down to where a curve of friction is searched:
the rise of a Stribeck curve towards rest has ended far above."""
