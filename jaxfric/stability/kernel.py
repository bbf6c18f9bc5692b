"""The memory of friction about a steady velocity: kernels g(t) and their transforms G(s).

    f(t) = f_ss + f_v V(t) - int_0^t g(t - tau) V(tau) dtau                        (8)
    F(s) = f_v - G(s),   G(s) = int_0^inf g(t) exp(-s t) dt                        (12)

V is the perturbation of velocity. Stability depends on a friction law only through f_v and g. A
kernel g has the unit force/m. The transform G has the unit force s/m, as f_v has. The kernel of a
law with states has a rational transform. A `FunctionKernel` is any function of time. The kernel of
a delay law is an impulse.
"""

import abc
from collections.abc import Callable, Sequence
from typing import cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Complex, Float

from ..errors import InputError
from ..quantity import quantity
from . import polynomial as poly
from .thresholds import LATE, MOST_PANELS, NEGLECTED, ROUNDINGS, SPLIT, UNRESOLVED


class AbstractKernel(eqx.Module):
    """A memory kernel; the theorem of Rice and Ruina uses only its methods."""

    @abc.abstractmethod
    def transform(self, s: Complex[Array, ""]) -> Complex[Array, ""]:
        """The transform G(s), for Re s >= 0."""

    @abc.abstractmethod
    def frequencies(self) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Lowest and highest angular frequency between which G changes [rad/s]."""

    @abc.abstractmethod
    def variation(self) -> Float[Array, ""]:
        """|g(0)| plus the total variation of g [force/m], or more: |G(i w)| <= variation/w.

        The variation is inf if the kernel does not know it.
        """


class StateSpaceKernel(AbstractKernel):
    """g(t) = c exp(a t) b and G(s) = c (s - a)^-1 b = N/D: the kernel of any law with states.

    Parameters
    ----------
    a : (n, n) matrix [1/s], b : (n,) [force/m], c : (n,).
    """

    a: Float[Array, "n n"] = eqx.field(converter=jnp.asarray)
    b: Float[Array, " n"] = eqx.field(converter=jnp.asarray)
    c: Float[Array, " n"] = eqx.field(converter=jnp.asarray)

    def fraction(self) -> tuple[Float[Array, " n"], Float[Array, " n+1"]]:
        """Ascending coefficients of N (degree n - 1) and of the monic D (degree n)."""
        # Faddeev and LeVerrier: adjugate and determinant of (s - a), power by power
        n = self.b.shape[0]
        numerator, denominator = [], [jnp.ones_like(jnp.sum(self.b) + 1.0)]
        M = jnp.eye(n)
        for k in range(1, n + 1):
            numerator.append(self.c @ M @ self.b)
            aM = self.a @ M
            denominator.append(-jnp.trace(aM) / k)
            M = aM + denominator[-1] * jnp.eye(n)
        top = jnp.stack(numerator[::-1]) if n else jnp.zeros((1,))
        return top, jnp.stack(denominator[::-1])

    def transform(self, s: Complex[Array, ""]):
        N, D = self.fraction()
        return poly.value(N, s) / poly.value(D, s)

    def frequencies(self):
        if not self.b.shape[0]:
            return jnp.ones(()), jnp.ones(())
        size = jnp.abs(poly.roots(self.fraction()[1]))
        return jnp.min(size), jnp.max(size)

    def variation(self):
        return jnp.asarray(jnp.inf)  # no search: its w_n are roots


class DelayKernel(AbstractKernel):
    """g(t) = k_f delta(t - alpha), G(s) = k_f exp(-alpha s).   (28)-(29)

    The transform G of a delay does not vanish at infinity, so the theorem of Rice and Ruina does
    not hold: see `stability.delay`.
    """

    strength: Float[Array, ""] = quantity("k_f", "F s/m", "fall of steady friction with velocity")
    delay: Float[Array, ""] = quantity("alpha", "s", "delay", lower=0.0)

    def transform(self, s: Complex[Array, ""]):
        return self.strength * jnp.exp(-self.delay * s)

    def frequencies(self):
        return 1e-2 / self.delay, 1e2 / self.delay

    def variation(self):
        return jnp.asarray(jnp.inf)


class FunctionKernel(AbstractKernel):
    """A kernel given as a function g(t), which may jump at known times.

    The kernel is stored as sums of Legendre polynomials on panels of time, and is zero beyond the
    last panel. The transform of these polynomials is exact at every frequency (Filon's idea: the
    oscillating factor is integrated, not sampled). So G vanishes at infinity, as the theorem
    requires.

    Panels that do not resolve g are split in halves, if g gives concrete numbers. If g depends on
    numbers that JAX traces, panels cannot be split. An unresolved kernel is then nan.

    Parameters
    ----------
    g : a function of t [s] to force/m.
    horizon : time [s] after which g is negligible (exp(-36) is 2e-16).
    panels, order : panels grow geometrically over five decades up to the horizon, with `order`
        Gauss points each.
    breaks : times [s] at which g or its slope jumps; with the horizon, if g is 0 beyond it.

    Raises
    ------
    InputError : the horizon, `panels` or `order` is too small; g is not finite; g needs more than
        4096 panels; g is not negligible at the horizon.
    """

    edges: Float[Array, " p+1"]
    """Ends of the panels [s], ascending."""
    coefficients: Float[Array, "p n"]
    """Legendre coefficients of g on every panel [force/m]."""

    def __init__(
        self,
        g: Callable[[Float[Array, ""]], Float[Array, ""]],
        horizon: float,
        *,
        panels: int = 32,
        order: int = 16,
        breaks: Sequence[float] = (),
    ):
        if not horizon > 0:
            raise InputError(f"kernel: the horizon is {horizon:g} s; it must be positive")
        if panels < 2 or order < 3:
            raise InputError(f"kernel: panels={panels}, order={order}; least are 2 and 3")
        inner = np.geomspace(1e-5 * horizon, horizon, panels)
        inside = np.asarray(breaks, float)
        inside = inside[(inside > 0) & (inside <= horizon)]
        edges = np.unique(np.concatenate([[0.0], inner[:-1], inside, [horizon]]))
        edges, values = _resolving(g, edges, order)
        total, unresolved, at_end = _quality(edges, values)
        if horizon in inside:
            at_end = 0.0 * at_end
        if not isinstance(total, Tracer):
            _refuse_unresolved(total, unresolved / _unresolved(values), at_end)
        sound = (unresolved <= _unresolved(values) * total) & (at_end <= NEGLECTED * total)
        self.edges = jnp.asarray(edges)
        self.coefficients = jnp.where(sound, values @ _projection(order), jnp.nan)

    def transform(self, s: Complex[Array, ""]):
        half = 0.5 * jnp.diff(self.edges)
        moments = _legendre_moments(s * half, self.coefficients.shape[1])
        panels = half * jnp.sum(self.coefficients * moments, axis=1)
        return jnp.sum(panels * jnp.exp(-s * self.edges[:-1]))

    def frequencies(self):
        return 0.1 / self.edges[-1], 10 / jnp.min(jnp.diff(self.edges))

    def variation(self):
        c, n = self.coefficients, np.arange(self.coefficients.shape[1])
        left, right = jnp.pad(c @ (-1.0) ** n, (0, 1)), jnp.pad(jnp.sum(c, axis=1), (1, 0))
        # int |p'| dx <= sqrt(2 int p'^2 dx) on a panel
        slope = np.stack([np.polynomial.legendre.legder(row, axis=0) for row in np.eye(len(n))])
        square = jnp.sum((c @ slope) ** 2 / (n[:-1] + 0.5), axis=1)
        return jnp.sum(jnp.abs(left - right)) + jnp.sum(jnp.sqrt(2 * square))


def _projection(order: int) -> np.ndarray:
    """Matrix from values at `order` Gauss points to Legendre coefficients."""
    x, w = np.polynomial.legendre.leggauss(order)
    return w[:, None] * np.polynomial.legendre.legvander(x, order - 1) * (np.arange(order) + 0.5)


def _resolving(
    g: Callable[[Float[Array, ""]], Float[Array, ""]], edges: np.ndarray, order: int
) -> tuple[np.ndarray, Array]:
    """Edges of panels and g at their Gauss points; panels are split if g is concrete."""
    while True:
        middle = 0.5 * (edges[1:] + edges[:-1])
        values = jax.vmap(jax.vmap(g))(jnp.asarray(_times(edges, order)))
        if isinstance(values, Tracer):
            return edges, values
        values = cast(Array, np.asarray(values))  # NumPy compiles nothing for a new shape
        total, _, _ = _quality(edges, values)
        rough = _tails(edges, values) > SPLIT * _unresolved(values) / len(edges) * total
        rough &= (middle > edges[:-1]) & (middle < edges[1:])
        if not rough.any() or len(edges) > MOST_PANELS:
            return edges, values
        edges = np.sort(np.concatenate([edges, middle[rough]]))


def _times(edges: np.ndarray, order: int) -> np.ndarray:
    """Gauss points of all panels [s], shape (panels, order)."""
    x = np.polynomial.legendre.leggauss(order)[0]
    return 0.5 * (edges[1:] + edges[:-1])[:, None] + 0.5 * np.diff(edges)[:, None] * x


def _tails(edges: np.ndarray, values: Float[Array, "p n"]) -> Float[Array, " p"]:
    """Length of each panel times the size of its last two Legendre coefficients [force s/m]."""
    last = values @ _projection(values.shape[1])[:, -2:]
    return abs(last).sum(axis=1) * np.diff(edges)


def _unresolved(values: Float[Array, "p n"]) -> float:
    """Largest share of int |g| dt that panels may leave unresolved, in the precision of values."""
    return max(UNRESOLVED, ROUNDINGS * float(jnp.finfo(values.dtype).eps))


def _quality(edges: np.ndarray, values: Float[Array, "p n"]) -> tuple[Array, Array, Array]:
    """int |g| dt, the part of it that panels do not resolve, and |g(horizon)| times the horizon."""
    order = values.shape[1]
    weights = 0.5 * np.diff(edges)[:, None] * np.polynomial.legendre.leggauss(order)[1]
    late = _times(edges, order) > LATE * edges[-1]
    at_end = (abs(values) * late).max() * edges[-1]
    return (abs(values) * weights).sum(), _tails(edges, values).sum(), at_end


def _refuse_unresolved(total: Array, unresolved: Array, at_end: Array) -> None:
    """Raise `InputError` for concrete numbers of `_quality` that make a kernel wrong."""
    if not jnp.isfinite(total):
        raise InputError("kernel: g is not finite at a time between 0 and the horizon")
    if unresolved > total:
        raise InputError(
            f"kernel: {MOST_PANELS} panels do not resolve g; lower the horizon, or name the times"
            " of jumps in breaks="
        )
    if at_end > NEGLECTED * total:
        raise InputError(
            f"kernel: |g| near the horizon times the horizon is {at_end / total:.2g} of"
            f" int |g| dt, more than {NEGLECTED:g}; raise the horizon, or name it in breaks= if g"
            " is 0 beyond it"
        )


def _legendre_moments(z: Complex[Array, " p"], order: int) -> Complex[Array, "p n"]:
    """int_-1^1 P_n(x) exp(-z (x + 1)) dx for n < order and Re z >= 0: spherical Bessel functions.

    Below about |z| = order by Gauss quadrature, exact to rounding. Above by the recurrence
    M_{n+1} = M_{n-1} + (2 n + 1)/z M_n, which is stable only there.
    """
    switch = max(2.0, 0.75 * order)
    small = jnp.abs(z) < switch
    x, w = np.polynomial.legendre.leggauss(order + 24)
    weights = w[:, None] * np.polynomial.legendre.legvander(x, order - 1)
    near = jnp.exp(-jnp.where(small, z, 0.0)[:, None] * (x + 1)) @ weights
    far = jnp.where(small, switch, z)
    decayed = jnp.exp(-2 * far)
    first = (1 - decayed) / far

    def step(last: tuple[Array, Array], n: Array) -> tuple[tuple[Array, Array], Array]:
        return (last[1], last[0] + (2 * n + 1) / far * last[1]), last[0]

    # a scan compiles three times faster than `order` expressions
    start = first, (first - (1 + decayed)) / far
    _, found = jax.lax.scan(step, start, jnp.arange(1, order + 1))
    return jnp.where(small[:, None], near, found.T)


def kernel_total(kernel: AbstractKernel) -> Float[Array, ""]:
    """int_0^inf g dt = G(0), the instantaneous minus the steady slope of friction with velocity."""
    zero = jnp.zeros(()) * 1j
    return kernel.transform(zero).real
