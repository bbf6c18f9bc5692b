"""The noise of a record: white plus an exponentially correlated part, by likelihood.

    r = e + s,   var e = sigma^2 (1 - c),   cov s(t), s(t') = sigma^2 c exp(-|t - t'|/tau)

A clock t is what noise forgets over: time (amplifier, servo), the path of the load point
(roughness, gouge: ten times as fast at ten times the velocity), or the samples of a recorder whose
filter follows its rate. Clocks of a record are the columns of an array (n, k); a column alone may
be (n,). The estimate takes the clock of the largest likelihood, of equal ones the first; a record
may be sampled anew at every velocity, so the number of the row is no stand-in for time.

s is an Ornstein-Uhlenbeck process, so a scalar Kalman filter gives the likelihood at uneven
sampling in one pass. Nothing in that pass needs c to be positive: with c < 0 neighbouring rows
differ by more than chance, as where the noise of a position is differentiated. That is a covariance
while |c| < (1 - a)/(2 a), a = exp(-gap/tau). The likelihood is the restricted one (REML): the
residual of a fit has lost the directions of its parameters, and without correcting for that a long
correlation time is under-estimated. sigma is profiled out; c and tau are found on a grid that zooms
in. Source: Rasmussen & Williams, Gaussian Processes for Machine Learning (2006), 2.7 and
appendix B.
"""

import math
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

_GRID = 6
_ZOOMS = 3
_LOGIT_RANGE = 5.0
_HIDDEN = 1e12  # variance of a row that is to be passed over
LONGEST = 0.1
"""Longest memory of the noise of a fit, as a share of the record: what wanders for longer is seen
too seldom for its size to be known, and a likelihood makes it as large as it likes."""
_SHORTEST = 1e-6  # shortest gap that is searched, as a share of the record


class Noise(NamedTuple):
    """Standard deviation, share of its square that is correlated, and over how much of each clock:
    infinite for the clocks that it does not follow."""

    sigma: Float[Array, ""]
    share: Float[Array, ""]
    memory: Float[Array, " k"]
    log_likelihood: Float[Array, ""]

    @property
    def rates(self) -> Float[Array, " k"]:
        """What is forgotten per unit of each clock."""
        return jnp.atleast_1d(1 / jnp.asarray(self.memory))


def forgotten(clock: Float[Array, "n *k"], rates: Float[Array, "*g k"]) -> Float[Array, "n-1 *g"]:
    """Exponents of what noise forgets from each row to the next, of one or many noise models."""
    return jnp.abs(jnp.diff(_columns(clock), axis=0)) @ rates.T


def _columns(clock):
    return clock[:, None] if clock.ndim == 1 else clock


def _kalman_step(share):
    """One step of the filter for all noise models: (mean, variance) -> misfit, 1/variance of it."""

    def step(mean, variance, y, hidden, keep):
        inverse = 1 / (variance + (1 - share) + hidden)
        misfit = y[:, None] - mean
        mean = keep * (mean + variance * inverse * misfit)
        squared = keep * keep
        variance = squared * variance * (1 - variance * inverse) + share * (1 - squared)
        return mean, variance, misfit, inverse

    return step


def _filter_inputs(clock, weight, columns, share, rates):
    keeps = jnp.exp(-forgotten(clock, rates))
    keeps = jnp.concatenate([keeps, jnp.ones_like(keeps[:1])])
    hidden = jnp.where(weight > 0, 0.0, _HIDDEN)
    start = (jnp.zeros((columns.shape[1], share.shape[0])), share)
    return start, (columns, hidden, keeps)


def whiten(
    clock: Float[Array, "n *k"],
    weight: Float[Array, " n"],
    columns: Float[Array, "n m"],
    noise: Noise,
) -> Float[Array, "n m"]:
    """The columns in units of the noise and uncorrelated: W c with W^T W = inverse covariance.

    Rows of zero weight are passed over and come out as 0.
    """
    share = noise.share[None]
    start, rows = _filter_inputs(clock, weight, columns, share, noise.rates[None])
    step = _kalman_step(share)

    def advance(carry, row):
        *carry, misfit, inverse = step(*carry, *row)
        return tuple(carry), (misfit * jnp.sqrt(inverse))[:, 0]

    _, white = jax.lax.scan(advance, start, rows, unroll=4)
    return white * (weight > 0)[:, None] / noise.sigma


def limit_of_share(keep):
    """Largest -c of a covariance whose rows are correlated by `keep` from one to the next."""
    return 0.98 * (1 - keep) / (2 * keep)


def _restricted(clock, weight, columns, share, rates):
    """Restricted log-likelihood and sigma of every noise model; column 0 is the residual."""
    start, rows = _filter_inputs(clock, weight, columns, share, rates)
    step = _kalman_step(share)

    def advance(carry, row):
        state, gram, log_inverse = carry
        *state, misfit, inverse = step(*state, *row)
        gram = gram + misfit[:, None, :] * (misfit * inverse)[None, :, :]
        log_inverse = log_inverse + jnp.where(row[1] > 0, 0.0, jnp.log(inverse))
        return (tuple(state), gram, log_inverse), None

    m, g = columns.shape[1], share.shape[0]
    (_, gram, log_inverse), _ = jax.lax.scan(
        advance, (start, jnp.zeros((m, m, g)), jnp.zeros(g)), rows, unroll=2
    )
    gram = jnp.moveaxis(gram, 2, 0)
    design = gram[:, 1:, 1:]
    diagonal = jnp.diagonal(design, axis1=1, axis2=2)
    used = diagonal > 0  # columns of zeros are padding
    n, p = jnp.sum(weight > 0), jnp.sum(used[0])
    scale = jnp.where(used, 1 / jnp.sqrt(jnp.where(used, diagonal, 1.0)), 1.0)
    ridge = jnp.where(used, 1e-12, 1.0)[:, :, None] * jnp.eye(m - 1)
    scaled = design * scale[:, :, None] * scale[:, None, :] + ridge
    projection = gram[:, 1:, 0] * scale
    solved = jnp.linalg.solve(scaled, projection[..., None])[..., 0]
    left = jnp.maximum(gram[:, 0, 0] - jnp.sum(projection * solved, axis=1), 1e-300)
    variance = left / (n - p)
    log_det = jnp.linalg.slogdet(scaled)[1] - 2 * jnp.sum(jnp.log(scale), axis=1)
    deviance = (n - p) * (jnp.log(variance) + 1) + log_det - log_inverse
    return -0.5 * deviance, jnp.sqrt(variance)


@eqx.filter_jit
def estimate_noise(
    clock: Float[Array, "n *k"],
    weight: Float[Array, " n"],
    residual: Float[Array, " n"],
    jacobian: Float[Array, "n p"],
    longest: Float[Array, "*k"] | None = None,
    either_sign: bool = False,
) -> Noise:
    """Restricted maximum-likelihood noise of a residual with the given Jacobian.

    Its memory is searched from half the median gap of rows to `longest`, by default half the
    record, in each clock; with `either_sign` also negative correlation, of even sampling.
    """
    columns = jnp.concatenate([residual[:, None], jacobian], axis=1)
    clocks = _columns(clock).T
    spans = jnp.max(clocks, axis=1) - jnp.min(clocks, axis=1)
    most = 0.5 * spans if longest is None else jnp.broadcast_to(longest, spans.shape)
    along = jnp.eye(len(clocks))

    def best_over(which):
        one, most, span, along = which
        gap = jnp.nanmedian(jnp.where(weight[1:] > 0, jnp.abs(jnp.diff(one)), jnp.nan))
        gap = jnp.maximum(gap, _SHORTEST * jnp.maximum(span, 1e-300))  # at rest most of the time

        def likelihood(logit, memory):
            share = jax.nn.sigmoid(logit)
            if either_sign:
                part = jnp.tanh(0.5 * logit)
                share = jnp.where(part > 0, part, part * limit_of_share(jnp.exp(-gap / memory)))
            found = _restricted(clock, weight, columns, share, along / memory[:, None])
            return share, *found

        low = jnp.log(0.5 * gap)
        return _zoomed(likelihood, low, jnp.maximum(jnp.log(most), low), along)

    found = jax.lax.map(best_over, (clocks, most, spans, along))
    best = jnp.argmax(found.log_likelihood)
    return jax.tree.map(lambda x: x[best], found)


def _zoomed(likelihood, low, high, along) -> Noise:
    """The likeliest noise on a grid of shares and logarithms of memory that zooms in."""
    offsets = jnp.linspace(-1.0, 1.0, _GRID)

    def zoom(carry, _):
        centre, half = carry
        logit = jnp.clip(centre[0] + half[0] * offsets, -2 * _LOGIT_RANGE, 2 * _LOGIT_RANGE)
        log_memory = jnp.clip(centre[1] + half[1] * offsets, low, high)
        logit, log_memory = (g.ravel() for g in jnp.meshgrid(logit, log_memory))
        share, value, sigma = likelihood(logit, jnp.exp(log_memory))
        i = jnp.argmax(jnp.where(jnp.isfinite(value), value, -jnp.inf))
        memory = jnp.where(along > 0, jnp.exp(log_memory[i]), jnp.inf)
        best = Noise(sigma[i], share[i], memory, value[i])
        return (jnp.stack([logit[i], log_memory[i]]), half * (2.0 / (_GRID - 1))), best

    centre = jnp.stack([0.0, 0.5 * (low + high)])
    half = jnp.stack([_LOGIT_RANGE, 0.5 * (high - low)])
    _, steps = jax.lax.scan(zoom, (centre, half), length=_ZOOMS)
    best = jnp.argmax(steps.log_likelihood)
    return jax.tree.map(lambda x: x[best], steps)


@eqx.filter_jit
def sandwich(
    clock: Float[Array, "n *k"], jacobian: Float[Array, "n p"], noise: Noise
) -> Float[Array, "p p"]:
    """J^T Sigma J for the noise covariance Sigma, in one pass."""
    keep = jnp.exp(-forgotten(clock, noise.rates))
    keep = jnp.concatenate([jnp.ones(1), keep])

    def step(carry, row):
        j, k = row
        carry = k * carry + j
        return carry, carry

    _, tail = jax.lax.scan(step, jnp.zeros(jacobian.shape[1]), (jacobian, keep), unroll=8)
    one_sided = jacobian.T @ tail
    gram = jacobian.T @ jacobian
    correlated = one_sided + one_sided.T - gram
    return noise.sigma**2 * ((1 - noise.share) * gram + noise.share * correlated)


def rms_error(clock: Float[Array, "n *k"], used, noise: Noise) -> float:
    """Relative standard error of the rms of noise over the `used` rows (a mask or 0 and 1).

    sqrt(sum rho^2/2)/n over all pairs of rows, rho their correlation: correlated rows count
    for fewer. Squares of rho are those of a noise of share c^2 and half the memory.
    """
    used = jnp.asarray(used, float)
    squared = Noise(jnp.ones(()), noise.share**2, 0.5 * noise.memory, noise.log_likelihood)
    total = float(sandwich(clock, used[:, None], squared)[0, 0])
    return math.sqrt(0.5 * total) / max(float(used.sum()), 1.0)
