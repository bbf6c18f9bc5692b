"""Exponential moments of Legendre polynomials: what makes the transform of a table exact."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex


def legendre_moments(z: Complex[Array, " p"], order: int) -> Complex[Array, "p n"]:
    """int_-1^1 P_n(x) exp(-z (x + 1)) dx for n < order and Re z >= 0: spherical Bessel functions.

    By the recurrence over n: downwards from the power series of the last two where |z| is
    below about the order, upwards beyond. In these directions it keeps its digits.
    """
    switch = max(2.0, 0.75 * order)
    small = jnp.abs(z) < switch
    near = _downwards(jnp.where(small, z, 0.0), order, switch)
    far = _upwards(jnp.where(small, switch, z), order)
    return jnp.where(small, near, far).T


def _upwards(z: Complex[Array, " p"], order: int) -> Complex[Array, "n p"]:
    """M_0 = 2 sinh z/z, M_1 = (M_0 - 2 cosh z)/z, M_{n+1} = M_{n-1} - (2n + 1)/z M_n up to
    sign, times exp(-z)."""
    decayed, inverse = jnp.exp(-2 * z), 1 / z
    first = (1 - decayed) * inverse
    second = (first - (1 + decayed)) * inverse

    def step(pair: tuple[Array, Array], n: Array):
        before, here = pair
        return (here, before + (2 * n + 1) * inverse * here), before

    return jax.lax.scan(step, (first, second), jnp.arange(1, order + 1))[1]


def _downwards(z: Complex[Array, " p"], order: int, largest: float) -> Complex[Array, "n p"]:
    """M_n = 2 (-z)^n p_n(z^2), p_{n-1} = (2n + 1) p_n + z^2 p_{n+1}, times exp(-z).

    For |z| < largest.
    """
    square = z * z
    last = (_bessel_series(square, order, largest), _bessel_series(square, order - 1, largest))

    def step(pair: tuple[Array, Array], n: Array):
        above, here = pair
        return (here, (2 * n + 1) * here + square * above), here

    _, scaled = jax.lax.scan(step, last, jnp.arange(order - 1, -1, -1))

    def power(factor: Array, _: None):
        return -factor * z, factor

    _, powers = jax.lax.scan(power, 2 * jnp.exp(-z), None, length=order)
    return powers * scaled[::-1]


def _bessel_series(square: Complex[Array, " p"], n: int, largest: float) -> Complex[Array, " p"]:
    """p_n = sum_k (z^2/2)^k/(k! (2n + 2k + 1)!!), as many terms as |z| < largest needs."""
    ratios, size, k = [], 1.0, 0
    while size > 1e-18 or k < 4:
        k += 1
        ratios.append(0.5 / (k * (2 * n + 2 * k + 1)))
        size *= ratios[-1] * largest**2

    def step(total: Array, ratio: Array):
        return 1 + ratio * square * total, None

    total, _ = jax.lax.scan(step, jnp.ones_like(square), jnp.asarray(ratios[::-1]))
    return total / float(np.prod(np.arange(1.0, 2 * n + 2, 2)))
