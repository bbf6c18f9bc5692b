"""`minimise(residual, z0, args)`: least squares that JAX compiles, batches and differentiates.

`minimise` finds the z with the least |r(z, p)|^2, by the Levenberg-Marquardt method of optimistix.
One evaluation gives the residual r (n,) and its Jacobian J (n, q) together, in forward mode. The
method needs only residual and Jacobian, so a fit costs one simulation with all tangents per
evaluated point.

A descent ends when the next Gauss-Newton step d = -(J^T J)^-1 J^T r is small:

    |J d| <= rtol |r|/sqrt(n) + atol.

If the residual r is noise, |r|/sqrt(n) is the standard deviation of the noise. The ratio of |J d|
to the standard deviation of the noise is the length of the step d in standard errors of the
parameters. With rtol = 1e-3 a descent therefore ends within a thousandth of a standard error of the
parameters. The test of convergence does not depend on the units of z and r. A trial whose residual
is not finite, or is huge (a slider that ran away), is rejected. The step after a rejected trial is
shorter. A descent also ends if a full step is within 30 rtol and rejected trials have made the next
step very short.

Derivatives of the minimum z*(p) come from F(z, p) = J^T r = 0 (the implicit function theorem):

    dz*/dp = -F_z^-1 F_p,   F_z = J^T J + sum_i r_i d^2 r_i/dz^2.

F_z is the true Hessian, not the J^T J of Gauss and Newton, so the derivative is exact even if the
residual is large. The descent itself is not differentiated. Second derivatives of the minimum
differentiate the rule for dz*/dp again, which needs third derivatives of the residual r by z.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..simulation.rodas import inverted
from .abstract_problem import AbstractProblem
from .thresholds import DAMPING, LEVEL, NEAR, SHORT, UNSEEN

Residual = Callable[[Float[Array, " q"], Any], Float[Array, " n"]]
"""r(z, args)."""


class Minimum(NamedTuple):
    """End of a descent. All fields of the result except `result` and `evaluations` have derivatives
    by `args`.
    """

    value: Float[Array, " q"]
    """z*."""
    residual: Float[Array, " n"]
    """r at z*."""
    jacobian: Float[Array, "n q"]
    """J at z*."""
    cost: Float[Array, ""]
    """|r|^2 at z*."""
    result: optx.RESULTS
    """`optimistix.RESULTS.successful`, or the reason for not converging."""
    evaluations: Int[Array, ""]
    """Points at which residual and Jacobian were computed."""

    @property
    def converged(self) -> Bool[Array, ""]:
        """Whether the descent ended at a minimum."""
        return self.result == optx.RESULTS.successful


def minimise(
    residual: Residual | AbstractProblem,
    z0: Float[Array, " q"],
    args: PyTree = None,
    *,
    rtol: float = 1e-3,
    atol: float = 1e-12,
    max_steps: int | Int[Array, ""] = 80,
) -> Minimum:
    """Minimise |residual(z, args)|^2 from `z0`; see the module for the method.

    `minimise` works under `jax.jit`, `jax.vmap`, `jax.jacfwd` and `jax.grad`. Under `vmap` all
    descents take as long as the slowest one. If the Hessian is singular, derivatives use its
    pseudo-inverse.

    Parameters
    ----------
    residual : a function r(z, args) -> (n,); or a `Problem`. The minimum then has derivatives by
        the arrays of the problem: friction, weights, stiffness, ... Reverse mode by an array that
        the simulation uses requires a simulation with reverse mode.
    z0 : starting point, unbounded parameters (q,); derivatives do not depend on it.
    args : any pytree, passed on to `residual`.
    rtol : the last step in standard errors of the parameters.
    atol : the last step in units of the residual's norm, for residuals that vanish.
    max_steps : most evaluations of residual and Jacobian; may be traced. With `max_steps` = 1 only
        `z0` is evaluated.

    Returns
    -------
    Minimum. Check `converged`: a descent that does not converge raises no exception.
    """
    if isinstance(residual, AbstractProblem):
        function: Residual = _of_problem
        args = residual
    else:
        function = residual
    found = optx.least_squares(
        _Once(function),
        _Marquardt(rtol, atol, max_steps),
        z0,
        args=args,
        options={"jac": "fwd"},
        max_steps=None,  # `_Marquardt` counts them
        adjoint=optx.ImplicitAdjoint(linear_solver=lx.AutoLinearSolver(well_posed=False)),
        throw=False,
    )
    last = found.state.f_info
    known = jax.lax.stop_gradient((last.residual, last.jac.as_matrix()))
    left, jacobian = _as_known(function, found.value, args, known)
    count = found.stats["num_steps"]
    return Minimum(found.value, left, jacobian, jnp.sum(left**2), found.result, count)


def residual_with_jacobian(
    residual: Residual, z: Float[Array, " q"], args: PyTree
) -> tuple[Float[Array, " n"], Float[Array, "n q"]]:
    """Residual r and Jacobian J at `z`, from one evaluation with all tangents. Entries of J that
    are not finite are set to 0.
    """

    def push(tangent: Array) -> tuple[Array, Array]:
        return jax.jvp(lambda z: residual(z, args), (z,), (tangent,))

    left, jacobian = jax.vmap(push, out_axes=(None, -1))(jnp.eye(z.shape[0], dtype=z.dtype))
    return left, jnp.where(jnp.isfinite(jacobian), jacobian, 0.0)


def _of_problem(z: Float[Array, " q"], problem: AbstractProblem) -> Float[Array, " r"]:
    return problem.residual(z)


class _Once(eqx.Module):
    """r(z, args) as a function whose derivative by z is the matrix J.

    optimistix linearises a residual, then applies that linear map several times per step. With a
    plain simulation each application would solve the differential equation again.
    """

    function: Residual = eqx.field(static=True)

    def __call__(self, z: Float[Array, " q"], args: PyTree) -> Float[Array, " n"]:
        return _once(self.function, z, args)


@eqx.filter_custom_jvp
def _once(function: Residual, z: Array, args: PyTree) -> Array:
    return function(z, args)


@_once.def_jvp
def _once_jvp(primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    function, z, args = primals
    _, t_z, t_args = tangents
    if t_z is None:
        left, along = function(z, args), jnp.zeros(())
    else:
        left, jacobian = residual_with_jacobian(function, z, args)
        along = jacobian @ t_z
    moves = jax.tree.map(lambda t: t is not None, t_args, is_leaf=lambda t: t is None)
    if any(jax.tree.leaves(moves)):
        some, rest = eqx.partition(args, moves)
        _, by_args = jax.jvp(lambda some: function(z, eqx.combine(some, rest)), (some,), (t_args,))
        along = along + by_args
    return left, jnp.broadcast_to(along, left.shape)


@eqx.filter_custom_jvp
def _as_known(
    function: Residual, z: Array, args: PyTree, known: tuple[Array, Array]
) -> tuple[Array, Array]:
    """r and J at `z`: their values are `known`, only their derivatives are computed."""
    return known


@_as_known.def_jvp
def _as_known_jvp(primals: tuple, tangents: tuple) -> tuple[tuple, tuple]:
    function, z, args, known = primals
    _, t_z, t_args, _ = tangents
    moves = jax.tree.map(lambda t: t is not None, (t_z, t_args), is_leaf=lambda t: t is None)
    some, rest = eqx.partition((z, args), moves)

    def again(some: PyTree) -> tuple[Array, Array]:
        return residual_with_jacobian(function, *eqx.combine(some, rest))

    return known, jax.jvp(again, (some,), ((t_z, t_args),))[1]


class _Damped(optx.AbstractDescent):
    """The step d of Marquardt: (J^T J + l D) d = -J^T r, D the diagonal of J^T J.

    D makes the steps independent of the units of z. The small normal equations take a tenth of the
    time of optimistix's QR of all rows. They lose digits, which l and more steps compensate.
    """

    def init(self, y: Float[Array, " q"], f_info_struct: PyTree) -> PyTree:
        """State of the method before the first evaluation of the residual."""
        q, n = y.shape[0], f_info_struct.residual.shape[0]
        return jnp.zeros(n, y.dtype), jnp.zeros((n, q), y.dtype)

    def query(self, y: Float[Array, " q"], f_info: PyTree, state: PyTree) -> PyTree:
        """Residual and Jacobian at an accepted point."""
        return f_info.residual, f_info.jac.as_matrix()

    def step(
        self, step_size: Float[Array, ""], state: tuple[Array, Array]
    ) -> tuple[Float[Array, " q"], optx.RESULTS]:
        """The step from the last accepted point, with the damping l = `DAMPING`/`step_size`."""
        left, jacobian = state
        unit, size = _unit_columns(jacobian)
        damped = unit.T @ unit + DAMPING / step_size * jnp.eye(unit.shape[1])
        return -(inverted(damped) @ (unit.T @ left)) / size, optx.RESULTS.successful


def _unit_columns(jacobian: Float[Array, "n q"]) -> tuple[Float[Array, "n q"], Float[Array, " q"]]:
    """J with columns of length 1, and their lengths; a zero column keeps 0, with length 1."""
    size = jnp.sqrt(jnp.sum(jacobian**2, axis=0))
    size = jnp.where(size > 0, size, 1.0)
    return jacobian / size, size


def _say_nothing(**_: object) -> None:
    """Message hook of optimistix: prints nothing."""


class _Marquardt(optx.AbstractGaussNewton):
    """Levenberg-Marquardt of optimistix with another termination test (see the module).

    optimistix stops when two accepted points agree, which takes two more evaluations. If simulation
    error hides the gain of a step, it accepts no step and never stops.
    """

    rtol: float
    atol: float
    max_steps: int | Int[Array, ""]
    norm: Callable[[PyTree], Array]
    descent: "_Damped"  # ty: ignore[incompatible-mutable-override]
    search: optx.ClassicalTrustRegion  # ty: ignore[incompatible-mutable-override]
    verbose: Callable[..., None]

    def __init__(self, rtol: float, atol: float, max_steps: int | Int[Array, ""]):
        self.rtol, self.atol, self.max_steps = rtol, atol, max_steps
        self.norm = optx.max_norm
        self.descent, self.search = _Damped(), optx.ClassicalTrustRegion(low_constant=0.1)
        self.verbose = _say_nothing

    def terminate(
        self,
        fn: Callable,
        y: Float[Array, " q"],
        args: PyTree,
        options: dict[str, Any],
        state: PyTree,
        tags: frozenset[object],
    ) -> tuple[Bool[Array, ""], optx.RESULTS]:
        """Whether the Gauss-Newton step from the last accepted point is small, or gains nothing."""
        left, jacobian = state.f_info.residual, state.f_info.jac.as_matrix()
        cost = jnp.sum(left**2)
        gain = _gain(left, jacobian)
        least = self.rtol * jnp.sqrt(cost / left.shape[0]) + self.atol
        level = (state.num_steps_since_acceptance > 0) & (gain <= LEVEL * cost)
        near = gain <= (NEAR * self.rtol) ** 2 * cost / left.shape[0]
        level |= near & (state.search_state.step_size <= SHORT)
        begun = jnp.logical_not(state.first_step)
        there = begun & ((gain <= least**2) | level)
        spent = state.num_steps >= self.max_steps
        out = optx.RESULTS.where(
            spent & ~there, optx.RESULTS.nonlinear_max_steps_reached, state.result
        )
        return there | spent, out


def _gain(left: Float[Array, " n"], jacobian: Float[Array, "n q"]) -> Float[Array, ""]:
    """|J d|^2 of the Gauss-Newton step d; directions in the null space of J do not count."""
    unit, _ = _unit_columns(jacobian)
    slope = unit.T @ left
    return slope @ (inverted(unit.T @ unit + UNSEEN * jnp.eye(unit.shape[1])) @ slope)
