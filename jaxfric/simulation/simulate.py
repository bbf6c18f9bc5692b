"""One entry point: `simulate(rig, motion, ts)`.

`stepping` integrates the motion. The default method is Tsit5 for a massless slider whose equations
are not stiff, else Rodas5P. `tangents` computes derivatives of every order and mode from the
accepted steps. If the user gives a solver, controller or adjoint, `diffrax.diffeqsolve` integrates
and differentiates.

For stick-slip over many periods, sample at the solver's steps (`at_steps`) rather than at given
times. The solver's steps are dense where the slider slips.
"""

import math

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from ..errors import InputError
from ..motion import AbstractMotion, PiecewiseVelocity
from ..quantity import is_known
from ..rig import Inertial, Rig
from .blocks import in_blocks
from .by_diffrax import solve_given
from .checks import is_possible, refuse_impossible, refuse_no_steady_state
from .ode import SliderEquation
from .start import InitialState, law_with_states
from .stepping import How, follow, recorded, until
from .thresholds import SAFETY, STIFF
from .trajectory import RESULTS, Trajectory, only_if


def simulate(
    rig: Rig,
    motion: AbstractMotion,
    ts: Float[Array, " n"],
    *,
    start: InitialState | None = None,
    at_steps: bool = False,
    rtol: float | Float[Array, ""] = 1e-6,
    max_steps: int = 4096,
    runaway: float = 1e4,
    stiff: bool | None = None,
    solver: diffrax.AbstractSolver | None = None,
    controller: diffrax.AbstractStepSizeController | None = None,
    adjoint: diffrax.AbstractAdjoint | None = None,
) -> Trajectory:
    """Simulate a slider, by default from steady sliding at the motion's first velocity.

    For the equations see `simulation.ode` and the laws. The function works under `jit`, `vmap`,
    forward mode, reverse mode and forward over reverse. Derivatives are exact to second order, with
    respect to every array of `rig`, `motion`, `start` and `ts`. Exceptions are the times of the
    motion's jumps and `ts[0]`, where the motion starts: derivatives by these times are 0.

    Parameters
    ----------
    rig, motion : the rig and its commanded motion.
    ts : sample times [s], ascending, shape (n,); the simulation starts at `ts[0]`. Repeat the last
        time to pad.
    start : velocity, spring elongation and state at `ts[0]`, where they differ from steady sliding;
        see `simulation.start`.
    at_steps : record at the solver's own steps between `ts[0]` and `ts[-1]` instead of at `ts`:
        all arrays get the length `max_steps` + 1, and the last row repeats to the end.
    rtol : requested error, relative to the range over which each quantity moves. For rtol 1e-4 to
        1e-8, results of all tested rigs were within 10 rtol of an independent solution. In float32
        (without `jax_enable_x64`) rounding limits the steps at 1e-6: with mass `max_steps` may not
        suffice, as `result` then says. Ask for 1e-4.
    max_steps : maximum number of solver steps.
    runaway : end the simulation when the slider moves `runaway` times faster than the
        largest commanded speed.
    stiff : True: the stiff method Rodas5P; False: Tsit5. The spring relaxes over A/K of slip,
        the mass within A/(m V); an explicit method's steps must be shorter. None: stiff with a
        mass, or if K times the path of the load point is concrete and exceeds 3000 A.
    solver, controller, adjoint : of diffrax. If any is given, `diffrax.diffeqsolve` simulates
        and the adjoint differentiates (default `diffrax.ForwardMode()`); `stiff` has no effect,
        and the default solver is `diffrax.Kvaerno5()`. With mass, give a controller with `dtmax`
        below A/(K V): a longer first step can overflow, and its derivative is then not finite.

    Returns
    -------
    Trajectory. Its `result` says whether and why the simulation ended early. Under `jit` and
    `vmap`, `result` also says whether the input was invalid.

    Raises
    ------
    InputError : `rtol` not in (0, 0.1], `runaway` not above 1, `max_steps` below 1, `ts` not of
        one dimension, friction that is no law, `start` with a state of another shape than the
        law's, or with a velocity for a slider without mass. Among concrete values: a parameter
        out of bounds, `ts` that descends, is not finite or begins before the motion, no steady
        sliding to start from.
    TypeError : a delay law (see `simulate_delay`), or neither direct effect nor mass.
    """
    if not isinstance(rtol, Tracer) and not 0 < rtol <= 0.1:
        raise InputError(f"simulate: rtol is {rtol}; it must be in (0, 0.1]")
    if not runaway > 1:
        raise InputError(f"simulate: runaway is {runaway}; it is a factor above 1")
    if max_steps < 1:
        raise InputError(f"simulate: max_steps is {max_steps}; take 1 at least")
    begin = InitialState() if start is None else start
    if not isinstance(begin, InitialState):
        raise InputError(f"simulate: start is {begin!r}; give an InitialState(...)")
    refuse_impossible("simulate", rig, ts, begin, motion=motion)
    if stiff is None:
        stiff = _is_stiff(rig, motion, ts)
    equation = SliderEquation(rig, motion, begin)
    initial = equation.initial()
    ts = jnp.asarray(ts, jnp.result_type(ts, *jax.tree.leaves(initial)))
    refuse_no_steady_state(initial, motion.first_velocity())
    possible = is_possible(rig, ts, begin, initial, motion=motion)
    ts_used = jnp.where(possible, ts, 0.0)
    initial = jax.tree.map(lambda x: jnp.where(possible, x, 0.0), initial)
    how = How(jnp.asarray(SAFETY * rtol), stiff, max_steps, math.log(runaway))
    how_given = {"solver": solver, "controller": controller, "adjoint": adjoint}
    if any(given is not None for given in how_given.values()):
        found, why = solve_given(equation, initial, ts_used, how, at_steps=at_steps, **how_given)
    else:
        found = (recorded if at_steps else follow)(equation, initial, ts_used, how)
        why = diffrax.RESULTS.max_steps_reached
    time = found.time if at_steps else ts
    slider = in_blocks(equation.physical, until(time, found.end), found.y)
    stopped = RESULTS.where(found.ran_away, RESULTS.ran_away, RESULTS.promote(why))
    result = RESULTS.where(found.reached, RESULTS.successful, stopped)
    read, steps = rig.sensor.read(time, slider.force), found.steps
    moved = slider.velocity, slider.slip, slider.state
    return only_if(possible, Trajectory(time, slider.force, read, *moved, result, found.end, steps))


def _is_stiff(rig: Rig, motion: AbstractMotion, ts: Array) -> bool:
    """Whether `simulate` uses the stiff method: with mass, or many relaxations of the spring."""
    if isinstance(rig.machine, Inertial) or not isinstance(motion, PiecewiseVelocity):
        return True
    scale, K = law_with_states(rig).force_scale(), rig.machine.stiffness
    if not all(is_known(x) for x in (scale, K, motion.times, motion.velocities, ts)):
        return False
    times, last = np.asarray(motion.times), np.asarray(ts)[-1]
    lasts = np.diff(np.minimum(np.append(times, np.inf), last))
    path = float(np.sum(np.abs(np.asarray(motion.velocities)) * lasts))
    return bool(np.asarray(K) * path > STIFF * np.asarray(scale))
