"""Thresholds of the gain search and its checks, each with its reason."""

import numpy as np

POSITIVE = 1e-9
""""Any positive" stiffness or damping, in natural units."""
FEASIBLE = 1e-7
"""Tolerance of a constraint, relative to its requirement, and of an active constraint, relative to
|y| (gains in natural units): above the rounding error of a margin. A smaller norm is printed as
0."""
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
"""Number of masses that represent a range given as text."""
OF_LAWS = 4
"""Number of samples of the law with which a slider is simulated at rest: the estimate and others at
even distances."""
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
LEAST_DROP = 0.05
"""Least drop from static to kinetic friction, over F_s: it limits the simulated time."""
CREEP = 1e-4
"""Largest creep of a stuck slider due to the smoothed sign in the simulated time, over F_s/k_p."""
DECAYED = 0.5
"""Ratio of the ranges in the last and the third quarter below which a motion decays; its inverse:
above which a motion grows."""
GROWN = 10.0
"""Range of x, over the largest initial offset, above which the motion grows."""
DEGREE = 5
"""Highest degree of a characteristic polynomial whose Hurwitz determinants are formed; their number
of terms grows like a factorial."""
RATIOS, RADII = np.geomspace(1e-4, 1e4, 14), np.append(0.0, np.geomspace(3e-3, 3e3, 13))
"""Ratios of damping to stiffness, and norms, of the gains at which a search starts, in natural
units. Half of the ratios are below 1, so that there is a stiff and a damped start."""
HANDFUL = np.array([1e-3, 0.1, 1.0, 3.0]), np.array([0.0, 0.1, 0.5, 1.2])
"""k_p and k_v, in natural units, whose pairs show which scenarios are hard."""
CARRIED, STEPS, NEAREST = 8, 4, 6
"""Worst scenarios in a round of the search, steps in a round, constraints in a step."""
TRUST, SHRINK = 0.5, 0.9
"""Largest relative change of the norm in the first step, and the factor by which it shrinks."""
BISECTIONS = 28
"""Bisections of a gain between two points of a grid, to 4e-9 of their distance."""
ZOOMS, ZOOM_POINTS, ABOUT = 5, 17, 1.4
"""Successively finer grids around an optimum at which a margin jumps, points of each along both
gains, and the range of the first as a factor."""
TILE, RATIONAL_TILE = 32, 2048
"""Scenarios evaluated at once: one shape to compile. Margins of kernels that are not rational need
thousands of frequencies each."""
FRAGILE = 0.2
"""Modulus margin below which a loop tolerates hardly any error of the model."""
SHORTEST_DELAY = 5e-5
"""Least delay of a real controller [s]: 1.5 samples at 30 kHz."""
MOST_SET_POINTS = 64
"""Largest number of set points of a schedule; a longer chain is reported as broken."""
PERIODS = 30.0
"""Simulated time, in periods of the slowest linear mode, or in times until a stuck slider breaks
loose."""
SPREAD = 1e6
"""Modes slower than the fastest by more than this factor are not simulated to their end."""
FOLDS, STRETCH = 8.0, 10.0
"""A known decay rate stretches the simulated time to a decay by exp(-8), at most tenfold."""
MAX_STEPS = 16384
"""Largest number of solver steps of one simulated motion."""
ROWS = 2000
"""Even samples of a simulated motion, besides the solver's own steps."""
LEAST_DECAY = 0.1
"""Decay rate times window of a motion that the number of solver steps cuts short: a smaller product
is not judged. Solver steps show the amplitude of a window to about 1 %."""
LONGER, TRIES = 4.0, 4
"""Factor by which an unresolved default duration is stretched, and the largest number of tries."""
DISTURBANCE = 0.02
"""Spring force of the disturbance at a constant velocity, over the law's `force_scale`."""
WIDTH = 1e-3
"""Width of the smoothed sign of a memoryless law, over the slowest commanded velocity."""
CLEAR = -0.22
"""Largest ln of the ratio of amplitudes in successive windows that counts as clear decay."""
LINEAR = 0.3
"""Largest amplitude at which a decay between windows shorter than a cycle is accepted. A sticking
slider has |V - V0|/V0 = 1, and the time between two slips must not be mistaken for decay."""
CYCLES = 4
"""Least number of cycles in the last half of a motion: two in a window."""
SMALL = 1e-3
"""Largest |V - V0|/V0 of a motion that counts as steady; for hunting about a target, largest |x|
over F_s/k_p."""
RUNAWAY = 1e9
"""Velocity over the commanded one that counts as runaway; light sliders slip at 1e6."""
CHANGE, SEED = 0.5, 0.01
"""Relative change of the velocity of a standard start, and the spring force added to it, over the
law's `force_scale`."""
FACTORS, JUMP_ROUNDS = 8, 2
"""Velocity jumps tried in each round of the search for the basin, and the number of rounds."""
SAMPLES, HUNTING_STEPS, HUNTING_RTOL = 8001, 200_000, 1e-6
"""Samples, largest number of solver steps and tolerance of a slider simulated at rest."""
TIED = 1e-6
"""Relative difference of two directions of motion below which neither is the worse: far above
rounding, and below the digits that are shown."""
