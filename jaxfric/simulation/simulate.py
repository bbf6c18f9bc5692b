"""One entry point: `simulate(rig, motion, ts)`.

The solver takes the steps it needs and keeps them with its own interpolant; all samples are
then evaluated at once. Handing thousands of sample times to the solver instead costs four to
eight times as much, and a cubic through the steps is less accurate than the solver. For stick-slip
over many periods the steps themselves are the better samples (`at_steps`): they crowd where the
slider slips, and take a tenth of the memory of an interpolant.

The solver is `Rodas5P`, and derivatives follow from the steps it took (`tangents`). A recorded
normal stress makes many steps necessary; without mass the cheaper ones of Tsit5 are then better.
Where a solver or an adjoint is given derivatives are diffrax's own.
"""

import functools
import math
from typing import NamedTuple, TypeVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..errors import InputError
from ..motion import AbstractMotion
from ..rig import Inertial, Rig
from ..threads import on_processor
from .blocks import in_blocks
from .checks import is_possible, refuse_impossible, refuse_no_steady_state
from .ode import Slider, SliderEquation, Unknowns
from .rodas import QuarticInterpolation, Rodas5P, through
from .start import Start
from .steps import StableStepController, padded_norm
from .tangents import Knots, differentiable
from .trajectory import RESULTS, Trajectory, only_if

# The controller bounds the error of one step. Over a record errors add up and the interpolant
# adds its own; this factor keeps the result within 10 rtol (tests/test_simulate.py).
_SAFETY = 0.03
_QUARTERS = (0.25, 0.5, 0.75)

T = TypeVar("T")


def simulate(
    rig: Rig,
    motion: AbstractMotion,
    ts: Float[Array, " n"],
    *,
    start: Start | None = None,
    at_steps: bool = False,
    rtol: float = 1e-6,
    max_steps: int = 4096,
    runaway: float = 1e4,
    solver: diffrax.AbstractSolver | None = None,
    adjoint: diffrax.AbstractAdjoint | None = None,
) -> Trajectory:
    """Simulate a slider, by default from steady sliding at the motion's first velocity.

    Equations: see `simulate.ode` and the laws. Jittable and vmappable; differentiable with
    respect to every array of `rig` and `motion` except the times of the motion's jumps.

    Parameters
    ----------
    rig, motion : the rig and its commanded motion.
    ts : sample times [s], ascending, shape (n,); the simulation starts at `ts[0]`. Repeat
        the last one to pad.
    start : velocity, spring elongation and state at `ts[0]` where they are not those of
        steady sliding; see `simulation.start`.
    at_steps : record at the solver's own steps between `ts[0]` and `ts[-1]` instead of at `ts`:
        all arrays get the length `max_steps` + 1, and the last row repeats to the end.
    rtol : error wanted, relative to the range over which each quantity moves. The result
        was within 10 rtol of an independent solution for rtol 1e-4 to 1e-8 in all rigs tested.
    max_steps : no more solver steps than this are taken; also the length of the
        solver's memory, so a batch runs faster with a small one.
    runaway : end the simulation when the slider moves `runaway` times faster than the
        largest commanded speed.
    solver : default `Rodas5P()`; without mass, but with an `adjoint` or a recorded normal
        stress, `diffrax.Tsit5()`. The spring relaxes over A/K of slip, mass within A/(m V): an
        explicit solver may take no longer steps.
    adjoint : by default forward mode (`jax.jvp`, `jax.jacfwd`), right for a handful of
        parameters: `tangents`, or at steps and with a `solver` `diffrax.ForwardMode()`. For
        reverse mode (`jax.grad`, `jax.vjp`) pass `diffrax.RecursiveCheckpointAdjoint()`.

    Returns
    -------
    Trajectory. Its `result` says whether and why the simulation ended early, and under `jit` and
    `vmap` whether what was asked for is impossible.

    Raises
    ------
    InputError : `rtol` not in (0, 0.1], `runaway` not above 1, `ts` not of one dimension, `start`
        with a velocity for a slider without mass; and of what is known when it is called, a
        parameter out of its bounds, `ts` that descends, is not finite or begins before the
        motion, no steady sliding to start from.
    TypeError : a delay law (see `simulate_delay`), or a law without direct effect without mass.
    """
    how = _Solving(at_steps, rtol, max_steps, runaway, solver, adjoint)
    return _solve(rig, motion, ts, Start() if start is None else start, how)


class _Solving(NamedTuple):
    """How a simulation is solved and recorded; see `simulate`."""

    at_steps: bool
    rtol: float
    max_steps: int
    runaway: float
    solver: diffrax.AbstractSolver | None
    adjoint: diffrax.AbstractAdjoint | None

    @property
    def own(self) -> bool:
        """Whether derivatives are those of `tangents`; at steps, which may be very many and need
        no interpolant, they are the solver's."""
        return not self.at_steps and self.solver is None and self.adjoint is None


def _solve(
    rig: Rig, motion: AbstractMotion, ts: Float[Array, " n"], begin: Start, how: _Solving
) -> Trajectory:
    rtol, runaway = how.rtol, how.runaway
    if not (0 < rtol <= 0.1) or math.isnan(rtol):
        raise InputError(f"simulate: rtol is {rtol}; it must be in (0, 0.1]")
    if not runaway > 1:
        raise InputError(f"simulate: runaway is {runaway}; it is a factor above 1")
    refuse_impossible("simulate", rig, ts, begin, motion=motion)
    ts = jnp.asarray(ts)
    equation = SliderEquation(rig, motion, begin)
    initial = equation.initial()
    refuse_no_steady_state(initial, motion.first_velocity())
    possible = is_possible(rig, ts, begin, initial, motion=motion)
    first, last = (jnp.where(possible, t, 0.0) for t in (ts[0], ts[-1]))
    initial = jax.tree.map(lambda x: jnp.where(possible, x, 0.0), initial)
    if how.own:
        start = _constant((equation, first, last, initial))
        solution = _integrated(*start, how)
        knots = differentiable(equation, initial, _knots(solution))
        found = _between(equation, solution, (initial, knots), ts)
    else:
        solution = _integrated(equation, first, last, initial, how)
        found = _at_steps(equation, solution) if how.at_steps else _sample(equation, solution, ts)
    return only_if(possible, found)


def _integrated(
    equation: SliderEquation, first: Array, last: Array, initial: Unknowns, how: _Solving
) -> diffrax.Solution:
    rig, own, solver = equation.rig, how.own, how.solver
    if solver is None:
        free = how.adjoint is None and rig.normal_stress is None
        stiff = isinstance(rig.machine, Inertial) or free
        solver = Rodas5P() if stiff else diffrax.Tsit5()
    return diffrax.diffeqsolve(
        diffrax.ODETerm(equation.derivative),
        solver,
        first,
        last,
        None,
        initial,
        saveat=diffrax.SaveAt(t0=True, steps=True) if how.at_steps else diffrax.SaveAt(dense=True),
        stepsize_controller=_controller(how.rtol, equation, None if own else solver),
        event=diffrax.Event(_RanAway(equation, math.log(how.runaway))),
        adjoint=diffrax.ForwardMode() if how.adjoint is None else how.adjoint,
        max_steps=how.max_steps,
        throw=False,
    )


def _constant(tree: T) -> T:
    """The same numbers, without derivatives."""
    return jax.tree.map(lambda x: jax.lax.stop_gradient(x) if eqx.is_inexact_array(x) else x, tree)


class _RanAway(eqx.Module):
    """The end of a simulation; no lambda, which would be compiled anew at every call."""

    equation: SliderEquation
    limit: float = eqx.field(static=True)

    def __call__(self, t: Array, y: Unknowns, args: None, **_: object) -> Bool[Array, ""]:
        del args
        return self.equation.log_speed(t, y) > self.limit


def _controller(
    rtol: float, equation: SliderEquation, solver: diffrax.AbstractSolver | None
) -> diffrax.AbstractStepSizeController:
    """The controller for a `solver` whose tangents go with it; None: they do not."""
    tolerance = _SAFETY * rtol
    controller = diffrax.PIDController(rtol=tolerance, atol=tolerance, norm=padded_norm)
    if not (solver is None or isinstance(solver, diffrax.AbstractImplicitSolver | Rodas5P)):
        controller = StableStepController(controller, _constant(equation).derivative)
    jumps = equation.motion.breakpoints()
    if jumps.shape[0] == 0:  # which the clipping controller cannot take
        return controller
    return diffrax.ClipStepSizeController(controller, jump_ts=jumps)


def _knots(solution: diffrax.Solution) -> Knots:
    """The steps of a solution whose interpolant is a quartic."""
    path = _constant(solution.interpolation)
    assert isinstance(path, diffrax.DenseInterpolation)
    t0, t1, count = path.ts[:-1], path.ts[1:], jnp.asarray(path.ts_size) - 1
    own = path.infos
    if path.interpolation_cls is QuarticInterpolation:
        return Knots(t0, t1, **own, count=count)
    y0, y1 = own["y0"], own["y1"]

    def inside(share: float) -> Unknowns:
        local = jax.vmap(lambda t0, t1, own: path.interpolation_cls(t0=t0, t1=t1, **own))
        ends = jnp.zeros_like(t0), jnp.ones_like(t1)
        return jax.vmap(lambda one: one.evaluate(jnp.asarray(share)))(local(*ends, own))

    k = jax.tree.map(functools.partial(through, _QUARTERS), y0, y1, *map(inside, _QUARTERS))
    return Knots(t0, t1, y0, y1, k, count)


def _between(
    equation: SliderEquation,
    solution: diffrax.Solution,
    path: tuple[Unknowns, Knots],
    ts: Float[Array, " n"],
) -> Trajectory:
    """The motion at `ts` from `path`: where it begins, and its knots."""
    initial, knots = path
    last = jnp.maximum(knots.count - 1, 0)
    still = knots.count == 0
    interpolation = _constant(solution.interpolation)
    assert interpolation is not None
    end = jnp.where(still, interpolation.t0, knots.t1[last])
    reached = jnp.minimum(ts, end)
    rows = _steps_of(_constant((knots.t1, last, reached)))
    steps = QuarticInterpolation(knots.t0, knots.t1, knots.y0, knots.y1, knots.k)

    def at(t: Array, i: Array) -> Slider:
        y = jax.tree.map(lambda x: x[i], steps).evaluate(t)
        return equation.physical(t, jax.tree.map(lambda a, b: jnp.where(still, a, b), initial, y))

    return _trajectory(equation.rig, solution, ts, end, in_blocks(at, reached, rows))


def _steps_of(found: tuple[Array, Array, Array]) -> Array:
    """The step that each of some ascending times is in, from the ends of the steps, the last of
    them, and the times: both are gone through once, in a third of the time of a search."""
    ends, last, ts = found
    if not on_processor():
        return jnp.clip(jnp.searchsorted(ends, ts), 0, last)

    def next_one(k: Array, t: Array) -> tuple[Array, Array]:
        k = jax.lax.while_loop(lambda k: (ends[k] < t) & (k < last), lambda k: k + 1, k)
        return k, k

    return jax.lax.scan(next_one, jnp.zeros_like(last), ts)[1]


def _sample(
    equation: SliderEquation, solution: diffrax.Solution, ts: Float[Array, " n"]
) -> Trajectory:
    interpolation = solution.interpolation
    assert interpolation is not None
    end = interpolation.t1
    reached = jnp.minimum(ts, end)
    slider = jax.vmap(lambda t: equation.physical(t, interpolation.evaluate(t)))(reached)
    return _trajectory(equation.rig, solution, ts, end, slider)


def _at_steps(equation: SliderEquation, solution: diffrax.Solution) -> Trajectory:
    assert solution.ts is not None
    last = solution.stats["num_accepted_steps"]
    rows = jnp.minimum(jnp.arange(solution.ts.shape[0]), last)
    ts, ys = jax.tree.map(lambda x: x[rows], (solution.ts, solution.ys))
    slider = jax.vmap(equation.physical)(ts, ys)
    return _trajectory(equation.rig, solution, ts, ts[-1], slider)


def _trajectory(
    rig: Rig,
    solution: diffrax.Solution,
    ts: Float[Array, " n"],
    end: Float[Array, ""],
    slider: Slider,
) -> Trajectory:
    ran_away = solution.result == diffrax.RESULTS.event_occurred
    result = RESULTS.where(ran_away, RESULTS.ran_away, RESULTS.promote(solution.result))
    return Trajectory(
        time=ts,
        force=slider.force,
        recorded=rig.sensor.read(ts, slider.force),
        velocity=slider.velocity,
        slip=slider.slip,
        state=slider.state,
        result=result,
        end=end,
        num_steps=solution.stats["num_steps"],
    )
