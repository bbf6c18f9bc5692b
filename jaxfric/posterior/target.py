"""The log posterior of a fit: its likelihood and the priors of its parameters.

    log p(y | record) = -|r(z(y))|^2/2 + sum_i [log p_i(x_i(y_i)) + log |dx_i/dy_i|] + constant

r is the residual that `jaxfric.fit` minimises with its weighting "whitened": in units of the noise
that the fit found, and uncorrelated under it. The noise is held at that estimate; its own
uncertainty is not in the posterior. An "ordinary" fit finds the noise in the same way and has the
error of its own weighting, so its values differ a little from the maximum here. Glitches are
passed over as in the fit. y holds one variable a parameter (`distributions`) and then the shifts of
step times that are fitted, in units of their errors, whose prior N(0, 1) is a part of r.

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

from ..fitting.noise import Noise
from ..fitting.problem import Problem
from ..traced import traced
from .distributions import AbstractPrior


class Target(eqx.Module):
    """A problem whose residual has unit variance, and the priors of its parameters in order."""

    problem: Problem
    priors: tuple[AbstractPrior, ...]

    def natural(self, y: Float[Array, " q"]) -> Float[Array, " p"]:
        """Parameters [SI] of the variables."""
        return jnp.stack([prior.natural(y[i]) for i, prior in enumerate(self.priors)])

    def free(self, y: Float[Array, " q"]) -> Float[Array, " q"]:
        """The fit's unbounded variables of the variables."""
        p = len(self.priors)
        return jnp.concatenate([self.problem.to_free(self.natural(y))[:p], y[p:]])

    def log_prior(self, y: Float[Array, " q"]) -> Float[Array, ""]:
        """Log density of the priors, Jacobians included; the shifts of step times are in r."""
        return jnp.sum(jnp.stack([p.log_density(y[i]) for i, p in enumerate(self.priors)]))

    def start(self, z: np.ndarray) -> np.ndarray:
        """The variables of the fit's unbounded ones, moved to where every prior has a density."""
        values = np.asarray(self.problem.from_free(jnp.asarray(z)))
        own = [p.variable(float(v)) for p, v in zip(self.priors, values, strict=True)]
        return np.concatenate([own, np.asarray(z)[len(own) :]])


def likelihood(problem: Problem, noise: Noise) -> Problem:
    """The problem with residuals of unit variance under `noise` (in units of its `noise_scale`).

    White noise needs no filter over the rows, which takes longer than the simulation.
    """
    white = not np.any(np.asarray(noise.share)) and np.ndim(noise.scale) == 0
    if not white:
        return problem.whitened(jax.tree.map(_put, noise))
    size = float(problem.noise_scale) * float(noise.sigma) * float(noise.scale)
    return dataclasses.replace(problem.plain(), noise_scale=_put(size))


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

    return jax.vmap(push, out_axes=(None, -1))(jnp.eye(y.shape[0], dtype=y.dtype))
