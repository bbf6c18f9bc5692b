"""A rig at a steady velocity, linearised: plant P(s) and friction F(s).

    P(s) = s/(m s^2 + k_v s + k_p)                                                (11)
    F(s) = f_v - G(s)                                                             (12)
    1 + P F = 0:  m s^2 + (k_v + f_v) s + k_p - s G(s) = 0

A sampled controller has a delay T, which replaces k_v s + k_p by (k_v s + k_p) exp(-T s). The
zero-order hold of one sample time h delays the force by h/2, and the computation by h. So the delay
is T = 1.5 h (`sampling_delay`). Polynomials use Pade's approximant of order 4 for exp(-T s). The
approximant has a phase error of 3e-6 rad at w T = 1.6 and 8e-4 rad at w T = 3 (J. E. Marshall,
Control of Time-Delay Systems, 1979).

A PID controller, k_v s + k_p + k_i/s, raises the order of the characteristic equation by one:

    m s^3 + (k_v + f_v) s^2 + k_p s + k_i - s^2 G(s) = 0

For a law with states, df = f_v dV + f_z dz + f_x dx and dz/dt = r_z dz + r_V dV. Automatic
differentiation of the law's `force` and `rate` gives the coefficients f_v, f_z, f_x, r_z and r_V.
So the kernel is g(t) = -f_z exp(r_z t) r_V for any states. A slope f_x of friction with slip acts
as a spring in parallel with k_p. A delay law defines its own kernel.
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Complex, Float, PyTree

from ..errors import InputError
from ..quantity import as_floats, refuse_batch
from ..rig import Inertial, QuasiStatic, Rig
from ..rig.friction.delay import AbstractDelayLaw
from ..rig.friction.law import AbstractLaw, Conditions
from ..units import parse_quantity
from . import polynomial as poly
from .kernel import AbstractKernel, DelayKernel, StateSpaceKernel
from .thresholds import PADE


class LinearFriction(eqx.Module):
    """Friction about a steady velocity: df = f_v dV - g * dV + f_x dx."""

    slope: Float[Array, ""]
    """f_v, instantaneous rise of friction with velocity [force s/m]   (9)."""
    kernel: AbstractKernel
    """Memory g(t) [force/m]."""
    trend: Float[Array, ""]
    """f_x, slope of friction with slip [force/m]."""

    def transfer(self, s: Complex[Array, ""]) -> Complex[Array, ""]:
        """Friction F(s) = f_v - G(s), equation (12) [force s/m], without the trend f_x."""
        return self.slope - self.kernel.transform(s)


class LinearSlider(eqx.Module):
    """A slider with PD or PID gains (or spring and dashpot) under linearised friction."""

    mass: Float[Array, ""] | None
    """m [force s^2/m]; None for the quasi-static limit, whose order is one less."""
    stiffness: Float[Array, ""]
    """k_p [force/m]."""
    damping: Float[Array, ""]
    """k_v [force s/m]."""
    friction: LinearFriction
    delay: Float[Array, ""] | None = None
    """T, delay of the controller [s]; None: no delay."""
    integral: Float[Array, ""] | None = None
    """k_i > 0, the integral gain [force/(m s)]; None: a controller without integral action."""

    def controller(self, s: Complex[Array, ""]) -> Complex[Array, ""]:
        """(k_v s + k_p + k_i/s) exp(-T s) [force/m]."""
        found = self.damping * s + self.stiffness
        found = found if self.integral is None else found + self.integral / s
        return found if self.delay is None else found * jnp.exp(-self.delay * s)

    def plant(self, s: Complex[Array, ""]) -> Complex[Array, ""]:
        """P(s)   (11) [m/(s force)]."""
        return s / (self.inertia() * s**2 + self.controller(s))

    def characteristic(self, s: Complex[Array, ""]) -> Complex[Array, ""]:
        """m s^2 + (k_v + f_v) s + k_p + f_x + k_i/s - s G(s) [force/m]: zero at the poles."""
        friction = self.friction
        rest = self.inertia() * s**2 + self.controller(s) + friction.trend
        return rest + s * friction.transfer(s)

    def loop(self, s: Complex[Array, ""]) -> Complex[Array, ""]:
        """The loop opened at the actuator: (k_v s + k_p + k_i/s)/(m s^2 + s F(s) + f_x)."""
        friction = self.friction
        load = self.inertia() * s**2 + s * friction.transfer(s) + friction.trend
        return self.controller(s) / load

    def inertia(self) -> Float[Array, ""]:
        """The mass, or zero in the quasi-static limit."""
        return jnp.zeros_like(self.stiffness) if self.mass is None else self.mass

    def polynomials(self) -> tuple[Array, Array, Array]:
        """Polynomials (characteristic, controller, load) times D(s), ascending.

        The open loop is controller/load. The polynomials exist for rational kernels only. The
        degree of the characteristic polynomial is the number of states plus 2, or plus 1 without
        mass. A controller delay adds 4 to the degree. Integral action multiplies controller and
        load by s, which adds 1 to the degree.
        """
        kernel = self.friction.kernel
        if not isinstance(kernel, StateSpaceKernel):
            raise TypeError(f"a {type(kernel).__name__} has no polynomials; it is not rational")
        N, D = kernel.fraction()
        f_v = jnp.asarray(self.friction.slope)
        load = [jnp.asarray(self.friction.trend), f_v]
        if self.mass is not None:
            load.append(jnp.asarray(self.mass))
        own = [self.stiffness, self.damping]
        own = own if self.integral is None else [self.integral, *own]
        controller = jnp.stack(jnp.broadcast_arrays(*own))
        load = poly.total(poly.product(jnp.stack(jnp.broadcast_arrays(*load)), D), -poly.shifted(N))
        load = load if self.integral is None else poly.shifted(load)
        controller = poly.product(controller, D)
        if self.delay is not None:
            late, ahead = _pade(self.delay)
            controller, load = poly.product(controller, late), poly.product(load, ahead)
        return poly.total(load, controller), controller, load


class Setting(eqx.Module):
    """Parameters of a slider other than its gains (k_p, k_v) and friction. Arrays of one shape."""

    mass: Float[Array, " *n"] | None
    """m [force s^2/m]; None without mass."""
    delay: Float[Array, " *n"] | None = None
    """T, delay of the controller [s]; None: no delay."""
    integral: Float[Array, " *n"] | None = None
    """k_i > 0, the integral gain [force/(m s)]; None: no integral action."""

    def slider(self, gains: Float[Array, " 2"], friction: LinearFriction) -> LinearSlider:
        """Build the slider with the gains (k_p, k_v)."""
        return LinearSlider(self.mass, gains[0], gains[1], friction, self.delay, self.integral)


def integral_gain(value: float | None) -> float | None:
    """Return the integral gain k_i of a controller; None (no integral action) for 0.

    Raises
    ------
    InputError : the integral gain is negative.
    """
    if value is not None and not 0 <= value < math.inf:
        raise InputError(f"integral gain is {value:g}; it must be 0 or more")
    return value or None


def sampling_delay(sample_time: ArrayLike) -> Float[Array, ""]:
    """Delay T = 1.5 h [s] of a controller with sample time h [s]: h/2 from the zero-order hold, and
    h from computing. A velocity computed from differences lags by a further h/2, which T does not
    include."""
    return 1.5 * jnp.asarray(sample_time, float)


def controller_delay(sample_time: float | None, delay: float | None) -> float | None:
    """Return the delay T [s] of a controller from its sample time or delay [s], or None.

    Raises
    ------
    InputError : both times are given, or a time is not positive.
    """
    if sample_time is not None and delay is not None:
        raise InputError(
            "a sample time and a delay exclude each other: a sampled controller answers 1.5"
            " samples late, and the delay is the whole of it; give one"
        )
    for what, value in (("sample time", sample_time), ("delay of the controller", delay)):
        if value is not None and not 0 < value < math.inf:
            raise InputError(f"{what} is {value:g} s; it must be positive")
    return delay if sample_time is None else float(sampling_delay(sample_time))


def _pade(delay: Float[Array, ""]) -> tuple[Array, Array]:
    """Ascending coefficients of numerator and denominator of exp(-T s), order 4."""
    n = PADE
    powers = np.arange(n + 1)
    c = np.asarray([math.comb(n, k) / math.perm(2 * n, k) for k in powers])
    ahead = jnp.asarray(c) * jnp.asarray(delay) ** powers
    return ahead * (-1.0) ** powers, ahead


def linear_friction(
    law: AbstractLaw | AbstractDelayLaw, velocity: Float[Array, ""]
) -> LinearFriction:
    """Linearise a law about steady sliding at `velocity` [m/s].

    Slip and ageing evolution give one kernel, (B/L) exp(-V0 t/L), and f_v = A/V0   (21)-(23).
    A law without states gives a kernel without states, G = 0. A delay law gives f_v and
    G(s) = k_f exp(-alpha s)   (26)-(29).
    """
    V = as_floats(velocity)
    if isinstance(law, AbstractDelayLaw):
        slope = jax.jacfwd(law.force)(V, V)
        return LinearFriction(
            slope, DelayKernel(law.negative_slope(V), law.delay), jnp.zeros_like(V)
        )
    at = Conditions(jnp.zeros_like(V), jnp.zeros_like(V))
    state = law.steady_state(V)
    f_V, f_z, f_at = jax.jacfwd(law.force, (0, 1, 2))(V, state, at)
    r_V, r_z = jax.jacfwd(law.rate, (0, 1))(V, state, at)
    return LinearFriction(f_V, StateSpaceKernel(r_z, r_V, -f_z), f_at.slip)


def refuse_no_law(law: object) -> None:
    """Raise `InputError` unless `law` is a friction law."""
    if not isinstance(law, AbstractLaw | AbstractDelayLaw):
        raise InputError(
            f"the law is a {type(law).__name__}; for a Fit, a Posterior, a Loop or a file pass"
            " jaxfric.law_from_fit(it, normal_force=...).law"
        )


def refuse_without_steady_state(velocity: ArrayLike, found: PyTree) -> None:
    """Raise `InputError` for the first velocity [m/s] at which an array of `found` is not finite.

    Velocities are along the first axis of the arrays.
    """
    V = np.asarray(velocity)
    finite = np.ones(len(V), bool)
    for leaf in jax.tree.leaves(found):
        finite &= np.all(np.isfinite(np.asarray(leaf)).reshape(len(V), -1), axis=1)
    if not finite.all():
        raise InputError(
            f"velocity: the friction law has no steady state at {float(V[~finite][0]):g} m/s (its"
            " force or its slope is not finite there); leave that velocity out"
        )


def linearise(rig: Rig, velocity: ArrayLike | str) -> LinearSlider:
    """Linearise a rig at a steady `velocity` [m/s] or "2 mm/s". Jittable and vmappable.

    The drive is outside the loop: the drive shapes the command and does not affect stability.

    Raises
    ------
    InputError : a concrete `velocity` is not positive; the rig's friction is not a friction law; an
        array for one number outside of `jax.vmap`.
    """
    machine = rig.machine
    if not isinstance(machine, QuasiStatic | Inertial):
        raise TypeError(f"no linearisation of a {type(machine).__name__}")
    if isinstance(velocity, str):
        velocity = parse_quantity(velocity, "m/s", "velocity")
    V = as_floats(velocity)
    if not isinstance(V, Tracer) and not bool(jnp.all(jnp.isfinite(V) & (V > 0))):
        raise InputError(f"linearise: velocity is {V} m/s; steady sliding needs a positive one")
    if V.ndim:
        raise InputError(f"linearise: velocity has shape {V.shape}; compute many with jax.vmap")
    refuse_no_law(rig.friction)
    refuse_batch(rig, "linearise")
    mass = machine.mass if isinstance(machine, Inertial) else None
    damping = jnp.zeros_like(machine.stiffness) if machine.damping is None else machine.damping
    return LinearSlider(mass, machine.stiffness, damping, linear_friction(rig.friction, V))


def to_control(slider: LinearSlider):
    """Return the loop opened at the actuator as `control.TransferFunction`.

    Needs python-control: `pip install "jaxfric[control]"`. `control.feedback` closes the loop.
    """
    try:
        import control
    except ImportError:
        raise InputError(
            'to_control needs python-control; install it with: pip install "jaxfric[control]"'
        ) from None
    _, controller, load = slider.polynomials()
    above, below = ([float(c) for c in p[::-1]] for p in (controller, load))
    return control.TransferFunction(above, below)
