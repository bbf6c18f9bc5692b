"""The root finder of the implicit solver.

Near sticking the friction force relaxes to the pull within A/(m V), as little as 1e-29 s,
while the solver takes steps of seconds. Rounding of the force is then a large rate: the
residual never gets small, and the Newton update, which divides that rate out again, only down to
rounding over the length of the step, a length that a root finder does not know. Usual tests of
convergence give up on such a stage at rest, at reversals and for light sliders.
"""

from collections.abc import Callable, Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int, PyTree

_Y = PyTree[Array]
_Options = Mapping[str, object]
_Tags = frozenset[object]
_Fn = Callable[[_Y, PyTree], tuple[_Y, PyTree]]
"""A function of the unknown and the arguments: the residual and auxiliary output."""


class _State(eqx.Module):
    update: Float[Array, ""]  # norm of the last update, in units of the tolerance
    previous: Float[Array, ""]
    steps: Int[Array, ""]
    result: optx.RESULTS


class UpdateNewton(optx.AbstractRootFinder):
    """Newton's method; it stops once the update is below `fraction` of the tolerance.

    It also stops, from the third update on, where updates no longer halve: that is rounding, or a
    stage that does not converge. What is left then enters the solver's estimate of the
    step's error with the weight it has in the step, which accepts the one and refuses the other.
    """

    rtol: float
    atol: float
    norm: Callable[[PyTree], Array] = optx.max_norm
    fraction: float = 1e-2

    def init(
        self,
        fn: _Fn,
        y: _Y,
        args: PyTree,
        options: _Options,
        f_struct: PyTree,
        aux_struct: PyTree,
        tags: _Tags,
    ) -> _State:
        del fn, args, options, f_struct, aux_struct, tags
        dtype = jnp.result_type(*jax.tree.leaves(y))
        inf = jnp.asarray(jnp.inf, dtype)
        return _State(inf, inf, jnp.asarray(0), optx.RESULTS.successful)

    def step(
        self, fn: _Fn, y: _Y, args: PyTree, options: _Options, state: _State, tags: _Tags
    ) -> tuple[_Y, _State, PyTree]:
        del options
        residual, tangent, aux = jax.linearize(lambda z: fn(z, args), y, has_aux=True)
        jacobian = lx.FunctionLinearOperator(tangent, jax.eval_shape(lambda: y), tags=tags)
        solution = lx.linear_solve(
            jacobian, residual, lx.AutoLinearSolver(well_posed=None), throw=False
        )
        y = jax.tree.map(lambda a, b: a - b, y, solution.value)
        scaled = jax.tree.map(
            lambda a, b: b / (self.atol + self.rtol * jnp.abs(a)), y, solution.value
        )
        result = optx.RESULTS.promote(solution.result)
        return y, _State(self.norm(scaled), state.update, state.steps + 1, result), aux

    def terminate(
        self, fn: _Fn, y: _Y, args: PyTree, options: _Options, state: _State, tags: _Tags
    ) -> tuple[Bool[Array, ""], optx.RESULTS]:
        del fn, y, args, options, tags
        failed = state.result != optx.RESULTS.successful
        lost = jnp.isnan(state.update)
        result = optx.RESULTS.where(lost, optx.RESULTS.nonlinear_divergence, state.result)
        stalls = (state.steps >= 3) & (state.update > 0.5 * state.previous)
        return failed | lost | stalls | (state.update < self.fraction), result

    def postprocess(
        self,
        fn: _Fn,
        y: _Y,
        aux: PyTree,
        args: PyTree,
        options: _Options,
        state: _State,
        tags: _Tags,
        result: optx.RESULTS,
    ) -> tuple[_Y, PyTree, dict[str, object]]:
        del fn, args, options, state, tags, result
        return y, aux, {}
