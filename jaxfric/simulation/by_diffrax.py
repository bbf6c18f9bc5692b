"""Compute a motion by `diffrax.diffeqsolve`, with a solver, step-size controller or adjoint method
that the user gives.
"""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .ode import SliderEquation, Unknowns
from .stepping import How, Sampled, until


def solve_given(
    equation: SliderEquation,
    initial: Unknowns,
    ts: Float[Array, " n"],
    how: How,
    *,
    at_steps: bool,
    solver: diffrax.AbstractSolver | None,
    controller: diffrax.AbstractStepSizeController | None,
    adjoint: diffrax.AbstractAdjoint | None,
) -> tuple[Sampled, diffrax.RESULTS]:
    """The solution at `ts` or at the steps, and how the solution ended.

    Derivatives are the derivatives of the adjoint. The default solver is Kvaerno5. In steady
    sliding the estimated error is 0, so the steps of an explicit method grow beyond its region of
    stability. The motion stays correct, but the derivatives of the motion grow without bound.
    """
    if controller is None:
        controller = diffrax.PIDController(rtol=how.tolerance, atol=how.tolerance)
    jumps = equation.motion.breakpoints()
    if jumps.shape[0]:  # the clipping controller refuses an empty array
        controller = diffrax.ClipStepSizeController(controller, jump_ts=jumps)
    found = diffrax.diffeqsolve(
        diffrax.ODETerm(eqx.Partial(_rate, equation)),
        diffrax.Kvaerno5() if solver is None else solver,
        ts[0],
        ts[-1],
        None,
        initial,
        saveat=diffrax.SaveAt(t0=at_steps, steps=at_steps, dense=not at_steps),
        stepsize_controller=controller,
        event=diffrax.Event(eqx.Partial(_ran_away, equation, how.log_runaway)),
        adjoint=diffrax.ForwardMode() if adjoint is None else adjoint,
        max_steps=how.max_steps,
        throw=False,
    )
    if at_steps:
        assert found.ts is not None
        last = found.stats["num_accepted_steps"]
        rows = jnp.minimum(jnp.arange(found.ts.shape[0]), last)
        time, y = jax.tree.map(lambda x: x[rows], (found.ts, found.ys))
        end = time[-1]
    else:
        assert found.interpolation is not None
        time, end = ts, found.interpolation.t1
        y = jax.vmap(found.interpolation.evaluate)(until(ts, end))
    reached = found.result == diffrax.RESULTS.successful
    ran_away = found.result == diffrax.RESULTS.event_occurred
    sampled = Sampled(time, y, end, reached, ran_away, found.stats["num_steps"])
    return sampled, found.result


# a lambda would be compiled anew at every call
def _rate(equation: SliderEquation, t: Array, y: Unknowns, args: None) -> Unknowns:
    del args
    return equation.derivative(t, y)


def _ran_away(
    equation: SliderEquation, limit: float, t: Array, y: Unknowns, args: None, **_: object
) -> Bool[Array, ""]:
    del args
    return equation.log_speed(t, y) > limit
