"""Thresholds of the gain search and its checks, each with its reason."""

POSITIVE = 1e-9
""""Any positive" stiffness or damping, in natural units."""
FEASIBLE = 1e-7
"""Tolerance of a constraint, relative to its requirement, and of an active constraint, relative to
|y| (gains in natural units): above the rounding error of a margin."""
ZERO = 1e-6
"""Zero in the KKT equations of |y| = min, relative to |y|: residual, multiplier times gradient,
step along a constraint. Also for the sine between two constraints and the curvature along one.
Second derivatives of a margin are about as accurate."""
ROUNDS = 20
"""Largest number of changes to the active set of scenarios or samples; more never converge."""
SPEEDS = 501
"""Speeds at which a steady curve is searched: 0.8 % apart over two decades."""
SLOWER = 1e-6
"""Lowest speed of the search of a friction curve, over the lowest or highest requested one: far
below the speeds at which a Stribeck curve still rises towards rest."""
SLOPES = 4001
"""Speeds for central differences of friction: 0.1 % apart over two decades, so that the relative
error of a slope is about the square of that."""
MOST_RAISED = 30.0
"""Largest factor by which gains are raised for a basin; more is not worth its cost."""
OF_A_RANGE = 5
"""Number of values that represent a range: masses given as text, velocities around a set point."""
CURVATURE = 0.1
"""Least curvature of the Lagrangian along a constraint, over that of the norm. With less, a step
would leave the region in which the linearised constraints are accurate."""
ROUNDING = 1e-12
"""Rounding tolerance of a linearised constraint, relative to |y|."""
ENOUGH = 10.0
"""Largest ratio of a margin to its requirement; larger or infinite ones are clipped to it."""
HALVINGS = 6
"""Bisections of the radius at which a ray becomes feasible; a start needs no more accuracy."""
SETTLED = 1e-8
"""Relative step size that counts as converged: further Newton steps change nothing."""
FAR = 1e30
"""Norm that represents no gains at all; its square does not overflow."""
REFINED = 4
"""Number of worst scenarios at an optimum around whose velocities more velocities are tried."""
FINE = 33
"""Number of velocities tried there."""
ALIKE = 1e-3
"""Relative difference below which two optima are the same."""
OFFSETS = (2.0, 3.3, 5.7)
"""Initial distances to the target, in F_s/k_p, from which the slider moves at once. There are
several, as from one of them it may stop so near its target that it sticks for very long."""
STICKS = 30.0
"""Simulated time, in units of the time until a stuck slider breaks loose."""
LEAST_DROP = 0.05
"""Least drop from static to kinetic friction, over F_s: it limits the simulated time."""
CREEP = 1e-4
"""Largest creep of a stuck slider due to the smoothed sign, over F_s/k_p."""
DECAYED = 0.5
"""Ratio of the ranges in the last and the third quarter below which a motion decays."""
GROWN = 10.0
"""Range of x, over the largest initial offset, above which the motion grows."""
