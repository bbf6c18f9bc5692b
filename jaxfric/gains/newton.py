"""Least norm under smooth constraints in two unknowns: steps of sequential quadratic programming.

    minimise |y|^2/2   subject to   c_k(y) >= 0

With two unknowns at most two constraints are active. So a step needs no general solver. Each step
lists the points at which none, one or two linearised constraints are active. The step then goes to
the best feasible point.

    none: d = -y;   one: along the line c_k + g_k d = 0 by Newton's method;   two: the intersection
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from .thresholds import CURVATURE, ROUNDING, ZERO


class NewtonStep(NamedTuple):
    """A step, and the two constraints that are active after the step; -1 for no constraint."""

    d: Float[Array, " 2"]
    active: Int[Array, " 2"]
    feasible: Bool[Array, ""]


def sqp_step(
    y: Float[Array, " 2"],
    c: Float[Array, " k"],
    g: Float[Array, "k 2"],
    H: Float[Array, "k 2 2"],
    radius: ArrayLike = jnp.inf,
) -> NewtonStep:
    """Step from `y` to the least norm under the linearised constraints.

    c, g, H are values, gradients and second derivatives of the constraints at y. The curvature L =
    I - sum l_k d^2c_k/dy^2 of the Lagrangian uses multipliers l_k from a step with L = I. A
    candidate point with a negative multiplier is not a minimum, and is accepted only as an
    intermediate step. Beyond `radius` the linearisation is inaccurate. If no candidate lies within
    `radius`, only the nearest candidate counts. If no point meets all constraints, the candidate
    with the least violation is chosen.
    """
    size = jnp.linalg.norm(g, axis=1)
    some = size > 0
    weight = jnp.where(some, 1 / jnp.where(some, size, 1.0), 0.0)
    c, n, H = jnp.where(some, c * weight, jnp.inf), g * weight[:, None], H * weight[:, None, None]
    straight, multiplier = _least(y, c, n, some, jnp.eye(2), radius)
    pushed = jnp.where(straight.active >= 0, jnp.maximum(multiplier, 0.0), 0.0)
    L = jnp.eye(2) - jnp.einsum("k,kij->ij", pushed, H[straight.active])
    return _least(y, c, n, some, L, radius)[0]


def _least(
    y: Array, c: Array, n: Array, some: Array, L: Float[Array, "2 2"], radius: ArrayLike
) -> tuple[NewtonStep, Float[Array, " 2"]]:
    """The best step for a curvature L, and the multipliers of the pair active after it.

    Constraints exist where `some`; their gradients n have length 1."""
    first, second = np.triu_indices(c.shape[0], 1)
    (one, single), (two, pair) = _single(y, c, n, L), _pairs(y, c, n, first, second)
    d = jnp.concatenate([-y[None], one, two])
    multiplier = jnp.concatenate([jnp.zeros((1, 2)), jnp.stack([single, 0 * single], 1), pair])
    rows = np.arange(c.shape[0])
    active = np.concatenate(
        [[[-1, -1]], np.stack([rows, 0 * rows - 1], 1), np.stack([first, second], 1)]
    )
    missed = jnp.max(jnp.where(some, -(c + d @ n.T), -jnp.inf), axis=1)
    usable = jnp.concatenate([jnp.ones(1, bool), some, some[first] & some[second]])
    far = jnp.linalg.norm(d, axis=1)
    # the change of |y|^2/2 on the curved constraints
    value = d @ y + 0.5 * jnp.maximum(jnp.einsum("ki,ij,kj->k", d, L, d), CURVATURE * far**2)
    usable &= jnp.all(jnp.isfinite(d), axis=1) & jnp.isfinite(value)
    missed = jnp.where(usable, missed, jnp.inf)
    length = jnp.sqrt(jnp.sum(y**2))
    feasible = missed <= ROUNDING * length
    pushing = jnp.min(multiplier, axis=1) >= -ROUNDING * length
    counting = feasible & (pushing | (far > ZERO * length))
    counting = jnp.where(jnp.any(counting), counting, feasible)
    within = counting & (far <= radius)
    nearest = jnp.argmin(jnp.where(counting, far, jnp.inf))
    best = jnp.argmin(jnp.where(within, value, jnp.inf))
    best = jnp.where(jnp.any(within), best, nearest)
    # the distance counts too, or nearly parallel constraints would give an infinite step
    least = jnp.argmin(missed + 1e-3 * far)
    chosen = jnp.where(jnp.any(feasible), best, least)
    step = jnp.where(usable[chosen], d[chosen], 0.0)
    return NewtonStep(step, jnp.asarray(active)[chosen], jnp.any(feasible)), multiplier[chosen]


def _single(y: Array, c: Array, n: Array, L: Array) -> tuple[Array, Array]:
    """Newton's step along each single constraint, and its multiplier."""
    t = jnp.stack([-n[:, 1], n[:, 0]], axis=1)
    down = -jnp.where(jnp.isfinite(c), c, 0.0)[:, None] * n
    curvature = jnp.maximum(jnp.einsum("ki,ij,kj->k", t, L, t), CURVATURE)
    slope = jnp.sum(t * (y + down @ L), axis=1)
    return down - (slope / curvature)[:, None] * t, jnp.sum((y + down) * n, axis=1)


def _pairs(
    y: Array, c: Array, n: Array, i: np.ndarray, j: np.ndarray
) -> tuple[Array, Float[Array, "k 2"]]:
    """The step to the intersection of each pair of constraints, and its multipliers."""
    sine = n[i, 0] * n[j, 1] - n[i, 1] * n[j, 0]
    some = (jnp.abs(sine) > ZERO) & jnp.isfinite(c[i]) & jnp.isfinite(c[j])
    safe = jnp.where(some, sine, 1.0)
    a, b = jnp.where(some, c[i], 0.0), jnp.where(some, c[j], 0.0)
    d = jnp.stack([b * n[i, 1] - a * n[j, 1], a * n[j, 0] - b * n[i, 0]], axis=1) / safe[:, None]
    return jnp.where(some[:, None], d, jnp.inf), multipliers(y + d, n[i], n[j], safe)


def multipliers(
    p: Float[Array, "*k 2"], one: Float[Array, "*k 2"], other: Float[Array, "*k 2"], sine: Array
) -> Float[Array, "*k 2"]:
    """Solve p = l_1 one + l_2 other for l_1, l_2; `sine` is that of the angle between both."""
    first = p[..., 0] * other[..., 1] - p[..., 1] * other[..., 0]
    second = one[..., 0] * p[..., 1] - one[..., 1] * p[..., 0]
    return jnp.stack([first, second], axis=-1) / sine[..., None]
