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
SLOPES = 4001
"""Speeds between which slopes of friction are differences: a thousandth apart over two decades, so
that a slope is right to its square."""
MOST_RAISED = 30.0
"""Times the gains of the margins above which no basin is worth what it costs."""
OF_A_RANGE = 5
"""Values for which a range stands: of masses that are given as text, and of velocities around a
set point."""
CURVATURE = 0.1
"""Least curvature of the Lagrangian along a constraint, over that of the norm: of less a step would
end far from where the constraints are known."""
ROUNDING = 1e-12
"""Share of |y| by which a candidate may miss a linearised constraint: its rounding."""
ENOUGH = 10.0
"""Times its requirement that a margin beyond it, or inf, counts as."""
HALVINGS = 6
"""Of the interval at whose end a ray becomes feasible: a start need not be nearer."""
SETTLED = 1e-8
"""Share of |y| below which a step has settled: Newton steps from there change nothing."""
FAR = 1e30
"""Norm that stands for no gains at all; its square is a number."""
REFINED = 4
"""Scenarios, the worst at an optimum, between whose velocities and the next others are tried."""
FINE = 33
"""Velocities that are tried there."""
ALIKE = 1e-3
"""Share of their norm by which two optima that are one may differ."""
OFFSETS = (2.0, 3.3, 5.7)
"""Distances to the target at the start, in F_s/k_p: the slider moves at once. Several, as from one
of them it may happen to stop so near its target that it comes loose only much later."""
STICKS = 30.0
"""Time that is simulated, in times that a stuck slider needs to come loose."""
LEAST_DROP = 0.05
"""Share of F_s that counts as the drop where friction hardly falls: it bounds the time."""
CREEP = 1e-4
"""Share of F_s/k_p by which the smoothed sign may let a stuck slider creep before it is loose."""
DECAYED = 0.5
"""Range of the last quarter over that of the third below which a motion dies out."""
GROWN = 10.0
"""Range of x, in units of the largest offset, that no slider has which stays about its target."""
