"""The smooth branches of a margin: the margin is the least of them.

A margin is a minimum over poles or over frequencies, and its gradient jumps where two of them
change places. An optimum often lies just there. Each branch alone is smooth, so the optimum is then
the point at which two smooth constraints meet.
"""

from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..stability import polynomial as poly
from ..stability.kernel import AbstractRationalKernel
from ..stability.linear import LinearSlider
from ..stability.margins import is_stable, margin, poles

# An imaginary part below this share of a pole is rounding: the pole is real.
_REAL = 1e-9


def branches(name: str, slider: LinearSlider) -> Float[Array, " n"]:
    """The branches of the margin of a given name, inf where one does not exist.

    One entry, the margin itself, where the margin is of another kind than those of `_BRANCHES` or
    where the kernel is not rational.
    """
    if name in _BRANCHES and isinstance(slider.friction.kernel, AbstractRationalKernel):
        return _BRANCHES[name](slider)
    return margin(name, slider)[None]


def _decay(slider: LinearSlider) -> Float[Array, " n"]:
    """-Re s of every pole [1/s], once for a complex pair."""
    s = poles(slider)
    return jnp.where(s.imag < -_REAL * jnp.abs(s), jnp.inf, -s.real)


def _damping(slider: LinearSlider) -> Float[Array, " n"]:
    """-Re s/|s| of every pole, once for a complex pair."""
    s = poles(slider)
    square = s.real**2 + s.imag**2
    ratio = -s.real / jnp.sqrt(jnp.where(square == 0, 1.0, square))
    return jnp.where(s.imag < -_REAL * jnp.abs(s), jnp.inf, jnp.where(square == 0, 0.0, ratio))


def _modulus(slider: LinearSlider) -> Float[Array, " n"]:
    """|1 + L(i w)| at every w where it may be least, and at w = 0 and infinity.

    |1 + L|^2 = 1 + Q/M with Q = |C|^2 + 2 Re(C conj W), M = |W|^2, L = C/W; candidates are the
    roots of Q' M - Q M' in y = w^2. A root that is not real gives an upper bound of the margin, so
    it may stay. Of an unstable slider all branches are minus the least distance.
    """
    whole, controller, load = slider.polynomials()
    real, _ = poly.cross(controller, load)
    Q = poly.total(poly.cross(controller, controller)[0], 2 * real)
    M, _ = poly.cross(load, load)
    massless = slider.mass is None
    Q = Q[: M.shape[0] if massless else M.shape[0] - 1]
    slope = poly.total(poly.product(poly.derivative(Q), M), -poly.product(Q, poly.derivative(M)))
    if massless:
        slope = slope[:-1]  # the leading terms cancel
    y = jnp.abs(poly.roots(slope))
    usable = (y > 0) & (y < poly.LARGEST)
    y = jnp.where(usable, y, 1.0)
    inner = jnp.where(usable, _root(_square(whole, y) / _nonzero(_square(load, y))), jnp.inf)
    friction = slider.friction
    ends = [_end(slider.stiffness, friction.trend)]
    if massless:
        ends.append(_end(slider.damping, friction.slope))
    else:
        ends.append(jnp.ones_like(ends[0]))
    distance = jnp.concatenate([inner, jnp.stack(ends)])
    return jnp.where(is_stable(slider), distance, -jnp.min(distance))


def _end(above: Array, below: Array) -> Float[Array, ""]:
    """|1 + above/below|; inf where below is 0."""
    some = below != 0
    return jnp.where(some, jnp.abs(1 + above / jnp.where(some, below, 1.0)), jnp.inf)


def _square(c: Array, y: Array) -> Array:
    """|c(i w)|^2 at y = w^2."""
    even, odd = poly.on_axis(c)
    return poly.value(even, y) ** 2 + y * poly.value(odd, y) ** 2


def _root(x: Array) -> Array:
    """Square root whose derivative at 0 is finite."""
    return jnp.where(x > 0, jnp.sqrt(jnp.where(x > 0, x, 1.0)), 0.0)


def _nonzero(x: Array) -> Array:
    return jnp.where(x == 0, 1e-300, x)


_BRANCHES: dict[str, Callable[[LinearSlider], Array]] = {
    "decay": _decay,
    "damping": _damping,
    "modulus": _modulus,
}
