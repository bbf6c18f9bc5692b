"""The log posterior of a fit: its likelihood and the priors of its parameters.

    log p(y | record) = -|r(z(y))|^2/2 + sum_i [log p_i(x_i(y_i)) + log |dx_i/dy_i|] + constant

r is the residual that `jaxfric.fit` minimises with its weighting "whitened": in units of the noise
that the fit found, and uncorrelated under it. The noise is held at that estimate; its own
uncertainty is not in the posterior. An "ordinary" fit finds the noise in the same way but weighs
all rows alike, so its values may differ from the maximum here by more than an error, whatever the
priors: beside a posterior stands the fit that is whitened by the same noise. Glitches are passed
over as in the fit. y holds one variable a parameter (`distributions`) and then the shifts of step
times that are fitted, in units of their errors, whose prior N(0, 1) is a part of r; shifts that
only pad the problem stay 0.

A simulation that fails is a large finite misfit without slope. The derivative is in forward mode,
one solve with all tangents: the gradient is -r^T J.
"""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..fitting.abstract_problem import FAILED_MISFIT
from ..fitting.noise import Noise, Whitening, whitening
from ..fitting.problem import Problem
from ..traced import traced
from .distributions import AbstractPrior


class Target(eqx.Module):
    """A problem whose residual has unit variance, and the priors of its parameters in order."""

    problem: Problem
    """Its residuals are those of one row after another (`Problem.plain`)."""
    whitening: Whitening | None
    """What makes them uncorrelated and of unit variance; None: they are."""
    priors: tuple[AbstractPrior, ...]
    shifts: int = eqx.field(static=True)
    """How many of the problem's shifts of step times are real; the rest pad it."""

    def natural(self, y: Float[Array, " q"]) -> Float[Array, " p"]:
        """Parameters [SI] of the variables."""
        return jnp.stack([prior.natural(y[i]) for i, prior in enumerate(self.priors)])

    def free(self, y: Float[Array, " q"]) -> Float[Array, " q"]:
        """The fit's unbounded variables of the variables."""
        p = len(self.priors)
        own, padding = self.problem.coordinates.to_free(self.natural(y)), p + self.shifts
        return jnp.concatenate([own[:p], y[p:], own[padding:]])

    def log_prior(self, y: Float[Array, " q"]) -> Float[Array, ""]:
        """Log density of the priors, Jacobians included; the shifts of step times are in r."""
        return jnp.sum(jnp.stack([p.log_density(y[i]) for i, p in enumerate(self.priors)]))

    def start(self, z: np.ndarray) -> np.ndarray:
        """The variables of the fit's unbounded ones, moved to where every prior has a density."""
        values = self.problem.coordinates.from_free(np.asarray(z))
        own = [p.variable(float(v)) for p, v in zip(self.priors, values, strict=True)]
        return np.concatenate([own, np.asarray(z)[len(own) : len(own) + self.shifts]])


def target_of_problem(problem: Problem, noise: Noise, priors: tuple[AbstractPrior, ...]) -> Target:
    """The log posterior of a problem whose noise is known (in units of its `noise_scale`)."""
    shifts = int(np.sum(np.asarray(problem.shift_scale) > 0))
    return Target(*likelihood(problem, noise), priors, shifts)


def likelihood(problem: Problem, noise: Noise) -> tuple[Problem, Whitening | None]:
    """The problem and the filter by which its residuals have unit variance under `noise` (in units
    of its `noise_scale`). White noise needs no filter."""
    if np.ndim(noise.scale):
        raise ValueError("the scale of the noise must be one for all rows")
    if not noise.is_white:
        noise = jax.tree.map(_put, noise)
        return problem.plain(), whitening(problem.clock, problem.weight, noise)
    size = float(problem.noise_scale) * float(noise.sigma) * float(noise.scale)
    return dataclasses.replace(problem.plain(), noise_scale=_put(size)), None


def _put(x: object) -> Array:
    return jax.device_put(np.asarray(x, float))


class Point(NamedTuple):
    """The log posterior at a point: value, gradient, Jacobian of the residual by the variables, and
    minus the second derivatives of the log prior, which is a sum over the parameters."""

    log_density: Float[Array, ""]
    gradient: Float[Array, " q"]
    jacobian: Float[Array, "r q"]
    prior_information: Float[Array, " q"]


def value_and_gradient(
    target: Target, y: Float[Array, " q"]
) -> tuple[Float[Array, ""], Float[Array, " q"]]:
    """The log posterior and its gradient."""
    r, jacobian = _residual(target, y)
    prior, slope = jax.value_and_grad(target.log_prior)(y)
    return prior - 0.5 * jnp.sum(r * r), slope - r @ jacobian


@traced
def point(target: Target, y: Float[Array, " q"]) -> Point:
    """The log posterior about a point."""
    r, jacobian = _residual(target, y)
    prior, slope = jax.value_and_grad(target.log_prior)(y)
    bend = jnp.diagonal(jax.hessian(target.log_prior)(y))
    return Point(prior - 0.5 * jnp.sum(r * r), slope - r @ jacobian, jacobian, -bend)


@traced
def natural_of(target: Target, ys: Float[Array, "s q"]) -> Float[Array, "s p"]:
    """Parameters [SI] of several rows of variables."""
    return jax.vmap(target.natural)(ys)


def _residual(target: Target, y: Float[Array, " q"]) -> tuple[Array, Array]:
    def push(tangent: Array) -> tuple[Array, Array]:
        return jax.jvp(lambda at: target.problem.residual(target.free(at)), (y,), (tangent,))

    r, jacobian = jax.vmap(push, out_axes=(None, -1))(jnp.eye(y.shape[0], dtype=y.dtype))
    if target.whitening is None:
        return r, jacobian
    rows = target.problem.time.shape[0]
    columns = jnp.column_stack([r, jacobian])
    white = jnp.concatenate([target.whitening(columns[:rows]), columns[rows:]])
    failed = r == FAILED_MISFIT  # such a trial stays as bad as it is
    return jnp.where(failed, r, white[:, 0]), white[:, 1:]
