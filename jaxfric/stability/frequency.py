"""Searches along the imaginary axis, for transfer functions that are not rational.

Functions are evaluated on a logarithmic grid around the frequencies of the kernel and the plant.
For margins, neighbouring frequencies are about one per cent apart, and features between them are
missed. For the theorem, the grid is refined where zeros are uncertain (`adaptive_grid`).
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Complex, Float, Int

from ..rig.thresholds import NEWTON_STEPS
from .kernel import DelayKernel
from .linear import LinearSlider
from .thresholds import (
    BEYOND,
    BISECTIONS,
    CROSSINGS,
    LEAST_SLOPE,
    MET,
    MINIMA,
    POINTS,
    REFINEMENTS,
    TINY,
    WORSE,
)


def axis(slider: LinearSlider) -> Float[Array, " points"]:
    """Grid of frequencies around the frequencies of the kernel and the plant [rad/s].

    The phase of a delay is linear in w. So with a delay the grid also contains an equal number of
    evenly spaced frequencies. The evenly spaced frequencies end where the loop gain has fallen to
    about 0.1.
    """
    kernel = slider.friction.kernel
    low, high = kernel.frequencies()
    m, k, d = slider.inertia(), slider.stiffness, slider.damping + slider.friction.slope
    heavy = m > 0
    mass = jnp.where(heavy, m, 1.0)
    own = [jnp.where(heavy, jnp.sqrt(jnp.abs(k) / mass), low)]
    own.append(jnp.where(heavy, jnp.abs(d) / mass, low))
    own.append(jnp.abs(k) / jnp.where(d == 0, 1.0, jnp.abs(d)))
    named = jnp.stack([low, high, *[jnp.clip(x, 1e-3 * low, 1e3 * high) for x in own]])
    ends = jnp.log(jnp.min(named) / BEYOND), jnp.log(jnp.max(named) * BEYOND)
    grid = jnp.exp(jnp.linspace(*ends, POINTS))
    if isinstance(kernel, DelayKernel):
        size = jnp.abs(kernel.strength) + 10 * jnp.abs(slider.damping) + jnp.abs(d)
        top = (size + jnp.sqrt(size**2 + 40 * mass * jnp.abs(k))) / (2 * mass)
        grid = jnp.sort(jnp.concatenate([grid, jnp.linspace(0.0, top, POINTS + 1)[1:]]))
    return jax.lax.stop_gradient(grid)


def adaptive_grid(
    function: Callable[[Float[Array, ""]], Float[Array, ""]],
    low: Float[Array, ""],
    high: Float[Array, ""],
    points: int,
) -> tuple[Float[Array, " points"], Float[Array, " points"], Bool[Array, ""]]:
    """Grid of frequencies from `low` to `high` that separates the zeros of a function.

    A quarter of the points are evenly spaced in ln w. Every other point halves an interval. The
    intervals where cubic interpolation leaves the number of zeros most uncertain are halved first.
    Between x_i and x_i + h a cubic departs from its chord by less than 4/27 times

        |h f'_i - (f_i+1 - f_i)| + |h f'_i+1 - (f_i+1 - f_i)|

    This number must be below the values at both ends, or below f_i - f_i+1 if the sign changes.
    Returns the grid, the function there, and whether all intervals fulfil this condition. Then the
    last points of the grid coincide, if fewer points suffice.
    """
    more = 3 * points // (4 * REFINEMENTS)
    first = points - REFINEMENTS * more

    # the search has no derivatives: JAX cannot reverse its loop
    fixed, numbers = jax.closure_convert(lambda x: function(jnp.exp(x)), jnp.log(low))
    numbers = jax.lax.stop_gradient(numbers)

    def evaluate(x: Float[Array, ""]) -> Float[Array, " 2"]:
        return jnp.stack(jax.jvp(lambda x: fixed(x, *numbers), (x,), (jnp.ones_like(x),)))

    def doubt(x: Float[Array, " n"], f: Float[Array, "n 2"]) -> Float[Array, " n-1"]:
        h, (value, slope) = jnp.diff(x), f.T
        rise = jnp.diff(value)
        bend = jnp.abs(h * slope[:-1] - rise) + jnp.abs(h * slope[1:] - rise)
        size = jnp.abs(value)
        same = (value[:-1] > 0) == (value[1:] > 0)
        least = jnp.where(same, jnp.minimum(size[:-1], size[1:]), jnp.abs(rise))
        return jnp.where(h > 0, bend / jnp.where(least > 0, least, TINY), 0.0)

    def refine(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        x, f, i = state
        _, worst = jax.lax.top_k(doubt(x, f), more)
        new = 0.5 * (x[worst] + x[worst + 1])
        here = first + i * more
        x = jax.lax.dynamic_update_slice_in_dim(x, new, here, 0)
        f = jax.lax.dynamic_update_slice_in_dim(f, jax.vmap(evaluate)(new), here, 0)
        order = jnp.argsort(x)
        return x[order], f[order], i + 1

    def unfinished(state: tuple[Array, Array, Array]) -> Bool[Array, ""]:
        x, f, i = state
        return (i < REFINEMENTS) & ~jnp.all(doubt(x, f) < 1)

    start = jnp.linspace(jnp.log(low), jnp.log(high), first)
    values = jax.vmap(evaluate)(start)
    pad = points - first
    x = jnp.concatenate([start, jnp.full(pad, start[-1])])
    f = jnp.concatenate([values, jnp.tile(values[-1:], (pad, 1))])
    x, f, _ = jax.lax.while_loop(unfinished, refine, (x, f, jnp.zeros((), int)))
    return jnp.exp(x), f[:, 0], jnp.all(doubt(x, f) < 1)


def crossings(
    function: Callable[[Float[Array, ""]], Float[Array, ""]],
    grid: Float[Array, " points"],
    *,
    number: int = CROSSINGS,
    wrapped: bool = False,
    value: Float[Array, " points"] | None = None,
) -> tuple[Float[Array, " number"], Bool[Array, " number"], Bool[Array, ""]]:
    """Find the lowest zeros of a `function` of frequency between points of a grid.

    If `wrapped`, the function is an angle, and angles of +-pi count as zeros too. Derivatives of a
    zero, of any order, follow the implicit function theorem. `value` is the function on the grid,
    if it is known.

    Returns
    -------
    The zeros, a mask of valid rows, and whether every zero is found to rounding.
    """
    value = jax.lax.stop_gradient(jax.vmap(function)(grid) if value is None else value)
    (place,) = jnp.nonzero(
        (value[:-1] > 0) != (value[1:] > 0), size=number, fill_value=grid.shape[0]
    )
    some = place < grid.shape[0]
    left = jnp.minimum(place, grid.shape[0] - 2)
    right = jnp.where(some, left + 1, left)
    logs = jnp.log(grid)

    def offset(x: Float[Array, ""]):
        value = function(jnp.exp(x))
        return jnp.sin(value) if wrapped else value

    def refine(low: Float[Array, ""], high: Float[Array, ""]):
        x = jax.lax.custom_root(offset, low, lambda f, _: _bracketed(f, low, high), _divided)
        return x, jnp.abs(offset(jax.lax.stop_gradient(x)))

    x, rest = jax.vmap(refine)(logs[left], logs[right])
    ends = jnp.sin(value) if wrapped else value
    size = jnp.maximum(jnp.abs(ends[left]), jnp.abs(ends[right]))
    met = jnp.all(~some | (jax.lax.stop_gradient(rest) <= MET * size))
    return jnp.where(some, jnp.exp(x), 1.0), some, met


def _divided(slope: Callable[[Array], Array], y: Float[Array, ""]) -> Float[Array, ""]:
    """y over the slope of a linear function, 0 where the zero has no derivative."""
    size = slope(jnp.ones_like(y))
    usable = jnp.abs(size) > LEAST_SLOPE
    return jnp.where(usable, y / jnp.where(usable, size, 1.0), 0.0)


def _bracketed(
    f: Callable[[Float[Array, ""]], Float[Array, ""]],
    low: Float[Array, ""],
    high: Float[Array, ""],
) -> Float[Array, ""]:
    """Find the zero of f between two ends of different sign, by Newton's method and bisection.

    A Newton step that leaves the bracket, or is longer than half of the last step, is replaced by
    bisection. If both ends are equal, the function returns them.
    """
    start = f(low) > 0
    enough = jnp.sqrt(jnp.finfo(low.dtype).eps)

    def step(state: tuple[Array, ...]) -> tuple[Array, ...]:
        x, low, high, last, k = state
        e, slope = jax.jvp(f, (x,), (jnp.ones_like(x),))
        before = (e > 0) == start
        low, high = jnp.where(before, x, low), jnp.where(before, high, x)
        to = x - e / jnp.where(slope == 0, 1.0, slope)
        newton = (slope != 0) & (to >= low) & (to <= high) & (jnp.abs(to - x) <= 0.5 * last)
        to = jnp.where(newton, to, 0.5 * (low + high))
        # quadratic convergence: after a short Newton step x is exact to rounding
        last = jnp.where(newton & (jnp.abs(to - x) <= enough), 0.0, jnp.abs(to - x))
        return to, low, high, last, k + 1

    def unfinished(state: tuple[Array, ...]) -> Array:
        return (state[3] > 0) & (state[4] < BISECTIONS)

    first = 0.5 * (low + high), low, high, high - low, jnp.zeros((), int)
    return jax.lax.while_loop(unfinished, step, first)[0]


def smallest(
    slider: LinearSlider, function: Callable[[Float[Array, ""]], Complex[Array, ""]]
) -> Float[Array, " minima"]:
    """Refined squared magnitudes of the lowest minima of |function| over the grid, including the
    global minimum. Derivatives of the squared magnitudes are exact up to third order."""
    grid = axis(slider)

    def square(x: Float[Array, ""]):
        value = function(jnp.exp(x))
        return value.real**2 + value.imag**2

    points = jnp.log(grid)
    value = jax.lax.stop_gradient(jax.vmap(square)(points))
    inner = value[1:-1]
    lowest = jnp.where((inner <= value[:-2]) & (inner <= value[2:]), inner, jnp.inf)
    _, best = jax.lax.top_k(-lowest, MINIMA)

    def refine(x: Float[Array, ""], low: Float[Array, ""], high: Float[Array, ""]):
        def slope(x: Float[Array, ""]):
            return jax.jvp(square, (x,), (jnp.ones_like(x),))[1]

        def newton(_: int | Array, x: Float[Array, ""]):
            first, second = jax.jvp(slope, (x,), (jnp.ones_like(x),))
            return jnp.clip(x - first / jnp.where(second > 0, second, jnp.inf), low, high)

        def step(x: Float[Array, ""], to: Float[Array, ""]):
            """`to` unless it is worse than x."""
            better = jax.lax.stop_gradient(square(to) <= square(x) * (1 + WORSE))
            return jnp.where(better, to, x)

        end = jax.lax.stop_gradient(jax.lax.fori_loop(0, NEWTON_STEPS, newton, x))
        x = step(x, end)
        x = step(x, newton(NEWTON_STEPS, x))  # carries the derivative of the place
        return square(x)

    places = jnp.append(best + 1, jnp.argmin(value))
    low, high = jnp.maximum(places - 1, 0), jnp.minimum(places + 1, value.shape[0] - 1)
    return jax.vmap(refine)(points[places], points[low], points[high])


def encirclements(slider: LinearSlider) -> Int[Array, ""]:
    """Number of unstable poles, from the phase of the characteristic function (Mikhailov).

    From w = 0 to infinity the phase changes by pi/2 times the order minus pi times the number of
    unstable poles. Known limits extend the grid of frequencies: the characteristic function is real
    at w = 0, and approaches m s^2 or d s at infinity.
    """
    grid = axis(slider)
    value = jax.vmap(lambda w: slider.characteristic(1j * w))(grid)
    damping = slider.damping + slider.friction.slope
    heavy = slider.inertia() > 0
    order = jnp.where(heavy, 2, 1)
    end = jnp.where(heavy, -1.0, 1j * jnp.where(damping < 0, -1.0, 1.0))
    turned = jnp.sum(jnp.angle(value[1:] / value[:-1])) + jnp.angle(end / value[-1])
    turned = turned + jnp.angle(value[0] / jnp.where(value[0].real < 0, -1.0, 1.0))
    return jnp.round(0.5 * order - turned / jnp.pi).astype(int)
