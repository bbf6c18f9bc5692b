"""Roots of real polynomials in batches, and the polynomial arithmetic that margins need.

Coefficients ascend: c[k] multiplies s^k. All functions of this module take one polynomial; use vmap
for a batch.
"""

import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float

from .thresholds import INFINITE, LARGEST, MAX_ITERATIONS, NEARLY, REAL, SPREAD
from .undefined import is_double, root_without_derivative


@jax.custom_jvp
def roots(c: Float[Array, " n+1"]) -> Complex[Array, " n"]:
    """All roots of sum_k c[k] s^k; a root at infinity (c[n] = 0) is 1e150, not nan.

    Up to degree 2 the roots are closed forms. Above degree 2, the simultaneous iteration of Aberth
    and Ehrlich starts from radii given by the Newton polygon (Bini 1996, doi:10.1007/BF02207694).
    The Aberth-Ehrlich iteration needs no matrix, so a batch is one loop over plain arrays. The
    magnitude of a root may differ from the median magnitude by a factor up to 10^(140/n).
    Derivatives of a root, of any order, follow from ds = -sum dc[k] s^k / p'(s). Derivatives of a
    root at infinity are 0. For nearly double roots the derivatives are unreliable (0 if p'(s) is
    0); see `simple_roots`.
    """
    n = c.shape[0] - 1
    if n == 0:
        return jnp.zeros((0,), jnp.result_type(c, jnp.complex64))
    if n == 1:
        return _complex(-c[:1] / _away_from_zero(c[1:], c[:1]))
    if n == 2:
        return _quadratic(c)
    return _aberth(c)


@roots.defjvp
def _roots_jvp(primals: tuple[Array], tangents: tuple[Array]):
    (c,), (dc,) = primals, tangents
    s = roots(c)
    slope = value(derivative(c), s)
    usable = jnp.isfinite(slope) & (slope != 0)
    safe = jnp.where(usable, s, 0.0)
    return s, jnp.where(usable, -value(dc, safe) / jnp.where(usable, slope, 1.0), 0.0)


def simple_roots(c: Float[Array, " n+1"]) -> Complex[Array, " n"]:
    """Return `roots`, with nan derivatives for `double` roots."""
    s = roots(c)
    meets = double(c, s)
    return root_without_derivative(s, meets, lambda s: value(c, s))


def double(c: Float[Array, " n+1"], s: Complex[Array, " n"]) -> Bool[Array, " n"]:
    """Mark the roots s of a polynomial that are double to rounding, and so have no derivative.

    A relative change of coefficients by 2e-14 makes two `double` roots coincide.
    """
    slope, curvature = derivative(c), derivative(derivative(c))
    terms = value(jnp.abs(c), jnp.abs(s))
    return (jnp.abs(s) < 0.1 * INFINITE) & is_double(value(slope, s), value(curvature, s), terms)


def positive_roots(c: Float[Array, " n+1"]) -> tuple[Float[Array, " n"], Bool[Array, " n"]]:
    """Real parts of the real positive roots (1 for all other roots), and a mask of them."""
    s = simple_roots(c)
    real = (jnp.abs(s.imag) <= REAL * jnp.abs(s)) & (s.real > 0) & jnp.isfinite(s.real)
    real = real & (s.real < LARGEST)
    return jnp.where(real, s.real, 1.0), real


def is_hurwitz(c: Float[Array, " n+1"]) -> Bool[Array, ""]:
    """Whether all roots have negative real parts, by the signs of Routh's first column.

    A leading coefficient of zero counts as the limit of a small positive number.
    """
    c = jnp.where(c[-1] < 0, -c, c)
    if c.shape[0] == 1:
        return jnp.ones((), bool)
    top = jnp.max(jnp.abs(c))
    c = c / jnp.where(top == 0, 1.0, top)
    c = jnp.concatenate([c[:-1], jnp.maximum(c[-1:], 1e-290)])
    rows = list(c[::-1])
    first, second = rows[0::2], rows[1::2]
    stable = jnp.all(c > 0)
    for _ in range(len(rows) - 2):
        second = second + [jnp.zeros_like(c[0])] * (len(first) - len(second))
        ratio = first[0] / jnp.where(second[0] > 0, second[0], 1.0)
        first, second = second, [a - ratio * b for a, b in zip(first[1:], second[1:], strict=True)]
        first = first[: len(second) + 1]
        stable = stable & (second[0] > 0)
    return stable


def value(c: Array, s: Array) -> Array:
    """The polynomial at `s`, by Horner's rule."""
    total = jnp.zeros_like(s * c[0]) if c.shape[0] else jnp.zeros_like(s)
    for k in range(c.shape[0] - 1, -1, -1):
        total = total * s + c[k]
    return total


def derivative(c: Float[Array, " n"]) -> Float[Array, " n-1"]:
    """Coefficients of the derivative; a constant gives one zero."""
    if c.shape[0] == 1:
        return jnp.zeros_like(c)
    return c[1:] * jnp.arange(1, c.shape[0])


def product(a: Float[Array, " n"], b: Float[Array, " m"]) -> Float[Array, " n+m-1"]:
    """Coefficients of the product."""
    if a.shape[0] > b.shape[0]:
        a, b = b, a
    size = a.shape[0] + b.shape[0] - 1
    return sum(
        (jnp.pad(a[k] * b, (k, size - b.shape[0] - k)) for k in range(a.shape[0])),
        start=jnp.zeros((size,), jnp.result_type(a, b)),
    )


def total(*polynomials: Float[Array, " _"]) -> Float[Array, " n"]:
    """Coefficients of the sum."""
    size = max(p.shape[0] for p in polynomials)
    return sum((jnp.pad(p, (0, size - p.shape[0])) for p in polynomials), start=jnp.zeros((size,)))


def shifted(c: Float[Array, " n"], by: int = 1) -> Float[Array, " n+by"]:
    """Coefficients of s^by times the polynomial."""
    return jnp.pad(c, (by, 0))


def on_axis(c: Float[Array, " n"]) -> tuple[Float[Array, " p"], Float[Array, " q"]]:
    """Polynomials E, O in y = w^2 with p(i w) = E(y) + i w O(y)."""

    def part(c: Array):
        return c * jnp.asarray((-1.0) ** np.arange(c.shape[0]), c.dtype)

    odd = c[1::2] if c.shape[0] > 1 else jnp.zeros((1,), c.dtype)
    return part(c[::2]), part(odd)


def cross(a: Float[Array, " n"], b: Float[Array, " m"]) -> tuple[Array, Array]:
    """Polynomials R, I in y = w^2 with a(i w) conj(b(i w)) = R(y) + i w I(y)."""
    (ea, oa), (eb, ob) = on_axis(a), on_axis(b)
    real = total(product(ea, eb), shifted(product(oa, ob)))
    return real, total(product(oa, eb), -product(ea, ob))


def _complex(x: Array) -> Array:
    return x + jnp.zeros_like(x) * 1j


def _away_from_zero(x: Array, other: Array) -> Array:
    """x, with its magnitude increased if needed so that |other/x| is at most `INFINITE`."""
    least = (jnp.abs(other) + (other == 0)) / INFINITE
    return jnp.where(jnp.abs(x) < least, jnp.where(x < 0, -least, least), x)


def _quadratic(c: Float[Array, " 3"]) -> Complex[Array, " 2"]:
    """Both roots without cancellation: q = -(b + sgn(b) sqrt(b^2 - 4ac))/2, then q/a and c/q."""
    c = c / jnp.max(jnp.abs(c))
    discriminant = _complex(c[1] ** 2 - 4 * c[0] * c[2])
    sign = jnp.where(c[1] < 0, -1.0, 1.0)
    q = -0.5 * (c[1] + sign * jnp.sqrt(discriminant))
    pair = q / _away_from_zero(c[2], jnp.abs(q)), c[0] / jnp.where(q == 0, 1.0, q)
    return jnp.stack(pair)


@jax.jit
def _aberth(c: Float[Array, " n+1"]) -> Complex[Array, " n"]:
    """Aberth's iteration, root by root in real arithmetic, so that a batch is long plain loops."""
    scaled, unit, x, y = _start(c)
    n = len(x)
    nearly = NEARLY * float(jnp.finfo(unit.dtype).eps) ** (1 / 3)

    def step(state: _State):
        x, y, change, _, k = state
        u, v = zip(*(_correction(scaled, x, y, i) for i in range(n)), strict=True)
        sizes = [(u[i] ** 2 + v[i] ** 2) / (x[i] ** 2 + y[i] ** 2 + 1e-300) for i in range(n)]
        x = tuple(x[i] - u[i] for i in range(n))
        y = tuple(y[i] - v[i] for i in range(n))
        return x, y, functools.reduce(jnp.maximum, sizes), change, k + 1

    def unfinished(state: _State):
        return (state[3] > nearly**2) & (state[4] < MAX_ITERATIONS)

    infinite = jnp.full_like(unit, jnp.inf)
    x, y, *_ = jax.lax.while_loop(unfinished, step, (x, y, infinite, infinite, 0))
    x, y = jnp.stack(x), jnp.stack(y)
    far = jnp.abs(x) + jnp.abs(y) > 0.1 * 10 ** (SPREAD / n)
    x = jnp.where(far, jnp.where(x > 0, INFINITE, -INFINITE), unit * x)
    return jax.lax.complex(x, jnp.where(far, 0.0, unit * y))


_State = tuple[tuple[Array, ...], tuple[Array, ...], Array, Array, Array | int]
"""Real and imaginary parts of the roots, the last two changes, and the number of steps."""


def _correction(
    c: list[Array], x: tuple[Array, ...], y: tuple[Array, ...], i: int
) -> tuple[Array, Array]:
    """Aberth's step for root i: p/(p' - p sum_j 1/(s_i - s_j))."""
    zero = jnp.zeros_like(c[-1])
    value, slope = (c[-1], zero), (zero, zero)
    at = x[i], y[i]
    for coefficient in c[-2::-1]:
        slope = _times(slope, at)
        slope = slope[0] + value[0], slope[1] + value[1]
        value = _times(value, at)
        value = value[0] + coefficient, value[1]
    real, imaginary = jnp.zeros_like(x[i]), jnp.zeros_like(x[i])
    for j in range(len(x)):
        if j != i:
            dx, dy = x[i] - x[j], y[i] - y[j]
            size = dx * dx + dy * dy
            weight = jnp.where(size == 0, 0.0, 1 / jnp.where(size == 0, 1.0, size))
            real, imaginary = real + dx * weight, imaginary - dy * weight
    pushed = _times(value, (real, imaginary))
    return _divide(*value, slope[0] - pushed[0], slope[1] - pushed[1])


def _times(a: tuple[Array, Array], b: tuple[Array, Array]) -> tuple[Array, Array]:
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]


def _divide(a: Array, b: Array, c: Array, d: Array) -> tuple[Array, Array]:
    """(a + ib)/(c + id); 0 if the divisor is 0."""
    size = c * c + d * d
    weight = jnp.where(size == 0, 0.0, 1 / jnp.where(size == 0, 1.0, size))
    return (a * c + b * d) * weight, (b * c - a * d) * weight


def _start(c: Float[Array, " n+1"]):
    """Scaled coefficients, the unit of s, and starting points (real and imaginary parts).

    The unit is the middle radius of the roots that are neither 0 nor at infinity, so that powers
    do not overflow.
    """
    n = c.shape[0] - 1
    height = _heights(c)
    slopes = _newton_polygon(height)
    at = jnp.arange(n + 1)
    lowest, highest = jnp.min(jnp.where(c == 0, n, at)), jnp.max(jnp.where(c == 0, 0, at))
    middle = jnp.zeros_like(slopes[0])  # if there is only one power
    for k, slope in enumerate(slopes):
        middle = jnp.where((lowest < highest) & ((lowest + highest) // 2 == k), slope, middle)
    most = SPREAD / n * float(np.log(10.0))
    radii = [jnp.exp(jnp.clip(middle - slope, -most, most)) for slope in slopes]
    angle = 2 * np.pi * np.arange(n) / n + 0.7
    x = tuple(radii[k] * float(np.cos(angle[k])) for k in range(n))
    y = tuple(radii[k] * float(np.sin(angle[k])) for k in range(n))
    level = [height[k] - k * middle for k in range(n + 1)]
    # the largest radius is `most`: a root at infinity is placed there
    level[n] = functools.reduce(jnp.maximum, [level[k] - (n - k) * most for k in range(n + 1)])
    top = functools.reduce(jnp.maximum, level)
    scaled = [jnp.where(c[k] < 0, -1.0, 1.0) * jnp.exp(level[k] - top) for k in range(n + 1)]
    return scaled, jnp.exp(-middle), x, y


def _heights(c: Float[Array, " n+1"]) -> list[Array]:
    """log|c[k]|; for a zero, a number far below the others."""
    size = jnp.abs(c)
    top = jnp.log(jnp.max(size) + 1e-300)
    logs = jnp.log(jnp.where(size == 0, 1.0, size))
    return list(jnp.where(size == 0, top - 1e3, logs))


def _newton_polygon(height: list[Array]) -> list[Array]:
    """Slopes of the upper hull of (k, log|c[k]|); exp(-slope) is the radius of a root.

    The slope over (k - 1, k) is the least, over i < k, of the largest chord from i to j >= k.
    """
    n = len(height) - 1
    chords = [[(height[j] - height[i]) / (j - i) for j in range(n, i, -1)] for i in range(n)]
    # largest[i][n - k]: over j >= k
    largest = [list(itertools.accumulate(from_i, jnp.maximum)) for from_i in chords]
    return [
        functools.reduce(jnp.minimum, (largest[i][n - k] for i in range(k)))
        for k in range(1, n + 1)
    ]
