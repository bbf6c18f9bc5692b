"""Stability margins of a linearised slider, vmappable and differentiable; `MARGINS` lists them.

L is the loop opened at the actuator, (k_v s + k_p)/(m s^2 + s F(s) + f_x), for a PID controller
with k_p + k_i/s in place of k_p. The loop L(i w) is evaluated from w = 0 to infinity, both
included. Each margin considers one way to move L to -1, such as a factor or a delay. If L cannot
reach -1 in this way, the margin is inf.

For an unstable slider every margin is beyond its limit. An unstable slider has negative margins
decay and damping, and a stiffness margin below 1. If (19) has several solutions, a stable slider
may have a stiffness margin below 1 too. The margins modulus and phase of an unstable slider are
minus the distance or angle of L from -1. The gain margin is 1 over the factor that moves L to -1,
or 0 if no factor does. The delay margin is minus the smallest advance that moves L to -1. Every
margin except delay passes its limit, 0 or 1, continuously. The delay margin jumps if a delay would
stabilise the slider.

Every margin except stiffness includes a controller delay (`LinearSlider.delay`). The stiffness
margin is undefined with a delay, because the theorem applies to springs. The delay margin is the
delay allowed in addition to the controller delay T. Compared with a dense scan, margins are
accurate to 1e-4 if L crosses at frequencies w < 2/T.

For a slider without mass and with k_v > |f_v|, |L| > 1 at the highest frequencies. Any delay makes
such a slider unstable, and the delay margin is 0. In a real actuator, mass removes this effect.

For rational kernels all margins are exact, from roots of polynomials. For other kernels (a delay, a
function of time) a grid of frequencies is searched and refined. Poles of a delay law come from
`stability.delay_roots` and need a mass. For a kernel given as a function of time no poles are
computed.

All margins need 64-bit numbers. In single precision, squares of polynomials in SI units overflow,
and the margins phase, delay and modulus would be silently wrong.
"""

import functools
import pkgutil
from collections.abc import Callable, Iterable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Complex, Float, PyTree

from ..errors import InputError
from . import polynomial as poly
from .delay import unstable_roots
from .delay_roots import rightmost_roots
from .frequency import axis, crossings, encirclements, smallest
from .kernel import AbstractKernel, DelayKernel, StateSpaceKernel
from .linear import LinearSlider
from .margin_table import MARGINS, known_margin, meaningless, refuse_meaningless
from .theorem import apply_theorem
from .thresholds import AT_LIMIT


class Crossing(NamedTuple):
    """Frequencies at which L crosses a curve; `some` is False in rows without a crossing."""

    frequency: Float[Array, " n"]
    real: Float[Array, " n"]
    imaginary: Float[Array, " n"]
    some: Bool[Array, " n"]


def stability_margin(name: str, slider: LinearSlider) -> Float[Array, ""]:
    """Compute the margin `name`.

    Raises
    ------
    InputError : no such margin, a margin that is not available for the kernel, or single precision.
    """
    known_margin(name)
    return several((name,), slider)[name]


def margins(slider: LinearSlider) -> dict[str, Float[Array, ""]]:
    """Compute all margins available for the slider, by name.

    Raises
    ------
    InputError : the slider is in single precision.
    """
    return several(available(slider), slider)


def available(slider: LinearSlider) -> tuple[str, ...]:
    """Names of the margins that are defined for the slider's kernel and controller."""
    has_poles = isinstance(slider.friction.kernel, StateSpaceKernel | DelayKernel)
    late, integral = slider.delay is not None, slider.integral is not None
    return tuple(
        name
        for name, one in MARGINS.items()
        if not (one.needs_poles and not has_poles)
        and not meaningless(name, late=late, integral=integral)
    )


def several(names: Iterable[str], slider: LinearSlider) -> dict[str, Float[Array, ""]]:
    """Compute several margins by name, from one analysis; errors as in `stability_margin`."""
    analysis, asked = Analysis(slider), tuple(names)
    refuse_meaningless(asked, late=slider.delay is not None, integral=slider.integral is not None)
    return {name: pkgutil.resolve_name(MARGINS[name].function)(analysis) for name in asked}


def poles(slider: LinearSlider, *, number: int = 1) -> Complex[Array, " n"]:
    """Poles of the closed loop [1/s]; for a delay law the `number` rightmost ones.

    Raises
    ------
    InputError : the kernel is a function of time, or a delay without mass.
    """
    kernel = _kernel(slider)
    if isinstance(kernel, StateSpaceKernel):
        return poly.simple_roots(slider.polynomials()[0])
    if isinstance(kernel, DelayKernel):
        return rightmost_roots(*_delay_slider(slider, kernel), number=number)
    raise InputError(
        f"the poles of a {type(kernel).__name__} are not available; its margins of"
        " stiffness, modulus, gain, phase and delay are"
    )


def is_stable(slider: LinearSlider) -> Bool[Array, ""]:
    """Whether steady sliding is asymptotically stable."""
    kernel = _kernel(slider)
    if isinstance(kernel, StateSpaceKernel):
        return poly.is_hurwitz(slider.polynomials()[0])
    if isinstance(kernel, DelayKernel):
        return unstable_roots(*_delay_slider(slider, kernel)) == 0
    return encirclements(slider) == 0


def _kernel(slider: LinearSlider) -> AbstractKernel:
    """Return the slider's kernel; raise `InputError` if its controller cannot be analysed."""
    kernel = slider.friction.kernel
    if slider.delay is not None and slider.mass is None:
        raise InputError("a controller with a delay needs a mass: without mass no delay is stable")
    if slider.delay is not None and isinstance(kernel, DelayKernel):
        raise InputError("a controller delay cannot be combined with a delay law; use another law")
    if slider.integral is not None and not isinstance(kernel, StateSpaceKernel):
        raise InputError(
            "integral action is analysed under laws with states or without memory only: not under"
            " a delay law, nor with a kernel that is a function of time"
        )
    return kernel


def refuse_single_precision(numbers: PyTree) -> None:
    """Raise `InputError` for numbers in single precision."""
    if jnp.result_type(*jax.tree.leaves(numbers)) != jnp.float64:
        raise InputError(
            "margins need 64-bit numbers: add jax.config.update('jax_enable_x64', True) after"
            " 'import jax', before any array is made; in a study precision='float64'"
        )


class Analysis:
    """Quantities shared by the margins of one slider, each computed once."""

    def __init__(self, slider: LinearSlider):
        refuse_single_precision(slider)
        self.slider = slider

    @functools.cached_property
    def stable(self) -> Bool[Array, ""]:
        """Whether steady sliding is stable."""
        return is_stable(self.slider)

    @functools.cached_property
    def poles(self) -> Complex[Array, " n"]:
        """Poles of the closed loop [1/s]."""
        return poles(self.slider)

    @functools.cached_property
    def real(self) -> Crossing:
        """Frequencies w > 0 at which L(i w) is real."""
        if not isinstance(self.slider.friction.kernel, StateSpaceKernel):
            return _searched(self.slider, jnp.angle, wrapped=True)
        _, controller, load = self.slider.polynomials()
        return _solved(poly.cross(controller, load)[1], controller, load)

    @functools.cached_property
    def unit(self) -> Crossing:
        """Frequencies w > 0 at which |L(i w)| = 1."""
        if not isinstance(self.slider.friction.kernel, StateSpaceKernel):
            return _searched(self.slider, lambda L: jnp.log(jnp.abs(L)), wrapped=False)
        _, controller, load = self.slider.polynomials()
        above, below = (poly.cross(c, c)[0] for c in (controller, load))
        return _solved(poly.total(above, -below), controller, load)


def stiffness(of: Analysis) -> Float[Array, ""]:
    """(k_p + f_x)/k_cr, stiffness over its critical value.

    The margin is inf if damping suffices, and nan if not all solutions of (19) were found.
    """
    k_cr = apply_theorem(of.slider).critical_stiffness
    k = of.slider.stiffness + of.slider.friction.trend
    some = (k_cr > 0) & jnp.isfinite(k_cr)
    ratio = k / jnp.where(some, k_cr, 1.0)
    by_damping = jnp.where(k > 0, jnp.inf, 0.0)
    known = jnp.where(some, ratio, jnp.where(k_cr == 0, by_damping, 0.0))
    return jnp.where(jnp.isnan(k_cr), jnp.nan, known)


def decay(of: Analysis) -> Float[Array, ""]:
    """-max Re s over the poles s of the closed loop [1/s]."""
    return _least(-of.poles.real)


def damping(of: Analysis) -> Float[Array, ""]:
    """min over the poles of -Re s/|s|, the damping ratio.

    A delay law has infinitely many poles, and their damping ratios approach 0. So for a delay law
    only the rightmost pole counts.
    """
    return _least(damping_ratios(of))


def damping_ratios(of: Analysis) -> Float[Array, " n"]:
    """-Re s/|s| of every pole; 0 for a pole at 0."""
    s = of.poles
    square = s.real**2 + s.imag**2
    some = square > 0
    size = jnp.sqrt(jnp.where(some, square, 1.0))
    return jnp.where(some, -s.real / size, 0.0)


def modulus(of: Analysis) -> Float[Array, ""]:
    """min over w of |1 + L(i w)| = 1/Ms, the distance of L from -1."""
    square = _least(squared_distances(of))
    return _signed(of, jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), square))


def squared_distances(of: Analysis) -> Float[Array, " n"]:
    """|1 + L(i w)|^2 at every frequency w of a possible minimum; w = 0 and infinity come last.

    |1 + L|^2 = 1 + Q/M with Q = |C|^2 + 2 Re(C conj W), M = |W|^2, L = C/W. At a minimum Q' M = Q
    M', which is a polynomial equation in y = w^2. Every y > 0 gives an upper bound of the minimum,
    so spurious roots of the polynomial are harmless. Rows without a root are inf.
    """
    if not isinstance(of.slider.friction.kernel, StateSpaceKernel):
        square = smallest(of.slider, lambda w: 1 + of.slider.loop(1j * w))
    else:
        whole, controller, load = of.slider.polynomials()
        real, _ = poly.cross(controller, load)
        Q = poly.total(poly.cross(controller, controller)[0], 2 * real)
        M, _ = poly.cross(load, load)
        Q = Q[: M.shape[0] if of.slider.mass is None else M.shape[0] - 1]
        slope = poly.total(
            poly.product(poly.derivative(Q), M), -poly.product(Q, poly.derivative(M))
        )
        if of.slider.mass is None:
            slope = slope[:-1]  # the leading terms cancel
        y = jnp.abs(poly.roots(slope))  # at a minimum dy matters from second order on
        y = jnp.where(y < poly.LARGEST, y, 0.0)
        place = jnp.where(y > 0, y, 1.0)  # with integral action y = 0 is a root, but L is infinite
        square = _square(whole, place) / _nonzero(_square(load, place))
        square = jnp.where(y > 0, square, jnp.inf)
    L, some = _ends(of.slider)
    return jnp.append(square, jnp.where(some, (1 + L) ** 2, jnp.inf))


def gain(of: Analysis) -> Float[Array, ""]:
    """Smallest factor > 1 that moves L to -1 when it multiplies or divides L."""
    at = of.real
    L, finite = _ends(of.slider)
    real = jnp.concatenate([at.real, L])
    negative = jnp.concatenate([at.some, finite]) & (real < 0)
    size = jnp.where(negative, -real, 1.0)
    factors = jnp.where(negative, jnp.maximum(size, 1 / size), jnp.inf)
    factor = _least(factors)
    return jnp.where(of.stable, factor, 1 / factor)


def phase(of: Analysis) -> Float[Array, ""]:
    """Smallest angle of rotation, in either direction, that moves L to -1 [rad]."""
    at, lag = of.unit, _lag(of.unit)
    angle = jnp.where(at.some, jnp.minimum(lag, 2 * jnp.pi - lag), jnp.inf)
    return _signed(of, _least(angle))


def delay(of: Analysis) -> Float[Array, ""]:
    """Smallest delay in the loop that moves L to -1 [s]."""
    at = of.unit
    lag = _lag(at)
    # at the limit of stability L = -1 to rounding, on either side: not one period away
    behind = jnp.where(lag > 2 * jnp.pi - AT_LIMIT, lag - 2 * jnp.pi, lag)
    ahead = jnp.where(lag < AT_LIMIT, -lag, 2 * jnp.pi - lag)
    time = jnp.where(of.stable, behind, ahead) / at.frequency
    found = _signed(of, _least(jnp.where(at.some, time, jnp.inf)))
    at_once = jnp.abs(of.slider.damping) > jnp.abs(of.slider.friction.slope)
    return jnp.where(at_once & ~(of.slider.inertia() > 0), 0.0, found)


def _searched(
    slider: LinearSlider, function: Callable[[Array], Array], *, wrapped: bool
) -> Crossing:
    """Zeros of a function of L(i w), found on a grid of frequencies."""
    w, some, _ = crossings(lambda w: function(slider.loop(1j * w)), axis(slider), wrapped=wrapped)
    L = jax.vmap(lambda w: slider.loop(1j * w))(w)
    return Crossing(w, L.real, L.imag, some)


def _solved(equation: Array, controller: Array, load: Array) -> Crossing:
    """Zeros of a polynomial in y = w^2, and L = controller/load there."""
    y, some = poly.positive_roots(equation)
    real, imaginary = poly.cross(controller, load)
    below = _nonzero(poly.value(poly.cross(load, load)[0], y))
    re, im = poly.value(real, y) / below, jnp.sqrt(y) * poly.value(imaginary, y) / below
    return Crossing(jnp.sqrt(y), re, im, some)


def _ends(slider: LinearSlider) -> tuple[Float[Array, " 2"], Bool[Array, " 2"]]:
    """L at w = 0 and at infinity, where it is real, and whether it is finite."""
    friction, zero = slider.friction, jnp.zeros(())
    heavy = slider.inertia() > 0
    last = jnp.where(heavy, 0.0, slider.damping), jnp.where(heavy, 1.0, friction.slope)
    first = (slider.stiffness, friction.trend) if slider.integral is None else (zero + 1, zero)
    above = jnp.stack(jnp.broadcast_arrays(first[0], last[0]))
    below = jnp.stack(jnp.broadcast_arrays(first[1], last[1]))
    some = below != 0
    return above / jnp.where(some, below, 1.0), some


def _delay_slider(slider: LinearSlider, kernel: DelayKernel) -> tuple[ArrayLike, ...]:
    """m, k_p, k_v, k_f, alpha: the arguments of `stability.delay`."""
    if slider.mass is None:
        raise InputError("stability of a delay law needs a mass; give the machine one (Inertial)")
    friction = slider.friction
    stiffness = slider.stiffness + friction.trend
    return slider.mass, stiffness, slider.damping + friction.slope, kernel.strength, kernel.delay


def _least(values: Float[Array, " n"]) -> Float[Array, ""]:
    """The least value, inf if there is none; with ties, the derivative is that of one of them."""
    values = jnp.append(values, jnp.inf)
    return values[jnp.argmin(values)]


def _square(c: Array, y: Array) -> Array:
    """|c(i w)|^2 at y = w^2, without cancellation between squares."""
    even, odd = poly.on_axis(c)
    return poly.value(even, y) ** 2 + y * poly.value(odd, y) ** 2


def _lag(at: Crossing) -> Float[Array, " n"]:
    """Clockwise rotation that moves L to -1, in [0, 2 pi)."""
    return jnp.mod(jnp.arctan2(at.imaginary, at.real) + jnp.pi, 2 * jnp.pi)


def _nonzero(x: Array) -> Array:
    return jnp.where(x == 0, 1e-300, x)


def _signed(of: Analysis, distance: Float[Array, ""]) -> Float[Array, ""]:
    return jnp.where(of.stable, distance, -distance)
