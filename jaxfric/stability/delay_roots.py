"""The roots of the delay slider that lie farthest to the right, complete and differentiable.

    F(s) = m s^2 + k_v s + k_p - k_f s exp(-alpha s) = 0          (11), (12) with (27), (29)

Counting. Let P(s) = m s^2 + k_v s + k_p and L = k_f s exp(-alpha s)/P. The number of roots to the
right of the line Re s = sigma is the sum of two numbers. The first number counts the zeros of P to
the right of the line. The second number counts the clockwise turns of L about 1 along the line.
With s = sigma + i y, |L| = 1 is a quadratic equation for y^2, so |L| > 1 on at most one interval of
y. The number of turns is the number of multiples of 2 pi that the phase of L passes on the interval
where |L| > 1. The phase of L is known in closed form. So roots are counted at any sigma, for any
alpha, in constant time.

Finding. The k-th root from the right has the largest sigma with a count of k or more. Bisection
gives the real part of a root, and the ends of the interval of y give the imaginary part. Newton
steps give the last digits. The method cannot miss a root, for any delay alpha and frequency w, and
has no parameter to tune.

Two alternatives were rejected. Spectral collocation of the infinitesimal generator needs an
eigenvalue problem that grows with alpha w. (The tests compare the roots with spectral collocation.)
Newton's method from seeds on every branch of the logarithm is as fast, but cannot detect a missing
root.

Units: mass kg, k_p N/m, k_v and k_f N s/m, alpha s, roots 1/s. mass > 0, alpha >= 0; other signs
are free. The arguments are scalars; vmap for more. The accuracy stated in `rightmost_roots` needs
64-bit numbers.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, ArrayLike, Complex, Float

from ..errors import InputError
from ..rig.thresholds import NEWTON_STEPS
from .undefined import is_double, root_without_derivative


class _Slider(NamedTuple):
    """The coefficients of F, or those of F/m in a scaled time, where mass is 1."""

    mass: Float[Array, ""]
    k_p: Float[Array, ""]
    k_v: Float[Array, ""]
    k_f: Float[Array, ""]
    alpha: Float[Array, ""]


def _slider(*values: ArrayLike):
    dtype = jnp.result_type(float, *values)
    return _Slider._make(jnp.asarray(value, dtype) for value in values)


def _residual(slider: _Slider, s: Array):
    """F and dF/ds."""
    memory = slider.k_f * jnp.exp(-slider.alpha * s)
    value = (slider.mass * s + slider.k_v - memory) * s + slider.k_p
    return value, 2 * slider.mass * s + slider.k_v - memory * (1 - slider.alpha * s)


def _scaled(slider: _Slider, unit: Array):
    """F/m in time measured in `unit` [s]."""
    mass = slider.mass
    k_p, k_v, k_f = slider.k_p * unit**2 / mass, slider.k_v * unit / mass, slider.k_f * unit / mass
    return _Slider(jnp.ones_like(mass), k_p, k_v, k_f, slider.alpha / unit)


def _time_unit(slider: _Slider):
    """A time in which the coefficients other than alpha are at most 1."""
    mass = slider.mass
    rate = jnp.sqrt(jnp.abs(slider.k_p) / mass)
    rate = rate + (jnp.abs(slider.k_v) + jnp.abs(slider.k_f)) / mass
    return 1 / jnp.maximum(rate, jnp.finfo(rate.dtype).tiny ** 0.25)


def _largest(dtype: DTypeLike):
    """Numbers up to this one can be raised to the fourth power."""
    return jnp.finfo(dtype).max ** 0.2


def _equal_magnitude(slider: _Slider, sigma: Array):
    """P, P', y1^2 <= y2^2 with |L(sigma + i y)| = 1 (mass 1), and whether |L| > 1 between.

    Otherwise |L| < 1 on the whole line, and |L| is closest to 1 at one of the two.
    """
    P = (sigma + slider.k_v) * sigma + slider.k_p
    slope = 2 * sigma + slider.k_v
    g = jnp.exp(jnp.minimum(-slider.alpha * sigma, jnp.log(_largest(sigma.dtype))))
    g = g * jnp.abs(slider.k_f)
    half = (g - jnp.abs(slope)) * (g + jnp.abs(slope)) / 2
    square = 2 * P * half + half**2 + (g * sigma) ** 2
    middle, root = P + half, jnp.sqrt(jnp.maximum(square, 0.0))
    far = middle + jnp.where(middle < 0, -root, root)
    product = (P - g * sigma) * (P + g * sigma)
    near = product / jnp.where(far == 0, 1.0, far)
    lower, upper = jnp.minimum(near, far), jnp.maximum(near, far)
    return P, slope, lower, upper, (square >= 0) & (upper > 0)


def _count(slider: _Slider, sigma: Array):
    """Number of roots with real part above sigma (mass 1), as a float."""
    P, slope, lower, upper, exceeds = _equal_magnitude(slider, sigma)
    negative = jnp.where(slider.k_f < 0, 1.0, 0.0)

    def phase(square: Array):
        """Continuous phase of L at y > 0, in units of pi."""
        y = jnp.sqrt(jnp.maximum(square, 0.0))
        angle = jnp.arctan2(y, sigma) - jnp.arctan2(y * slope, P - square) - slider.alpha * y
        return angle / jnp.pi + negative

    start = jnp.where(sigma < 0, 1.0, 0.0) + negative
    start = start - jnp.where(P < 0, jnp.where(slope < 0, -1.0, 1.0), 0.0)
    end = phase(upper)
    passed = 2 * jnp.floor(end / 2)
    # Without a y1 the interval reaches down to -y2, where the phase mirrors that of y2.
    turns = passed - jnp.where(lower > 0, 2 * jnp.floor(phase(lower) / 2), start - 1)
    poles = jnp.where(P < 0, 1.0, jnp.where(slope < 0, jnp.where(P > 0, 2.0, 1.0), 0.0))
    return poles - jnp.where(exceeds, turns, 0.0)


def _bisect(slider: _Slider, rank: Array):
    """The real part of the root of each rank, the count just right of it, whether it exists."""
    largest = _largest(slider.k_p.dtype)
    right = jnp.maximum(jnp.abs(slider.k_f) - slider.k_v, 0.0) + jnp.zeros_like(rank)
    near = jnp.full_like(rank, -2.0)
    beyond = jnp.log(largest) / jnp.maximum(slider.alpha, 1 / largest)
    many = _count(slider, near)
    is_near = many >= rank
    left = jnp.where(is_near, near, -2.0 - jnp.minimum(beyond, largest))
    right = jnp.where(is_near, right, near)
    exists = _count(slider, left) >= rank

    def halve(_: Array, bounds: tuple[Array, Array, Array]):
        left, right, count = bounds
        middle = left + (right - left) / 2
        here = _count(slider, middle)
        inside = here >= rank
        return (
            jnp.where(inside, middle, left),
            jnp.where(inside, right, middle),
            jnp.where(inside, count, here),
        )

    start = left, right, jnp.where(is_near, 0.0, many)
    steps = jnp.finfo(rank.dtype).nmant + 8
    _, right, count = jax.lax.fori_loop(0, steps, halve, start)
    return right, count, exists


def _newton(slider: _Slider, s: Array):
    for _ in range(NEWTON_STEPS):
        value, slope = _residual(slider, s)
        s = s - jnp.where(slope == 0, 0.0, value / jnp.where(slope == 0, 1.0, slope))
    return s


def _search(slider: _Slider, number: int):
    """The `number` rightmost roots, conjugates listed one after the other."""
    unit = _time_unit(slider)
    scaled = _scaled(slider, unit)
    rank = 1 + jnp.arange(number, dtype=slider.k_p.dtype)
    real, count, exists = _bisect(scaled, rank)
    _, _, lower, upper, _ = _equal_magnitude(scaled, real)
    y = jnp.sqrt(jnp.maximum(jnp.stack([jnp.zeros_like(lower), lower, upper]), 0.0))
    guess = jax.lax.complex(jnp.broadcast_to(real, y.shape), y)
    root = _newton(scaled, guess)
    # Choose the candidate that moved least among those that became roots. One that did not become
    # a root may not have moved either: Newton steps at a zero slope are skipped.
    size = jnp.abs(root) * (jnp.abs(root) + jnp.abs(scaled.k_v)) + jnp.abs(scaled.k_p)
    found = jnp.abs(_residual(scaled, root)[0]) <= 1e-3 * size
    best = jnp.argmin(jnp.where(found, jnp.abs(root - guess), jnp.inf), axis=0)
    best = jnp.take_along_axis(root, best[None], axis=0)[0]
    root = jnp.where(jnp.any(found, axis=0), best, guess[2])
    root = jnp.where(rank - count > 1.5, jnp.conj(root), root)
    return jnp.where(exists, root / unit, -jnp.inf)


@jax.custom_jvp
def _implicit(slider: _Slider, root: Array):
    """`root`, with the derivative of the implicit function that F(s) = 0 defines."""
    return root


@_implicit.defjvp
def _implicit_jvp(primals: tuple[_Slider, Array], tangents: tuple[_Slider, Array]):
    slider, root = primals
    root = _implicit(slider, root)
    found = jnp.isfinite(root.real)
    s = jnp.where(found, root, 0.0)
    _, change = jax.jvp(lambda slider: _residual(slider, s)[0], (slider,), (tangents[0],))
    slope = _residual(slider, s)[1]
    safe = found & (slope != 0)
    return root, jnp.where(safe, -change / jnp.where(safe, slope, 1.0), 0.0)


def _double(slider: _Slider, root: Array):
    """Which roots are double to rounding."""
    found = jnp.isfinite(root.real)
    s = jnp.where(found, root, 0.0)
    memory = slider.k_f * jnp.exp(-slider.alpha * s)
    curvature = 2 * slider.mass + slider.alpha * memory * (2 - slider.alpha * s)
    size = jnp.abs(s)
    terms = (slider.mass * size + jnp.abs(slider.k_v) + jnp.abs(memory)) * size
    return found & is_double(_residual(slider, s)[1], curvature, terms + jnp.abs(slider.k_p))


def rightmost_roots(
    mass: Float[ArrayLike, ""],
    k_p: Float[ArrayLike, ""],
    k_v: Float[ArrayLike, ""],
    k_f: Float[ArrayLike, ""],
    alpha: Float[ArrayLike, ""],
    *,
    number: int = 1,
) -> Complex[Array, " number"]:
    """The `number` roots [1/s] with the largest real parts, ordered from the largest real part.

    Of a complex pair of roots, the root with positive imaginary part comes first. The roots have
    full precision for any alpha w (half the digits if two roots nearly coincide). If alpha
    (sqrt(k_p/m) + (|k_v| + |k_f|)/m) exceeds about 1e6, the roots are dense. Rounding may then
    replace a root by a neighbouring root or by a point between two roots. Derivatives of any order
    exist with respect to all five arguments, by the implicit function theorem. The derivatives are
    nan if two roots coincide to rounding. A root that does not exist is -inf; for alpha = 0 only
    two roots exist. All arguments are scalars. Raises `InputError` if `number` is less than 1.
    """
    if number < 1:
        raise InputError(f"rightmost roots: number is {number}; ask for at least 1")
    slider = _slider(mass, k_p, k_v, k_f, alpha)
    root = _search(jax.lax.stop_gradient(slider), number)
    meets = _double(slider, root)
    root = _implicit(slider, root)
    return root_without_derivative(root, meets, lambda s: _residual(slider, s)[0])
