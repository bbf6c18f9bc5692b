"""One entry point: `simulate(rig, motion, ts)`.

By default `stepping` integrates the motion in segments. The method is Tsit5 for a massless slider
that is not stiff, else `Rodas5P`. `tangents` computes derivatives of every order and mode from the
accepted steps. With `at_steps`, or a given solver, controller or adjoint, `diffrax.diffeqsolve`
integrates and differentiates.

For stick-slip over many periods, the solver's own steps (`at_steps`) are better samples than given
times. The steps are dense where the slider slips. Recording the steps needs a tenth of an
interpolant's memory.
"""

import math

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float, Int

from ..errors import InputError
from ..motion import AbstractMotion, PiecewiseVelocity
from ..quantity import is_known
from ..rig import Inertial, Rig
from .blocks import in_blocks
from .checks import is_possible, refuse_impossible, refuse_no_steady_state
from .ode import Slider, SliderEquation, Unknowns
from .rodas import Rodas5P
from .start import InitialState, law_with_states
from .stepping import SAFETY, How, Sampled, constant, follow
from .steps import StableStepController, padded_norm
from .trajectory import RESULTS, Trajectory, only_if

STIFF = 3000.0
"""Load-point path over A/K (spring relaxations) above which the stiff method is faster."""


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

    Equations: see `simulation.ode` and the laws. The function works under `jit`, `vmap`, forward
    mode, reverse mode and forward over reverse. Derivatives are exact to second order, with respect
    to every array of `rig`, `motion`, `start` and `ts` except the times of the motion's jumps.

    Parameters
    ----------
    rig, motion : the rig and its commanded motion.
    ts : sample times [s], ascending, shape (n,); the simulation starts at `ts[0]`. Repeat the last
        time to pad.
    start : velocity, spring elongation and state at `ts[0]`, where they differ from steady sliding;
        see `simulation.start`.
    at_steps : record at the solver's own steps between `ts[0]` and `ts[-1]` instead of at `ts`:
        all arrays get the length `max_steps` + 1, and the last row repeats to the end.
    rtol : error wanted, relative to the range over which each quantity moves. The result
        was within 10 rtol of an independent solution for rtol 1e-4 to 1e-8 in all rigs tested.
    max_steps : maximum number of solver steps.
    runaway : end the simulation when the slider moves `runaway` times faster than the
        largest commanded speed.
    stiff : True: the stiff method `Rodas5P`; False: Tsit5. The spring relaxes over A/K of slip,
        the mass within A/(m V); an explicit method's steps must be shorter. None: stiff with a
        mass, or if K times the path of the load point is concrete and exceeds 3000 A.
    solver, controller, adjoint : of diffrax. If any is given, `diffrax.diffeqsolve` simulates
        and the adjoint differentiates (default `diffrax.ForwardMode()`).

    Returns
    -------
    Trajectory. Its `result` tells whether and why the simulation ended early, and under `jit` and
    `vmap` whether the input was invalid.

    Raises
    ------
    InputError : `rtol` not in (0, 0.1], `runaway` not above 1, `ts` not of one dimension, `start`
        with a velocity for a slider without mass. Among concrete values: a parameter out of
        bounds, `ts` that descends, is not finite or begins before the motion, no steady sliding
        to start from.
    TypeError : a delay law (see `simulate_delay`), or neither direct effect nor mass.
    """
    if not isinstance(rtol, Tracer) and not 0 < rtol <= 0.1:
        raise InputError(f"simulate: rtol is {rtol}; it must be in (0, 0.1]")
    if not runaway > 1:
        raise InputError(f"simulate: runaway is {runaway}; it is a factor above 1")
    begin = InitialState() if start is None else start
    refuse_impossible("simulate", rig, ts, begin, motion=motion)
    if stiff is None:
        stiff = _is_stiff(rig, motion, ts)
    ts = jnp.asarray(ts)
    equation = SliderEquation(rig, motion, begin)
    initial = equation.initial()
    refuse_no_steady_state(initial, motion.first_velocity())
    possible = is_possible(rig, ts, begin, initial, motion=motion)
    ts_used = jnp.where(possible, ts, 0.0)
    initial = jax.tree.map(lambda x: jnp.where(possible, x, 0.0), initial)
    tolerance, away = SAFETY * rtol, math.log(runaway)
    if not at_steps and solver is None and controller is None and adjoint is None:
        how = How(stiff, max_steps, away)
        sampled = follow(equation, initial, ts_used, jnp.asarray(tolerance), how)
        found = _sampled(equation, sampled, ts)
    else:
        if solver is None:
            solver = Rodas5P() if stiff else diffrax.Tsit5()
        if controller is None:
            controller = _controller(equation, solver, tolerance)
        jumps = motion.breakpoints()
        if jumps.shape[0]:  # the clipping controller refuses an empty array
            controller = diffrax.ClipStepSizeController(controller, jump_ts=jumps)
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(equation.derivative),
            solver,
            ts_used[0],
            ts_used[-1],
            None,
            initial,
            saveat=diffrax.SaveAt(t0=at_steps, steps=at_steps, dense=not at_steps),
            stepsize_controller=controller,
            # a lambda would be compiled anew at every call
            event=diffrax.Event(eqx.Partial(_ran_away, equation, away)),
            adjoint=diffrax.ForwardMode() if adjoint is None else adjoint,
            max_steps=max_steps,
            throw=False,
        )
        found = _of_diffrax(equation, solution, ts)
    return only_if(possible, found)


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


def _sampled(equation: SliderEquation, found: Sampled, ts: Float[Array, " n"]) -> Trajectory:
    """The motion at `ts`."""
    reached = jnp.minimum(ts, found.end)
    slider = in_blocks(equation.physical, reached, found.y)
    stopped = RESULTS.where(
        found.ran_away, RESULTS.ran_away, RESULTS.promote(diffrax.RESULTS.max_steps_reached)
    )
    result = RESULTS.where(found.reached, RESULTS.successful, stopped)
    return _trajectory(equation.rig, ts, slider, result, found.end, found.steps)


def _controller(
    equation: SliderEquation, solver: diffrax.AbstractSolver, tolerance: float | Float[Array, ""]
) -> diffrax.AbstractStepSizeController:
    controller = diffrax.PIDController(rtol=tolerance, atol=tolerance, norm=padded_norm)
    if isinstance(solver, diffrax.AbstractImplicitSolver | Rodas5P):
        return controller
    return StableStepController(controller, constant(equation).derivative)


def _ran_away(
    equation: SliderEquation, limit: float, t: Array, y: Unknowns, args: None, **_: object
) -> Bool[Array, ""]:
    del args
    return equation.log_speed(t, y) > limit


def _of_diffrax(
    equation: SliderEquation, solution: diffrax.Solution, ts: Float[Array, " n"]
) -> Trajectory:
    """The motion at `ts`, or at the steps if those were saved."""
    between = solution.interpolation
    if between is None:
        assert solution.ts is not None
        last = solution.stats["num_accepted_steps"]
        rows = jnp.minimum(jnp.arange(solution.ts.shape[0]), last)
        ts, ys = jax.tree.map(lambda x: x[rows], (solution.ts, solution.ys))
        end = ts[-1]
        slider = jax.vmap(equation.physical)(ts, ys)
    else:
        end = between.t1
        reached = jnp.minimum(ts, end)
        slider = jax.vmap(lambda t: equation.physical(t, between.evaluate(t)))(reached)
    ran_away = solution.result == diffrax.RESULTS.event_occurred
    result = RESULTS.where(ran_away, RESULTS.ran_away, RESULTS.promote(solution.result))
    return _trajectory(equation.rig, ts, slider, result, end, solution.stats["num_steps"])


def _trajectory(
    rig: Rig,
    ts: Float[Array, " n"],
    slider: Slider,
    result: RESULTS,
    end: Float[Array, ""],
    steps: Int[Array, ""],
) -> Trajectory:
    recorded = rig.sensor.read(ts, slider.force)
    return Trajectory(
        ts, slider.force, recorded, slider.velocity, slider.slip, slider.state, result, end, steps
    )
