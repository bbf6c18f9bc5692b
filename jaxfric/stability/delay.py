"""Stability of a slider with the delay law: crossings, stable intervals, unstable roots, charts.

The delay law of Hess and Soom (6) depends on the velocity `alpha` seconds ago. The linearised law
is f_v = 0 and G(s) = k_f exp(-alpha s), equations (26)-(29). Here -k_f is the slope of the steady
friction-velocity curve. The characteristic equation of the slider is

    m s^2 + k_v s + k_p - k_f s exp(-alpha s) = 0.

On s = i w the characteristic equation gives (19) and (20) as k_v = k_f cos(alpha w) and k_p = m w^2
+ k_f w sin(alpha w), which is (31). With beta = arccos(k_v / k_f) and r = sqrt(k_f^2 - k_v^2), ALL
solutions are

    w_n+ = (beta + 2 n pi)/alpha, n = 0, 1, 2, ...   k_n+ = m w^2 + r w   two roots become stable
    w_n- = (2 n pi - beta)/alpha, n = 1, 2, 3, ...   k_n- = m w^2 - r w   two roots become unstable

The words at the right say what happens when k_p grows through k_n+ or k_n-. The paper's list (30)
is incomplete. The list (30) starts at n = 1, so it leaves out w_0+, the first threshold of all. The
list (30) has no -beta branch, so all its crossings are stabilising. With stabilising crossings
alone, stability and instability could not alternate, as the paper's text describes. A delay law has
no critical stiffness: one stable interval of k_p means infinitely many.

All functions of this module are closed forms. A direct effect or any other instantaneous viscosity
f_v of the law adds to k_v: pass the sum k_v + f_v. Units are SI (forces in newtons, or divided by
the normal force): mass kg, k_p N/m, k_v and k_f N s/m, alpha s. Required: mass > 0, alpha >= 0.
The formulas cover either sign of k_f and any k_v; k_f < 0 means that the steady curve rises. For
k_f < 0 the same formulas hold with beta = 2 pi - arccos(k_v / k_f). For |k_v| >= |k_f| no root
crosses the imaginary axis.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from ..errors import InputError


class Crossings(eqx.Module):
    """Crossings of the imaginary axis by roots: frequencies [rad/s] and stiffnesses k_p [N/m].

    Branch `plus` holds n = 0 .. number-1, branch `minus` n = 1 .. number. All numbers are inf where
    the equation has no crossing (|k_v| >= |k_f|, or alpha = 0). A negative `minus_stiffness` is a
    crossing below every physical stiffness, but `unstable_roots` counts this crossing.
    """

    plus_frequency: Float[Array, " number"]
    plus_stiffness: Float[Array, " number"]
    minus_frequency: Float[Array, " number"]
    minus_stiffness: Float[Array, " number"]


def _branch(k_v: Array, k_f: Array):
    """Whether there are crossings, r = sqrt(k_f^2 - k_v^2) and beta in (0, 2 pi).

    beta is the angle with k_f exp(i beta) = k_v + i r.
    """
    exists = jnp.abs(k_v) < jnp.abs(k_f)
    r = jnp.sqrt(jnp.where(exists, (k_f - k_v) * (k_f + k_v), 1.0))
    sign = jnp.where(k_f < 0, -1.0, 1.0)
    angle = jnp.arctan2(sign * r, sign * k_v)
    return exists, r, jnp.where(angle < 0, angle + 2 * jnp.pi, angle)


def crossings(
    mass: Float[ArrayLike, ""],
    k_v: Float[ArrayLike, ""],
    k_f: Float[ArrayLike, ""],
    alpha: Float[ArrayLike, ""],
    *,
    number: int,
) -> Crossings:
    """The first `number` solutions of (19) and (20) on each branch, completing (30) and (31).

    The arguments are scalars (vmap for more). The results are arrays of shape (number,), and
    differentiable. Raises `InputError` if `number` is less than 1.
    """
    if number < 1:
        raise InputError(f"delay crossings: number is {number}; ask for at least 1")
    exists, r, beta = _branch(jnp.asarray(k_v), jnp.asarray(k_f))
    turn = 2 * jnp.pi * jnp.arange(number)
    exists = exists & (jnp.asarray(alpha) > 0)
    delay = jnp.where(exists, alpha, 1.0)
    plus, minus = (turn + beta) / delay, (turn + 2 * jnp.pi - beta) / delay
    values = (plus, plus * (mass * plus + r), minus, minus * (mass * minus - r))
    return Crossings(*(jnp.where(exists, value, jnp.inf) for value in values))


def stable_intervals(
    mass: Float[ArrayLike, ""],
    k_v: Float[ArrayLike, ""],
    k_f: Float[ArrayLike, ""],
    alpha: Float[ArrayLike, ""],
    *,
    number: int,
) -> tuple[Float[Array, " number"], Float[Array, " number"]]:
    """The first `number` open intervals of k_p > 0 [N/m] in which steady sliding is stable.

    For k_f > |k_v| the intervals are (k_n+, k_{n+1}-), n = 0, 1, ...; see
    `stable_stiffness_exists`. For k_f < -|k_v| the intervals are (0, k_1-), then (k_n+, k_{n+2}-).
    With k_v >= |k_f| the only interval is (0, inf); with k_v <= -|k_f| no interval exists. An
    interval that does not exist is (inf, inf). With k_f < 0 the first interval may be the only one
    that does not exist. Otherwise either no interval exists, or only the first interval exists.
    The function takes scalars and returns (lower, upper), each of shape (number,), which are
    differentiable. At k_v = |k_f| exactly, isolated values of k_p are marginal.
    """
    found = crossings(mass, k_v, k_f, alpha, number=number)
    k_v, k_f = jnp.asarray(k_v), jnp.asarray(k_f)
    start = jnp.zeros_like(found.plus_stiffness[:1])
    lower = jnp.where(
        k_v < k_f, found.plus_stiffness, jnp.concatenate([start, found.plus_stiffness[:-1]])
    )
    undamped = (k_v <= 0) & (jnp.abs(k_v) >= jnp.abs(k_f))
    stable = (lower < found.minus_stiffness) & ~undamped
    return jnp.where(stable, lower, jnp.inf), jnp.where(stable, found.minus_stiffness, jnp.inf)


def stable_stiffness_exists(
    mass: Float[ArrayLike, "*#s"],
    k_v: Float[ArrayLike, "*#s"],
    k_f: Float[ArrayLike, "*#s"],
    alpha: Float[ArrayLike, "*#s"],
) -> Bool[Array, "*s"]:
    """Whether any k_p > 0 is stable.

    For |k_v| < |k_f| and k_f > 0 the condition is m (2 pi - 2 beta)/alpha > sqrt(k_f^2 - k_v^2).
    For k_f < 0 the factor 2 pi - 2 beta becomes 4 pi - 2 beta. The condition does not depend on n,
    so the number of stable intervals is infinite or zero. For k_v >= |k_f| all k_p > 0 are stable;
    for k_v <= -|k_f| none is stable. Elementwise.
    """
    exists, r, beta = _branch(jnp.asarray(k_v), jnp.asarray(k_f))
    gap = 2 * jnp.where(jnp.asarray(k_f) > 0, jnp.pi - beta, 2 * jnp.pi - beta)
    rising = (jnp.asarray(alpha) == 0) & (jnp.asarray(k_f) < 0)
    wide = jnp.where(jnp.asarray(alpha) > 0, mass * gap > r * alpha, rising)
    return jnp.where(exists, wide, jnp.asarray(k_v) > 0)


def unstable_roots(
    mass: Float[ArrayLike, "*#s"],
    k_p: Float[ArrayLike, "*#s"],
    k_v: Float[ArrayLike, "*#s"],
    k_f: Float[ArrayLike, "*#s"],
    alpha: Float[ArrayLike, "*#s"],
) -> Int[Array, "*s"]:
    """Number of roots with positive real part.

    For k_p > 0 the number is NU = NU_0 - 2 #{n: k_n+ < k_p} + 2 #{n: k_n- < k_p} with NU_0 = 2 if
    k_v < k_f, else 0. The crossings n are counted in closed form, from the frequencies at which
    each branch reaches k_p. So k_p may be arbitrarily large, and of either sign. A root at exactly
    zero, as at k_p = 0, is not counted. The function works elementwise.
    """
    mass, k_p, k_v, k_f, alpha = (jnp.asarray(x) for x in (mass, k_p, k_v, k_f, alpha))
    exists, r, beta = _branch(k_v, k_f)
    square = r * r + 4 * mass * k_p
    exists = exists & (square >= 0)
    root = jnp.sqrt(jnp.where(exists, square, 1.0))

    def below(w: Array, offset: Array):
        """Number of n >= 0 with (offset + 2 n pi)/alpha < w."""
        return jnp.maximum(jnp.ceil((alpha * w - offset) / (2 * jnp.pi)), 0.0)

    top, bottom = (r + root) / (2 * mass), (r - root) / (2 * mass)
    second = 2 * jnp.pi - beta
    crossed = below(top, second) - below(bottom, second) - below(-bottom, beta)
    falling = jnp.where((k_v < k_f) | ((k_v == k_f) & (k_v < 0)), 1, 0)
    start = jnp.where(k_p > 0, 2 * falling, jnp.where(k_p < 0, 1, falling))
    return start + 2 * jnp.where(exists, crossed, 0.0).astype(int)


def is_stable(
    mass: Float[ArrayLike, "*#s"],
    k_p: Float[ArrayLike, "*#s"],
    k_v: Float[ArrayLike, "*#s"],
    k_f: Float[ArrayLike, "*#s"],
    alpha: Float[ArrayLike, "*#s"],
) -> Bool[Array, "*s"]:
    """Whether k_p > 0 and steady sliding is asymptotically stable. Elementwise."""
    return (unstable_roots(mass, k_p, k_v, k_f, alpha) == 0) & (jnp.asarray(k_p) > 0)
