"""The log posterior of a fit: the likelihood and the priors of the fit's parameters.

    log p(y | record) = -|r(z(y))|^2/2 + sum_i [log p_i(x_i(y_i)) + log |dx_i/dy_i|] + constant

r is the residual that `jaxfric.fit` minimises with its weighting "whitened". Under the noise that
the fit found, the residual r is uncorrelated and has unit variance. The noise is fixed at the
estimate of the fit; the uncertainty of the noise is not included. An "ordinary" fit estimates the
same noise as a "whitened" fit but weights all rows equally. So an ordinary fit may differ from the
maximum of the posterior by more than a standard error, for any priors. A posterior is therefore
compared with the whitened fit. Outliers are excluded as in the fit. y holds one variable for each
parameter (`distributions`), then the fitted shifts of step times in units of their errors. The
prior N(0, 1) of the shifts is part of the residual r; padding shifts are fixed at 0.

A failed simulation counts as a large finite misfit with zero gradient. One solve in forward mode
computes the derivatives J with all tangents. The gradient of the log likelihood is -r^T J.
"""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..fitting.noise import Noise, Whitening, whitening
from ..fitting.problem import Problem
from ..fitting.thresholds import FAILED_MISFIT
from ..traced import traced
from .distributions import AbstractPrior


class Shear(eqx.Module):
    """Variables w in which the priors with bounds leave the others' likelihood unbent.

    y_o = w_o + sum_b K_ob [z_b(w_b) - z_b(y*_b) - z'_b(y*_b) (w_b - y*_b)],   y_b = w_b.

    The likelihood is nearly normal in the fit's variables z. So the most likely y_o follow z_b on a
    line, and y_b on a curve where z_b(y_b) is bent. The determinant of dy/dw is 1.
    """

    at: Float[Array, " q"]
    """The maximum y*."""
    gain: Float[Array, "q q"]
    """K, 0 but for rows o and columns b."""


class Target(eqx.Module):
    """A problem whose residual has unit variance, and the priors of its parameters in order."""

    problem: Problem
    """The problem with unfiltered residuals (`Problem.plain`)."""
    whitening: Whitening | None
    """Filter to uncorrelated residuals of unit variance; None: not needed."""
    priors: tuple[AbstractPrior, ...]
    shifts: int = eqx.field(static=True)
    """Number of fitted shifts of step times; the problem's others are padding."""
    shear: Shear | None = None
    """If given, the methods below take the variables w of the shear in place of y."""

    def unsheared(self, w: Float[Array, " q"]) -> Float[Array, " q"]:
        """Convert the variables to y, one of each parameter."""
        if self.shear is None:
            return w
        at, plain = self.shear.at, dataclasses.replace(self, shear=None)
        line = sum(jax.jvp(lambda y: plain.free(y)[: len(y)], (at,), (w - at,)))
        return w + self.shear.gain @ (plain.free(w)[: len(w)] - line)

    def natural(self, y: Float[Array, " q"]) -> Float[Array, " p"]:
        """Convert the variables to parameters [SI]."""
        y = self.unsheared(y)
        return jnp.stack([prior.natural(y[i]) for i, prior in enumerate(self.priors)])

    def free(self, y: Float[Array, " q"]) -> Float[Array, " q"]:
        """Convert the variables to the fit's unbounded variables."""
        p = len(self.priors)
        own, padding = self.problem.coordinates.to_free(self.natural(y)), p + self.shifts
        return jnp.concatenate([own[:p], self.unsheared(y)[p:], own[padding:]])

    def log_prior(self, y: Float[Array, " q"]) -> Float[Array, ""]:
        """Log density of the priors, Jacobians included; the prior of the shifts is part of r."""
        y = self.unsheared(y)
        return jnp.sum(jnp.stack([p.log_density(y[i]) for i, p in enumerate(self.priors)]))

    def stretch(self, y: Float[Array, " q"]) -> Float[Array, " q"]:
        """dz/dy of every variable, without a shear."""
        return jax.jvp(lambda y: self.free(y)[: len(y)], (y,), (jnp.ones_like(y),))[1]

    def start(self, z: np.ndarray) -> np.ndarray:
        """Convert the fit's unbounded variables, moved into the support of every prior."""
        values = self.problem.coordinates.from_free(np.asarray(z))
        own = [p.variable(float(v)) for p, v in zip(self.priors, values, strict=True)]
        return np.concatenate([own, np.asarray(z)[len(own) : len(own) + self.shifts]])


def target_of_problem(problem: Problem, noise: Noise, priors: tuple[AbstractPrior, ...]) -> Target:
    """The log posterior of a problem with known noise (in units of its `noise_scale`)."""
    shifts = int(np.sum(np.asarray(problem.shift_scale) > 0))
    return Target(*likelihood(problem, noise), priors, shifts)


def likelihood(problem: Problem, noise: Noise) -> tuple[Problem, Whitening | None]:
    """The problem, and the filter that whitens its residuals under `noise` (in units of its
    `noise_scale`); None for white noise."""
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
    """The log posterior at a point: value, gradient, Jacobian of the residual, and the prior's part
    of minus its second derivatives at the maximum, which is diagonal (`point`)."""

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
    """Evaluate the log posterior and its curvature at a point.

    With z_i(y_i), the fit's unbounded variables, and l, p, the log likelihood and log prior,

        -d^2 (l + p)/dy^2 = z' (-d^2 l/dz^2) z' + diag(-dl/dz z'' - d^2 p/dy^2).

    The first term is J^T J, as in the fit's own errors. At the maximum dl/dz = -(dp/dy)/z'. So the
    prior's part is (dp/dy) z''/z' - d^2 p/dy^2, here at any y. It is positive for a uniform prior,
    whose end may cut the likelihood where dl/dz is large.
    """
    r, jacobian = _residual(target, y)
    prior, slope = jax.value_and_grad(target.log_prior)(y)
    bend = jnp.diagonal(jax.hessian(target.log_prior)(y))
    first, second = jax.jvp(target.stretch, (y,), (jnp.ones_like(y),))
    flat = first == 0  # a uniform prior's end, to rounding
    own = slope * jnp.where(flat, 0.0, second / jnp.where(flat, 1.0, first)) - bend
    return Point(prior - 0.5 * jnp.sum(r * r), slope - r @ jacobian, jacobian, own)


@traced
def natural_of(target: Target, ys: Float[Array, "s q"]) -> Float[Array, "s p"]:
    """Convert several rows of variables to parameters [SI]."""
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
    failed = r == FAILED_MISFIT  # keep the penalty of a failed simulation
    return jnp.where(failed, r, white[:, 0]), white[:, 1:]
