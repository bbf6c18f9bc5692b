"""The memory of friction about a steady velocity: kernels g(t) and their transforms G(s).

    f(t) = f_ss + f_v V(t) - int_0^t g(t - tau) V(tau) dtau                        (8)
    F(s) = f_v - G(s),   G(s) = int_0^inf g(t) exp(-s t) dt                        (12)

V is the perturbation of velocity. Stability needs nothing else of a friction law. A kernel has the
unit force/m, its transform force s/m, like f_v. A rational kernel (every law with states) is a
ratio of polynomials; a `SampledKernel` is a table, exact between its nodes; a delay is an impulse.
"""

import abc
from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Complex, Float

from ..errors import InputError
from ..quantity import quantity
from . import polynomial as poly
from .moments import legendre_moments


class AbstractKernel(eqx.Module):
    """A memory kernel. `transform` and `rate` are all that the generic theorem asks for."""

    @abc.abstractmethod
    def transform(self, s: Complex[Array, ""]) -> Complex[Array, ""]:
        """G(s), for Re s >= 0."""

    @abc.abstractmethod
    def frequencies(self) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Lowest and highest angular frequency between which G changes [rad/s]."""


class AbstractRationalKernel(AbstractKernel):
    """A kernel with G = N/D."""

    @abc.abstractmethod
    def fraction(self) -> tuple[Float[Array, " n"], Float[Array, " n+1"]]:
        """Ascending coefficients of N (degree n - 1) and of the monic D (degree n)."""


class StateSpaceKernel(AbstractRationalKernel):
    """g(t) = c exp(a t) b and G(s) = c (s - a)^-1 b: what any law with states gives.

    Parameters
    ----------
    a : (n, n) matrix [1/s], b : (n,) [force/m], c : (n,).
    """

    a: Float[Array, "n n"] = eqx.field(converter=jnp.asarray)
    b: Float[Array, " n"] = eqx.field(converter=jnp.asarray)
    c: Float[Array, " n"] = eqx.field(converter=jnp.asarray)

    def fraction(self):
        # Faddeev and LeVerrier: the adjoint of (s - a) and its determinant, power by power
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


class ExponentialKernel(AbstractRationalKernel):
    """g(t) = sum_i g_i exp(-r_i t), G(s) = sum_i g_i/(s + r_i).   (22)-(23) for one term.

    Parameters
    ----------
    amplitude : g_i [force/m], shape (n,).
    rate : r_i > 0 [1/s], shape (n,).
    """

    amplitude: Float[Array, " n"] = quantity("g", "F/m", "amplitudes of the memory kernel")
    rate: Float[Array, " n"] = quantity("r", "1/s", "rates of the memory kernel", lower=0.0)

    def fraction(self):
        n = self.rate.shape[0]
        factors = [jnp.stack([self.rate[i], jnp.ones_like(self.rate[i])]) for i in range(n)]

        def times(skip: int | None):
            chosen = [factors[i] for i in range(n) if i != skip]
            result = jnp.ones((1,))
            for factor in chosen:
                result = poly.product(result, factor)
            return result

        terms = [self.amplitude[i] * times(i) for i in range(n)]
        return (poly.total(*terms) if n else jnp.zeros((1,))), times(None)

    def transform(self, s: Complex[Array, ""]):
        return jnp.sum(self.amplitude / (s + self.rate))

    def frequencies(self):
        return jnp.min(self.rate), jnp.max(self.rate)


class DelayKernel(AbstractKernel):
    """g(t) = k_f delta(t - alpha), G(s) = k_f exp(-alpha s).   (28)-(29)

    G does not vanish at infinity, so the theorem does not hold: see `stability.delay`.
    """

    strength: Float[Array, ""] = quantity("k_f", "F s/m", "fall of steady friction with velocity")
    delay: Float[Array, ""] = quantity("alpha", "s", "delay", lower=0.0)

    def transform(self, s: Complex[Array, ""]):
        return self.strength * jnp.exp(-self.delay * s)

    def frequencies(self):
        return 1e-2 / self.delay, 1e2 / self.delay


class SampledKernel(AbstractKernel):
    """A kernel known on panels as sums of Legendre polynomials; zero beyond the last edge.

    Its transform is exact for the panels at every frequency (Filon's idea: the oscillating
    factor is integrated, not sampled). Make one with `from_function` or `from_samples`.
    """

    edges: Float[Array, " p+1"]
    """Ends of the panels [s], ascending."""
    coefficients: Float[Array, "p n"]
    """Legendre coefficients of g on every panel [force/m]."""

    @staticmethod
    def from_function(
        g: Callable[[Float[Array, ""]], Float[Array, ""]],
        horizon: float,
        *,
        panels: int = 32,
        order: int = 16,
        breaks: Sequence[float] = (),
    ) -> "SampledKernel":
        """A kernel from a callable g(t), t in seconds, taken as zero beyond `horizon`.

        Panels grow geometrically over five decades up to the horizon, with `order` Gauss points
        each; `breaks` are the times at which g jumps. Choose a horizon after which g has died
        out (exp(-36) is 2e-16). `resolution_error` tells whether panels and order suffice.
        """
        if not horizon > 0:
            raise InputError(f"kernel: the horizon is {horizon:g} s; it must be positive")
        inner = np.geomspace(1e-5 * horizon, horizon, panels)
        inside = np.asarray(breaks, float)
        edges = np.unique(np.concatenate([[0.0], inner, inside[inside < horizon]]))
        x, w = np.polynomial.legendre.leggauss(order)
        middle, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
        times = jnp.asarray(middle[:, None] + half[:, None] * x)
        values = jax.vmap(jax.vmap(g))(times)
        basis = np.polynomial.legendre.legvander(x, order - 1)
        weights = w[:, None] * basis * (np.arange(order) + 0.5)
        return SampledKernel(jnp.asarray(edges), values @ jnp.asarray(weights))

    @staticmethod
    def from_samples(times: ArrayLike, values: ArrayLike) -> "SampledKernel":
        """A kernel from measured values of g [force/m] at times [s], with straight lines between.

        The first time may be later than zero; g is then taken to be constant before it.
        """
        t, g = np.asarray(times, float), np.asarray(values, float)
        if t.ndim != 1 or t.shape != g.shape or t.size < 2:
            raise InputError(
                f"kernel: times of shape {t.shape} and values of shape {g.shape};"
                " give two rows of one length, two samples or more"
            )
        if not (np.all(np.isfinite(t)) and np.all(np.isfinite(g))):
            raise InputError("kernel: a time or a value is not a finite number")
        if t[0] < 0 or np.any(np.diff(t) <= 0):
            raise InputError("kernel: times must be positive and ascending")
        if t[0] > 0:
            t, g = np.insert(t, 0, 0.0), np.insert(g, 0, g[0])
        mean, half = 0.5 * (g[1:] + g[:-1]), 0.5 * np.diff(g)
        return SampledKernel(jnp.asarray(t), jnp.asarray(np.stack([mean, half], axis=1)))

    def transform(self, s: Complex[Array, ""]):
        half = 0.5 * jnp.diff(self.edges)
        moments = legendre_moments(s * half, self.coefficients.shape[1])
        panels = half * jnp.sum(self.coefficients * moments, axis=1)
        return jnp.sum(panels * jnp.exp(-s * self.edges[:-1]))

    def frequencies(self):
        return 0.1 / self.edges[-1], 10 / jnp.min(jnp.diff(self.edges))

    def resolution_error(self) -> Float[Array, ""]:
        """Largest last coefficient of a panel over the largest first: about the error of g."""
        last = jnp.max(jnp.abs(self.coefficients[:, -2:]))
        return last / jnp.max(jnp.abs(self.coefficients[:, 0]))


def kernel_total(kernel: AbstractKernel) -> Float[Array, ""]:
    """int_0^inf g dt = G(0): what steady friction falls short of the instantaneous response."""
    zero = jnp.zeros(()) * 1j
    return kernel.transform(zero).real
