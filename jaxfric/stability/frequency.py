"""Searches along the imaginary axis, for transfer functions that are not rational.

Functions are evaluated on a logarithmic grid around the frequencies of the kernel and the plant.
The search misses features between two neighbouring frequencies, about one per cent apart.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Complex, Float, Int

from ..rig.friction.law import NEWTON_STEPS
from .kernel import DelayKernel
from .linear import LinearSlider
from .thresholds import BEYOND, CROSSINGS, LEAST_SLOPE, MINIMA, POINTS, WORSE


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


def crossings(
    function: Callable[[Float[Array, ""]], Float[Array, ""]],
    grid: Float[Array, " points"],
    *,
    number: int = CROSSINGS,
    wrapped: bool = False,
) -> tuple[Float[Array, " number"], Bool[Array, " number"]]:
    """Find the lowest zeros of a `function` of frequency; return zeros and a mask of valid rows.

    If `wrapped`, the function is an angle, and angles of +-pi count as zeros too. First and second
    derivatives of a zero follow the implicit function theorem; higher derivatives are wrong.
    """
    value = jax.lax.stop_gradient(jax.vmap(function)(grid))
    target = jnp.zeros_like(value)
    change = (value[:-1] > 0) != (value[1:] > 0)
    if wrapped:
        target = jnp.where(jnp.abs(value) > 0.5 * jnp.pi, jnp.sign(value) * jnp.pi, 0.0)
    (place,) = jnp.nonzero(change, size=number, fill_value=grid.shape[0])
    some = place < grid.shape[0]
    left = jnp.minimum(place, grid.shape[0] - 2)
    low, high = jnp.log(grid[left]), jnp.log(grid[left + 1])
    a, b = (value - target)[left], (value - target)[left + 1]
    share = jnp.where(some, a / jnp.where(a == b, 1.0, a - b), 0.5)
    start = low + jnp.clip(share, 0.0, 1.0) * (high - low)

    def refine(x: Float[Array, ""], low: Float[Array, ""], high: Float[Array, ""]):
        def offset(x: Float[Array, ""]):
            value = function(jnp.exp(x))
            return jnp.sin(value) if wrapped else value

        def step(x: Float[Array, ""]):
            """A Newton step, or 0 if the step would leave the grid interval."""
            e, slope = jax.jvp(offset, (x,), (jnp.ones_like(x),))
            slope = jax.lax.stop_gradient(slope)
            change = e / jnp.where(slope == 0, 1.0, slope)
            inside = (jnp.abs(slope) > LEAST_SLOPE) & (jnp.abs(change) <= high - low)
            return jnp.where(inside, change, 0.0)

        def newton(_: Array, x: Float[Array, ""]):
            return jnp.clip(x - step(x), low, high)

        x = jax.lax.stop_gradient(jax.lax.fori_loop(0, NEWTON_STEPS, newton, x))
        for _ in range(2):  # carry first and second derivatives
            x = x - step(x)
        return jnp.exp(x)

    w = jax.vmap(refine)(start, low, high)
    return jnp.where(some, w, 1.0), some


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
    if slider.mass is None:
        order, end = 1, 1j * jnp.where(damping < 0, -1.0, 1.0)
    else:
        order, end = 2, -1.0 + 0j
    turned = jnp.sum(jnp.angle(value[1:] / value[:-1])) + jnp.angle(end / value[-1])
    turned = turned + jnp.angle(value[0] / jnp.where(value[0].real < 0, -1.0, 1.0))
    return jnp.round(0.5 * order - turned / jnp.pi).astype(int)
